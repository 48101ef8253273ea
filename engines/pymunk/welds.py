"""Bodies that are welded together are one body of Chipmunk's: their masses are summed, and so nothing can part.

What is attached to a welded body (joints, stops, force elements) is moved to the body that carries
it, or to the ground. Only welds of the tree are treated here; one that closes a loop is a
constraint like any other joint.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping
from dataclasses import dataclass

from ...models.force_elements import (
    AnyForceElement,
    ConstantForce,
    ConstantTorque,
    RotationalSpringDamper,
    SpringDamper,
)
from ...models.joints import GROUND, AnyJoint, PrismaticJoint, SlotJoint, WeldJoint
from ...models.mechanism import Body, Mechanism
from ...models.spec import Vector
from ...models.stops import PointStop, Stop


@dataclass(frozen=True)
class Placement:
    """Where a body's frame is in that of the body (or of the ground) that carries it."""

    carrier: str
    origin: complex = 0j
    """[m]"""
    angle: float = 0.0
    """The body's angle less its carrier's [rad], clockwise."""

    def direction(self, local: complex) -> complex:
        """A direction of the body's frame in its carrier's."""
        return local * cmath.exp(-1j * self.angle)

    def point(self, local: Vector) -> Vector:
        """A point of the body's frame in its carrier's [m]."""
        return _pair(self.origin + self.direction(complex(*local)))


@dataclass(frozen=True)
class Weights:
    """Mass [kg], centre [m] and inertia about it [kg m^2] of a body with the masses moved onto it."""

    mass: float
    centre: complex
    inertia: float

    @classmethod
    def of(cls, body: Body) -> Weights:
        """A body's own."""
        return cls(body.mass, complex(*body.centre), body.inertia)

    def joined(self, other: Weights) -> Weights:
        """The two as one body."""
        joined = self.with_mass_at(other.centre, other.mass)
        return Weights(joined.mass, joined.centre, joined.inertia + other.inertia)

    def with_mass_at(self, point: complex, mass: float) -> Weights:
        """The same body with a point mass."""
        if same_point(point, self.centre):  # keeps the inertia of a point mass at exactly 0
            return Weights(self.mass + mass, self.centre, self.inertia)
        total = self.mass + mass
        centre = (self.mass * self.centre + mass * point) / total
        inertia = self.inertia + self.mass * mass / total * abs(point - self.centre) ** 2
        return Weights(total, centre, inertia)

    def spare_mass(self, point: complex) -> float:
        """The mass that can be taken away at a point [kg]: then the inertia of the rest is 0."""
        if same_point(point, self.centre) or math.isinf(self.inertia):
            return self.mass
        return self.mass * self.inertia / (self.inertia + self.mass * abs(point - self.centre) ** 2)

    def with_pivot_mass(self, pin: complex, factor: float) -> Weights:
        """The same body about a fixed pin, its mass multiplied."""
        arm = self.centre - pin
        inertia = self.inertia + self.mass * abs(arm) ** 2 * (1 - 1 / factor)
        return Weights(self.mass * factor, pin + arm / factor, inertia)


_SAME_POINT = 1e-12  # [m]


def same_point(a: complex, b: complex) -> bool:
    """Whether two points differ by rounding only."""
    return abs(a - b) <= _SAME_POINT


def without_welds(mechanism: Mechanism) -> tuple[Mechanism, Mapping[str, Placement]]:
    """The mechanism with each group of welded bodies as one body, and where each of its bodies is in that one.

    The coordinates are the same. What is welded to the ground is the ground. The mechanism is not
    validated: a joint that closes a loop may have the ground as its child.
    """
    placements = _placements(mechanism)
    if not any(isinstance(joint, WeldJoint) for joint in mechanism.tree_joints):
        return mechanism, placements
    tree = [joint for joint in mechanism.tree_joints if not isinstance(joint, WeldJoint)]
    loops = [joint for joint in mechanism.loop_joints if len(_carriers(joint, placements)) > 1]
    changes = {
        "bodies": _joined_bodies(mechanism, placements),
        "joints": tuple(_moved_joint(joint, placements) for joint in (*tree, *loops)),
        "stops": tuple(_moved_stop(stop, placements) for stop in mechanism.stops),
        "force_elements": tuple(
            _moved_element(element, placements) for element in mechanism.force_elements
        ),
    }
    return mechanism.model_copy(update=changes), placements


def _placements(mechanism: Mechanism) -> dict[str, Placement]:
    placements = {GROUND: Placement(GROUND)}
    for body, joint in zip(mechanism.bodies, mechanism.tree_joints, strict=True):
        if not isinstance(joint, WeldJoint):
            placements[body.name] = Placement(body.name)
            continue
        parent = placements[joint.parent]
        turned = Placement(
            parent.carrier, complex(*parent.point(joint.parent_point)), parent.angle + joint.angle
        )
        origin = turned.origin - turned.direction(complex(*joint.child_point))
        placements[body.name] = Placement(parent.carrier, origin, turned.angle)
    return placements


def _carriers(joint: AnyJoint, placements: Mapping[str, Placement]) -> set[str]:
    return {placements[name].carrier for name in (joint.parent, joint.child)}


def _joined_bodies(mechanism: Mechanism, placements: Mapping[str, Placement]) -> tuple[Body, ...]:
    weights: dict[str, Weights] = {}
    for body in mechanism.bodies:
        place = placements[body.name]
        own = Weights(body.mass, complex(*place.point(body.centre)), body.inertia)
        weights[place.carrier] = (
            weights[place.carrier].joined(own) if place.carrier in weights else own
        )
    return tuple(
        body.model_copy(
            update={"mass": own.mass, "centre": _pair(own.centre), "inertia": own.inertia}
        )
        for body in mechanism.bodies
        if body.name in weights
        for own in [weights[body.name]]
    )


def _moved_joint(joint: AnyJoint, placements: Mapping[str, Placement]) -> AnyJoint:
    parent, child = placements[joint.parent], placements[joint.child]
    changes: dict[str, object] = {
        "parent": parent.carrier,
        "child": child.carrier,
        "parent_point": parent.point(joint.parent_point),
        "child_point": child.point(joint.child_point),
    }
    if isinstance(joint, SlotJoint | PrismaticJoint):
        changes["axis"] = _pair(parent.direction(complex(*joint.axis)))
    if joint.turned_by is not None:
        changes["angle"] = joint.turned_by + parent.angle - child.angle
    return joint.model_copy(update=changes)


def _moved_stop(stop: Stop | PointStop, placements: Mapping[str, Placement]) -> Stop | PointStop:
    own, other = placements[stop.body], placements[stop.relative_to]
    changes: dict[str, object] = {"body": own.carrier, "relative_to": other.carrier}
    if isinstance(stop, Stop):
        changes["limit"] = stop.limit - stop.sense * (own.angle - other.angle)
    else:
        normal = other.direction(complex(*stop.normal))
        offset = stop.offset + (normal.conjugate() * other.origin).real
        changes |= {"point": own.point(stop.point), "normal": _pair(normal), "offset": offset}
    return stop.model_copy(update=changes)


def _moved_element(
    element: AnyForceElement, placements: Mapping[str, Placement]
) -> AnyForceElement:
    own = placements[element.body]
    changes: dict[str, object] = {"body": own.carrier}
    if isinstance(element, SpringDamper | RotationalSpringDamper | ConstantTorque):
        other = placements[element.relative_to]
        changes["relative_to"] = other.carrier
        if isinstance(element, SpringDamper):
            changes["relative_point"] = other.point(element.relative_point)
        elif isinstance(element, RotationalSpringDamper):
            changes["rest_angle"] = element.rest_angle - (own.angle - other.angle)
    if isinstance(element, SpringDamper | ConstantForce):
        changes["point"] = own.point(element.point)
    return element.model_copy(update=changes)


def _pair(z: complex) -> Vector:
    return z.real, z.imag
