"""pymunk (Chipmunk 2D): impulses on maximal coordinates, steps that are a leapfrog in disguise."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar

from ...models.elements import (
    Coupler,
    CubicTorsionSpring,
    RecordedForce,
    RecordedTorque,
    RotorInertia,
    SlideSpringDamper,
    TranslationJoint,
)
from ...models.features import COVERED_BY_FEATURES
from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw
from ..inspection import Inspection, State
from ..protocol import BuiltinEngine, Capabilities, Recording, built_features
from ..study import EngineStudy
from ..supplied import Assistance, Part, Supplied, has_instants, has_stops
from ..units import scaled_units
from .options import (
    ALONE,
    ERROR_BIAS,
    HALF_IN_A_MILLISECOND,
    ITERATIONS,
    ONLY_WITH,
    PymunkOptions,
)
from .study import STUDY

BUILT: frozenset[type] = COVERED_BY_FEATURES | {
    Coupler,
    CubicTorsionSpring,
    RecordedForce,
    RecordedTorque,
    RotorInertia,
    SlideSpringDamper,
    TranslationJoint,
}
"""Classes that the tables of :mod:`.build` and :mod:`.alone` have a handler for; these need the
library."""


def _of_rods(part: Part, does: str, acts_on: Callable[[Mechanism], bool]) -> Assistance:
    """Something that comes with trebucheck's own representation of a mechanism."""
    return Assistance(
        part, does, "joints", off="documented", depending=ONLY_WITH["rods"], acts_on=acts_on
    )


class PymunkEngine(PymunkOptions, BuiltinEngine):
    """Chipmunk's impulse solver.

    A step moves the bodies with their old velocities and then finds impulses at the new position.
    Read as a leapfrog (positions and forces at t = k h, velocities half a step later) it is of
    second order; read directly it is of first order.

    By itself (:mod:`.alone`) it has the elements of its documentation, and they stay as they are:
    PivotJoints, GrooveJoints and GearJoints; RotaryLimitJoints for stops on angles, which have no
    restitution; circles that collide with segments for stops on points; springs with their damping,
    those along a slide to a point of its line that is far away. Recorded efforts are forces given
    before each step: those of its beginning. Couplers of two angles are GearJoints; rotors whose
    angle is that of one body are a part of its moment.
    A limit has no force in a step that begins without an error, as does every start; a stop is read
    as released at the end of the first step without one. A GrooveJoint takes the component across
    its line of an impulse that would hold the point in both directions, so that a point beside the
    centre of a turning body leaves the line at a share of its speed along it, and only the
    correction of errors brings it back: such an error need not fall with the step, the energy is
    wrong, and two grooves on one body may be unstable.

    With assistance (:mod:`.motion`) massless rods with a mass at their end are point masses on
    PinJoints; a closed stop on an angle is one more PinJoint that braces such a rod, or a GearJoint
    between two bodies that can turn; a point on a line (a slot, a rail, a trough) hangs on a
    PinJoint across it, whose anchor moves along; a stop that releases is removed. Springs are
    Chipmunk's own; its dampers would be of first order, so dampers are forces, as constant ones
    and recorded ones are. At an impact the speeds change by Chipmunk's own impulses, and a new
    leapfrog starts, as it does where a recorded effort changes. The step is shortened a little
    where a whole number of them would not make the time to that or to the end. With lengths held,
    `iterations` is the least number of passes: loops that are rigid or nearly singular get as many
    as they need.

    Raises:
        InputError: an option is unknown, outside its range, or does nothing with these `joints`.
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
    default_options: ClassVar[Mapping[str, object] | None] = {
        **ALONE,
        # A space has no step of its own: that of the example in pymunk's README.
        "timestep": 0.02,
        "iterations": ITERATIONS,
        "start_iterations": ITERATIONS,
        "error_bias": ERROR_BIAS,
    }
    settings_options: ClassVar[Mapping[str, object] | None] = {
        **ALONE,
        "start_iterations": 200,
        # All of a groove's error, undone at once, makes two grooves on one body unstable. Where it
        # is one in a loop, pins are that may not have all of theirs undone: at a singular position
        # of the loop they would throw it with any energy, whatever the step.
        "groove_error_bias": HALF_IN_A_MILLISECOND,
        "slot_error_bias": 0.0,
        "slot_pin_error_bias": HALF_IN_A_MILLISECOND,
        # A limit whose error is undone at once has no force in every second step.
        "limit_error_bias": ERROR_BIAS,
    }
    assistance: ClassVar[tuple[Assistance, ...] | None] = (
        _of_rods(
            Part.MODEL,
            "builds pins, lines and stops as rods, of masses moved along pins",
            lambda _: True,
        ),
        _of_rods(Part.EVENTS, "takes stops out of the model and puts them back", has_stops),
        _of_rods(Part.IMPACTS, "finds impacts inside a step and resolves them there", has_stops),
        _of_rods(
            Part.ELEMENTS,
            "gives dampers, cubic springs, springs on rods or along slides as forces of each step",
            lambda mechanism: bool(mechanism.force_elements),
        ),
        _of_rods(
            Part.SUBSTEPS,
            "shortens the step so that a whole number of them makes the time to the end or from an "
            "impact to it",
            lambda _: True,
        ),
        _of_rods(Part.RESTARTS, "begins anew where a recorded effort changes", has_instants),
        _of_rods(Part.TORQUES, "reads stop forces off the motion", has_stops),
        Assistance(
            Part.START,
            "starts half a step ahead in velocity, and reads velocities between steps",
            "leapfrog",
            off=False,
        ),
        Assistance(
            Part.CORRECTIONS,
            "sets rods shorter in each step, with as many passes as loops need",
            "hold_lengths",
            off=False,
        ),
        Assistance(
            Part.EVENTS,
            "releases a stop where its torque is foreseen to vanish",
            "locate_releases",
            off=False,
            acts_on=has_stops,
        ),
        Assistance(
            Part.MODEL,
            "gives bodies that are pinned to the ground more mass at the pin",
            "pivot_mass",
            off=1.0,
        ),
        scaled_units(),
    )
    readings: ClassVar[Supplied] = {Part.REACTIONS: ""}

    def _run(self, problem: Problem) -> Recording:
        if self.joints == "documented":
            from .alone import run_alone as run  # loads pymunk, which may be missing
        else:
            from .motion import run
        return self.units(problem.mechanism).run(run, problem, self)

    def _script(self, problem: Problem) -> str:
        from .alone import script

        return script(problem, self)

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """Inertia of the built bodies, and accelerations and torques by one step in each state."""
        self.refuse_absence()
        from .inspect import inspect

        return self.units(mechanism).inspect(inspect, mechanism, states, self)
