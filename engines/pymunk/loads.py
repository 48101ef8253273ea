"""Forces on Chipmunk's bodies that it has no element for, or one of too low an order.

Chipmunk adds `body.force` and `body.torque` to a step's impulses at its end position and then sets
them to zero, so they are set before every step: constant forces and torques, and those of dampers.
Chipmunk's own dampers slow bodies down by a factor exp(-c h / m) after all other forces of the
step, which is of first order. Here a damper's force is that of the speeds at the step's end
position, which the leapfrog has half a step later: they are extrapolated from the last two half
steps, which is of second order.

A point of a massless rod is a combination (1 - s) pin + s tip of points of Chipmunk's bodies, with
a constant complex s; forces are divided among them by virtual work.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import pymunk

from ...models.elements import SpringDamper


@dataclass(frozen=True)
class Pose:
    """Place [m, rad] and speeds [m/s, rad/s] of a body at a step's end, counter-clockwise."""

    position: complex
    angle: float
    velocity: complex
    spin: float


@dataclass
class Resultant:
    """Force on a body's centre [N] and counter-clockwise torque [N m]."""

    force: complex = 0j
    torque: float = 0.0


class LoadedBodies:
    """Poses of the bodies, and the resultants that they collect."""

    def __init__(self, pose_of: Callable[[pymunk.Body], Pose]) -> None:
        self._pose_of = pose_of
        self._poses: dict[pymunk.Body, Pose] = {}
        self.resultants: dict[pymunk.Body, Resultant] = {}

    def pose(self, body: pymunk.Body) -> Pose:
        """Pose of a body."""
        if body not in self._poses:
            self._poses[body] = self._pose_of(body)
        return self._poses[body]

    def add(self, body: pymunk.Body, force: complex, torque: float) -> None:
        """Let a force on its centre and a torque act on a body."""
        resultant = self.resultants.setdefault(body, Resultant())
        resultant.force += force
        resultant.torque += torque


@dataclass(frozen=True)
class Term:
    """A point of a body of Chipmunk's, times a complex weight."""

    weight: complex
    body: pymunk.Body
    arm: complex
    """From the body's centre, in its frame [m]."""


@dataclass(frozen=True)
class Combination:
    """A point, or a vector between points: constant + sum of weighted points of bodies."""

    constant: complex = 0j
    terms: tuple[Term, ...] = ()

    def __add__(self, other: Combination) -> Combination:
        return Combination(self.constant + other.constant, self.terms + other.terms)

    def __sub__(self, other: Combination) -> Combination:
        return self + other.times(-1.0)

    def times(self, weight: complex) -> Combination:
        """The weighted combination."""
        terms = (Term(weight * term.weight, term.body, term.arm) for term in self.terms)
        return Combination(weight * self.constant, tuple(terms))

    def place_and_speed(self, bodies: LoadedBodies) -> tuple[complex, complex]:
        """Its value [m] and the rate of that [m/s]."""
        place, speed = self.constant, 0j
        for term in self.terms:
            pose = bodies.pose(term.body)
            arm = term.arm * cmath.exp(1j * pose.angle)
            place += term.weight * (pose.position + arm)
            speed += term.weight * (pose.velocity + 1j * pose.spin * arm)
        return place, speed

    def push(self, bodies: LoadedBodies, force: complex) -> None:
        """Let a force act on it [N]: each term gets what does the same work."""
        for term in self.terms:
            share = term.weight.conjugate() * force
            arm = term.arm * cmath.exp(1j * bodies.pose(term.body).angle)
            bodies.add(term.body, share, (arm.conjugate() * share).imag)


class Angle(Protocol):
    """Angle of a body of the mechanism, clockwise."""

    def value_and_speed(self, bodies: LoadedBodies) -> tuple[float, float]:
        """[rad] and [rad/s]."""
        ...

    def push(self, bodies: LoadedBodies, torque: float) -> None:
        """Let a clockwise torque act on the body [N m]."""
        ...


@dataclass(frozen=True)
class FixedAngle:
    """Angle of the ground."""

    def value_and_speed(self, bodies: LoadedBodies) -> tuple[float, float]:
        """0."""
        return 0.0, 0.0

    def push(self, bodies: LoadedBodies, torque: float) -> None:
        """Nothing moves."""


@dataclass(frozen=True)
class EngineAngle:
    """Angle of a body that turns in Chipmunk as well."""

    body: pymunk.Body

    def value_and_speed(self, bodies: LoadedBodies) -> tuple[float, float]:
        """[rad] and [rad/s]."""
        pose = bodies.pose(self.body)
        return -pose.angle, -pose.spin

    def push(self, bodies: LoadedBodies, torque: float) -> None:
        """Let a clockwise torque act on the body [N m]."""
        bodies.add(self.body, 0j, -torque)


@dataclass
class RodAngle:
    """Angle of a point mass on a massless rod; a couple is two forces on the rod's ends."""

    rod: Combination
    """From the rod's pin to the mass."""
    arm: complex
    """The same in the body's frame [m]."""
    near: float
    """The angle at the last call, which counts full turns [rad]."""

    def value_and_speed(self, bodies: LoadedBodies) -> tuple[float, float]:
        """[rad] and [rad/s]."""
        rod, speed = self.rod.place_and_speed(bodies)
        self.near -= math.remainder(self.near + cmath.phase(rod / self.arm), 2 * math.pi)
        return self.near, -(speed / rod).imag

    def push(self, bodies: LoadedBodies, torque: float) -> None:
        """Let a clockwise torque act on the body [N m]."""
        rod, _ = self.rod.place_and_speed(bodies)
        self.rod.push(bodies, -1j * rod * torque / abs(rod) ** 2)


class Load(Protocol):
    """A force element, or a part of one, that acts through `body.force` and `body.torque`."""

    def act(self, bodies: LoadedBodies) -> None:
        """Add what it exerts in these poses."""
        ...


@dataclass(frozen=True)
class PointForce:
    """A constant force on a point."""

    point: Combination
    force: complex
    """[N]"""

    def act(self, bodies: LoadedBodies) -> None:
        """Add what it exerts in these poses."""
        self.point.push(bodies, self.force)


@dataclass(frozen=True)
class Pull:
    """A damper between two points, and its spring where Chipmunk's has no body to act on."""

    element: SpringDamper
    vector: Combination
    """From the other body's point to the body's."""
    stiffness: float
    """Stiffness of the spring that acts here [N/m]; 0 where Chipmunk's own does."""

    def act(self, bodies: LoadedBodies) -> None:
        """Add what it exerts in these poses."""
        vector, speed = self.vector.place_and_speed(bodies)
        force, length = -self.stiffness * vector, abs(vector)
        if length > 0:
            along = vector / length
            rate = (along.conjugate() * speed).real
            force += (
                self.stiffness * self.element.rest_length - self.element.damping * rate
            ) * along
        self.vector.push(bodies, force)


@dataclass(frozen=True)
class Twist:
    """A torque between two bodies: constant, of a damper, or of a spring that Chipmunk has not."""

    torque: Callable[[float, float], float]
    """Torque on the body [N m] by the relative angle [rad] and its rate [rad/s], all clockwise."""
    own: Angle
    other: Angle

    def act(self, bodies: LoadedBodies) -> None:
        """Add what it exerts in these poses."""
        (angle, speed), (other_angle, other_speed) = (
            end.value_and_speed(bodies) for end in (self.own, self.other)
        )
        torque = self.torque(angle - other_angle, speed - other_speed)
        self.own.push(bodies, torque)
        self.other.push(bodies, -torque)


@dataclass
class Loads:
    """Forces on an assembly's bodies beside gravity and Chipmunk's own joints and springs."""

    loads: list[Load] = field(default_factory=list[Load])

    def set_forces(self, pose_of: Callable[[pymunk.Body], Pose]) -> None:
        """Set the bodies' forces and torques for the next step.

        Args:
            pose_of: a body's pose at the step's end.
        """
        bodies = LoadedBodies(pose_of)
        for load in self.loads:
            load.act(bodies)
        for body, resultant in bodies.resultants.items():
            body.force = (resultant.force.real, resultant.force.imag)
            body.torque = resultant.torque
