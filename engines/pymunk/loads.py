"""Forces on Chipmunk's bodies that it has no element for, or one of too low an order.

Chipmunk adds `body.force` and `body.torque` to a step's impulses at its end position and then sets
them to zero, so they are set before every step: constant forces and torques, and those of dampers.
A record of efforts is constant here: a run begins anew where one changes (:mod:`.motion`). Springs
along slides are forces as well: Chipmunk's act between points.
Chipmunk's own dampers slow bodies down by a factor exp(-c h / m) after all other forces of the
step, which is of first order. Here a damper's force is that of the speeds at the step's end
position, which the leapfrog has half a step later: they are extrapolated from the last two half
steps, which is of second order.

A point of a massless rod is a combination (1 - s) pin + s tip of points of Chipmunk's bodies, with
a constant complex s; forces are divided among them by virtual work.
"""

from __future__ import annotations

import cmath
import functools
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import pymunk

from ...models.elements import SpringDamper


@dataclass(frozen=True)
class Pose:
    """Place [m, rad] and speeds [m/s, rad/s] of a body at a step's end, counter-clockwise."""

    position: complex
    angle: float
    velocity: complex
    spin: float


class LoadedBodies:
    """Poses of the bodies at a step's end, and the forces and torques that act on them there."""

    def __init__(self, pose_of: Callable[[pymunk.Body], Pose]) -> None:
        self.pose = functools.cache(pose_of)
        self.resultants: dict[pymunk.Body, tuple[complex, float]] = {}
        """Force on each body's centre [N] and counter-clockwise torque [N m]."""

    def add(self, body: pymunk.Body, force: complex, torque: float) -> None:
        """Add a force on a body's centre [N] and a torque [N m]."""
        total, moment = self.resultants.get(body, (0j, 0.0))
        self.resultants[body] = total + force, moment + torque


Load = Callable[[LoadedBodies], None]
"""A force element, or a part of one: adds to the bodies what it exerts in their poses."""


def set_forces(loads: Iterable[Load], pose_of: Callable[[pymunk.Body], Pose]) -> None:
    """Set forces and torques of the bodies for the next step, from their poses at its end."""
    bodies = LoadedBodies(pose_of)
    for load in loads:
        load(bodies)
    for body, (force, torque) in bodies.resultants.items():
        body.force, body.torque = (force.real, force.imag), torque


@dataclass(frozen=True)
class Term:
    """A point of a body of Chipmunk's, times a complex weight."""

    weight: complex
    body: pymunk.Body
    arm: complex  # from the body's centre, in its frame [m]


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


@dataclass(frozen=True)
class EngineAngle:
    """Clockwise angle of a body that turns in Chipmunk as well; None: of the ground."""

    body: pymunk.Body | None

    def value_and_speed(self, bodies: LoadedBodies) -> tuple[float, float]:
        """[rad] and [rad/s]."""
        if self.body is None:
            return 0.0, 0.0
        pose = bodies.pose(self.body)
        return -pose.angle, -pose.spin

    def push(self, bodies: LoadedBodies, torque: float) -> None:
        """Let a clockwise torque act on the body [N m]."""
        if self.body is not None:
            bodies.add(self.body, 0j, -torque)


@dataclass
class RodAngle:
    """Clockwise angle of a point mass on a massless rod; a couple is two forces on its ends."""

    rod: Combination  # from the rod's pin to the mass
    arm: complex  # the same in the body's frame [m]
    near: float  # the angle at the last call, which counts full turns [rad]

    def value_and_speed(self, bodies: LoadedBodies) -> tuple[float, float]:
        """[rad] and [rad/s]."""
        rod, speed = self.rod.place_and_speed(bodies)
        self.near -= math.remainder(self.near + cmath.phase(rod / self.arm), 2 * math.pi)
        return self.near, -(speed / rod).imag

    def push(self, bodies: LoadedBodies, torque: float) -> None:
        """Let a clockwise torque act on the body [N m]."""
        rod, _ = self.rod.place_and_speed(bodies)
        self.rod.push(bodies, -1j * rod * torque / abs(rod) ** 2)


def pull(element: SpringDamper, vector: Combination, stiffness: float) -> Load:
    """A damper along a vector, and its spring where Chipmunk's has no body to act on.

    The stiffness [N/m] is 0 where Chipmunk's own spring acts.
    """

    def act(bodies: LoadedBodies) -> None:
        between, speed = vector.place_and_speed(bodies)
        force, length = -stiffness * between, abs(between)
        if length > 0:
            along = between / length
            rate = (along.conjugate() * speed).real
            force += (stiffness * element.rest_length - element.damping * rate) * along
        vector.push(bodies, force)

    return act


def twist(
    torque: Callable[[float, float], float],
    angle: EngineAngle | RodAngle,
    other: EngineAngle | RodAngle,
) -> Load:
    """A torque between two bodies: constant, of a damper, or of a spring that Chipmunk has not.

    On the first one [N m], by the relative angle [rad] and its rate [rad/s], all clockwise.
    """

    def act(bodies: LoadedBodies) -> None:
        value, speed = angle.value_and_speed(bodies)
        other_value, other_speed = other.value_and_speed(bodies)
        exerted = torque(value - other_value, speed - other_speed)
        angle.push(bodies, exerted)
        other.push(bodies, -exerted)

    return act


@dataclass(frozen=True)
class SlideLine:
    """A line of a body along which a point of another one slides."""

    body: pymunk.Body | None  # None: a line of the ground
    origin: Combination  # point of the line where the slide is 0
    axis: complex  # its direction in the body's frame


def slide_force(
    force: Callable[[float, float], float], point: Combination, line: SlideLine
) -> Load:
    """A force on a point along a line, and the opposite on the line's body there.

    By the slide [m] and its rate [m/s], [N].
    """

    def act(bodies: LoadedBodies) -> None:
        axis, spin = line.axis, 0.0
        if line.body is not None:
            pose = bodies.pose(line.body)
            axis, spin = axis * cmath.exp(1j * pose.angle), pose.spin
        (place, speed), (origin, origin_speed) = (
            each.place_and_speed(bodies) for each in (point, line.origin)
        )
        slide = axis.conjugate() * (place - origin)
        rate = axis.conjugate() * (speed - origin_speed) - 1j * spin * slide
        along = force(slide.real, rate.real) * axis
        point.push(bodies, along)
        if line.body is not None:
            arm = place - bodies.pose(line.body).position
            bodies.add(line.body, -along, -(arm.conjugate() * along).imag)

    return act
