"""A mechanism made of Chipmunk's bodies and constraints.

Bodies that are welded together are one; :mod:`.bodies` says how each body is represented. Joints:

- a pin is a PivotJoint, or two rods (PinJoints) from the pin to two points of the body;
- a point on a line (a slot, a wall) hangs on a rod across the line, whose anchor moves along in the
  frame of the body with the line;
- what holds an angle (a prismatic joint, a weld that closes a loop, a stop) is a GearJoint, and so
  is a coupler of two angles;
- a free joint is nothing, nor is one that leaves a body two slides: it does not turn in Chipmunk
  either.

Rotors that turn with the angle of a body are a part of its moment. Springs are DampedSprings and
DampedRotarySprings without damping: their impulses are those of the force at a step's end position,
as the leapfrog needs it. What has no such element, or none of second order, is a load
(:mod:`.loads`).

Chipmunk's angles are counter-clockwise, the mechanism's clockwise. Local points are complex numbers
a + i b.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Collection
from typing import Any

import pymunk
from pymunk import constraints

from ...models import elements
from ...models.elements import GROUND
from ...models.errors import UnsupportedProblemError
from ...models.kinematics import Kinematics, initial_state
from ...models.mechanism import Mechanism
from ...models.spec import Vector
from .bodies import Assembly, Rod, gear_of, is_brace, parts_of, same_point, without_welds
from .loads import Combination, EngineAngle, RodAngle, SlideLine, Term, pull, slide_force, twist

_SLIDING_LENGTH = 1.0  # [m] length of the rod that keeps a point on a line


def build(
    mechanism: Mechanism, closed: Collection[str], error_bias: float, pivot_mass: float
) -> Assembly:
    """The mechanism in its start position and with its start speeds, the named stops active.

    Raises:
        UnsupportedProblemError: it has a part that has no counterpart here; the sentence names it.
    """
    rigid, placements = without_welds(mechanism)
    space = pymunk.Space()
    space.gravity = mechanism.gravity_vector
    assembly = Assembly(space, mechanism, rigid, placements)
    for part in parts_of(rigid, pivot_mass):
        assembly.parts[part.name] = part
        space.add(part.body)
    builder = _Builder(assembly, error_bias)
    for joint in rigid.tree_joints:
        TREE_JOINT_BUILDERS[joint](builder, joint)
    for joint in rigid.loop_joints:
        LOOP_JOINT_BUILDERS[joint](builder, joint)
    for coupler in rigid.couplers:
        COUPLER_BUILDERS[coupler](builder, coupler)
    for stop in rigid.stops:
        build_stop = STOP_BUILDERS[stop]
        if not stop.closed:
            continue
        active = stop.name in closed
        if stop.body != stop.relative_to:
            # Built in any case, so that a stop that cannot be held is refused at once.
            constraint, rod = build_stop(builder, stop)
            if active:
                builder.add(constraint, rod)
                assembly.stops[stop.name] = constraint
        elif active:  # its gap does not change: while it is open, there is nothing to build
            raise UnsupportedProblemError(
                f"pymunk cannot hold the stop {stop.name!r}: nothing can move against it, so its "
                "force is not determined."
            )
    for element in rigid.force_elements:
        add_force = FORCE_BUILDERS[element]
        if len(set(element.bodies)) == len(element.bodies):  # else within one rigid body
            add_force(builder, element)
    return assembly


class _Builder:
    """Adds joints, stops and force elements to an assembly that has its bodies."""

    def __init__(self, assembly: Assembly, error_bias: float) -> None:
        self.assembly, self.mechanism, self.error_bias = assembly, assembly.rigid, error_bias
        self.kinematics = Kinematics(self.mechanism)
        self.q, _ = initial_state(self.mechanism)

    def add(self, joint: constraints.Constraint, rod: Rod | None = None) -> None:
        joint.error_bias = self.error_bias
        self.assembly.space.add(joint)
        if rod is not None:
            self.assembly.rods.append(rod)

    def add_rod(
        self, parent: str, parent_point: complex, child: str, child_point: complex, length: float
    ) -> None:
        rod = self.rod(parent, parent_point, child, child_point, length)
        self.add(rod.joint, rod)

    def rod(
        self, parent: str, parent_point: complex, child: str, child_point: complex, length: float
    ) -> Rod:
        a, anchor_a = self.assembly.end(parent, parent_point)
        b, anchor_b = self.assembly.end(child, child_point)
        joint = constraints.PinJoint(a, b, anchor_a, anchor_b)
        joint.distance = length
        return Rod(joint, length)

    # --- Joints

    def add_nothing(self, joint: elements.FreeJoint | elements.WeldJoint) -> None:
        """Add no constraint: the body is free, cannot turn here, or is one with its parent."""

    def add_tree_pin(self, joint: elements.PinJoint) -> None:
        """Add a rod to a bob, else a pivot."""
        part, at = self.assembly.parts[joint.child], complex(*joint.parent_point)
        if not part.turns:
            length = abs(part.reference - part.pin)
            self.add_rod(joint.parent, at, part.name, part.reference, length)
        elif joint.parent == GROUND:
            (a, anchor_a), (b, anchor_b) = (
                self.assembly.end(GROUND, at),
                self.assembly.end(part.name, part.pin),
            )
            self.add(constraints.PivotJoint(a, b, anchor_a, anchor_b))
        else:
            self.add_pivot(joint.parent, at, part.name, part.pin)

    def add_pivot(self, still: str, at: complex, turning: str, point: complex) -> None:
        # Two rods from the pin to two points of the body act as a pivot, and their lengths can be
        # corrected.
        for direction in (1, 1j):
            self.add_rod(still, at, turning, point + direction, 1.0)

    def add_loop_pin(self, joint: elements.PinJoint | elements.WeldJoint) -> None:
        """Add a pivot that closes a loop, and what holds a weld's angle."""
        parts = self.assembly.parts
        parent, at = joint.parent, complex(*joint.parent_point)
        child, point = joint.child, complex(*joint.child_point)
        if child == GROUND:
            (parent, at), (child, point) = (child, point), (parent, at)
        if parts[child].turns:
            self.add_pivot(parent, at, child, point)
        elif parent == GROUND:
            for direction in (1, 1j):
                self.add_rod(GROUND, at + direction, child, point, 1.0)
        elif parts[parent].turns:
            self.add_pivot(child, point, parent, at)
        else:
            # Two point masses turn nothing: a pivot between them is linear, and so exact.
            bodies, origin = (parts[parent].body, parts[child].body), (0.0, 0.0)
            self.add(constraints.PivotJoint(*bodies, origin, origin))
        if joint.turned_by is not None:
            self.hold_angle(joint, joint.turned_by)

    def add_slide(self, joint: elements.SlotJoint | elements.PrismaticJoint) -> None:
        """Add a rod across the joint's line, and what holds a slider's angle."""
        line = complex(*joint.parent_point), complex(*joint.axis)
        rod = self.sliding_rod(joint.parent, *line, joint.child, joint.child_point)
        self.add(rod.joint, rod)
        if joint.turned_by is not None:
            self.hold_angle(joint, joint.turned_by)

    def sliding_rod(
        self, line: str, origin: complex, axis: complex, body: str, point: Vector
    ) -> Rod:
        """A rod across a line of a body (or of the ground) that keeps another body's point on it.

        A GrooveJoint on a body that turns about another point is of first order only, however many
        passes it gets; a rod whose anchor moves along the line keeps the second order.
        """
        ends = ((body, point), (line, (origin.real, origin.imag)))
        there, here = (
            complex(*self.kinematics.position(self.kinematics.point(*end), self.q)) for end in ends
        )
        offset = there - here
        offset *= cmath.exp(1j * float(self.kinematics.angle(line).value(self.q)))
        along = (offset * axis.conjugate()).real
        anchor = origin + axis * (along - 1j * _SLIDING_LENGTH)
        rod = self.rod(line, anchor, body, complex(*point), _SLIDING_LENGTH)
        rod.axis = axis
        return rod

    def can_turn(self, name: str) -> bool:
        return name != GROUND and self.assembly.parts[name].body.moment < math.inf

    def hold_angle(self, joint: elements.AnyJoint, turned_by: float) -> None:
        """Keep the angle between two bodies, if one of them can turn."""
        if self.can_turn(joint.parent) or self.can_turn(joint.child):
            gear = self.gear(joint.parent, joint.child)
            gear.phase -= math.remainder(gear.phase + turned_by, 2 * math.pi)
            self.add(gear)

    def gear(self, parent: str, child: str) -> constraints.GearJoint:
        """A joint that keeps the angle that two bodies have between them."""
        (a, _), (b, _) = self.assembly.end(parent, 0j), self.assembly.end(child, 0j)
        return constraints.GearJoint(a, b, b.angle - a.angle, 1.0)

    def add_coupler(self, coupler: elements.Coupler) -> None:
        """Add a gear."""
        self.add(gear_of(coupler, self.assembly))

    # --- Stops

    def point_contact(self, stop: elements.PointStop) -> tuple[constraints.Constraint, Rod]:
        """A rod across the wall."""
        normal = complex(*stop.normal)
        rod = self.sliding_rod(
            stop.relative_to, stop.offset * normal, -1j * normal, stop.body, stop.point
        )
        return rod.joint, rod

    def angle_limit(self, stop: elements.Stop) -> tuple[constraints.Constraint, Rod | None]:
        """A gear between two bodies that turn, or a brace of a bob."""
        ends, parts = (stop.body, stop.relative_to), self.assembly.parts
        bobs = [name for name in ends if name != GROUND and not parts[name].turns]
        if not bobs and any(map(self.can_turn, ends)):
            return self.gear(stop.relative_to, stop.body), None
        if not bobs:
            raise UnsupportedProblemError(
                f"pymunk cannot hold the stop {stop.name!r}: its angle cannot change."
            )
        if len(bobs) > 1 or not is_brace(self.mechanism, stop, bobs[0]):
            raise UnsupportedProblemError(
                f"pymunk cannot hold the stop {stop.name!r}: a point mass on a rod can only be "
                "stopped relative to the body that it is pinned to, which must be able to turn."
            )
        # A rod across the bob's own, as long as that, from the body that the bob is pinned to.
        (bob,) = bobs
        joint, part = self.mechanism.joint_of(bob), parts[bob]
        between = float(self.kinematics.angle(bob, joint.parent).value(self.q))
        along = (part.reference - part.pin) * cmath.exp(-1j * between)
        anchor = complex(*joint.parent_point) + along + 1j * along
        brace = self.rod(joint.parent, anchor, bob, part.reference, abs(along))
        return brace.joint, brace

    # --- Force elements

    def constant_force(self, element: elements.ConstantForce) -> None:
        """Add a load."""
        point, force = self.point(element.body, complex(*element.point)), complex(*element.force)
        self.assembly.loads.append(lambda bodies: point.push(bodies, force))

    def constant_torque(self, element: elements.ConstantTorque) -> None:
        """Add a load."""
        self.add_twist(element, lambda _angle, _speed: element.torque)

    def recorded_torque(self, element: elements.RecordedTorque) -> None:
        """Add a load of the one torque of its record."""
        torque = element.value
        self.add_twist(element, lambda _angle, _speed: torque)

    def recorded_force(self, element: elements.RecordedForce) -> None:
        """Add a load of the one force of its record."""
        force = element.value
        self.add_slide_force(element.slide, lambda _slide, _rate: force)

    def slide_spring(self, element: elements.SlideSpringDamper) -> None:
        """Add a load: Chipmunk's springs act between points, not along a line."""
        stiffness, damping = element.stiffness, element.damping
        rest, constant = element.rest_position, element.force

        def force(slide: float, rate: float) -> float:
            return constant - stiffness * (slide - rest) - damping * rate

        self.add_slide_force(element.slide, force)

    def add_slide_force(self, coordinate: str, force: Callable[[float, float], float]) -> None:
        slide = self.mechanism.slide(coordinate)
        joint = slide.joint
        base = self.assembly.parts.get(joint.parent)  # none: the ground
        origin = self.point(joint.parent, complex(*joint.parent_point))
        line = SlideLine(base and base.body, origin, slide.direction)
        point = self.point(joint.child, complex(*joint.child_point))
        self.assembly.loads.append(slide_force(force, point, line))

    def add_rotor(self, element: elements.RotorInertia) -> None:
        """Add nothing: the bodies' moments have it (:mod:`..rotors`)."""

    def point_spring(self, element: elements.SpringDamper) -> None:
        """Add Chipmunk's spring where it has both points; else, and of the damper, a load."""
        ends = (
            (element.relative_to, complex(*element.relative_point)),
            (element.body, complex(*element.point)),
        )
        stiffness = element.stiffness
        if all(self.is_on_body(*end) for end in ends):
            if stiffness:
                (a, anchor_a), (b, anchor_b) = (self.assembly.end(*end) for end in ends)
                spring = constraints.DampedSpring(
                    a, b, anchor_a, anchor_b, element.rest_length, stiffness, 0.0
                )
                self.assembly.space.add(spring)
            stiffness = 0.0
        if stiffness or element.damping:
            vector = self.point(*ends[1]) - self.point(*ends[0])
            self.assembly.loads.append(pull(element, vector, stiffness))

    def rotational_spring(self, element: elements.RotationalSpringDamper) -> None:
        """Add Chipmunk's spring where it has both angles; else, and of the damper, a load."""
        stiffness, damping, rest = element.stiffness, element.damping, element.rest_angle
        parts = [self.assembly.parts.get(name) for name in element.bodies]
        if all(part is None or part.turns for part in parts):
            (b, _), (a, _) = (self.assembly.end(name, 0j) for name in element.bodies)
            if stiffness and min(a.moment, b.moment) < math.inf:
                # Its angle is that of a less that of b, counter-clockwise: the mechanism's of the
                # body less the other's.
                spring = constraints.DampedRotarySpring(a, b, rest, stiffness, 0.0)
                self.assembly.space.add(spring)
            stiffness = 0.0

        def torque(angle: float, speed: float) -> float:
            return -stiffness * (angle - rest) - damping * speed

        if stiffness or damping:
            self.add_twist(element, torque)

    def cubic_spring(self, element: elements.CubicTorsionSpring) -> None:
        """Add the torque of the angle at the step's end, as Chipmunk's own springs have it."""

        def torque(angle: float, _speed: float) -> float:
            stretch = angle - element.rest_angle
            return -stretch * (element.stiffness + element.cubic_stiffness * stretch * stretch)

        self.add_twist(element, torque)

    def add_twist(
        self,
        element: elements.ConstantTorque
        | elements.RecordedTorque
        | elements.RotationalSpringDamper
        | elements.CubicTorsionSpring,
        torque: Callable[[float, float], float],
    ) -> None:
        angle, other = self.angle(element.body), self.angle(element.relative_to)
        self.assembly.loads.append(twist(torque, angle, other))

    def is_on_body(self, name: str, point: complex) -> bool:
        """Tell whether a point is one of an engine body, or of the ground."""
        part = self.assembly.parts.get(name)
        return part is None or part.turns or same_point(point, part.reference)

    def point(self, name: str, point: complex) -> Combination:
        """A body's point by those of engine bodies: one, or pin and tip of a massless rod."""
        if name == GROUND:
            return Combination(point)
        part = self.assembly.parts[name]
        if self.is_on_body(name, point):
            arm = point - part.reference if part.turns else 0j
            return Combination(0j, (Term(1.0, part.body, arm),))
        share = (point - part.pin) / (part.reference - part.pin)
        tip = Combination(0j, (Term(share, part.body, 0j),))
        return self.pin(name).times(1 - share) + tip

    def pin(self, name: str) -> Combination:
        joint = self.mechanism.joint_of(name)
        return self.point(joint.parent, complex(*joint.parent_point))

    def angle(self, name: str) -> EngineAngle | RodAngle:
        if name == GROUND:
            return EngineAngle(None)
        part = self.assembly.parts[name]
        if part.turns:
            return EngineAngle(part.body)
        rod = Combination(0j, (Term(1.0, part.body, 0j),)) - self.pin(name)
        start = float(self.kinematics.angle(name).value(self.q))
        return RodAngle(rod, part.reference - part.pin, start)


TREE_JOINT_BUILDERS: elements.ElementTable[Callable[[_Builder, Any], None]] = elements.ElementTable(
    "pymunk",
    elements.JOINTS,
    {
        elements.PinJoint: _Builder.add_tree_pin,
        elements.WeldJoint: _Builder.add_nothing,
        elements.SlotJoint: _Builder.add_slide,
        elements.PrismaticJoint: _Builder.add_slide,
        elements.FreeJoint: _Builder.add_nothing,
        elements.TranslationJoint: _Builder.add_nothing,
    },
)
LOOP_JOINT_BUILDERS: elements.ElementTable[Callable[[_Builder, Any], None]] = elements.ElementTable(
    "pymunk's loops",
    elements.JOINTS,
    {
        elements.PinJoint: _Builder.add_loop_pin,
        elements.WeldJoint: _Builder.add_loop_pin,
        elements.SlotJoint: _Builder.add_slide,
        elements.PrismaticJoint: _Builder.add_slide,
    },
    {
        elements.FreeJoint: "a free joint closes no loop",
        elements.TranslationJoint: "it closes no loop",
    },
)
COUPLER_BUILDERS: elements.ElementTable[Callable[[_Builder, Any], None]] = elements.ElementTable(
    "pymunk", elements.COUPLERS, {elements.Coupler: _Builder.add_coupler}
)
STOP_BUILDERS: elements.ElementTable[
    Callable[[_Builder, Any], tuple[constraints.Constraint, Rod | None]]
] = elements.ElementTable(
    "pymunk",
    elements.STOPS,
    {elements.Stop: _Builder.angle_limit, elements.PointStop: _Builder.point_contact},
)
FORCE_BUILDERS: elements.ElementTable[Callable[[_Builder, Any], None]] = elements.ElementTable(
    "pymunk",
    elements.FORCE_ELEMENTS,
    {
        elements.SpringDamper: _Builder.point_spring,
        elements.RotationalSpringDamper: _Builder.rotational_spring,
        elements.CubicTorsionSpring: _Builder.cubic_spring,
        elements.ConstantForce: _Builder.constant_force,
        elements.ConstantTorque: _Builder.constant_torque,
        elements.RecordedTorque: _Builder.recorded_torque,
        elements.RecordedForce: _Builder.recorded_force,
        elements.SlideSpringDamper: _Builder.slide_spring,
        elements.RotorInertia: _Builder.add_rotor,
    },
    {elements.SlideInertia: "our adapter adds no inertia along slides"},
)
