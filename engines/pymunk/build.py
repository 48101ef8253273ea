"""A mechanism made of Chipmunk's bodies and constraints.

Chipmunk has no massless body and no inertia of zero, so each body of the mechanism is represented by one that moves
in the same way (equal mass, first and second moment about its pin):

- a *bob*: a body that is pinned to another one is a point mass at its centre of oscillation, on a massless rod, and the
  rest of its mass is at the pin, in the other body. A point mass on a massless rod is its own bob.
- a *turning* body keeps its inertia. Where it is pinned to the ground, mass at the pin never moves: a large mass there
  brings the centre close to the pin, so that the pin's impulses hardly couple with those of the other joints.

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
from ...models.joints import GROUND, AnyJoint, PinJoint, SlotJoint
from ...models.kinematics import Kinematics, initial_state
from ...models.mechanism import Body, Mechanism
from ...models.stops import PointStop, Stop

_SAME_POINT = 1e-12  # [m]
_SLIDING_LENGTH = 1.0  # [m] length of the rod that keeps a point on a line


@dataclass
class Part:
    """How a body of the mechanism is represented in the space."""

    name: str
    body: pymunk.Body
    reference: complex
    """The engine body's centre, in the mechanism's body frame [m]."""
    pin: complex
    """Where the body is pinned, in its own frame [m]."""
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
    """Direction of the line along which the end on the ground follows the other one; None if it is fixed."""


@dataclass
class Assembly:
    """A space with what is needed to step and to read it."""

    space: pymunk.Space
    mechanism: Mechanism
    parts: dict[str, Part]
    rods: list[Rod] = field(default_factory=list[Rod])
    stops: dict[str, constraints.Constraint] = field(default_factory=dict[str, constraints.Constraint])

    @property
    def bodies(self) -> list[pymunk.Body]:
        """Engine bodies in the order of the mechanism's."""
        return [self.parts[body.name].body for body in self.mechanism.bodies]

    @property
    def rates(self) -> FloatArray:
        """Velocities and angular velocities of the bodies, shape (n_bodies, 3); can be set."""
        return np.array([[*body.velocity, body.angular_velocity] for body in self.bodies])

    @rates.setter
    def rates(self, rates: FloatArray) -> None:
        for body, (x, y, spin) in zip(self.bodies, rates.tolist(), strict=True):
            body.velocity, body.angular_velocity = (x, y), spin


@dataclass(frozen=True)
class _Weights:
    """Mass [kg], centre [m] and inertia about it [kg m^2] of a body with the masses moved onto it."""

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


def build(mechanism: Mechanism, closed: Collection[str], error_bias: float, pivot_mass: float) -> Assembly:
    """The mechanism in its start position and with its start speeds, the named stops active.

    Raises:
        UnsupportedProblemError: it has a part that has no counterpart here; the sentence names it.
    """
    return _Builder(mechanism, error_bias, pivot_mass).assembly_with(closed)


class _Builder:
    def __init__(self, mechanism: Mechanism, error_bias: float, pivot_mass: float) -> None:
        self.mechanism = mechanism
        self.error_bias = error_bias
        self.pivot_mass = pivot_mass
        self.kinematics = Kinematics(mechanism)
        self.q, self.u = initial_state(mechanism)
        self.joints = {joint.child: joint for joint in mechanism.tree_joints}
        space = pymunk.Space()
        space.gravity = (0.0, -mechanism.gravity)
        self.assembly = Assembly(space, mechanism, {})

    def assembly_with(self, closed: Collection[str]) -> Assembly:
        for part in self._parts():
            self.assembly.parts[part.name] = part
            self.assembly.space.add(part.body)
        for body in self.mechanism.bodies:
            self._add_tree_joint(self.assembly.parts[body.name])
        for joint in self.mechanism.loop_joints:
            self._add_loop_joint(joint)
        for stop in self.mechanism.stops:
            if stop.closed:
                self._add_stop(stop, stop.name in closed)
        return self.assembly

    def _parts(self) -> list[Part]:
        """Parts in the order of the bodies; made from the leaves, which move mass to their parents' pins."""
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
        stops = [stop for stop in self.mechanism.angle_stops if stop.closed and body.name in stop.bodies]
        unbraced = any(not self._is_brace(stop, body.name) for stop in stops)
        constrained = self._constrained_points(body.name)
        if own.inertia > 0 and (children or joint.parent == GROUND or unbraced or constrained):
            return False
        pins = [complex(*self.joints[child.name].parent_point) for child in children]
        return all(_same(point, own.centre) for point in (*pins, *constrained))

    def _constrained_points(self, body: str) -> list[complex]:
        """Points of a body at which loop joints or stops act on it."""
        loops = self.mechanism.loop_joints
        ends = [(joint.parent, joint.parent_point) for joint in loops]
        ends += [(joint.child, joint.child_point) for joint in loops]
        ends += [(stop.body, stop.point) for stop in self.mechanism.point_stops if stop.closed]
        return [complex(*point) for name, point in ends if name == body]

    def _is_brace(self, stop: Stop, body: str) -> bool:
        return set(stop.bodies) == {body, self.joints[body].parent}

    def _turning(self, body: Body, own: _Weights, joint: AnyJoint) -> _Weights:
        if own.inertia <= 0:
            raise UnsupportedProblemError(
                f"pymunk cannot turn the body {body.name!r}, whose inertia is 0: it can only be a point mass at "
                f"the end of a rod, with all joints and stops on it at that mass."
            )
        pinned = joint.parent == GROUND and isinstance(joint, PinJoint)
        return own.with_pivot_mass(complex(*joint.child_point), self.pivot_mass) if pinned else own

    def _part(self, body: Body, weights: _Weights, pin: complex, turns: bool) -> Part:
        engine_body = pymunk.Body(weights.mass, weights.inertia if turns else math.inf)
        row = self.kinematics.point(body.name, (weights.centre.real, weights.centre.imag))
        engine_body.position = _pair(self.kinematics.position(row, self.q))
        engine_body.velocity = _pair(self.kinematics.velocity(row, self.q, self.u))
        if turns:
            index = self.mechanism.bodies.index(body)
            engine_body.angle, engine_body.angular_velocity = -float(self.q[index]), -float(self.u[index])
        return Part(body.name, engine_body, weights.centre, pin, turns)

    def _end(self, name: str, point: complex) -> tuple[pymunk.Body | None, tuple[float, float]]:
        """A point of a body (or of the ground) as an end of a joint."""
        if name == GROUND:
            return None, (point.real, point.imag)
        part = self.assembly.parts[name]
        arm = point - part.reference
        return part.body, (arm.real, arm.imag)

    def _add(self, joint: constraints.Constraint) -> None:
        joint.error_bias = self.error_bias
        self.assembly.space.add(joint)

    def _rod(self, parent: str, parent_point: complex, child: str, child_point: complex, length: float) -> Rod:
        a, end_a = self._end(parent, parent_point)
        b, end_b = self._end(child, child_point)
        assert b is not None
        joint = constraints.PinJoint(a or self.assembly.space.static_body, b, end_a, end_b)
        joint.distance = length
        return Rod(joint, a, b, end_a, end_b, length)

    def _add_tree_joint(self, part: Part) -> None:
        joint = self.joints[part.name]
        at = complex(*joint.parent_point)
        if isinstance(joint, SlotJoint):
            slide = self.mechanism.start[self.mechanism.coordinates.index(joint.coordinate or "")]
            self._add_rod(self._sliding_rod(part.name, part.pin, at, complex(*joint.axis), slide))
        elif not part.turns:
            self._add_rod(self._rod(joint.parent, at, part.name, part.reference, abs(part.reference - part.pin)))
        elif joint.parent == GROUND:
            b, end_b = self._end(part.name, part.pin)
            assert b is not None
            self._add(constraints.PivotJoint(self.assembly.space.static_body, b, (at.real, at.imag), end_b))
        else:
            self._add_pivot(joint.parent, at, part.name, part.pin)

    def _add_rod(self, rod: Rod) -> None:
        self._add(rod.joint)
        self.assembly.rods.append(rod)

    def _add_pivot(self, still: str, at: complex, turning: str, point: complex) -> None:
        # Two rods from the pin to two points of the body act as a pivot, and their lengths can be corrected.
        for direction in (1, 1j):
            self._add_rod(self._rod(still, at, turning, point + direction, 1.0))

    def _add_loop_joint(self, joint: AnyJoint) -> None:
        """A joint that closes a loop."""
        at, point = complex(*joint.parent_point), complex(*joint.child_point)
        if isinstance(joint, SlotJoint):
            axis = complex(*joint.axis)
            along = ((self._position(joint.child, joint.child_point) - at) * axis.conjugate()).real
            self._add_rod(self._sliding_rod(joint.child, point, at, axis, along))
        elif self.assembly.parts[joint.child].turns:
            self._add_pivot(joint.parent, at, joint.child, point)
        elif joint.parent == GROUND:
            for direction in (1, 1j):
                self._add_rod(self._rod(GROUND, at + direction, joint.child, point, 1.0))
        elif self.assembly.parts[joint.parent].turns:
            self._add_pivot(joint.child, point, joint.parent, at)
        else:
            # Two point masses turn nothing: a pivot between them is linear, and so exact.
            a, b = self.assembly.parts[joint.parent].body, self.assembly.parts[joint.child].body
            self._add(constraints.PivotJoint(a, b, (0.0, 0.0), (0.0, 0.0)))

    def _position(self, body: str, point: tuple[float, float]) -> complex:
        """Position of a body's point at the start [m]."""
        return complex(*self.kinematics.position(self.kinematics.point(body, point), self.q))

    def _sliding_rod(self, body: str, point: complex, origin: complex, axis: complex, along: float) -> Rod:
        """A rod across a line that keeps a body's point on it, at the start `along` from the line's origin.

        A GrooveJoint on a body that turns about another point is of first order only, however many passes it gets;
        a rod whose anchor moves along the line keeps the second order.
        """
        rod = self._rod(GROUND, origin + axis * (along - 1j * _SLIDING_LENGTH), body, point, _SLIDING_LENGTH)
        rod.axis = axis
        return rod

    def _add_stop(self, stop: Stop | PointStop, closed: bool) -> None:
        """Add a stop's joint if it is closed; raise in any case if it cannot be built."""
        joint, rod = self._point_contact(stop) if isinstance(stop, PointStop) else self._angle_limit(stop)
        if not closed:
            return
        if rod is not None:
            self.assembly.rods.append(rod)
        self._add(joint)
        self.assembly.stops[stop.name] = joint

    def _point_contact(self, stop: PointStop) -> tuple[constraints.Constraint, Rod]:
        if stop.body == GROUND:
            raise UnsupportedProblemError(f"pymunk cannot hold the stop {stop.name!r}: it is on a point of the ground.")
        normal = complex(*stop.normal)
        axis = -1j * normal
        along = (self._position(stop.body, stop.point) * axis.conjugate()).real
        rod = self._sliding_rod(stop.body, complex(*stop.point), stop.offset * normal, axis, along)
        return rod.joint, rod

    def _angle_limit(self, stop: Stop) -> tuple[constraints.Constraint, Rod | None]:
        bobs = [
            name for name in (stop.body, stop.relative_to) if name != GROUND and not self.assembly.parts[name].turns
        ]
        if not bobs:
            return self._gear(stop), None
        if len(bobs) == 1 and self._is_brace(stop, bobs[0]):
            rod = self._brace(bobs[0])
            return rod.joint, rod
        raise UnsupportedProblemError(
            f"pymunk cannot hold the stop {stop.name!r}: a point mass on a rod can only be stopped relative to the "
            f"body that it is pinned to, which must be able to turn."
        )

    def _gear(self, stop: Stop) -> constraints.GearJoint:
        static = self.assembly.space.static_body
        b = self.assembly.parts[stop.body].body if stop.body != GROUND else static
        a = self.assembly.parts[stop.relative_to].body if stop.relative_to != GROUND else static
        return constraints.GearJoint(a, b, b.angle - a.angle, 1.0)

    def _brace(self, bob: str) -> Rod:
        """A rod across the bob's own, of the same length, from the body that the bob is pinned to."""
        joint, part = self.joints[bob], self.assembly.parts[bob]
        angle = dict(zip((b.name for b in self.mechanism.bodies), self.mechanism.start, strict=False)) | {GROUND: 0.0}
        along = (part.reference - part.pin) * cmath.exp(-1j * (angle[bob] - angle[joint.parent]))
        anchor = complex(*joint.parent_point) + along + 1j * along
        return self._rod(joint.parent, anchor, bob, part.reference, abs(along))


def _same(a: complex, b: complex) -> bool:
    return abs(a - b) <= _SAME_POINT


def _oscillator(own: _Weights, pin: complex) -> tuple[_Weights, float]:
    """The point mass that swings about the pin like the body, and the mass that is left on the pin [kg]."""
    arm = own.centre - pin
    about_pin = own.inertia + own.mass * abs(arm) ** 2
    ratio = about_pin / (own.mass * abs(arm) ** 2)
    return _Weights(own.mass / ratio, pin + ratio * arm, 0.0), own.mass * (1 - 1 / ratio)


def _pair(vector: FloatArray) -> tuple[float, float]:
    return float(vector[0]), float(vector[1])
