"""Springs, dampers and motors as forces that a program gives an engine before each of its steps.

For engines that have no such elements, and take forces and torques on bodies. :func:`program` has
the same forces as statements of a program without trebucheck, to the last bit. Places, velocities
and forces in the plane are complex numbers x + i y; angles and torques are clockwise.
"""

from __future__ import annotations

import cmath
import inspect
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from typing import Any, Protocol

from trebucheck.models import elements
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import GROUND
from trebucheck.models.features import COVERED_BY_FEATURES
from trebucheck.models.mechanism import Mechanism

from .joint_coordinates import JointCoordinates

GIVEN: frozenset[type] = COVERED_BY_FEATURES | {elements.SlideSpringDamper}
"""Classes of elements of an engine of all joints whose forces are given."""


def spring_force(
    between: complex, rate: complex, stiffness: float, rest_length: float, damping: float
) -> complex:
    """Force [N] of a spring and damper on its end at `between` [m] from the other one.

    Args:
        between: from the other end to this one [m].
        rate: its rate of change [m/s].
        stiffness, rest_length, damping: [N/m], [m], [N s/m].
    """
    if not (rest_length or damping):
        return -stiffness * between
    length = abs(between)
    stretching = (between.conjugate() * rate).real / length
    return (stiffness * (rest_length - length) - damping * stretching) * between / length


def slide_force(
    between: complex,
    rate: complex,
    axis: complex,
    turn: tuple[float, float],
    stiffness: float,
    damping: float,
    rest_position: float,
    constant: float,
) -> complex:
    """Force [N] of a spring, damper and motor along a line of a body, on the point that slides.

    Args:
        between: from the line's origin to the point [m].
        rate: its rate of change [m/s].
        axis: direction of the line in its body's frame.
        turn: clockwise angle [rad] and speed [rad/s] of that body.
        stiffness, damping, rest_position, constant: [N/m], [N s/m], [m], [N].
    """
    along = axis * cmath.exp(-1j * turn[0])
    slide = along.conjugate() * between
    speed = (along.conjugate() * rate + 1j * turn[1] * slide).real
    return (constant - stiffness * (slide.real - rest_position) - damping * speed) * along


class Bodies(Protocol):
    """Bodies of an engine in their present state."""

    def centre(self, name: str) -> tuple[complex, complex]:
        """Place [m] and velocity [m/s] of a body's centre of mass."""
        ...

    def push(self, name: str, place: complex, force: complex) -> None:
        """Give a body a force [N] at a place [m] for the next step."""
        ...

    def twist(self, name: str, torque: float) -> None:
        """Give a body a torque [N m] for the next step."""
        ...


@dataclass(frozen=True)
class Turn:
    """Angle of a body: a coordinate, or none, and a constant [rad]."""

    index: int | None
    constant: float

    def of(self, q: FloatArray, u: FloatArray) -> tuple[float, float]:
        """The angle [rad] and its speed [rad/s]."""
        if self.index is None:
            return self.constant, 0.0
        return float(q[self.index]) + self.constant, float(u[self.index])


@dataclass
class GivenForces:
    """Forces of a mechanism's force elements, by bodies' centres of mass and angles."""

    mechanism: Mechanism
    turns: dict[str, Turn] = field(init=False)

    def __post_init__(self) -> None:
        """Note the bodies' angles, and refuse elements that are not known."""
        self.turns = {name: Turn(*turn) for name, turn in self.mechanism.attitudes.items()}
        for element in self.mechanism.force_elements:
            _GIVEN[element]

    def give(self, bodies: Bodies, q: FloatArray, u: FloatArray) -> None:
        """Give the bodies the forces in the present state, for the next step."""
        for element in self.mechanism.force_elements:
            _GIVEN[element](self, element, _Present(self, bodies, q, u))

    def arm(self, name: str, point: tuple[float, float]) -> complex:
        """A body's point from its centre of mass, in its frame; of the ground the point [m]."""
        if name == GROUND:
            return complex(*point)
        return complex(*point) - complex(*self.mechanism.body(name).centre)

    # --- Elements

    def pull(self, element: elements.SpringDamper, to: _Target) -> None:
        """Give or write the force of a spring."""
        law = element.stiffness, element.rest_length, element.damping
        to.pull(
            (element.body, self.arm(element.body, element.point)),
            (element.relative_to, self.arm(element.relative_to, element.relative_point)),
            law,
        )

    def wind(self, element: elements.RotationalSpringDamper, to: _Target) -> None:
        """Give or write the torque of a spring."""
        law = element.stiffness, element.rest_angle, element.damping
        to.wind(element.body, element.relative_to, law)

    def slide(self, element: elements.SlideSpringDamper, to: _Target) -> None:
        """Give or write the force along a slide, and the opposite there."""
        slide = self.mechanism.slide(element.coordinate)
        joint = slide.joint
        law = element.stiffness, element.damping, element.rest_position, element.force
        to.slide(
            (joint.child, self.arm(joint.child, joint.child_point)),
            (joint.parent, self.arm(joint.parent, joint.parent_point)),
            (complex(slide.direction), *law),
        )

    def push(self, element: elements.ConstantForce, to: _Target) -> None:
        """Give or write a constant force."""
        if element.body != GROUND:
            to.push(element.body, self.arm(element.body, element.point), complex(*element.force))

    def twist(self, element: elements.ConstantTorque, to: _Target) -> None:
        """Give or write a constant torque."""
        for name, torque in zip(element.bodies, (element.torque, -element.torque), strict=True):
            if name != GROUND:
                to.twist(name, torque)


_Ends = tuple[str, complex]
_Law = tuple[float, float, float]
_SlideLaw = tuple[complex, float, float, float, float]


class _Target(Protocol):
    """Receiver of forces: bodies to which they are given, or a text in which they are written."""

    def pull(self, end: _Ends, other: _Ends, law: _Law) -> None: ...

    def wind(self, body: str, other: str, law: _Law) -> None: ...

    def slide(self, end: _Ends, other: _Ends, law: _SlideLaw) -> None: ...

    def push(self, body: str, arm: complex, force: complex) -> None: ...

    def twist(self, body: str, torque: float) -> None: ...


@dataclass(frozen=True)
class _Present:
    """Forces given to an engine's bodies."""

    forces: GivenForces
    bodies: Bodies
    q: FloatArray
    u: FloatArray

    def point(self, name: str, arm: complex) -> tuple[complex, complex]:
        if name == GROUND:
            return arm, 0j
        return point_of(self.bodies.centre(name), self.forces.turns[name].of(self.q, self.u), arm)

    def pull(self, end: _Ends, other: _Ends, law: _Law) -> None:
        (z1, v1), (z0, v0) = self.point(*end), self.point(*other)
        force = spring_force(z1 - z0, v1 - v0, *law)
        for (name, _), place, sign in ((end, z1, 1), (other, z0, -1)):
            if name != GROUND:
                self.bodies.push(name, place, sign * force)

    def wind(self, body: str, other: str, law: _Law) -> None:
        stiffness, rest, damping = law
        (a1, w1), (a0, w0) = (self.forces.turns[name].of(self.q, self.u) for name in (body, other))
        torque = -stiffness * (a1 - a0 - rest) - damping * (w1 - w0)
        for name, sign in ((body, 1), (other, -1)):
            if name != GROUND:
                self.bodies.twist(name, sign * torque)

    def slide(self, end: _Ends, other: _Ends, law: _SlideLaw) -> None:
        (z1, v1), (z0, v0) = self.point(*end), self.point(*other)
        axis, *rest = law
        turn = self.forces.turns[other[0]].of(self.q, self.u)
        force = slide_force(z1 - z0, v1 - v0, axis, turn, *rest)
        for (name, _), sign in ((end, 1), (other, -1)):
            if name != GROUND:
                self.bodies.push(name, z1, sign * force)

    def push(self, body: str, arm: complex, force: complex) -> None:
        self.bodies.push(body, self.point(body, arm)[0], force)

    def twist(self, body: str, torque: float) -> None:
        self.bodies.twist(body, torque)


def point_of(
    centre: tuple[complex, complex], turn: tuple[float, float], arm: complex
) -> tuple[complex, complex]:
    """Place [m] and velocity [m/s] of a point of a body.

    Args:
        centre: place and velocity of its centre of mass.
        turn: its clockwise angle [rad] and speed [rad/s].
        arm: the point from the centre of mass, in the body's frame [m].
    """
    turned = arm * cmath.exp(-1j * turn[0])
    return centre[0] + turned, centre[1] - 1j * turn[1] * turned


def springs_of_joints(
    to: JointCoordinates, but: Collection[int] = ()
) -> dict[str, tuple[int, tuple[float, float, float]]]:
    """Torsion springs between bodies that a joint connects, for engines whose joints have springs.

    Args:
        to: the joint coordinates.
        but: indices of joint coordinates that get none.

    Returns:
        By the name of the element the joint coordinate that it acts on, one element each, and its
        stiffness [N m/rad], rest angle [rad] and damping [N m s/rad] there.
    """
    found: dict[str, tuple[int, tuple[float, float, float]]] = {}
    taken = set(but)
    turns = {
        frozenset({freedom.joint.child, freedom.joint.parent}): (index, freedom.joint.child)
        for index, freedom in enumerate(to.freedoms)
        if freedom.direction is None
    }
    for element in to.mechanism.force_elements:
        if isinstance(element, elements.RotationalSpringDamper):
            index, child = turns.get(frozenset(element.bodies), (-1, ""))
            if index >= 0 and index not in taken:
                rest = element.rest_angle if element.body == child else -element.rest_angle
                found[element.name] = index, (element.stiffness, rest, element.damping)
                taken.add(index)
    return found


# --- The same as a program


@dataclass
class _Written:
    """Forces written as statements."""

    forces: GivenForces
    statements: list[str] = field(default_factory=list[str])

    def point(self, name: str, arm: complex) -> str:
        if name == GROUND:
            return f"({arm!r}, 0j)"
        return f"point_of(centre({name!r}), {self.turn(name)}, {arm!r})"

    def turn(self, name: str) -> str:
        turn = self.forces.turns[name]
        if turn.index is None:
            return f"({turn.constant!r}, 0.0)"
        angle = f"float(q[{turn.index}]) + {turn.constant!r}"
        return f"({angle}, float(u[{turn.index}]))"

    def pull(self, end: _Ends, other: _Ends, law: _Law) -> None:
        self.statements += [
            f"z1, v1 = {self.point(*end)}",
            f"z0, v0 = {self.point(*other)}",
            f"force = spring_force(z1 - z0, v1 - v0, {', '.join(map(repr, law))})",
        ]
        for (name, _), place, sign in ((end, "z1", "1"), (other, "z0", "-1")):
            if name != GROUND:
                self.statements.append(f"push({name!r}, {place}, {sign} * force)")

    def wind(self, body: str, other: str, law: _Law) -> None:
        stiffness, rest, damping = map(repr, law)
        self.statements += [
            f"(a1, w1), (a0, w0) = {self.turn(body)}, {self.turn(other)}",
            f"torque = -{stiffness} * (a1 - a0 - {rest}) - {damping} * (w1 - w0)",
        ]
        for name, sign in ((body, "1"), (other, "-1")):
            if name != GROUND:
                self.statements.append(f"twist({name!r}, {sign} * torque)")

    def slide(self, end: _Ends, other: _Ends, law: _SlideLaw) -> None:
        axis, *numbers = map(repr, law)
        line = f"{axis}, {self.turn(other[0])}"
        self.statements += [
            f"z1, v1 = {self.point(*end)}",
            f"z0, v0 = {self.point(*other)}",
            f"force = slide_force(z1 - z0, v1 - v0, {line}, {', '.join(numbers)})",
        ]
        for (name, _), sign in ((end, "1"), (other, "-1")):
            if name != GROUND:
                self.statements.append(f"push({name!r}, z1, {sign} * force)")

    def push(self, body: str, arm: complex, force: complex) -> None:
        self.statements.append(f"push({body!r}, {self.point(body, arm)}[0], {force!r})")

    def twist(self, body: str, torque: float) -> None:
        self.statements.append(f"twist({body!r}, {torque!r})")


_GIVEN: elements.ElementTable[Callable[[GivenForces, Any, _Target], None]] = elements.ElementTable(
    "forces given before each step",
    elements.FORCE_ELEMENTS,
    {
        elements.SpringDamper: GivenForces.pull,
        elements.RotationalSpringDamper: GivenForces.wind,
        elements.ConstantForce: GivenForces.push,
        elements.ConstantTorque: GivenForces.twist,
        elements.SlideSpringDamper: GivenForces.slide,
    },
    others="our adapter gives no such force",
)


def program(mechanism: Mechanism) -> tuple[list[str], list[str]]:
    """Definitions and statements of a program that gives the forces before a step.

    The statements call `centre`, `push` and `twist` as :class:`Bodies` has them, and read the
    mechanism's coordinates and speeds from arrays `q` and `u`.
    """
    forces = GivenForces(mechanism)
    written = _Written(forces)
    for element in mechanism.force_elements:
        _GIVEN[element](forces, element, written)
    functions: list[Callable[..., Any]] = [spring_force, point_of]
    if any("slide_force(" in statement for statement in written.statements):
        functions.append(slide_force)
    return [inspect.getsource(each) for each in functions], written.statements
