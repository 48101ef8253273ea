"""Force elements in a Chipmunk space.

Springs are DampedSprings and DampedRotarySprings without damping: their impulses are those of the
force at a step's end position, as the leapfrog needs it. What has no such element, or none of
second order, is a load (:mod:`.loads`): dampers, constant forces and torques, and springs on a
point of a massless rod, which has no body of its own.
"""

from __future__ import annotations

import math

from pymunk import constraints

from ...models.force_elements import (
    AnyForceElement,
    ConstantForce,
    RotationalSpringDamper,
    SpringDamper,
)
from ...models.joints import GROUND
from ...models.kinematics import Kinematics, initial_state
from .assembly import Assembly, Part
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
from .welds import same_point


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
