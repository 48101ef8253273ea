"""pymunk (Chipmunk 2D): impulses on maximal coordinates, steps that are a leapfrog in disguise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

from ...models.elements import CubicTorsionSpring
from ...models.features import COVERED_BY_FEATURES
from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw
from ..inspection import Inspection, State
from ..protocol import BuiltinEngine, Capabilities, Recording, built_features
from ..study import EngineStudy
from ..supplied import Part, Supplied
from ..units import units_of
from .options import PymunkOptions
from .study import STUDY

_LIBRARY_ERROR_BIAS = (1.0 - 0.1) ** 60
BUILT: frozenset[type] = COVERED_BY_FEATURES | {CubicTorsionSpring}
"""Classes that the tables of :mod:`.build` have a handler for; these need the library."""


class PymunkEngine(PymunkOptions, BuiltinEngine):
    """Chipmunk's impulse solver.

    A step moves the bodies with their old velocities and then finds impulses at the new position.
    Read as a leapfrog (positions and forces at t = k h, velocities half a step later) it is of
    second order; read directly it is of first order. Massless rods with a mass at their end are
    point masses on PinJoints; a closed stop on an angle is one more PinJoint that braces such a
    rod, or a GearJoint between two bodies that can turn; a point on a line (a slot, a rail, a
    trough) hangs on a PinJoint across it, whose anchor moves along; a stop that releases is
    removed. Springs are Chipmunk's own; its dampers would be of first order, so dampers are forces,
    as constant ones are. At an impact the speeds change by Chipmunk's own impulses, and a new
    leapfrog starts. The step is shortened a little where a whole number of them would not make the
    duration. With lengths held, `iterations` is the least number of passes: loops that are rigid or
    nearly singular get as many as they need.
    """

    name: ClassVar[str] = "pymunk"
    package: ClassVar[str] = "pymunk"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Capabilities] = Capabilities(
        joint_reactions=True,
        joint_gaps=True,
        located_releases=True,
        stop_laws=frozenset(StopLaw),
        features=built_features(BUILT),
        elements=BUILT,
        formulation="maximal coordinates, velocity-level impulses by Gauss-Seidel, leapfrog "
        "positions",
    )
    # What the library does if nothing is set, and its states read as they come after each step.
    default_options: ClassVar[Mapping[str, object] | None] = {
        "iterations": 10,
        "start_iterations": 10,
        "error_bias": _LIBRARY_ERROR_BIAS,
        "leapfrog": False,
        "hold_lengths": False,
        "locate_releases": False,
        "pivot_mass": 1.0,
    }

    @property
    def supplied(self) -> Supplied:
        """Stops as joints that come and go; forces, of which Chipmunk tells magnitudes alone."""
        elements = "dampers and constant forces"
        return {Part.EVENTS: "", Part.ELEMENTS: elements, Part.REACTIONS: "", Part.TORQUES: ""}

    def _run(self, problem: Problem) -> Recording:
        from .motion import run  # loads pymunk, which may be missing

        return units_of(problem.mechanism).run(run, problem, self)

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """Inertia of the built bodies, and accelerations and torques by one step in each state."""
        self.refuse_absence()
        from .inspect import inspect

        return units_of(mechanism).inspect(inspect, mechanism, states, self)
