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
- a rotor whose angle is that of a body alone is a part of that body's inertia.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pymunk
from pymunk import constraints

from ...models import elements
from ...models.arrays import FloatArray
from ...models.elements import GROUND
from ...models.errors import UnsupportedProblemError
from ...models.kinematics import Kinematics, initial_state
from ...models.mechanism import Body, Mechanism
from ...models.spec import Vector
from ..rotors import rotors_of
from .loads import Load

_SAME_POINT = 1e-12  # [m]
# Mass of a point mass on a rod that is pinned to the ground, in multiples of its own.
_LEAST_PIVOT_MASS = 2.0


def same_point(a: complex, b: complex) -> bool:
    """Tell whether two points differ by rounding only."""
    return abs(a - b) <= _SAME_POINT


def is_weld(joint: elements.AnyJoint) -> bool:
    """Tell whether a joint makes its two bodies one, if it is of the tree."""
    return joint.holds_angle and not joint.free_directions


def is_pin(joint: elements.AnyJoint) -> bool:
    """Tell whether a joint holds a point and leaves the angle free."""
    return not (joint.holds_angle or joint.free_directions)


def is_brace(mechanism: Mechanism, stop: elements.Stop, body: str) -> bool:
    """Tell whether a stop is between a body and the one that it is pinned to."""
    return set(stop.bodies) == {body, mechanism.joint_of(body).parent}


# --- Welded bodies as one


@dataclass(frozen=True)
class Placement:
    """Pose of a body's frame in that of the body (or of the ground) that carries it."""

    carrier: str
    origin: complex = 0j  # [m]
    angle: float = 0.0  # the body's angle less its carrier's [rad], clockwise

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

    def with_mass_at(self, point: complex, mass: float) -> LumpedMass:
        """The same body with a point mass."""
        if same_point(point, self.centre):  # keeps the inertia of a point mass at exactly 0
            return LumpedMass(self.mass + mass, self.centre, self.inertia)
        total = self.mass + mass
        centre = (self.mass * self.centre + mass * point) / total
        inertia = self.inertia + self.mass * mass / total * abs(point - self.centre) ** 2
        return LumpedMass(total, centre, inertia)


def without_welds(mechanism: Mechanism) -> tuple[Mechanism, Mapping[str, Placement]]:
    """The mechanism with welded bodies as one, and where each of its bodies is in that one.

    The coordinates are the same. What is welded to the ground is the ground. The mechanism is not
    validated: a joint that closes a loop may have the ground as its child.
    """
    placements = {GROUND: Placement(GROUND)}
    masses: dict[str, LumpedMass] = {}
    for body, joint in zip(mechanism.bodies, mechanism.tree_joints, strict=True):
        place = Placement(body.name)
        if is_weld(joint) and joint.turned_by is not None:
            parent = placements[joint.parent]
            angle = parent.angle + joint.turned_by
            at = complex(*parent.point(joint.parent_point))
            origin = at - complex(*joint.child_point) * cmath.exp(-1j * angle)
            place = Placement(parent.carrier, origin, angle)
        placements[body.name] = place
        mass = LumpedMass(body.mass, complex(*place.point(body.centre)), body.inertia)
        if place.carrier in masses:
            joined = masses[place.carrier].with_mass_at(mass.centre, mass.mass)
            mass = replace(joined, inertia=joined.inertia + mass.inertia)
        masses[place.carrier] = mass
    tree = [joint for joint in mechanism.tree_joints if not is_weld(joint)]
    if len(tree) == len(mechanism.tree_joints):
        return mechanism, placements

    bodies: list[Body] = []
    for body in mechanism.bodies:
        if body.name in masses:
            mass = masses[body.name]
            fields = {"mass": mass.mass, "centre": _pair(mass.centre), "inertia": mass.inertia}
            bodies.append(body.model_copy(update=fields))
    # A joint that closes a loop within one rigid body holds nothing.
    loops = [
        joint
        for joint in mechanism.loop_joints
        if placements[joint.parent].carrier != placements[joint.child].carrier
    ]
    changes = {
        "bodies": tuple(bodies),
        "joints": tuple(_moved(joint, placements) for joint in (*tree, *loops)),
        "stops": tuple(_moved(stop, placements) for stop in mechanism.stops),
        "force_elements": tuple(_moved(force, placements) for force in mechanism.force_elements),
    }
    return mechanism.model_copy(update=changes), placements


_ENDS = {
    "parent": "parent_point",
    "child": "child_point",
    "body": "point",
    "relative_to": "relative_point",
}
"""Fields of elements that name a body, with those of the point in that body's frame."""
_TURNED_FIELDS: elements.ElementTable[tuple[str, ...]] = elements.ElementTable(
    "pymunk's welds",
    elements.ELEMENTS,
    {
        elements.PinJoint: (),
        elements.WeldJoint: ("angle",),
        elements.SlotJoint: ("axis",),
        elements.PrismaticJoint: ("angle", "axis"),
        elements.FreeJoint: (),
        elements.TranslationJoint: ("angle",),
        elements.Stop: ("limit",),
        elements.PointStop: ("normal", "offset"),
        elements.SpringDamper: (),
        elements.RotationalSpringDamper: ("rest_angle",),
        elements.CubicTorsionSpring: ("rest_angle",),
        elements.ConstantForce: (),
        elements.ConstantTorque: (),
        elements.RotorInertia: (),
        elements.SlideInertia: (),
        elements.SlideSpringDamper: (),
        elements.RecordedForce: (),
        elements.RecordedTorque: (),
        elements.Coupler: (),
    },
)
"""Fields of elements, besides their points, that depend on their bodies' frames."""


def _moved(element: Any, placements: Mapping[str, Placement]) -> Any:
    """An element in the frames of the bodies that carry those that it is attached to."""
    turned_fields, known = _TURNED_FIELDS[element], type(element).model_fields
    places: dict[str, Placement] = {}
    changes: dict[str, object] = {}
    for end, point in _ENDS.items():
        if end in known:
            place = places[end] = placements[getattr(element, end)]
            changes[end] = place.carrier
            if point in known:
                changes[point] = place.point(getattr(element, point))
    for name in turned_fields:
        value = getattr(element, name)
        match name:
            case "angle":
                value = value + places["parent"].angle - places["child"].angle
            case "axis":
                value = _pair(places["parent"].direction(complex(*value)))
            case "normal":
                value = _pair(places["relative_to"].direction(complex(*value)))
            case "offset":
                wall = places["relative_to"]
                normal = wall.direction(complex(*element.normal))
                value = value + (normal.conjugate() * wall.origin).real
            case _:  # the angle of a stop or of a spring at rest
                turned = places["body"].angle - places["relative_to"].angle
                value = value - (element.sense if name == "limit" else 1) * turned
        changes[name] = value
    return element.model_copy(update=changes)


def _pair(z: complex) -> Vector:
    return z.real, z.imag


# --- The assembly


@dataclass
class BodyPart:
    """Representation of a body of the mechanism in the space."""

    name: str
    body: pymunk.Body
    reference: complex  # the engine body's centre, in the mechanism's body frame [m]
    pin: complex  # where the body is pinned, in its own frame [m]
    turns: bool
    """Whether the engine body's angle is that of the mechanism's; a bob has none of its own."""


@dataclass
class Rod:
    """A PinJoint with the distance that it is to keep."""

    joint: constraints.PinJoint
    length: float  # [m]
    axis: complex | None = None
    """Line, in the frame of a, along which the end on a follows the other; None: it is fixed."""


@dataclass
class Assembly:
    """A space with what is needed to step and to read it."""

    space: pymunk.Space
    mechanism: Mechanism
    rigid: Mechanism
    """The mechanism with each group of welded bodies as one body: what the space is made of."""
    placements: Mapping[str, Placement]  # places of all bodies of the mechanism in those
    parts: dict[str, BodyPart] = field(default_factory=dict[str, BodyPart])
    """Bodies of the space, in the order of those of `rigid`."""
    rods: list[Rod] = field(default_factory=list[Rod])
    stops: dict[str, constraints.Constraint] = field(
        default_factory=dict[str, constraints.Constraint]
    )
    loads: list[Load] = field(default_factory=list[Load])
    """Forces besides those of joints, springs and gravity."""

    @property
    def bodies(self) -> list[pymunk.Body]:
        """Engine bodies in the order of the parts."""
        return [part.body for part in self.parts.values()]

    def end(self, name: str, point: complex) -> tuple[pymunk.Body, tuple[float, float]]:
        """Engine body and anchor of a body's point."""
        if name == GROUND:
            return self.space.static_body, (point.real, point.imag)
        arm = point - self.parts[name].reference
        return self.parts[name].body, (arm.real, arm.imag)

    @property
    def rates(self) -> FloatArray:
        """Velocities and angular velocities of the bodies, shape (n_bodies, 3); can be set."""
        return np.array([[*body.velocity, body.angular_velocity] for body in self.bodies])

    @rates.setter
    def rates(self, rates: FloatArray) -> None:
        for body, (x, y, spin) in zip(self.bodies, rates.tolist(), strict=True):
            body.velocity, body.angular_velocity = (x, y), spin


def parts_of(mechanism: Mechanism, pivot_mass: float) -> list[BodyPart]:
    """Parts in the order of the bodies of a mechanism without welds in its tree, at its start.

    Raises:
        UnsupportedProblemError: a body has no inertia and is no bob, or a rotor turns with the
            angle between two bodies.
    """
    kinematics, (q, u) = Kinematics(mechanism), initial_state(mechanism)
    masses: dict[str, LumpedMass] = {}
    rotors = rotors_of(mechanism, "pymunk")
    together: dict[int | None, list[Body]] = {}
    for body in mechanism.bodies:
        together.setdefault(mechanism.attitudes[body.name][0], []).append(body)
    for index, group in together.items():
        total = math.fsum(body.inertia + rotors.get(body.name, 0.0) for body in group)
        inertia = math.inf if index is None else total / len(group)
        for body in group:
            masses[body.name] = LumpedMass(body.mass, complex(*body.centre), inertia)

    parts: list[BodyPart] = []
    for body in reversed(mechanism.bodies):  # leaves first: they move mass to their parents' pins
        joint, mass = mechanism.joint_of(body.name), masses[body.name]
        pin, at = complex(*joint.child_point), complex(*joint.parent_point)
        turns = not _is_bob(mechanism, body.name, mass)
        if turns:
            mass = _with_inertia(mass, joint, masses, pivot_mass)
        else:  # a point mass that swings about the pin like the body, and the rest on the pin
            arm = mass.centre - pin
            about_pin = mass.inertia + mass.mass * abs(arm) ** 2
            ratio = about_pin / (mass.mass * abs(arm) ** 2)
            rest = mass.mass * (1 - 1 / ratio)
            if rest > 0 and joint.parent != GROUND:
                masses[joint.parent] = masses[joint.parent].with_mass_at(at, rest)
            mass = LumpedMass(mass.mass / ratio, pin + ratio * arm, 0.0)

        parts.append(placed_part(kinematics, (q, u), body.name, mass, turns=turns))
    return parts[::-1]


def gear_of(coupler: elements.Coupler, assembly: Assembly) -> constraints.GearJoint:
    """The GearJoint that holds an angle to another one, or to the ground's.

    Raises:
        UnsupportedProblemError: the coupler has slides, or more than two angles.
    """
    mechanism = assembly.rigid
    of_angle = {body.angle: body.name for body in mechanism.bodies if body.angle is not None}
    followed = {term.coordinate: term.ratio for term in coupler.terms if term.ratio}
    if len(followed) > 1 or not {coupler.coordinate, *followed} <= set(of_angle):
        raise UnsupportedProblemError(
            f"our adapter builds couplers as pymunk's GearJoints, which hold one angle to another; "
            f"{coupler.name!r} holds {coupler.coordinate!r} to "
            f"{', '.join(map(repr, followed)) or 'a constant'}."
        )
    (a, _), (b, ratio) = assembly.end(of_angle[coupler.coordinate], 0j), (GROUND, 1.0)
    for name, of_name in followed.items():
        b, ratio = of_angle[name], of_name
    # It holds ratio * angle of b - angle of a at the phase; both are the opposites of clockwise
    # ones.
    return constraints.GearJoint(a, assembly.end(b, 0j)[0], coupler.offset, ratio)


def placed_part(
    kinematics: Kinematics,
    state: tuple[FloatArray, FloatArray],
    name: str,
    mass: LumpedMass,
    *,
    turns: bool = True,
) -> BodyPart:
    """A body in Chipmunk in a state (q, u), with its mass; one that turns has its angle as well."""
    mechanism, (q, u) = kinematics.mechanism, state
    body = pymunk.Body(mass.mass, mass.inertia if turns else math.inf)
    row = kinematics.point(name, _pair(mass.centre))
    x, y = kinematics.position(row, q).tolist()
    body.position = x, y
    x, y = kinematics.velocity(row, q, u).tolist()
    body.velocity = x, y
    if turns:
        index, turned = mechanism.attitudes[name]
        body.angle = -(turned if index is None else float(q[index]) + turned)
        body.angular_velocity = 0.0 if index is None else -float(u[index])
    pin = complex(*mechanism.joint_of(name).child_point)
    return BodyPart(name, body, mass.centre, pin, turns)


def _is_bob(mechanism: Mechanism, body: str, mass: LumpedMass) -> bool:
    """Tell whether a body can be a point mass on a rod: nothing else needs its angle."""
    joint, loops = mechanism.joint_of(body), mechanism.loop_joints
    walls = [stop for stop in mechanism.point_stops if stop.closed]
    guides = any(
        end.parent == body and (end.free_directions or end.holds_angle) for end in mechanism.joints
    )
    guides |= any(loop.child == body and loop.holds_angle for loop in loops)
    angle = mechanism.body(body).angle
    guides |= any(angle in coupler.coordinates for coupler in mechanism.couplers)
    guides |= any(wall.relative_to == body for wall in walls)
    if guides or not is_pin(joint) or same_point(mass.centre, complex(*joint.child_point)):
        return False
    # Points of the body at which loop joints and stops act on it.
    ends = [(loop.parent, loop.parent_point) for loop in loops]
    ends += [(loop.child, loop.child_point) for loop in loops]
    ends += [(wall.body, wall.point) for wall in walls]
    points = [complex(*point) for end, point in ends if end == body]
    children = mechanism.children(body)
    if mass.inertia > 0:
        loaded = any(body in element.bodies for element in mechanism.force_elements)
        unbraced = any(
            stop.closed and body in stop.bodies and not is_brace(mechanism, stop, body)
            for stop in mechanism.angle_stops
        )
        if children or points or loaded or unbraced or joint.parent == GROUND:
            return False
    points += [complex(*mechanism.joint_of(child.name).parent_point) for child in children]
    return all(same_point(point, mass.centre) for point in points)


def _with_inertia(
    mass: LumpedMass, joint: elements.AnyJoint, masses: dict[str, LumpedMass], pivot_mass: float
) -> LumpedMass:
    """Mass of a turning body: a point mass gets an inertia by mass at its pin.

    Its parent among `masses` lends it, or the ground; it is refused if neither can.
    """
    pin, at = complex(*joint.child_point), complex(*joint.parent_point)
    if is_pin(joint) and joint.parent == GROUND:
        factor = pivot_mass if mass.inertia > 0 else max(pivot_mass, _LEAST_PIVOT_MASS)
        arm = mass.centre - pin
        inertia = mass.inertia + mass.mass * abs(arm) ** 2 * (1 - 1 / factor)
        mass = LumpedMass(mass.mass * factor, pin + arm / factor, inertia)
    elif is_pin(joint) and mass.inertia <= 0 and not same_point(mass.centre, pin):
        parent = masses[joint.parent]
        # All that can be taken away from the parent there: then the inertia of the rest is 0.
        spare = parent.mass
        if not (same_point(at, parent.centre) or math.isinf(parent.inertia)):
            about = parent.inertia + parent.mass * abs(at - parent.centre) ** 2
            spare = parent.mass * parent.inertia / about
        lent = min(mass.mass, spare / 2)
        masses[joint.parent] = parent.with_mass_at(at, -lent)
        mass = mass.with_mass_at(pin, lent)
    if mass.inertia <= 0:
        raise UnsupportedProblemError(
            f"pymunk cannot turn the body {joint.child!r}, whose inertia is 0: it can only be a "
            "point mass at the end of a rod that is pinned to the ground or to a body with an "
            "inertia."
        )
    return mass
