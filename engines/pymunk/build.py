"""A mechanism made of Chipmunk's bodies and constraints.

Chipmunk knows no massless body and no inertia of zero, so each body of the mechanism is given as one that moves
alike (equal mass, first and second moment about its pin):

- a *bob*: a body that hangs on another one is a point mass at its centre of oscillation, on a massless rod, and the
  rest of its mass sits on the pin, in the other body. A point mass on a massless rod is its own bob.
- a *turning* body keeps its inertia. Where it is pinned to the ground, mass on the pin never moves: given a large
  one, the body hardly has an arm from its centre to the pin, and the pin hardly couples with the other joints.

Chipmunk's angles are counter-clockwise, the mechanism's clockwise. Local points are complex numbers a + i b.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np
import pymunk
from pymunk import constraints

from ...models.arrays import FloatArray
from ...models.errors import UnsupportedProblemError
from ...models.kinematics import Kinematics
from ...models.mechanism import GROUND, Body, Mechanism, PinJoint, PointStop, SlotJoint, Stop

_SAME_POINT = 1e-12  # [m]
_RAIL = 1.0  # [m] length of the link that holds a point on a line


@dataclass
class Part:
    """How a body of the mechanism stands in the space."""

    name: str
    body: pymunk.Body
    reference: complex
    """The engine body's centre, in the mechanism's body frame [m]."""
    pin: complex
    """Where the body hangs, in its own frame [m]."""
    turns: bool
    """Whether the engine body has an angle of its own; a bob has not."""


@dataclass
class Rod:
    """A PinJoint and its two ends; None is the ground."""

    joint: constraints.PinJoint
    a: pymunk.Body | None
    b: pymunk.Body
    end_a: tuple[float, float]
    end_b: tuple[float, float]
    length: float
    """[m]"""
    axis: complex | None = None
    """Direction in which the end on the ground has to go along with the other one: the link across a line."""


@dataclass
class Machine:
    """A space with all it takes to step and to read it."""

    space: pymunk.Space
    mechanism: Mechanism
    parts: dict[str, Part]
    rods: list[Rod] = field(default_factory=list[Rod])
    stops: dict[str, constraints.Constraint] = field(default_factory=dict[str, constraints.Constraint])

    @property
    def bodies(self) -> list[pymunk.Body]:
        """Engine bodies in the order of the mechanism's."""
        return [self.parts[body.name].body for body in self.mechanism.bodies]


@dataclass(frozen=True)
class _Weights:
    """Mass [kg], centre [m] and inertia about it [kg m^2] of a body with what was moved onto it."""

    mass: float
    centre: complex
    inertia: float

    def with_mass_at(self, point: complex, mass: float) -> _Weights:
        if _same(point, self.centre):  # keeps the inertia of a point mass at exactly 0
            return _Weights(self.mass + mass, self.centre, self.inertia)
        total = self.mass + mass
        centre = (self.mass * self.centre + mass * point) / total
        inertia = self.inertia + self.mass * mass / total * abs(point - self.centre) ** 2
        return _Weights(total, centre, inertia)

    def with_pivot_mass(self, pin: complex, factor: float) -> _Weights:
        """The same body about a fixed pin, its mass multiplied."""
        arm = self.centre - pin
        inertia = self.inertia + self.mass * abs(arm) ** 2 * (1 - 1 / factor)
        return _Weights(self.mass * factor, pin + arm / factor, inertia)


def build(mechanism: Mechanism, closed: Collection[str], error_bias: float, pivot_mass: float) -> Machine:
    """The mechanism in its start position and with its start speeds, the named stops closed.

    Raises:
        UnsupportedProblemError: it has a part that has no counterpart here; the sentence names it.
    """
    return _Builder(mechanism, error_bias, pivot_mass).machine_with(closed)


class _Builder:
    def __init__(self, mechanism: Mechanism, error_bias: float, pivot_mass: float) -> None:
        self.mechanism = mechanism
        self.error_bias = error_bias
        self.pivot_mass = pivot_mass
        self.joints = {joint.child: joint for joint in mechanism.tree_joints}
        space = pymunk.Space()
        space.gravity = (0.0, -mechanism.gravity)
        self.machine = Machine(space, mechanism, {})

    def machine_with(self, closed: Collection[str]) -> Machine:
        for part in self._parts():
            self.machine.parts[part.name] = part
            self.machine.space.add(part.body)
        for body in self.mechanism.bodies:
            self._hang(self.machine.parts[body.name])
        for joint in self.mechanism.loop_joints:
            self._close(joint)
        for stop in self.mechanism.stops:
            if stop.closed:
                self._hold(stop, stop.name in closed)
        return self.machine

    def _parts(self) -> list[Part]:
        """Parts in the order of the bodies; leaves first, for what they leave on their parents' pins."""
        weights = {b.name: _Weights(b.mass, complex(*b.centre), b.inertia) for b in self.mechanism.bodies}
        parts: list[Part] = []
        for body in reversed(self.mechanism.bodies):
            joint, own = self.joints[body.name], weights[body.name]
            pin = complex(*joint.child_point)
            if self._is_bob(body, own, pin):
                bob, rest = _oscillator(own, pin)
                if rest > 0 and joint.parent != GROUND:
                    at = complex(*joint.parent_point)
                    weights[joint.parent] = weights[joint.parent].with_mass_at(at, rest)
                parts.append(self._part(body, bob, pin, turns=False))
            else:
                parts.append(self._part(body, self._turning(body, own, joint), pin, turns=True))
        return parts[::-1]

    def _is_bob(self, body: Body, own: _Weights, pin: complex) -> bool:
        joint, children = self.joints[body.name], self.mechanism.children(body.name)
        if isinstance(joint, SlotJoint) or _same(own.centre, pin):
            return False
        if own.inertia > 0 and (children or joint.parent == GROUND):
            return False
        if own.inertia > 0 and any(not self._is_brace(stop, body.name) for stop in self._stops_of(body.name)):
            return False
        held = self._points_held(body.name)
        if own.inertia > 0 and held:
            return False
        hung = [complex(*self.joints[child.name].parent_point) for child in children]
        return all(_same(point, own.centre) for point in (*hung, *held))

    def _stops_of(self, body: str) -> list[Stop]:
        return [stop for stop in self.mechanism.angle_stops if stop.closed and body in (stop.body, stop.relative_to)]

    def _points_held(self, body: str) -> list[complex]:
        """Points of a body at which something else than the tree holds it."""
        loops = self.mechanism.loop_joints
        ends = [(joint.parent, joint.parent_point) for joint in loops]
        ends += [(joint.child, joint.child_point) for joint in loops]
        ends += [(stop.body, stop.point) for stop in self.mechanism.point_stops if stop.closed]
        return [complex(*point) for name, point in ends if name == body]

    def _is_brace(self, stop: Stop, body: str) -> bool:
        return {stop.body, stop.relative_to} == {body, self.joints[body].parent}

    def _turning(self, body: Body, own: _Weights, joint: PinJoint | SlotJoint) -> _Weights:
        if own.inertia <= 0:
            raise UnsupportedProblemError(
                f"pymunk cannot turn the body {body.name!r}, whose inertia is 0: it can only be a point mass at "
                f"the end of a rod, with all that hangs on it or holds it at that mass."
            )
        pinned = joint.parent == GROUND and isinstance(joint, PinJoint)
        return own.with_pivot_mass(complex(*joint.child_point), self.pivot_mass) if pinned else own

    def _part(self, body: Body, weights: _Weights, pin: complex, turns: bool) -> Part:
        made = pymunk.Body(weights.mass, weights.inertia if turns else math.inf)
        kinematics = Kinematics(self.mechanism)
        row = kinematics.point(body.name, (weights.centre.real, weights.centre.imag))
        q, u = start_of(self.mechanism)
        made.position = _pair(kinematics.position(row, q))
        made.velocity = _pair(kinematics.velocity(row, q, u))
        if turns:
            index = self.mechanism.bodies.index(body)
            made.angle, made.angular_velocity = -float(q[index]), -float(u[index])
        return Part(body.name, made, weights.centre, pin, turns)

    def _end(self, name: str, point: complex) -> tuple[pymunk.Body | None, tuple[float, float]]:
        """A point of a body (or of the ground) as an end of a joint."""
        if name == GROUND:
            return None, (point.real, point.imag)
        part = self.machine.parts[name]
        arm = point - part.reference
        return part.body, (arm.real, arm.imag)

    def _add(self, joint: constraints.Constraint) -> None:
        joint.error_bias = self.error_bias
        self.machine.space.add(joint)

    def _rod(self, parent: str, parent_point: complex, child: str, child_point: complex, length: float) -> Rod:
        a, end_a = self._end(parent, parent_point)
        b, end_b = self._end(child, child_point)
        assert b is not None
        joint = constraints.PinJoint(a or self.machine.space.static_body, b, end_a, end_b)
        joint.distance = length
        return Rod(joint, a, b, end_a, end_b, length)

    def _hang(self, part: Part) -> None:
        joint = self.joints[part.name]
        at = complex(*joint.parent_point)
        if isinstance(joint, SlotJoint):
            slide = self.mechanism.start[self.mechanism.coordinates.index(joint.coordinate or "")]
            self._keep(self._link(part.name, part.pin, at, complex(*joint.axis), slide))
        elif not part.turns:
            self._keep(self._rod(joint.parent, at, part.name, part.reference, abs(part.reference - part.pin)))
        elif joint.parent == GROUND:
            b, end_b = self._end(part.name, part.pin)
            assert b is not None
            self._add(constraints.PivotJoint(self.machine.space.static_body, b, (at.real, at.imag), end_b))
        else:
            self._pin(joint.parent, at, part.name, part.pin)

    def _keep(self, rod: Rod) -> None:
        self._add(rod.joint)
        self.machine.rods.append(rod)

    def _pin(self, still: str, at: complex, turning: str, point: complex) -> None:
        # Two rods from the pin to two points of the body hold it like a pivot, and their lengths can be held.
        for direction in (1, 1j):
            self._keep(self._rod(still, at, turning, point + direction, 1.0))

    def _close(self, joint: PinJoint | SlotJoint) -> None:
        """A joint that closes a loop."""
        at, point = complex(*joint.parent_point), complex(*joint.child_point)
        if isinstance(joint, SlotJoint):
            axis = complex(*joint.axis)
            along = ((self._place(joint.child, joint.child_point) - at) * axis.conjugate()).real
            self._keep(self._link(joint.child, point, at, axis, along))
        elif self.machine.parts[joint.child].turns:
            self._pin(joint.parent, at, joint.child, point)
        elif joint.parent == GROUND:
            for direction in (1, 1j):
                self._keep(self._rod(GROUND, at + direction, joint.child, point, 1.0))
        elif self.machine.parts[joint.parent].turns:
            self._pin(joint.child, point, joint.parent, at)
        else:
            # Two point masses turn nothing: a pivot between them is linear, and so exact.
            a, b = self.machine.parts[joint.parent].body, self.machine.parts[joint.child].body
            self._add(constraints.PivotJoint(a, b, (0.0, 0.0), (0.0, 0.0)))

    def _place(self, body: str, point: tuple[float, float]) -> complex:
        """Where a body's point is at the start [m]."""
        kinematics = Kinematics(self.mechanism)
        return complex(*kinematics.position(kinematics.point(body, point), start_of(self.mechanism)[0]))

    def _link(self, body: str, point: complex, origin: complex, axis: complex, along: float) -> Rod:
        """A rod across a line, which holds a body's point `along` from the line's origin on it.

        A GrooveJoint on a body that turns about another point leaves only first order, however many passes it gets;
        a link whose foot goes along keeps the second.
        """
        rod = self._rod(GROUND, origin + axis * (along - 1j * _RAIL), body, point, _RAIL)
        rod.axis = axis
        return rod

    def _hold(self, stop: Stop | PointStop, closed: bool) -> None:
        """Close a stop, or only see that it could be."""
        held, rod = self._on_a_wall(stop) if isinstance(stop, PointStop) else self._between(stop)
        if not closed:
            return
        if rod is not None:
            self.machine.rods.append(rod)
        self._add(held)
        self.machine.stops[stop.name] = held

    def _on_a_wall(self, stop: PointStop) -> tuple[constraints.Constraint, Rod]:
        if stop.body == GROUND:
            raise UnsupportedProblemError(f"pymunk cannot hold the stop {stop.name!r}: it is on a point of the ground.")
        normal = complex(*stop.normal)
        axis = -1j * normal
        along = (self._place(stop.body, stop.point) * axis.conjugate()).real
        rod = self._link(stop.body, complex(*stop.point), stop.offset * normal, axis, along)
        return rod.joint, rod

    def _between(self, stop: Stop) -> tuple[constraints.Constraint, Rod | None]:
        bobs = [name for name in (stop.body, stop.relative_to) if name != GROUND and not self.machine.parts[name].turns]
        if not bobs:
            return self._gear(stop), None
        if len(bobs) == 1 and self._is_brace(stop, bobs[0]):
            rod = self._brace(bobs[0])
            return rod.joint, rod
        raise UnsupportedProblemError(
            f"pymunk cannot hold the stop {stop.name!r}: a point mass on a rod can only be held against the "
            f"body it hangs on, which must be able to turn."
        )

    def _gear(self, stop: Stop) -> constraints.GearJoint:
        static = self.machine.space.static_body
        b = self.machine.parts[stop.body].body if stop.body != GROUND else static
        a = self.machine.parts[stop.relative_to].body if stop.relative_to != GROUND else static
        return constraints.GearJoint(a, b, b.angle - a.angle, 1.0)

    def _brace(self, bob: str) -> Rod:
        """A rod across the bob's own, from the body it hangs on, as long as its own."""
        joint, part = self.joints[bob], self.machine.parts[bob]
        angle = dict(zip((b.name for b in self.mechanism.bodies), self.mechanism.start, strict=False)) | {GROUND: 0.0}
        along = (part.reference - part.pin) * cmath.exp(-1j * (angle[bob] - angle[joint.parent]))
        foot = complex(*joint.parent_point) + along + 1j * along
        return self._rod(joint.parent, foot, bob, part.reference, abs(along))


def start_of(mechanism: Mechanism) -> tuple[FloatArray, FloatArray]:
    """Coordinates q and speeds u at t = 0."""
    q = np.array(mechanism.start, dtype=np.float64)
    return q, np.array(mechanism.start_speeds, dtype=np.float64) if mechanism.start_speeds else np.zeros_like(q)


def _same(a: complex, b: complex) -> bool:
    return abs(a - b) <= _SAME_POINT


def _oscillator(own: _Weights, pin: complex) -> tuple[_Weights, float]:
    """The point mass that swings about the pin like the body, and the mass that is left on the pin [kg]."""
    arm = own.centre - pin
    about_pin = own.inertia + own.mass * abs(arm) ** 2
    stretch = about_pin / (own.mass * abs(arm) ** 2)
    return _Weights(own.mass / stretch, pin + stretch * arm, 0.0), own.mass * (1 - 1 / stretch)


def _pair(vector: FloatArray) -> tuple[float, float]:
    return float(vector[0]), float(vector[1])
