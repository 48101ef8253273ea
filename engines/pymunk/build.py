"""A mechanism made of Chipmunk's bodies and constraints.

Bodies that are welded together are one (:mod:`.welds`); :mod:`.parts` says how each body is
represented. Joints:

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
from collections.abc import Collection

import pymunk
from pymunk import constraints

from ...models.errors import UnsupportedProblemError
from ...models.force_elements import (
    AnyForceElement,
    ConstantForce,
    RotationalSpringDamper,
    SpringDamper,
)
from ...models.joints import GROUND, AnyJoint, FreeJoint, PrismaticJoint, SlotJoint
from ...models.kinematics import Kinematics, initial_state
from ...models.mechanism import Mechanism
from ...models.spec import Vector
from ...models.stops import PointStop, Stop
from .bodies import Assembly, Part, Rod, is_brace, parts_of, same_point, without_welds
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
    add_force_elements(assembly)
    return assembly


class _Builder:
    """Adds joints and stops to an assembly that has its bodies."""

    def __init__(self, assembly: Assembly, error_bias: float) -> None:
        self.assembly, self.mechanism, self.error_bias = assembly, assembly.rigid, error_bias
        self.kinematics = Kinematics(self.mechanism)
        self.q, _ = initial_state(self.mechanism)

    def add_constraints(self, closed: Collection[str]) -> None:
        for joint in self.mechanism.tree_joints:
            self._add_tree_joint(joint)
        for joint in self.mechanism.loop_joints:
            self._add_loop_joint(joint)
        for stop in self.mechanism.stops:
            if stop.closed:
                self._add_stop(stop, stop.name in closed)

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

    def _add_tree_joint(self, joint: AnyJoint) -> None:
        part, at = self.assembly.parts[joint.child], complex(*joint.parent_point)
        if isinstance(joint, FreeJoint):
            return
        if isinstance(joint, SlotJoint | PrismaticJoint):
            self._add_slide(joint)
        elif not part.turns:
            self._add_rod(
                self._rod(
                    joint.parent, at, part.name, part.reference, abs(part.reference - part.pin)
                )
            )
        elif joint.parent == GROUND:
            _, end_b = self.assembly.end(part.name, part.pin)
            self._add(
                constraints.PivotJoint(
                    self.assembly.space.static_body, part.body, (at.real, at.imag), end_b
                )
            )
        else:
            self._add_pivot(joint.parent, at, part.name, part.pin)

    def _add_pivot(self, still: str, at: complex, turning: str, point: complex) -> None:
        # Two rods from the pin to two points of the body act as a pivot, and their lengths can be
        # corrected.
        for direction in (1, 1j):
            self._add_rod(self._rod(still, at, turning, point + direction, 1.0))

    def _add_loop_joint(self, joint: AnyJoint) -> None:
        """A joint that closes a loop."""
        if isinstance(joint, SlotJoint | PrismaticJoint):
            self._add_slide(joint)
            return
        ends = [
            (joint.parent, complex(*joint.parent_point)),
            (joint.child, complex(*joint.child_point)),
        ]
        (parent, at), (child, point) = ends if joint.child != GROUND else reversed(ends)
        self._add_loop_pin(parent, at, child, point)
        if joint.turned_by is not None:
            self._hold_angle(joint, joint.turned_by)

    def _add_loop_pin(self, parent: str, at: complex, child: str, point: complex) -> None:
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
            self._add(
                constraints.PivotJoint(
                    parts[parent].body, parts[child].body, (0.0, 0.0), (0.0, 0.0)
                )
            )

    def _add_slide(self, joint: SlotJoint | PrismaticJoint) -> None:
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
        apart = self._position(body, point) - self._position(line, (origin.real, origin.imag))
        apart *= cmath.exp(1j * float(self.kinematics.angle(line).value(self.q)))
        along = (apart * axis.conjugate()).real
        anchor = origin + axis * (along - 1j * _SLIDING_LENGTH)
        rod = self._rod(line, anchor, body, complex(*point), _SLIDING_LENGTH)
        rod.axis = axis
        return rod

    def _add_stop(self, stop: Stop | PointStop, closed: bool) -> None:
        """Add a stop's joint if it is closed; raise in any case if it cannot be built.

        The gap of a stop on a single body does not change: while it is open, there is nothing to
        build.
        """
        if stop.body == stop.relative_to:
            if closed:
                raise UnsupportedProblemError(
                    f"pymunk cannot hold the stop {stop.name!r}: nothing can move against it, so its force is not "
                    "determined."
                )
            return
        joint, rod = (
            self._point_contact(stop) if isinstance(stop, PointStop) else self._angle_limit(stop)
        )
        if not closed:
            return
        if rod is not None:
            self.assembly.rods.append(rod)
        self._add(joint)
        self.assembly.stops[stop.name] = joint

    def _point_contact(self, stop: PointStop) -> tuple[constraints.Constraint, Rod]:
        normal = complex(*stop.normal)
        rod = self._sliding_rod(
            stop.relative_to, stop.offset * normal, -1j * normal, stop.body, stop.point
        )
        return rod.joint, rod

    def _angle_limit(self, stop: Stop) -> tuple[constraints.Constraint, Rod | None]:
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
            f"pymunk cannot hold the stop {stop.name!r}: a point mass on a rod can only be stopped relative to the "
            f"body that it is pinned to, which must be able to turn."
        )

    def _brace(self, bob: str) -> Rod:
        """A rod across the bob's own, of the same length, from the body that the bob is pinned to."""
        joint, part = self.mechanism.joint_of(bob), self.assembly.parts[bob]
        between = float(self.kinematics.angle(bob, joint.parent).value(self.q))
        along = (part.reference - part.pin) * cmath.exp(-1j * between)
        anchor = complex(*joint.parent_point) + along + 1j * along
        return self._rod(joint.parent, anchor, bob, part.reference, abs(along))


def add_force_elements(assembly: Assembly) -> None:
    """Add the mechanism's force elements to an assembly that has its bodies."""
    ways = _Ways(assembly)
    loads = [load for element in assembly.rigid.force_elements for load in ways.loads_of(element)]
    assembly.loads = Loads(loads) if loads else None


class _Ways:
    """How each element acts on the bodies of an assembly."""

    def __init__(self, assembly: Assembly) -> None:
        self.assembly, self.mechanism = assembly, assembly.rigid

    def loads_of(self, element: AnyForceElement) -> list[Load]:
        """What of an element is a load; its spring, if Chipmunk's own can be it, is added to the space."""
        if len(set(element.bodies)) < len(element.bodies):
            return []  # within one rigid body
        if isinstance(element, ConstantForce):
            return [
                PointForce(
                    self._point(element.body, complex(*element.point)), complex(*element.force)
                )
            ]
        if isinstance(element, SpringDamper):
            return self._pull(element)
        own, other = (self._angle(name) for name in (element.body, element.relative_to))
        stiffness = 0.0
        if isinstance(element, RotationalSpringDamper):
            stiffness = 0.0 if self._add_rotary_spring(element) else element.stiffness
            if not (stiffness or element.damping):
                return []
        return [Twist(element, own, other, stiffness)]

    def _pull(self, element: SpringDamper) -> list[Load]:
        own, other = complex(*element.point), complex(*element.relative_point)
        is_own = self._is_on_body(element.body, own) and self._is_on_body(
            element.relative_to, other
        )
        if is_own and element.stiffness:
            still = self.assembly.space.static_body
            b, end_b = self.assembly.end(element.body, own)
            a, end_a = self.assembly.end(element.relative_to, other)
            lengths = element.rest_length, element.stiffness, 0.0
            self.assembly.space.add(
                constraints.DampedSpring(a or still, b or still, end_a, end_b, *lengths)
            )
        stiffness = 0.0 if is_own else element.stiffness
        vector = self._point(element.body, own) - self._point(element.relative_to, other)
        return [Pull(element, vector, stiffness)] if stiffness or element.damping else []

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
            spring = constraints.DampedRotarySpring(
                a, b, element.rest_angle, element.stiffness, 0.0
            )
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

    def _pin(self, part: Part) -> Combination:
        joint = self.mechanism.joint_of(part.name)
        return self._point(joint.parent, complex(*joint.parent_point))

    def _angle(self, name: str) -> Angle:
        if name == GROUND:
            return FixedAngle()
        part = self.assembly.parts[name]
        if part.turns:
            return EngineAngle(part.body)
        rod = Combination(0j, (Term(1.0, part.body, 0j),)) - self._pin(part)
        start = float(
            Kinematics(self.mechanism).angle(name).value(initial_state(self.mechanism)[0])
        )
        return RodAngle(rod, part.reference - part.pin, start)
