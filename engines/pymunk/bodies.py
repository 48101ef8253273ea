"""Chipmunk's bodies of a mechanism, and the assembly that they are a part of.

Bodies that are welded together are one: their masses are summed, and what is attached to them
(joints, stops, force elements) is moved to the body that carries them, or to the ground. A weld
that closes a loop is a constraint like any other joint.

Chipmunk has no massless body and no inertia of zero, so each body of the mechanism is represented
by one that moves in the same way (equal mass, first and second moment about its pin):

- a *bob*: a body that is pinned to another one is a point mass at its centre of oscillation, on a
  massless rod, and the rest of its mass is at the pin, in the other body. A point mass on a
  massless rod is its own bob.
- a *turning* body keeps its inertia. Where it is pinned to the ground, mass at the pin never moves:
  a large mass there brings the centre close to the pin, so that the pin's impulses hardly couple
  with those of the other joints.
- a point mass on which something else acts than at its mass gets an inertia by mass at its pin,
  which moves no differently: where it is pinned to the ground as above, elsewhere by mass that its
  parent has less.
- bodies that turn together (prismatic joints) share their inertia evenly, for only its sum counts:
  a slider may be a point mass. Those that do not turn at all get an infinite one.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pymunk
from pymunk import constraints

from ...models.arrays import FloatArray
from ...models.elements import (
    ELEMENTS,
    GROUND,
    AnyJoint,
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
from ...models.mechanism import Body, Mechanism
from ...models.spec import Vector
from .loads import Loads


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
class LumpedMass:
    """Mass [kg], centre [m] and inertia about it [kg m^2] of a body, moved masses included."""

    mass: float
    centre: complex
    inertia: float

    @classmethod
    def of(cls, body: Body) -> LumpedMass:
        """A body's own."""
        return cls(body.mass, complex(*body.centre), body.inertia)

    def fields(self) -> dict[str, object]:
        """The fields of a body that has these."""
        return {"mass": self.mass, "centre": _pair(self.centre), "inertia": self.inertia}

    def joined(self, other: LumpedMass) -> LumpedMass:
        """The two as one body."""
        joined = self.with_mass_at(other.centre, other.mass)
        return LumpedMass(joined.mass, joined.centre, joined.inertia + other.inertia)

    def with_mass_at(self, point: complex, mass: float) -> LumpedMass:
        """The same body with a point mass."""
        if same_point(point, self.centre):  # keeps the inertia of a point mass at exactly 0
            return LumpedMass(self.mass + mass, self.centre, self.inertia)
        total = self.mass + mass
        centre = (self.mass * self.centre + mass * point) / total
        inertia = self.inertia + self.mass * mass / total * abs(point - self.centre) ** 2
        return LumpedMass(total, centre, inertia)

    def spare_mass(self, point: complex) -> float:
        """The mass that can be taken away at a point [kg]: then the inertia of the rest is 0."""
        if same_point(point, self.centre) or math.isinf(self.inertia):
            return self.mass
        return self.mass * self.inertia / (self.inertia + self.mass * abs(point - self.centre) ** 2)

    def with_pivot_mass(self, pin: complex, factor: float) -> LumpedMass:
        """The same body about a fixed pin, its mass multiplied."""
        arm = self.centre - pin
        inertia = self.inertia + self.mass * abs(arm) ** 2 * (1 - 1 / factor)
        return LumpedMass(self.mass * factor, pin + arm / factor, inertia)


_SAME_POINT = 1e-12  # [m]


def same_point(a: complex, b: complex) -> bool:
    """Whether two points differ by rounding only."""
    return abs(a - b) <= _SAME_POINT


def without_welds(mechanism: Mechanism) -> tuple[Mechanism, Mapping[str, Placement]]:
    """The mechanism with welded bodies as one, and where each of its bodies is in that one.

    The coordinates are the same. What is welded to the ground is the ground. The mechanism is not
    validated: a joint that closes a loop may have the ground as its child.
    """
    placements = _placements(mechanism)
    if not any(is_weld(joint) for joint in mechanism.tree_joints):
        return mechanism, placements
    tree = [joint for joint in mechanism.tree_joints if not is_weld(joint)]
    loops = [joint for joint in mechanism.loop_joints if len(_carriers(joint, placements)) > 1]
    changes = {
        "bodies": _joined_bodies(mechanism, placements),
        "joints": tuple(_moved(joint, placements) for joint in (*tree, *loops)),
        "stops": tuple(_moved(stop, placements) for stop in mechanism.stops),
        "force_elements": tuple(
            _moved(element, placements) for element in mechanism.force_elements
        ),
    }
    return mechanism.model_copy(update=changes), placements


def is_weld(joint: AnyJoint) -> bool:
    """Whether a joint makes its two bodies one, if it is of the tree."""
    return joint.holds_angle and not joint.free_directions


def is_pin(joint: AnyJoint) -> bool:
    """Whether a joint holds a point and leaves the angle free."""
    return not (joint.holds_angle or joint.free_directions)


def _placements(mechanism: Mechanism) -> dict[str, Placement]:
    placements = {GROUND: Placement(GROUND)}
    for body, joint in zip(mechanism.bodies, mechanism.tree_joints, strict=True):
        if joint.turned_by is None or not is_weld(joint):
            placements[body.name] = Placement(body.name)
            continue
        parent = placements[joint.parent]
        turned = Placement(
            parent.carrier,
            complex(*parent.point(joint.parent_point)),
            parent.angle + joint.turned_by,
        )
        origin = turned.origin - turned.direction(complex(*joint.child_point))
        placements[body.name] = Placement(parent.carrier, origin, turned.angle)
    return placements


def _carriers(joint: AnyJoint, placements: Mapping[str, Placement]) -> set[str]:
    return {placements[name].carrier for name in (joint.parent, joint.child)}


def _joined_bodies(mechanism: Mechanism, placements: Mapping[str, Placement]) -> tuple[Body, ...]:
    """Bodies that carry others or only themselves, with the masses of all that they carry."""
    masses: dict[str, LumpedMass] = {}
    for body in mechanism.bodies:
        frame = placements[body.name]
        carried = LumpedMass(body.mass, complex(*frame.point(body.centre)), body.inertia)
        carrier = masses.get(frame.carrier)
        masses[frame.carrier] = carried if carrier is None else carrier.joined(carried)
    carriers = [body for body in mechanism.bodies if body.name in masses]
    return tuple(body.model_copy(update=masses[body.name].fields()) for body in carriers)


_Changes = dict[str, object]
_Placements = Mapping[str, Placement]


def _moved(element: Any, placements: _Placements) -> Any:
    """An element in the frames of the bodies that carry those that it is attached to."""
    return element.model_copy(update=_MOVES[element](element, placements))


def _moved_joint(joint: AnyJoint, placements: _Placements) -> _Changes:
    parent, child = placements[joint.parent], placements[joint.child]
    changes: _Changes = {
        "parent": parent.carrier,
        "child": child.carrier,
        "parent_point": parent.point(joint.parent_point),
        "child_point": child.point(joint.child_point),
    }
    if joint.turned_by is not None:
        changes["angle"] = joint.turned_by + parent.angle - child.angle
    return changes


def _moved_slide(joint: SlotJoint | PrismaticJoint, placements: _Placements) -> _Changes:
    axis = placements[joint.parent].direction(complex(*joint.axis))
    return _moved_joint(joint, placements) | {"axis": _pair(axis)}


def _moved_angle_stop(stop: Stop, placements: _Placements) -> _Changes:
    frame, other_frame = placements[stop.body], placements[stop.relative_to]
    limit = stop.limit - stop.sense * (frame.angle - other_frame.angle)
    return {"body": frame.carrier, "relative_to": other_frame.carrier, "limit": limit}


def _moved_point_stop(stop: PointStop, placements: _Placements) -> _Changes:
    frame, other_frame = placements[stop.body], placements[stop.relative_to]
    normal = other_frame.direction(complex(*stop.normal))
    return {
        "body": frame.carrier,
        "relative_to": other_frame.carrier,
        "point": frame.point(stop.point),
        "normal": _pair(normal),
        "offset": stop.offset + (normal.conjugate() * other_frame.origin).real,
    }


def _moved_force(element: ConstantForce, placements: _Placements) -> _Changes:
    frame = placements[element.body]
    return {"body": frame.carrier, "point": frame.point(element.point)}


def _moved_torque(
    element: ConstantTorque | RotationalSpringDamper | CubicTorsionSpring, placements: _Placements
) -> _Changes:
    frame, other_frame = placements[element.body], placements[element.relative_to]
    return {"body": frame.carrier, "relative_to": other_frame.carrier}


def _moved_torsion_spring(
    element: RotationalSpringDamper | CubicTorsionSpring, placements: _Placements
) -> _Changes:
    frame, other_frame = placements[element.body], placements[element.relative_to]
    rest_angle = element.rest_angle - (frame.angle - other_frame.angle)
    return _moved_torque(element, placements) | {"rest_angle": rest_angle}


def _moved_spring(element: SpringDamper, placements: _Placements) -> _Changes:
    frame, other_frame = placements[element.body], placements[element.relative_to]
    return {
        "body": frame.carrier,
        "relative_to": other_frame.carrier,
        "point": frame.point(element.point),
        "relative_point": other_frame.point(element.relative_point),
    }


_MOVES: ElementTable[Callable[[Any, _Placements], _Changes]] = ElementTable(
    "pymunk's welds",
    ELEMENTS,
    {
        PinJoint: _moved_joint,
        WeldJoint: _moved_joint,
        SlotJoint: _moved_slide,
        PrismaticJoint: _moved_slide,
        FreeJoint: _moved_joint,
        Stop: _moved_angle_stop,
        PointStop: _moved_point_stop,
        SpringDamper: _moved_spring,
        RotationalSpringDamper: _moved_torsion_spring,
        CubicTorsionSpring: _moved_torsion_spring,
        ConstantForce: _moved_force,
        ConstantTorque: _moved_torque,
    },
)


def _pair(z: complex) -> Vector:
    return z.real, z.imag


@dataclass
class BodyPart:
    """How a body of the mechanism is represented in the space."""

    name: str
    body: pymunk.Body
    reference: complex
    """The engine body's centre, in the mechanism's body frame [m]."""
    pin: complex
    """Where the body is pinned, in its own frame [m]."""
    turns: bool
    """Whether the engine body's angle is that of the mechanism's; a bob has none of its own."""


@dataclass
class Rod:
    """A PinJoint and its two ends; None is the ground."""

    joint: constraints.PinJoint
    a: pymunk.Body | None
    b: pymunk.Body | None
    end_a: tuple[float, float]
    end_b: tuple[float, float]
    length: float
    """[m]"""
    axis: complex | None = None
    """Line, in the frame of a, along which the end on a follows the other; None: it is fixed."""


@dataclass
class Assembly:
    """A space with what is needed to step and to read it."""

    space: pymunk.Space
    mechanism: Mechanism
    rigid: Mechanism
    """The mechanism with each group of welded bodies as one body: what the space is made of."""
    placements: Mapping[str, Placement]
    """Places of all bodies of the mechanism in those."""
    parts: dict[str, BodyPart] = field(default_factory=dict[str, BodyPart])
    """Bodies of the space, in the order of those of `rigid`."""
    rods: list[Rod] = field(default_factory=list[Rod])
    stops: dict[str, constraints.Constraint] = field(
        default_factory=dict[str, constraints.Constraint]
    )
    loads: Loads | None = None
    """Forces besides those of joints, springs and gravity; None if there are none."""

    @property
    def bodies(self) -> list[pymunk.Body]:
        """Engine bodies in the order of the parts."""
        return [part.body for part in self.parts.values()]

    def end(self, name: str, point: complex) -> tuple[pymunk.Body | None, tuple[float, float]]:
        """A body's point as an end of a joint: engine body (None is the ground) and anchor."""
        if name == GROUND:
            return None, (point.real, point.imag)
        part = self.parts[name]
        arm = point - part.reference
        return part.body, (arm.real, arm.imag)

    @property
    def rates(self) -> FloatArray:
        """Velocities and angular velocities of the bodies, shape (n_bodies, 3); can be set."""
        return np.array([[*body.velocity, body.angular_velocity] for body in self.bodies])

    @rates.setter
    def rates(self, rates: FloatArray) -> None:
        for body, (x, y, spin) in zip(self.bodies, rates.tolist(), strict=True):
            body.velocity, body.angular_velocity = (x, y), spin


# Mass of a point mass on a rod that is pinned to the ground, in multiples of its own.
_LEAST_PIVOT_MASS = 2.0


def parts_of(mechanism: Mechanism, pivot_mass: float) -> list[BodyPart]:
    """Parts in the order of the bodies.

    Args:
        mechanism: without welds in its tree; its start is where the parts are put.
        pivot_mass: as the engine's option.

    Raises:
        UnsupportedProblemError: a body has no inertia and is no bob.
    """
    return _PartMaker(mechanism, pivot_mass).parts()


def is_brace(mechanism: Mechanism, stop: Stop, body: str) -> bool:
    """Whether a stop is between a body and the one that it is pinned to."""
    return set(stop.bodies) == {body, mechanism.joint_of(body).parent}


class _PartMaker:
    def __init__(self, mechanism: Mechanism, pivot_mass: float) -> None:
        self.mechanism, self.pivot_mass = mechanism, pivot_mass
        self.kinematics = Kinematics(mechanism)
        self.q, self.u = initial_state(mechanism)
        self.attitudes = mechanism.attitudes
        self.joints = {joint.child: joint for joint in mechanism.tree_joints}

    def parts(self) -> list[BodyPart]:
        """Made from the leaves, which move mass to their parents' pins."""
        masses = self._mass_properties()
        parts: list[BodyPart] = []
        for body in reversed(self.mechanism.bodies):
            joint, body_mass = self.joints[body.name], masses[body.name]
            pin = complex(*joint.child_point)
            if self._is_bob(body, body_mass, pin):
                bob, rest = _oscillator(body_mass, pin)
                if rest > 0 and joint.parent != GROUND:
                    at = complex(*joint.parent_point)
                    masses[joint.parent] = masses[joint.parent].with_mass_at(at, rest)
                parts.append(self._part(body, bob, pin, turns=False))
            else:
                body_mass = self._with_inertia(body_mass, joint, masses)
                body_mass = self._turning(body, body_mass, joint)
                parts.append(self._part(body, body_mass, pin, turns=True))
        return parts[::-1]

    def _mass_properties(self) -> dict[str, LumpedMass]:
        """Mass properties of the bodies; those that turn together share their inertia."""
        masses = {body.name: LumpedMass.of(body) for body in self.mechanism.bodies}
        groups: dict[int | None, list[str]] = {}
        for name in masses:
            groups.setdefault(self.attitudes[name][0], []).append(name)
        for index, group in groups.items():
            total = math.fsum(masses[name].inertia for name in group)
            share = math.inf if index is None else total / len(group)
            for name in group:
                masses[name] = replace(masses[name], inertia=share)
        return masses

    def _is_bob(self, body: Body, body_mass: LumpedMass, pin: complex) -> bool:
        joint, children = self.joints[body.name], self.mechanism.children(body.name)
        if not is_pin(joint) or same_point(body_mass.centre, pin) or self._guides(body.name):
            return False
        stops = [
            stop for stop in self.mechanism.angle_stops if stop.closed and body.name in stop.bodies
        ]
        unbraced = any(not is_brace(self.mechanism, stop, body.name) for stop in stops)
        constrained = self._constrained_points(body.name)
        loaded = any(body.name in element.bodies for element in self.mechanism.force_elements)
        if body_mass.inertia > 0 and (
            children or joint.parent == GROUND or unbraced or constrained or loaded
        ):
            return False
        pins = [complex(*self.joints[child.name].parent_point) for child in children]
        return all(same_point(point, body_mass.centre) for point in (*pins, *constrained))

    def _guides(self, body: str) -> bool:
        """Whether another joint or a wall needs the body's angle."""
        for joint in self.mechanism.joints:
            if joint.parent == body and (joint.free_directions or joint.holds_angle):
                return True
        for joint in self.mechanism.loop_joints:
            if joint.child == body and joint.holds_angle:
                return True
        walls = self.mechanism.point_stops
        return any(stop.closed and stop.relative_to == body for stop in walls)

    def _constrained_points(self, body: str) -> list[complex]:
        """Points of a body at which loop joints or stops act on it."""
        loops = self.mechanism.loop_joints
        ends = [(joint.parent, joint.parent_point) for joint in loops]
        ends += [(joint.child, joint.child_point) for joint in loops]
        ends += [(stop.body, stop.point) for stop in self.mechanism.point_stops if stop.closed]
        return [complex(*point) for name, point in ends if name == body]

    def _with_inertia(
        self, body_mass: LumpedMass, joint: AnyJoint, masses: dict[str, LumpedMass]
    ) -> LumpedMass:
        """A point mass with mass at its pin that its parent lends, if it can."""
        pin, at = complex(*joint.child_point), complex(*joint.parent_point)
        if (
            body_mass.inertia > 0
            or not is_pin(joint)
            or joint.parent == GROUND
            or same_point(body_mass.centre, pin)
        ):
            return body_mass
        lent = min(body_mass.mass, masses[joint.parent].spare_mass(at) / 2)
        masses[joint.parent] = masses[joint.parent].with_mass_at(at, -lent)
        return body_mass.with_mass_at(pin, lent)

    def _turning(self, body: Body, body_mass: LumpedMass, joint: AnyJoint) -> LumpedMass:
        if joint.parent == GROUND and is_pin(joint):
            factor = self.pivot_mass
            if body_mass.inertia <= 0:
                factor = max(factor, _LEAST_PIVOT_MASS)
            body_mass = body_mass.with_pivot_mass(complex(*joint.child_point), factor)
        if body_mass.inertia <= 0:
            raise UnsupportedProblemError(
                f"pymunk cannot turn the body {body.name!r}, whose inertia is 0: it can only be a "
                f"point mass at the end of a rod that is pinned to the ground or to a body "
                "with an inertia."
            )
        return body_mass

    def _part(self, body: Body, body_mass: LumpedMass, pin: complex, turns: bool) -> BodyPart:
        engine_body = pymunk.Body(body_mass.mass, body_mass.inertia if turns else math.inf)
        row = self.kinematics.point(body.name, _pair(body_mass.centre))
        x, y = self.kinematics.position(row, self.q).tolist()
        engine_body.position = x, y
        x, y = self.kinematics.velocity(row, self.q, self.u).tolist()
        engine_body.velocity = x, y
        if turns:
            index, turned = self.attitudes[body.name]
            engine_body.angle = -(turned if index is None else float(self.q[index]) + turned)
            engine_body.angular_velocity = 0.0 if index is None else -float(self.u[index])
        return BodyPart(body.name, engine_body, body_mass.centre, pin, turns)


def _oscillator(body_mass: LumpedMass, pin: complex) -> tuple[LumpedMass, float]:
    """Point mass that swings about the pin like the body, and the mass left on the pin [kg]."""
    arm, mass = body_mass.centre - pin, body_mass.mass
    about_pin = body_mass.inertia + mass * abs(arm) ** 2
    ratio = about_pin / (mass * abs(arm) ** 2)
    return LumpedMass(mass / ratio, pin + ratio * arm, 0.0), mass * (1 - 1 / ratio)
