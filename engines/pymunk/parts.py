"""How the bodies of a mechanism without welds are represented by Chipmunk's.

Chipmunk has no massless body and no inertia of zero, so each body of the mechanism is represented
by one that moves in the same way (equal mass, first and second moment about its pin):

- a *bob*: a body that is pinned to another one is a point mass at its centre of oscillation, on a
  massless rod, and the rest of its mass is at the pin, in the other body. A point mass on a
  massless rod is its own bob.
- a *turning* body keeps its inertia. Where it is pinned to the ground, mass at the pin never moves:
  a large mass there brings the centre close to the pin, so that the pin's impulses hardly couple
  with those of the other joints.
- a point mass on which something else acts than at its mass gets an inertia by mass at its pin,
which moves no
  differently: where it is pinned to the ground as above, elsewhere by mass that its parent has
  less.
- bodies that turn together (prismatic joints) share their inertia evenly, for only its sum counts:
  a slider may be a point mass. Those that do not turn at all get an infinite one.
"""

from __future__ import annotations

import math

import pymunk

from ...models.errors import UnsupportedProblemError
from ...models.joints import GROUND, AnyJoint, PinJoint
from ...models.kinematics import Kinematics, initial_state
from ...models.mechanism import Body, Mechanism
from ...models.stops import Stop
from .assembly import Part
from .welds import Weights, same_point

_LEAST_PIVOT_MASS = (
    2.0  # of a point mass on a rod that is pinned to the ground, in multiples of its own
)


def parts_of(mechanism: Mechanism, pivot_mass: float) -> list[Part]:
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

    def parts(self) -> list[Part]:
        """Made from the leaves, which move mass to their parents' pins."""
        weights = self._weights()
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
                own = self._with_inertia(own, joint, weights)
                parts.append(self._part(body, self._turning(body, own, joint), pin, turns=True))
        return parts[::-1]

    def _weights(self) -> dict[str, Weights]:
        """The bodies' own weights, but the inertia shared by those that turn together."""
        weights = {body.name: Weights.of(body) for body in self.mechanism.bodies}
        groups: dict[int | None, list[str]] = {}
        for name in weights:
            groups.setdefault(self.attitudes[name][0], []).append(name)
        for index, group in groups.items():
            if len(group) > 1 or index is None:
                total = (
                    math.inf
                    if index is None
                    else math.fsum(weights[name].inertia for name in group)
                )
                each = total / len(group)
                weights |= {
                    name: Weights(weights[name].mass, weights[name].centre, each) for name in group
                }
        return weights

    def _is_bob(self, body: Body, own: Weights, pin: complex) -> bool:
        joint, children = self.joints[body.name], self.mechanism.children(body.name)
        if (
            not isinstance(joint, PinJoint)
            or same_point(own.centre, pin)
            or self._guides(body.name)
        ):
            return False
        stops = [
            stop for stop in self.mechanism.angle_stops if stop.closed and body.name in stop.bodies
        ]
        unbraced = any(not is_brace(self.mechanism, stop, body.name) for stop in stops)
        constrained = self._constrained_points(body.name)
        loaded = any(body.name in element.bodies for element in self.mechanism.force_elements)
        if own.inertia > 0 and (
            children or joint.parent == GROUND or unbraced or constrained or loaded
        ):
            return False
        pins = [complex(*self.joints[child.name].parent_point) for child in children]
        return all(same_point(point, own.centre) for point in (*pins, *constrained))

    def _guides(self, body: str) -> bool:
        """Whether another joint or a wall needs the body's angle."""
        joints = [
            joint
            for joint in self.mechanism.joints
            if joint.parent == body and joint.free_directions
        ]
        joints += [
            joint
            for joint in self.mechanism.loop_joints
            if joint.holds_angle and joint.child == body
        ]
        joints += [
            joint for joint in self.mechanism.joints if joint.holds_angle and joint.parent == body
        ]
        walls = [
            stop for stop in self.mechanism.point_stops if stop.closed and stop.relative_to == body
        ]
        return bool(joints or walls)

    def _constrained_points(self, body: str) -> list[complex]:
        """Points of a body at which loop joints or stops act on it."""
        loops = self.mechanism.loop_joints
        ends = [(joint.parent, joint.parent_point) for joint in loops]
        ends += [(joint.child, joint.child_point) for joint in loops]
        ends += [(stop.body, stop.point) for stop in self.mechanism.point_stops if stop.closed]
        return [complex(*point) for name, point in ends if name == body]

    def _with_inertia(self, own: Weights, joint: AnyJoint, weights: dict[str, Weights]) -> Weights:
        """A point mass with mass at its pin that its parent lends, if it can."""
        pin, at = complex(*joint.child_point), complex(*joint.parent_point)
        if (
            own.inertia > 0
            or not isinstance(joint, PinJoint)
            or joint.parent == GROUND
            or same_point(own.centre, pin)
        ):
            return own
        lent = min(own.mass, weights[joint.parent].spare_mass(at) / 2)
        weights[joint.parent] = weights[joint.parent].with_mass_at(at, -lent)
        return own.with_mass_at(pin, lent)

    def _turning(self, body: Body, own: Weights, joint: AnyJoint) -> Weights:
        if joint.parent == GROUND and isinstance(joint, PinJoint):
            factor = self.pivot_mass if own.inertia > 0 else max(self.pivot_mass, _LEAST_PIVOT_MASS)
            own = own.with_pivot_mass(complex(*joint.child_point), factor)
        if own.inertia <= 0:
            raise UnsupportedProblemError(
                f"pymunk cannot turn the body {body.name!r}, whose inertia is 0: it can only be a point mass at "
                f"the end of a rod that is pinned to the ground or to a body with an inertia."
            )
        return own

    def _part(self, body: Body, weights: Weights, pin: complex, turns: bool) -> Part:
        engine_body = pymunk.Body(weights.mass, weights.inertia if turns else math.inf)
        row = self.kinematics.point(body.name, (weights.centre.real, weights.centre.imag))
        x, y = self.kinematics.position(row, self.q).tolist()
        engine_body.position = x, y
        x, y = self.kinematics.velocity(row, self.q, self.u).tolist()
        engine_body.velocity = x, y
        if turns:
            index, turned = self.attitudes[body.name]
            engine_body.angle = -(turned if index is None else float(self.q[index]) + turned)
            engine_body.angular_velocity = 0.0 if index is None else -float(self.u[index])
        return Part(body.name, engine_body, weights.centre, pin, turns)


def _oscillator(own: Weights, pin: complex) -> tuple[Weights, float]:
    """The point mass that swings about the pin like the body, and the mass that is left on the pin [kg]."""
    arm = own.centre - pin
    about_pin = own.inertia + own.mass * abs(arm) ** 2
    ratio = about_pin / (own.mass * abs(arm) ** 2)
    return Weights(own.mass / ratio, pin + ratio * arm, 0.0), own.mass * (1 - 1 / ratio)
