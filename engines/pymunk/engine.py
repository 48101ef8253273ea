"""pymunk (Chipmunk 2D): impulses on maximal coordinates, a semi-implicit step that is a leapfrog in disguise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar

from pydantic import Field

from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw
from ...models.spec import Positive, Real
from ..inspection import Inspection, State
from ..protocol import BuiltinEngine, Capabilities, Recording

_LIBRARY_ERROR_BIAS = (1.0 - 0.1) ** 60


class PymunkEngine(BuiltinEngine):
    """Chipmunk's impulse solver.

    A step moves the bodies with their old velocities and then finds impulses at the new place. Read as a leapfrog
    (positions and forces at t = k h, velocities half a step later) it is of second order; read as it comes it is of
    first order. Massless rods with a mass at their end are point masses on PinJoints; a closed stop on an angle is one
    more PinJoint that braces such a rod, or a GearJoint between two bodies that can turn; a point on a line (a slot, a
    trough) hangs on a PinJoint across it, whose foot goes along; a stop that releases is removed. Where a stop is met,
    Chipmunk's own impulses make the impact, and a new leapfrog starts. The step is shortened a little where a whole
    number of them would not make the duration.
    """

    name: ClassVar[str] = "pymunk"
    package: ClassVar[str] = "pymunk"
    capabilities: ClassVar[Capabilities] = Capabilities(
        joint_reactions=True,
        joint_gaps=True,
        located_releases=True,
        stop_laws=frozenset(StopLaw),
        formulation="maximal coordinates, velocity-level impulses by Gauss-Seidel, leapfrog positions",
    )
    # What the library does if nothing is set, and its states read as they come after each step.
    stock_options: ClassVar[Mapping[str, object]] = {
        "iterations": 10,
        "start_iterations": 10,
        "error_bias": _LIBRARY_ERROR_BIAS,
        "leapfrog": False,
        "hold_lengths": False,
        "locate_releases": False,
        "pivot_mass": 1.0,
    }

    iterations: int = Field(default=200, ge=1, le=100_000, description="passes of the impulse solver in a step")
    start_iterations: int = Field(
        default=5_000, ge=1, le=1_000_000, description="passes in the first step, which has no impulses to start from"
    )
    error_bias: Annotated[Real, Field(ge=0, le=1)] = Field(
        default=0.0, description="share of a joint's error left after a second; 0: all of it is undone in a step"
    )
    leapfrog: bool = Field(
        default=True, description="start half a step ahead in velocity, and read velocities at half steps"
    )
    hold_lengths: bool = Field(
        default=True, description="set rods shorter by what the curvature of their motion lengthens them in a step"
    )
    locate_releases: bool = Field(
        default=True, description="release where the torque is foreseen to vanish, not a step after it has"
    )
    pivot_mass: Positive = Field(
        default=1e4, ge=1, le=1e9, description="mass given to a body pinned to the ground, in multiples of its own"
    )

    def _run(self, problem: Problem) -> Recording:
        # Here and not above: a class must tell that its library is missing, not fail to load.
        from .run import record

        return record(problem, self)

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """The built bodies' inertia, and accelerations and torques by one step of theirs in each state."""
        from .inspect import inspect

        return inspect(mechanism, states, self)
