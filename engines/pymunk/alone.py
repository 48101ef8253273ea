"""Chipmunk by itself: elements that its documentation offers, its own step from start to end.

A body is a `Body` with its mass and its moment about its centre of mass; bodies that are welded
together are one. Then

- a pin is a PivotJoint, a slot a GrooveJoint, an angle that a joint holds a GearJoint, and so is a
  coupler of two angles;
- a stop on an angle is a RotaryLimitJoint, one on a point a Circle that collides with a Segment,
  whose elasticity is its restitution. Both stay in the space for the whole run;
- springs are DampedSprings and DampedRotarySprings with their damping, one with a cubic term by its
  `torque_func`; one along a slide is a DampedSpring to a point far away on the slide's line;
- constant and recorded forces and torques are given to the bodies before each step;
- a rotor whose angle is that of a body alone is a part of the body's moment.

Chipmunk divides by a body's moment, so a point mass gets one by mass moved along its pin, which
changes no motion (:mod:`..point_masses`). Angles of the mechanism are clockwise, Chipmunk's the
opposite. :func:`script` writes the same run as a program from the space that was built.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pymunk
from pymunk import constraints

from ...models import elements
from ...models.arrays import ComplexArray, FloatArray, as_vectors
from ...models.elements import GROUND, RecordedEffort, efforts_during
from ...models.elements.recorded_effort import ROUNDED
from ...models.errors import SimulationError, UnsupportedProblemError
from ...models.kinematics import Kinematics, initial_state
from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw
from .. import study
from ..events import ContactEvents, note_own_releases, whole_steps
from ..point_masses import NoPointMasses, shared_inertia
from ..protocol import Recording
from ..reading import read_each_step, timed_reading
from ..rotors import rotors_of
from .bodies import Assembly, LumpedMass, gear_of, placed_part, without_welds
from .leapfrog import Stepper
from .options import ERROR_BIAS, PymunkOptions
from .read import MotionReading, forces_of, reading_of

_LEAST_INERTIA = 0.1
"""Of a point mass about its centre of mass, as a part of m d^2, d the distance of its pin."""
_LENGTH = 1000.0  # [m] from the middle of a groove or wall to its ends
_THICKNESS = 10.0  # [m] of a wall: what goes through it in one step is not stopped
_MOST_WALLS = 32  # categories of shapes that Chipmunk tells apart
_LIMITS_SETTLE = 2  # steps: the first one only brings a limit's error about


@dataclass(frozen=True)
class CubicTorque:
    """Torque function of a spring with a cubic term."""

    stiffness: float  # [N m/rad]
    cubic_stiffness: float  # [N m/rad^3]
    rest_angle: float  # [rad]

    def __call__(self, spring: constraints.DampedRotarySpring, angle: float) -> float:
        """The torque at a relative angle [N m]."""
        turned = angle - self.rest_angle
        return self.stiffness * turned + self.cubic_stiffness * turned**3


def spring_torque(spring: constraints.DampedRotarySpring, angle: float) -> float:
    """Torque of a spring without its damping at a relative angle [N m]."""
    if isinstance(spring.torque_func, CubicTorque):
        return spring.torque_func(spring, angle)
    # pymunk's own function takes no spring of the class that its annotation states.
    return spring.stiffness * (angle - spring.rest_angle)


@dataclass(frozen=True)
class PointForce:
    """A constant force on a body's point, given before each step."""

    body: str
    point: tuple[float, float]  # from the centre of mass, in the body's frame [m]
    force: tuple[float, float]  # [N]


@dataclass(frozen=True)
class BodyTorque:
    """A constant torque on a body, given before each step."""

    body: str
    torque: float  # counter-clockwise [N m]


@dataclass(frozen=True)
class RecordedTwist:
    """A share of a recorded torque on a body, given before each step."""

    body: str
    record: int  # number of the record
    share: float  # 1.0 or -1.0, counter-clockwise


@dataclass(frozen=True)
class SlidePush:
    """A force on a body's point along an axis of another one, given before each step.

    The other one, or the ground, gets the opposite at the same place.
    """

    body: str
    point: tuple[float, float]  # from the centre of mass, in the body's frame [m]
    base: str
    axis: tuple[float, float]  # in the base's frame
    constant: float = 0.0  # [N]
    record: int | None = None  # number of the record that it follows; None: it is constant

    def force(self, efforts: Sequence[float]) -> float:
        """The force with the efforts of the records in a step [N]."""
        return self.constant if self.record is None else efforts[self.record]


Load = PointForce | BodyTorque | RecordedTwist | SlidePush


@dataclass(frozen=True)
class StopShapes:
    """Shapes of a stop on a point, which collide with each other."""

    body: pymunk.Body
    circle: pymunk.Circle  # around the point of the body, without radius
    base: pymunk.Body
    segment: pymunk.Segment  # of the body, or the ground, with the wall


@dataclass
class DocumentedSpace:
    """A space of Chipmunk's documented elements, and what it does not hold itself."""

    assembly: Assembly
    limits: dict[str, constraints.RotaryLimitJoint] = field(
        default_factory=dict[str, constraints.RotaryLimitJoint]
    )
    walls: dict[str, StopShapes] = field(default_factory=dict[str, StopShapes])
    loads: list[Load] = field(default_factory=list[Load])
    records: list[RecordedEffort] = field(default_factory=list[RecordedEffort])

    def push(self, efforts: Sequence[float]) -> None:
        """Give the bodies their forces and torques for the next step.

        Args:
            efforts: of the records in that step [N m or N].
        """
        for load in self.loads:
            body = self.assembly.parts[load.body].body
            match load:
                case PointForce():
                    body.apply_force_at_world_point(load.force, body.local_to_world(load.point))
                case BodyTorque():
                    body.torque += load.torque
                case RecordedTwist():
                    body.torque += load.share * efforts[load.record]
                case SlidePush():
                    at = body.local_to_world(load.point)
                    base, _ = self.assembly.end(load.base, 0j)
                    force = load.force(efforts) * pymunk.Vec2d(*load.axis).rotated(base.angle)
                    body.apply_force_at_world_point(force, at)
                    if load.base != GROUND:
                        base.apply_force_at_world_point(-force, at)

    def impulses(self) -> dict[str, float]:
        """Impulse of each stop in the last step [N m s or N s]."""
        impulses = {name: limit.impulse for name, limit in self.limits.items()}
        for name, wall in self.walls.items():
            felt: list[float] = []
            wall.body.each_arbiter(_feel, wall.circle, felt)
            impulses[name] = math.fsum(felt)
        return impulses


def _feel(arbiter: pymunk.Arbiter, circle: pymunk.Circle, felt: list[float]) -> None:
    """Note the impulse of a collision in the last step, if it is one of the circle [N s]."""
    if circle in arbiter.shapes:
        felt.append(arbiter.total_impulse.length)


def build(mechanism: Mechanism, options: PymunkOptions) -> DocumentedSpace:
    """The mechanism in its start position and with its start speeds.

    Raises:
        UnsupportedProblemError: it has a part that the adapter builds no element of Chipmunk's for.
    """
    rigid, placements = without_welds(mechanism)
    space = pymunk.Space()
    space.gravity = mechanism.gravity_vector
    space.iterations = options.iterations
    if options.collision_slop is not None:
        space.collision_slop = options.collision_slop
    if options.collision_bias is not None:
        space.collision_bias = options.collision_bias
    made = DocumentedSpace(Assembly(space, mechanism, rigid, placements))
    kinematics, state = Kinematics(rigid), initial_state(rigid)
    massive = NoPointMasses(shared_inertia(rigid), _LEAST_INERTIA)
    for name in massive.added:
        raise UnsupportedProblemError(
            f"our adapter gives a point mass the moment that pymunk's bodies need by mass moved "
            f"along its pin; {name!r} has no pin that it could be moved along."
        )
    for body in massive.mechanism.bodies:
        mass = LumpedMass(body.mass, complex(*body.centre), body.inertia)
        part = placed_part(kinematics, state, body.name, mass)
        part.body.angle += 0.0  # so that a program has no -0.0
        part.body.angular_velocity += 0.0
        made.assembly.parts[body.name] = part
        space.add(part.body)
    for name, inertia in rotors_of(rigid, "pymunk").items():
        made.assembly.parts[name].body.moment += inertia
    builder = _Builder(made, options)
    for joint in rigid.joints:
        JOINT_BUILDERS[joint](builder, joint)
    for coupler in rigid.couplers:
        COUPLER_BUILDERS[coupler](builder, coupler)
    for stop in rigid.stops:
        add_stop = STOP_BUILDERS[stop]
        if stop.body != stop.relative_to:  # else within one rigid body
            add_stop(builder, stop)
    for element in rigid.force_elements:
        add_force = FORCE_BUILDERS[element]
        if len(set(element.bodies)) == len(element.bodies):  # else within one rigid body
            add_force(builder, element)
    return made


def _first(value: float | None, otherwise: float) -> float:
    return otherwise if value is None else value


def _has_slot_in_loops(mechanism: Mechanism) -> bool:
    """Tell whether a mechanism with loops has joints along a line, and no body two of them."""
    lines = [joint for joint in mechanism.joints if len(joint.free_directions) == 1]
    ends = [end for joint in lines for end in (joint.parent, joint.child) if end != GROUND]
    return bool(mechanism.loop_joints and lines) and len(ends) == len(set(ends))


class _Builder:
    """Adds joints, stops and force elements to a space that has its bodies."""

    def __init__(self, made: DocumentedSpace, options: PymunkOptions) -> None:
        self.made, self.assembly, self.options = made, made.assembly, options
        self.space = made.assembly.space
        self.error_bias = options.error_bias
        self.groove_error_bias = _first(options.groove_error_bias, options.error_bias)
        if _has_slot_in_loops(made.assembly.rigid):
            self.error_bias = _first(options.slot_pin_error_bias, self.error_bias)
            self.groove_error_bias = _first(options.slot_error_bias, self.groove_error_bias)
        self.limit_error_bias = _first(options.limit_error_bias, options.error_bias)

    def add(self, joint: constraints.Constraint, error_bias: float | None = None) -> None:
        joint.error_bias = _first(error_bias, self.error_bias)
        self.space.add(joint)

    def bodies(self, element: Any) -> tuple[pymunk.Body, pymunk.Body]:
        """Chipmunk's bodies of an element's other body, or the ground, and of its body."""
        b, a = (self.assembly.end(name, 0j)[0] for name in element.bodies)
        return a, b

    # --- Joints

    def add_nothing(self, joint: elements.FreeJoint) -> None:
        """Add no constraint."""

    def add_pivot(self, joint: elements.PinJoint | elements.WeldJoint) -> None:
        """Add a pivot, and a gear for a weld that closes a loop."""
        a, anchor_a = self.assembly.end(joint.parent, complex(*joint.parent_point))
        b, anchor_b = self.assembly.end(joint.child, complex(*joint.child_point))
        self.add(constraints.PivotJoint(a, b, anchor_a, anchor_b))
        self.hold_angle(joint)

    def add_groove(self, joint: elements.SlotJoint | elements.PrismaticJoint) -> None:
        """Add a groove along the joint's line, and a gear for a slider."""
        origin, along = complex(*joint.parent_point), _LENGTH * complex(*joint.axis)
        a, start = self.assembly.end(joint.parent, origin - along)
        _, end = self.assembly.end(joint.parent, origin + along)
        b, anchor = self.assembly.end(joint.child, complex(*joint.child_point))
        groove = constraints.GrooveJoint(a, b, start, end, anchor)
        self.add(groove, self.groove_error_bias)
        self.hold_angle(joint)

    def hold_angle(self, joint: elements.AnyJoint) -> None:
        """Add a gear for an angle that a joint holds."""
        if joint.turned_by is not None:
            (a, _), (b, _) = (self.assembly.end(name, 0j) for name in (joint.parent, joint.child))
            turns = round((b.angle - a.angle + joint.turned_by) / (2 * math.pi))
            phase = 2 * math.pi * turns - joint.turned_by
            self.add(constraints.GearJoint(a, b, phase, 1.0))

    def add_coupler(self, coupler: elements.Coupler) -> None:
        """Add a gear."""
        self.add(gear_of(coupler, self.assembly))

    # --- Stops

    def add_limit(self, stop: elements.Stop) -> None:
        """Add a limit of the angle that the body has from the other one."""
        a, b = self.bodies(stop)
        # Counter-clockwise angles: the gap of sense 1 is -(b - a) - limit.
        least, most = (stop.limit, math.inf) if stop.sense < 0 else (-math.inf, -stop.limit)
        limit = constraints.RotaryLimitJoint(a, b, least, most)
        self.add(limit, self.limit_error_bias)
        self.made.limits[stop.name] = limit

    def add_wall(self, stop: elements.PointStop) -> None:
        """Add a circle without radius and a thick segment, which collide with each other only."""
        index = len(self.made.walls)
        if index >= _MOST_WALLS:
            raise UnsupportedProblemError(
                f"our adapter builds at most {_MOST_WALLS} stops on points for pymunk; "
                f"{stop.name!r} is one more."
            )
        normal = complex(*stop.normal)
        middle = (stop.offset - _THICKNESS / 2) * normal
        base, start = self.assembly.end(stop.relative_to, middle - 1j * _LENGTH * normal)
        _, end = self.assembly.end(stop.relative_to, middle + 1j * _LENGTH * normal)
        body, point = self.assembly.end(stop.body, complex(*stop.point))
        circle = pymunk.Circle(body, 0.0, point)
        segment = pymunk.Segment(base, start, end, _THICKNESS / 2)
        circle.filter = segment.filter = pymunk.ShapeFilter(categories=1 << index, mask=1 << index)
        circle.elasticity, segment.elasticity = stop.restitution, 1.0
        self.space.add(circle, segment)
        self.made.walls[stop.name] = StopShapes(body, circle, base, segment)

    # --- Force elements

    def add_spring(self, element: elements.SpringDamper) -> None:
        """Add a spring with its damping."""
        a, anchor_a = self.assembly.end(element.relative_to, complex(*element.relative_point))
        b, anchor_b = self.assembly.end(element.body, complex(*element.point))
        law = element.rest_length, element.stiffness, element.damping
        self.space.add(constraints.DampedSpring(a, b, anchor_a, anchor_b, *law))

    def add_rotary_spring(self, element: elements.RotationalSpringDamper) -> None:
        """Add a spring with its damping: Chipmunk's angle of a less that of b is clockwise."""
        law = element.rest_angle, element.stiffness, element.damping
        self.space.add(constraints.DampedRotarySpring(*self.bodies(element), *law))

    def add_cubic_spring(self, element: elements.CubicTorsionSpring) -> None:
        """Add a spring with a torque function of its own."""
        spring = constraints.DampedRotarySpring(
            *self.bodies(element), element.rest_angle, element.stiffness, 0.0
        )
        spring.torque_func = CubicTorque(
            element.stiffness, element.cubic_stiffness, element.rest_angle
        )
        self.space.add(spring)

    def add_force(self, element: elements.ConstantForce) -> None:
        """Add a load."""
        if element.body != GROUND:
            _, point = self.assembly.end(element.body, complex(*element.point))
            self.made.loads.append(PointForce(element.body, point, element.force))

    def add_torque(self, element: elements.ConstantTorque) -> None:
        """Add a load on each of the bodies."""
        for name, torque in zip(element.bodies, (-element.torque, element.torque), strict=True):
            if name != GROUND:
                self.made.loads.append(BodyTorque(name, torque))

    def add_recorded_torque(self, element: elements.RecordedTorque) -> None:
        """Add a record, and a load on each of the bodies."""
        for name, share in zip(element.bodies, (-1.0, 1.0), strict=True):
            if name != GROUND:
                self.made.loads.append(RecordedTwist(name, len(self.made.records), share))
        self.made.records.append(element)

    def add_recorded_force(self, element: elements.RecordedForce) -> None:
        """Add a record, and a load on the body and the one that it slides on."""
        self.push_along(element.slide, record=len(self.made.records))
        self.made.records.append(element)

    def add_slide_spring(self, element: elements.SlideSpringDamper) -> None:
        """Add a spring to a point of the slide's line that is far away, and a constant force."""
        slide = self.assembly.rigid.slide(element.slide)
        joint = slide.joint
        if element.stiffness or element.damping:
            if len(joint.free_directions) > 1:
                raise UnsupportedProblemError(
                    f"our adapter builds springs along slides as pymunk's DampedSprings, which act "
                    f"between points; {element.name!r} acts on {joint.child!r}, which moves across "
                    "the slide as well."
                )
            start = element.rest_position - _LENGTH
            far = complex(*joint.parent_point) + start * slide.direction
            a, anchor_a = self.assembly.end(joint.parent, far)
            b, anchor_b = self.assembly.end(joint.child, complex(*joint.child_point))
            law = _LENGTH, element.stiffness, element.damping
            self.space.add(constraints.DampedSpring(a, b, anchor_a, anchor_b, *law))
        if element.force:
            self.push_along(element.slide, element.force)

    def push_along(self, coordinate: str, constant: float = 0.0, record: int | None = None) -> None:
        slide = self.assembly.rigid.slide(coordinate)
        joint, axis = slide.joint, (slide.direction.real, slide.direction.imag)
        _, point = self.assembly.end(joint.child, complex(*joint.child_point))
        load = SlidePush(joint.child, point, joint.parent, axis, constant, record)
        self.made.loads.append(load)

    def add_rotor(self, element: elements.RotorInertia) -> None:
        """Add nothing: the bodies' moments have it."""


JOINT_BUILDERS: elements.ElementTable[Callable[[_Builder, Any], None]] = elements.ElementTable(
    "pymunk by itself",
    elements.JOINTS,
    {
        elements.PinJoint: _Builder.add_pivot,
        elements.WeldJoint: _Builder.add_pivot,
        elements.SlotJoint: _Builder.add_groove,
        elements.PrismaticJoint: _Builder.add_groove,
        elements.FreeJoint: _Builder.add_nothing,
        elements.TranslationJoint: _Builder.hold_angle,
    },
)
COUPLER_BUILDERS: elements.ElementTable[Callable[[_Builder, Any], None]] = elements.ElementTable(
    "pymunk by itself", elements.COUPLERS, {elements.Coupler: _Builder.add_coupler}
)
STOP_BUILDERS: elements.ElementTable[Callable[[_Builder, Any], None]] = elements.ElementTable(
    "pymunk by itself",
    elements.STOPS,
    {elements.Stop: _Builder.add_limit, elements.PointStop: _Builder.add_wall},
)
FORCE_BUILDERS: elements.ElementTable[Callable[[_Builder, Any], None]] = elements.ElementTable(
    "pymunk by itself",
    elements.FORCE_ELEMENTS,
    {
        elements.SpringDamper: _Builder.add_spring,
        elements.RotationalSpringDamper: _Builder.add_rotary_spring,
        elements.CubicTorsionSpring: _Builder.add_cubic_spring,
        elements.ConstantForce: _Builder.add_force,
        elements.ConstantTorque: _Builder.add_torque,
        elements.RecordedTorque: _Builder.add_recorded_torque,
        elements.RecordedForce: _Builder.add_recorded_force,
        elements.SlideSpringDamper: _Builder.add_slide_spring,
        elements.RotorInertia: _Builder.add_rotor,
    },
    {elements.SlideInertia: "our adapter adds no inertia along slides"},
)


# --- A run


def space_of(problem: Problem, options: PymunkOptions) -> DocumentedSpace:
    """The space of a problem's run.

    Raises:
        UnsupportedProblemError: the mechanism has a part that the adapter builds no element of
            Chipmunk's for, or a stop on an angle rebounds.
    """
    if problem.stop_law is StopLaw.UNILATERAL:
        for stop in problem.mechanism.angle_stops:
            if stop.restitution:
                raise UnsupportedProblemError(
                    f"our adapter builds stops on angles as pymunk's RotaryLimitJoints, which have "
                    f"no restitution; {stop.name!r} has {stop.restitution!r}."
                )
    return build(problem.mechanism, options)


def run_alone(problem: Problem, options: PymunkOptions) -> Recording:
    """Step Chipmunk from the start to a problem's end or just beyond, and read the bodies.

    Raises:
        SimulationError: impulses diverged, or a point left the end of its groove or wall.
        UnsupportedProblemError: the mechanism has a part that has no counterpart here.
    """
    made, h = space_of(problem, options), options.timestep
    steps = whole_steps(problem.duration, h)
    stepper = Stepper(made.assembly, h, hold_lengths=False, steps=steps)
    stepper.start(options.start_iterations, leapfrog=False)
    torques = {stop.name: np.zeros(steps + 1) for stop in problem.mechanism.stops}
    times: FloatArray = h * np.arange(steps + 1, dtype=np.float64)
    efforts = efforts_during(made.records, times, h).tolist()

    @read_each_step
    def read_impulses() -> None:
        for name, impulse in made.impulses().items():
            torques[name][stepper.steps] = impulse / h

    def after_step() -> None:
        read_impulses()
        made.push(efforts[stepper.steps])

    made.push(efforts[0])
    stepper.run(1, options.start_iterations, after_step)
    stepper.run(steps - 1, options.iterations, after_step)
    with timed_reading():
        return _recording(problem, made, stepper, times, torques)


def _recording(
    problem: Problem,
    made: DocumentedSpace,
    stepper: Stepper,
    times: FloatArray,
    torques: dict[str, FloatArray],
) -> Recording:
    """Read the bodies at the times [s] of all steps."""
    # A sample's forces are those of the step that ends there, the first sample's of the first step.
    begun = times[np.maximum(np.arange(len(times)) - 1, 0)] + ROUNDED * stepper.h
    motion = MotionReading(made.assembly, stepper.samples(0), acting=begun)
    q, u, _ = motion.motion
    lost = np.flatnonzero(~np.isfinite(np.hstack([q, u])).all(axis=1))
    if len(lost):
        raise SimulationError(
            f"pymunk diverged: its state is not finite at t = {times[lost[0]]:.6g} s."
        )
    _refuse_ends(motion)
    events = ContactEvents(problem.mechanism, "pymunk")
    note_own_releases(events, times, torques, settled=_LIMITS_SETTLE)
    kinetic, potential = motion.energies()
    return Recording(
        t=times,
        q=q,
        u=u,
        markers=motion.markers(),
        kinetic_energy=kinetic,
        potential_energy=potential,
        stop_torques=torques,
        release_times=events.releases,
        joint_reactions=_reactions(motion, torques),
        joint_gaps=motion.gaps(),
        steps=stepper.steps,
    )


def _reactions(reading: MotionReading, torques: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """Force of each joint on its child [N], read off the motion with the stops that push."""
    n = len(reading.motion[0])
    pushing = np.array([torque > 0 for torque in torques.values()]).reshape(-1, n)
    reactions: dict[str, ComplexArray] = {
        joint.name: np.zeros(n, dtype=np.complex128) for joint in reading.mechanism.joints
    }
    sets, of_sample = np.unique(pushing, axis=1, return_inverse=True)
    for k, active in enumerate(sets.T):
        names = tuple(name for name, pushes in zip(torques, active, strict=True) if pushes)
        forces, _ = forces_of(reading, names)
        samples = of_sample.ravel() == k
        for name, reaction in reactions.items():
            reaction[samples] = forces[name][samples]
    return {name: as_vectors(reaction) for name, reaction in reactions.items()}


def _refuse_ends(reading: MotionReading) -> None:
    """Raise SimulationError where a point has come to the end of its groove or wall."""
    lines: list[tuple[str, str, complex, ComplexArray]] = []
    for joint in reading.mechanism.joints:
        if len(joint.free_directions) == 1:
            (axis,) = joint.free_directions
            lines.append((joint.name, joint.parent, axis, reading.between(joint)))
    for stop in reading.mechanism.point_stops:
        origin = reading.point(stop.relative_to, (0.0, 0.0))
        between = reading.point(stop.body, stop.point) - origin
        lines.append((stop.name, stop.relative_to, 1j * complex(*stop.normal), between))
    for name, body, axis, between in lines:
        along, _, _ = reading.frames[body].component(axis, between)
        if np.abs(along).max() >= _LENGTH:
            raise SimulationError(
                f"pymunk came to the end of {name!r}: our adapter makes grooves and walls "
                f"{_LENGTH:g} m long to either side."
            )


# --- The same run as a program

_ARGUMENTS: dict[type[constraints.Constraint], tuple[str, ...]] = {
    constraints.PivotJoint: ("anchor_a", "anchor_b"),
    constraints.GrooveJoint: ("groove_a", "groove_b", "anchor_b"),
    constraints.GearJoint: ("phase", "ratio"),
    constraints.RotaryLimitJoint: ("min", "max"),
    constraints.DampedSpring: ("anchor_a", "anchor_b", "rest_length", "stiffness", "damping"),
    constraints.DampedRotarySpring: ("rest_angle", "stiffness", "damping"),
}
"""Arguments of the constraints' classes after the bodies; they are attributes as well."""


def script(problem: Problem, options: PymunkOptions) -> str:
    """The run of :func:`run_alone` as a program of its own, written from the space that it moves.

    Raises:
        UnsupportedProblemError: the mechanism has a part that has no counterpart here.
    """
    made = space_of(problem, options)
    space, parts = made.assembly.space, made.assembly.parts
    instants = np.array([0.0, *problem.mechanism.instants])
    names = {space.static_body: GROUND, **{part.body: part.name for part in parts.values()}}
    return study.filled_template(
        __name__,
        "alone.py.j2",
        options=options,
        steps=whole_steps(problem.duration, options.timestep),
        space=space,
        own=pymunk.Space(),
        bodies=parts.values(),
        moves_mass=any(body.inertia == 0 for body in made.assembly.rigid.bodies),
        constraints=[_call(joint, names) for joint in space.constraints],
        walls=made.walls.values(),
        names=names,
        loads=made.loads,
        instants=instants.tolist(),
        efforts=efforts_during(made.records, instants, options.timestep).tolist(),
        has_records=bool(made.records),
        angles=[body.name for body in problem.mechanism.bodies if body.angle is not None],
        slides=_slides(made.assembly),
        text=_text,
    )


def _call(
    joint: constraints.Constraint, names: Mapping[pymunk.Body, str]
) -> tuple[str, float | None, CubicTorque | None]:
    """The call of a constraint's constructor, and what is to be set afterwards."""
    arguments = [_text(getattr(joint, name)) for name in _ARGUMENTS[type(joint)]]
    bodies = [f'bodies["{names[body]}"]' for body in (joint.a, joint.b)]
    call = f"pymunk.{type(joint).__name__}({', '.join((*bodies, *arguments))})"
    law = joint.torque_func if isinstance(joint, constraints.DampedRotarySpring) else None
    bias = None if joint.error_bias == ERROR_BIAS else joint.error_bias
    return call, bias, law if isinstance(law, CubicTorque) else None


def _slides(assembly: Assembly) -> list[str]:
    """Arguments of the program's `slide` for each slide coordinate.

    Its two points, each as a body of the space, the arm from that body's centre and the angle at
    which the arm is so; then the line's direction, at the same angle as the first point's arm.
    """
    frames, slides = reading_of(assembly).frames, list[str]()
    for slide in assembly.mechanism.slides:
        joint, points = slide.joint, list[str]()
        for name, local in (
            (joint.parent, joint.parent_point),
            (joint.child, joint.child_point),
        ):
            place = assembly.placements[name]
            arm = complex(complex(*local) - frames[name].reference)
            points.append(f'("{place.carrier}", {arm!r}, {place.angle!r})')
        slides.append(f"{points[0]}, {points[1]}, {complex(slide.direction)!r}")
    return slides


def _text(value: float | tuple[float, ...]) -> str:
    """A number or a tuple of numbers as Python reads it."""
    if isinstance(value, tuple):
        return f"({', '.join(map(_text, value))})"
    return repr(float(value)).replace("inf", 'float("inf")')
