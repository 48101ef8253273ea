"""A mechanism made of Chipmunk's bodies and constraints.

Bodies that are welded together are one; :mod:`.bodies` says how each body is represented. Joints:

- a pin is a PivotJoint, or two rods (PinJoints) from the pin to two points of the body;
- a point on a line (a slot, a wall) hangs on a rod across the line, whose anchor moves along in the
  frame of the body with the line;
- what holds an angle (a prismatic joint, a weld that closes a loop, a stop) is a GearJoint;
- a free joint is nothing.

Springs without damping are Chipmunk's own; :mod:`.loads` holds what acts besides.

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

from ...models.elements import (
    FORCE_ELEMENTS,
    GROUND,
    JOINTS,
    STOPS,
    AnyJoint,
    AnyStop,
    ConstantForce,
    ConstantTorque,
    CubicTorsionSpring,
    ElementTable,
    FreeJoint,
    PinJoint,
    PointStop,
    PrismaticJoint,
    RotationalSpringDamper,
    SlotJoint,
    SpringDamper,
    Stop,
    WeldJoint,
)
from ...models.errors import UnsupportedProblemError
from ...models.kinematics import Kinematics, initial_state
from ...models.mechanism import Mechanism
from ...models.spec import Vector
from .bodies import Assembly, BodyPart, Rod, is_brace, parts_of, same_point, without_welds
from .loads import (
    Angle,
    Combination,
    EngineAngle,
    FixedAngle,
    Load,
    Loads,
    PointForce,
    Pull,
    RodAngle,
    Term,
    Twist,
)

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
    _Builder(assembly, error_bias).add_constraints(closed)
    _ForceBuilder(assembly).add_all()
    return assembly


class _Builder:
    """Adds joints and stops to an assembly that has its bodies."""

    def __init__(self, assembly: Assembly, error_bias: float) -> None:
        self.assembly, self.mechanism, self.error_bias = assembly, assembly.rigid, error_bias
        self.kinematics = Kinematics(self.mechanism)
        self.q, _ = initial_state(self.mechanism)

    def add_constraints(self, closed: Collection[str]) -> None:
        """Add the joints of the tree, those that close loops, and the named stops."""
        for joint in self.mechanism.tree_joints:
            TREE_JOINT_BUILDERS[joint](self, joint)
        for joint in self.mechanism.loop_joints:
            LOOP_JOINT_BUILDERS[joint](self, joint)
        for stop in self.mechanism.stops:
            build_stop = STOP_BUILDERS[stop]
            if stop.closed:
                self._add_stop(stop, build_stop, stop.name in closed)

    def _add(self, joint: constraints.Constraint) -> None:
        joint.error_bias = self.error_bias
        self.assembly.space.add(joint)

    def _add_rod(self, rod: Rod) -> None:
        self._add(rod.joint)
        self.assembly.rods.append(rod)

    def _rod(
        self, parent: str, parent_point: complex, child: str, child_point: complex, length: float
    ) -> Rod:
        a, end_a = self.assembly.end(parent, parent_point)
        b, end_b = self.assembly.end(child, child_point)
        still = self.assembly.space.static_body
        joint = constraints.PinJoint(a or still, b or still, end_a, end_b)
        joint.distance = length
        return Rod(joint, a, b, end_a, end_b, length)

    def add_nothing(self, joint: FreeJoint | WeldJoint) -> None:
        """Nothing is held by a free joint, nor by a weld of the tree: its bodies are one."""

    def add_tree_pin(self, joint: PinJoint) -> None:
        """Add a rod to a bob, else a pivot."""
        part, at = self.assembly.parts[joint.child], complex(*joint.parent_point)
        if not part.turns:
            length = abs(part.reference - part.pin)
            self._add_rod(self._rod(joint.parent, at, part.name, part.reference, length))
        elif joint.parent == GROUND:
            _, end_b = self.assembly.end(part.name, part.pin)
            still = self.assembly.space.static_body
            self._add(constraints.PivotJoint(still, part.body, (at.real, at.imag), end_b))
        else:
            self._add_pivot(joint.parent, at, part.name, part.pin)

    def _add_pivot(self, still: str, at: complex, turning: str, point: complex) -> None:
        # Two rods from the pin to two points of the body act as a pivot, and their lengths can be
        # corrected.
        for direction in (1, 1j):
            self._add_rod(self._rod(still, at, turning, point + direction, 1.0))

    def add_loop_pin(self, joint: PinJoint | WeldJoint) -> None:
        """Add a pivot that closes a loop, and what holds a weld's angle."""
        ends = [
            (joint.parent, complex(*joint.parent_point)),
            (joint.child, complex(*joint.child_point)),
        ]
        (parent, at), (child, point) = ends if joint.child != GROUND else reversed(ends)
        self._add_loop_pivot(parent, at, child, point)
        if joint.turned_by is not None:
            self._hold_angle(joint, joint.turned_by)

    def _add_loop_pivot(self, parent: str, at: complex, child: str, point: complex) -> None:
        parts = self.assembly.parts
        if parts[child].turns:
            self._add_pivot(parent, at, child, point)
        elif parent == GROUND:
            for direction in (1, 1j):
                self._add_rod(self._rod(GROUND, at + direction, child, point, 1.0))
        elif parts[parent].turns:
            self._add_pivot(child, point, parent, at)
        else:
            # Two point masses turn nothing: a pivot between them is linear, and so exact.
            bodies, origin = (parts[parent].body, parts[child].body), (0.0, 0.0)
            self._add(constraints.PivotJoint(*bodies, origin, origin))

    def add_slide(self, joint: SlotJoint | PrismaticJoint) -> None:
        """Add a rod across the joint's line, and what holds a slider's angle."""
        line = complex(*joint.parent_point), complex(*joint.axis)
        self._add_rod(self._sliding_rod(joint.parent, *line, joint.child, joint.child_point))
        if joint.turned_by is not None:
            self._hold_angle(joint, joint.turned_by)

    def _hold_angle(self, joint: AnyJoint, turned_by: float) -> None:
        """Keep the angle between two bodies, at least one of which turns."""
        if not (self._can_turn(joint.parent) or self._can_turn(joint.child)):
            return
        gear = self._gear(joint.parent, joint.child)
        gear.phase -= math.remainder(gear.phase + turned_by, 2 * math.pi)
        self._add(gear)

    def _can_turn(self, name: str) -> bool:
        return name != GROUND and self.assembly.parts[name].body.moment < math.inf

    def _gear(self, parent: str, child: str) -> constraints.GearJoint:
        """A joint that keeps the angle that two bodies have between them."""
        still, parts = self.assembly.space.static_body, self.assembly.parts
        a, b = (still if name == GROUND else parts[name].body for name in (parent, child))
        return constraints.GearJoint(a, b, b.angle - a.angle, 1.0)

    def _position(self, body: str, point: Vector) -> complex:
        """Position of a body's point at the start [m]."""
        return complex(*self.kinematics.position(self.kinematics.point(body, point), self.q))

    def _sliding_rod(
        self, line: str, origin: complex, axis: complex, body: str, point: Vector
    ) -> Rod:
        """A rod across a line of a body (or of the ground) that keeps another body's point on it.

        A GrooveJoint on a body that turns about another point is of first order only, however many
        passes it gets; a rod whose anchor moves along the line keeps the second order.
        """
        offset = self._position(body, point) - self._position(line, (origin.real, origin.imag))
        offset *= cmath.exp(1j * float(self.kinematics.angle(line).value(self.q)))
        along = (offset * axis.conjugate()).real
        anchor = origin + axis * (along - 1j * _SLIDING_LENGTH)
        rod = self._rod(line, anchor, body, complex(*point), _SLIDING_LENGTH)
        rod.axis = axis
        return rod

    def _add_stop(self, stop: AnyStop, build_stop: _BuildStop, closed: bool) -> None:
        """Add a stop's joint if it is closed; raise in any case if it cannot be built.

        The gap of a stop on a single body does not change: while it is open, there is nothing to
        build.
        """
        if stop.body == stop.relative_to:
            if closed:
                raise UnsupportedProblemError(
                    f"pymunk cannot hold the stop {stop.name!r}: nothing can move against it, so "
                    "its force is not determined."
                )
            return
        joint, rod = build_stop(self, stop)
        if not closed:
            return
        if rod is not None:
            self.assembly.rods.append(rod)
        self._add(joint)
        self.assembly.stops[stop.name] = joint

    def point_contact(self, stop: PointStop) -> tuple[constraints.Constraint, Rod]:
        """A rod across the wall."""
        normal = complex(*stop.normal)
        rod = self._sliding_rod(
            stop.relative_to, stop.offset * normal, -1j * normal, stop.body, stop.point
        )
        return rod.joint, rod

    def angle_limit(self, stop: Stop) -> tuple[constraints.Constraint, Rod | None]:
        """A gear between two bodies that turn, or a brace of a bob."""
        ends = (stop.body, stop.relative_to)
        bobs = [name for name in ends if name != GROUND and not self.assembly.parts[name].turns]
        if not (bobs or any(map(self._can_turn, ends))):
            raise UnsupportedProblemError(
                f"pymunk cannot hold the stop {stop.name!r}: its angle cannot change."
            )
        if not bobs:
            return self._gear(stop.relative_to, stop.body), None
        if len(bobs) == 1 and is_brace(self.mechanism, stop, bobs[0]):
            rod = self._brace(bobs[0])
            return rod.joint, rod
        raise UnsupportedProblemError(
            f"pymunk cannot hold the stop {stop.name!r}: a point mass on a rod can only be stopped "
            "relative to the body that it is pinned to, which must be able to turn."
        )

    def _brace(self, bob: str) -> Rod:
        """A rod across the bob's own, as long as that, from the body that the bob is pinned to."""
        joint, part = self.mechanism.joint_of(bob), self.assembly.parts[bob]
        between = float(self.kinematics.angle(bob, joint.parent).value(self.q))
        along = (part.reference - part.pin) * cmath.exp(-1j * between)
        anchor = complex(*joint.parent_point) + along + 1j * along
        return self._rod(joint.parent, anchor, bob, part.reference, abs(along))


_AddJoint = Callable[[_Builder, Any], None]
_BuildStop = Callable[[_Builder, Any], tuple[constraints.Constraint, Rod | None]]

TREE_JOINT_BUILDERS: ElementTable[_AddJoint] = ElementTable(
    "pymunk",
    JOINTS,
    {
        PinJoint: _Builder.add_tree_pin,
        WeldJoint: _Builder.add_nothing,
        SlotJoint: _Builder.add_slide,
        PrismaticJoint: _Builder.add_slide,
        FreeJoint: _Builder.add_nothing,
    },
)
LOOP_JOINT_BUILDERS: ElementTable[_AddJoint] = ElementTable(
    "pymunk's loops",
    JOINTS,
    {
        PinJoint: _Builder.add_loop_pin,
        WeldJoint: _Builder.add_loop_pin,
        SlotJoint: _Builder.add_slide,
        PrismaticJoint: _Builder.add_slide,
    },
    {FreeJoint: "a free joint closes no loop"},
)
STOP_BUILDERS: ElementTable[_BuildStop] = ElementTable(
    "pymunk", STOPS, {Stop: _Builder.angle_limit, PointStop: _Builder.point_contact}
)


class _ForceBuilder:
    """Adds force elements to an assembly that has its bodies.

    Springs are DampedSprings and DampedRotarySprings without damping: their impulses are those of
    the force at a step's end position, as the leapfrog needs it. What has no such element, or none
    of second order, is a load (:mod:`.loads`).
    """

    def __init__(self, assembly: Assembly) -> None:
        self.assembly, self.mechanism = assembly, assembly.rigid

    def add_all(self) -> None:
        """Add springs of Chipmunk's to the space, and what else acts as loads."""
        loads: list[Load] = []
        for element in self.mechanism.force_elements:
            loads_of = FORCE_BUILDERS[element]
            if len(set(element.bodies)) == len(element.bodies):  # else within one rigid body
                loads += loads_of(self, element)
        self.assembly.loads = Loads(loads) if loads else None

    def constant_force(self, element: ConstantForce) -> list[Load]:
        """A force on a point."""
        point = self._point(element.body, complex(*element.point))
        return [PointForce(point, complex(*element.force))]

    def constant_torque(self, element: ConstantTorque) -> list[Load]:
        """A torque on a body and its opposite on another one."""
        return [self._twist(element, lambda _angle, _speed: element.torque)]

    def point_spring(self, element: SpringDamper) -> list[Load]:
        """Chipmunk's spring where it has both points; else, and of the damper, a load."""
        own, other = complex(*element.point), complex(*element.relative_point)
        stiffness = element.stiffness
        if self._is_on_body(element.body, own) and self._is_on_body(element.relative_to, other):
            if stiffness:
                still = self.assembly.space.static_body
                b, end_b = self.assembly.end(element.body, own)
                a, end_a = self.assembly.end(element.relative_to, other)
                ends = a or still, b or still, end_a, end_b
                spring = constraints.DampedSpring(*ends, element.rest_length, stiffness, 0.0)
                self.assembly.space.add(spring)
            stiffness = 0.0
        vector = self._point(element.body, own) - self._point(element.relative_to, other)
        return [Pull(element, vector, stiffness)] if stiffness or element.damping else []

    def rotational_spring(self, element: RotationalSpringDamper) -> list[Load]:
        """Chipmunk's spring where it has both angles; else, and of the damper, a load."""
        stiffness = 0.0 if self._add_rotary_spring(element) else element.stiffness
        damping, rest = element.damping, element.rest_angle
        if not (stiffness or damping):
            return []

        def torque(angle: float, speed: float) -> float:
            return -stiffness * (angle - rest) - damping * speed

        return [self._twist(element, torque)]

    def cubic_spring(self, element: CubicTorsionSpring) -> list[Load]:
        """The torque of the angle at the step's end position, as Chipmunk's own springs have it."""

        def torque(angle: float, _speed: float) -> float:
            stretch = angle - element.rest_angle
            return -stretch * (element.stiffness + element.cubic_stiffness * stretch * stretch)

        return [self._twist(element, torque)]

    def _twist(
        self,
        element: ConstantTorque | RotationalSpringDamper | CubicTorsionSpring,
        torque: Callable[[float, float], float],
    ) -> Load:
        return Twist(torque, self._angle(element.body), self._angle(element.relative_to))

    def _add_rotary_spring(self, element: RotationalSpringDamper) -> bool:
        """Add Chipmunk's own if both bodies have angles there."""
        still, names = self.assembly.space.static_body, (element.body, element.relative_to)
        parts = [None if name == GROUND else self.assembly.parts[name] for name in names]
        if not all(part is None or part.turns for part in parts):
            return False
        b, a = (still if part is None else part.body for part in parts)
        if element.stiffness and min(a.moment, b.moment) < math.inf:
            # Its angle is that of a less that of b, counter-clockwise: the mechanism's of the body
            # less the other's.
            rest, stiffness = element.rest_angle, element.stiffness
            spring = constraints.DampedRotarySpring(a, b, rest, stiffness, 0.0)
            self.assembly.space.add(spring)
        return True

    def _is_on_body(self, name: str, point: complex) -> bool:
        """Whether a point is one of an engine body, or of the ground."""
        if name == GROUND:
            return True
        part = self.assembly.parts[name]
        return part.turns or same_point(point, part.reference)

    def _point(self, name: str, point: complex) -> Combination:
        if name == GROUND:
            return Combination(point)
        part = self.assembly.parts[name]
        if self._is_on_body(name, point):
            arm = point - part.reference if part.turns else 0j
            return Combination(0j, (Term(1.0, part.body, arm),))
        share = (point - part.pin) / (part.reference - part.pin)
        return self._pin(part).times(1 - share) + Combination(0j, (Term(share, part.body, 0j),))

    def _pin(self, part: BodyPart) -> Combination:
        joint = self.mechanism.joint_of(part.name)
        return self._point(joint.parent, complex(*joint.parent_point))

    def _angle(self, name: str) -> Angle:
        if name == GROUND:
            return FixedAngle()
        part = self.assembly.parts[name]
        if part.turns:
            return EngineAngle(part.body)
        rod = Combination(0j, (Term(1.0, part.body, 0j),)) - self._pin(part)
        q, _ = initial_state(self.mechanism)
        start = float(Kinematics(self.mechanism).angle(name).value(q))
        return RodAngle(rod, part.reference - part.pin, start)


FORCE_BUILDERS: ElementTable[Callable[[_ForceBuilder, Any], list[Load]]] = ElementTable(
    "pymunk",
    FORCE_ELEMENTS,
    {
        SpringDamper: _ForceBuilder.point_spring,
        RotationalSpringDamper: _ForceBuilder.rotational_spring,
        CubicTorsionSpring: _ForceBuilder.cubic_spring,
        ConstantForce: _ForceBuilder.constant_force,
        ConstantTorque: _ForceBuilder.constant_torque,
    },
)
