"""Reading the mechanism's motion and forces from Chipmunk's bodies.

Angles, points and energies come from the engine bodies' positions and velocities.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...models.applied_forces import AppliedForces
from ...models.arrays import ComplexArray, FloatArray, as_vectors
from ...models.elements import GROUND, AnyJoint
from ...models.kinematics import Kinematics
from ...models.mechanism import Mechanism
from ...models.spec import Vector
from ...models.trajectory import PointMotion
from .bodies import Assembly, BodyPart, Placement, is_pin


@dataclass(frozen=True)
class BodySamples:
    """Engine bodies at the samples: values, first and second rates, shape (3, n, n_bodies)."""

    points: ComplexArray
    """Position [m], velocity [m/s] and acceleration [m/s^2], complex."""
    angles: FloatArray
    """Angle [rad], angular velocity [rad/s] and acceleration [rad/s^2], counter-clockwise."""


@dataclass(frozen=True)
class PointState:
    """A point at the samples: position, velocity, acceleration [m, s], complex, shape (n,)."""

    position: ComplexArray
    velocity: ComplexArray
    acceleration: ComplexArray

    def __sub__(self, other: PointState) -> PointState:
        """The vector from another point."""
        return PointState(
            self.position - other.position,
            self.velocity - other.velocity,
            self.acceleration - other.acceleration,
        )


@dataclass(frozen=True)
class Frame:
    """A body of the mechanism: motion of a reference point and of its clockwise angle, (n,)."""

    reference: complex
    at: PointState
    q: FloatArray
    u: FloatArray
    a: FloatArray

    def welded(self, place: Placement) -> Frame:
        """The frame of a body that this one carries: the same point is its reference."""
        reference = (self.reference - place.origin) * np.exp(1j * place.angle)
        return Frame(reference, self.at, self.q + place.angle, self.u, self.a)

    def world(self, direction: complex) -> ComplexArray:
        """A direction given in the body's frame."""
        return direction * np.exp(-1j * self.q)

    def component(
        self, direction: complex, vector: PointState
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Along a direction of this frame: a vector's component, and its first and second rate."""
        along = self.world(direction).conjugate()
        # conj(direction) turns with exp(+i q).
        rate = vector.velocity + 1j * self.u * vector.position
        second = (
            vector.acceleration
            + 2j * self.u * vector.velocity
            + (1j * self.a - self.u**2) * vector.position
        )
        return (along * vector.position).real, (along * rate).real, (along * second).real

    def point(self, local: complex) -> PointState:
        """A point given in the body's frame [m]."""
        arm = (local - self.reference) * np.exp(-1j * self.q)
        return PointState(
            self.at.position + arm,
            self.at.velocity - 1j * self.u * arm,
            self.at.acceleration - (1j * self.a + self.u**2) * arm,
        )


@dataclass
class MotionReading:
    """The mechanism's motion, from the engine bodies' samples."""

    assembly: Assembly
    samples: BodySamples
    near: FloatArray | None = None
    """Coordinates that tell the full turns of the first sample; None: those of the start."""
    frames: dict[str, Frame] = field(default_factory=dict[str, Frame])

    def __post_init__(self) -> None:
        rest = np.zeros(self.samples.points.shape[1])
        origin = np.zeros(rest.shape, dtype=np.complex128)
        still = PointState(origin, origin, origin)
        self.frames[GROUND] = Frame(0j, still, rest, rest, rest)
        for i, (name, part) in enumerate(self.assembly.parts.items()):
            self.frames[name] = self._turning(i, part) if part.turns else self._swinging(i, part)
        for name, place in self.assembly.placements.items():
            if name not in self.frames:
                self.frames[name] = self.frames[place.carrier].welded(place)

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism that the assembly was built from."""
        return self.assembly.mechanism

    def point(self, body: str, local: Vector) -> PointState:
        """A point of a body, or of the ground."""
        return self.frames[body].point(complex(*local))

    def between(self, joint: AnyJoint) -> PointState:
        """The vector from a joint's point of the parent to that of the child."""
        parent = self.point(joint.parent, joint.parent_point)
        return self.point(joint.child, joint.child_point) - parent

    def _body(self, i: int) -> PointState:
        return PointState(*self.samples.points[:, :, i])

    def _turning(self, i: int, part: BodyPart) -> Frame:
        angle, spin, spin_rate = self.samples.angles[:, :, i]
        return Frame(part.reference, self._body(i), 0.0 - angle, 0.0 - spin, -spin_rate)

    def _swinging(self, i: int, part: BodyPart) -> Frame:
        """A bob's rod points from its pin to its mass: rod = arm exp(-i q)."""
        rigid = self.assembly.rigid
        joint, (index, _) = rigid.joint_of(part.name), rigid.attitudes[part.name]
        assert index is not None
        pin, bob = self.point(joint.parent, joint.parent_point), self._body(i)
        rod = bob.position - pin.position
        q = np.unwrap(-np.angle(rod / (part.reference - part.pin)))
        near = rigid.start[index] if self.near is None else float(self.near[index])
        turns = round((near - float(q[0])) / (2 * np.pi))
        u = -((bob.velocity - pin.velocity) / rod).imag
        a = -((bob.acceleration - pin.acceleration) / rod).imag
        return Frame(part.reference, bob, q + 2 * np.pi * turns, u, a)

    def coordinates(self) -> tuple[FloatArray, FloatArray]:
        """Coordinates q and speeds u, shape (n, n_q)."""
        return self._motion[0], self._motion[1]

    @cached_property
    def _motion(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """q, u and a, shape (n, n_q)."""
        columns: list[tuple[FloatArray, FloatArray, FloatArray]] = []
        for body in self.mechanism.bodies:
            if body.angle is not None:
                frame = self.frames[body.name]
                columns.append((frame.q, frame.u, frame.a))
        for slide in self.mechanism.slides:
            frame = self.frames[slide.joint.parent]
            columns.append(frame.component(slide.direction, self.between(slide.joint)))
        q, u, a = (np.stack(values, axis=-1) for values in zip(*columns, strict=True))
        return q, u, a

    def markers(self) -> dict[str, PointMotion]:
        """Markers by name."""
        motions: dict[str, PointMotion] = {}
        for marker in self.mechanism.markers:
            at = self.point(marker.body, marker.point)
            motions[marker.name] = PointMotion(as_vectors(at.position), as_vectors(at.velocity))
        return motions

    def energies(self) -> tuple[FloatArray, FloatArray]:
        """Kinetic and potential energy [J], shape (n,)."""
        kinetic, potential = np.zeros((2, self.samples.points.shape[1]))
        weight = complex(*self.mechanism.gravity_vector)
        for body in self.mechanism.bodies:
            centre = self.point(body.name, body.centre)
            kinetic += 0.5 * (
                body.mass * np.abs(centre.velocity) ** 2
                + body.inertia * self.frames[body.name].u ** 2
            )
            potential -= body.mass * (centre.position * weight.conjugate()).real
        if self.mechanism.force_elements:
            potential += self.applied.potential_energy(self._motion[0])
        return kinetic, potential

    @cached_property
    def applied(self) -> AppliedForces:
        """The mechanism's force elements."""
        return AppliedForces(Kinematics(self.mechanism))

    @cached_property
    def applied_on_bodies(self) -> dict[str, ComplexArray]:
        """Resultant force of the force elements on each body that one acts on [N], shape (n,)."""
        forces = self.applied.on_bodies(*self.coordinates())
        return {name: force[..., 0] + 1j * force[..., 1] for name, force in forces.items()}

    @cached_property
    def applied_couples(self) -> FloatArray:
        """Couples of the force elements on the bodies of each angle [N m], (n, n_angles).

        Their generalized forces, less those of the same forces at the centres.
        """
        kinematics, (q, u) = self.applied.kinematics, self.coordinates()
        couples, rates = self.applied.generalized(q, u), kinematics.rates(q)
        for body, centre in zip(self.mechanism.bodies, kinematics.centres, strict=True):
            if body.name in self.applied_on_bodies:
                force = self.applied_on_bodies[body.name].conj()[:, None]
                couples -= (force * kinematics.gradient(centre, q, rates)).real
        return couples[:, : len(self.mechanism.angles)]

    def accelerations(self) -> FloatArray:
        """Second derivatives of the coordinates, shape (n, n_q) [rad/s^2 or m/s^2]."""
        return self._motion[2]

    def gaps(self) -> dict[str, FloatArray]:
        """Constraint drift [m], shape (n,): distance of points, or error of a bob's rod."""
        return {
            joint.name: self._drift(joint)
            for joint in self.mechanism.joints
            if joint.held_directions
        }

    def _drift(self, joint: AnyJoint) -> FloatArray:
        part, vector = self.assembly.parts.get(joint.child), self.between(joint)
        if is_pin(joint) and part and not part.turns and joint in self.mechanism.tree_joints:
            parent = self.point(joint.parent, joint.parent_point).position
            length = np.abs(self.frames[joint.child].at.position - parent)
            return np.abs(length - abs(part.reference - part.pin))
        if not joint.free_directions:
            return np.abs(vector.position)
        (across,) = joint.held_directions
        return np.abs(self.frames[joint.parent].component(across, vector)[0])


def samples_of(
    states: FloatArray, h: float, leapfrog: bool, start: FloatArray | None = None
) -> BodySamples:
    """Samples 0 ... n from rows -1 ... n.

    In a leapfrog, the velocity at a sample is the mean of those half a step before and after it:
    the energy of this state does not drift. Forces are those of the velocity increment at the
    sample, of second order there.

    Args:
        states: shape (n + 2, n_bodies, 6).
        h: the step [s].
        leapfrog: velocities of row k are at (k + 1/2) h, not at k h.
        start: the rows whose velocities belong to sample 0 instead of those of rows -1 and 0, shape
            (2, n_bodies, 6).
    """
    share = 0.5 if leapfrog else 1.0

    def with_rates(
        values: NDArray[Any], rates: NDArray[Any], at_start: NDArray[Any] | None
    ) -> NDArray[Any]:
        before, after = rates[:-1].copy(), rates[1:].copy()
        if at_start is not None:
            before[0], after[0] = at_start
        return np.stack([values[1:], share * after + (1 - share) * before, (after - before) / h])

    points, first = _points(states), None if start is None else _points(start)
    return BodySamples(
        with_rates(points[..., 0], points[..., 1], None if first is None else first[..., 1]),
        with_rates(states[..., 2], states[..., 5], None if start is None else start[..., 5]),
    )


def _points(states: FloatArray) -> ComplexArray:
    """Positions and velocities, complex, shape (..., 2)."""
    return states[..., 0:4:3] + 1j * states[..., 1:5:3]


def reading_of(assembly: Assembly, accelerations: FloatArray | None = None) -> MotionReading:
    """The bodies' present state as one sample; accelerations as its rates, zero if left out."""
    places = np.array([[*body.position, body.angle] for body in assembly.bodies])
    rates = assembly.rates
    second = np.zeros_like(rates) if accelerations is None else accelerations
    x, y, angles = np.stack([places, rates, second]).T
    return MotionReading(assembly, BodySamples((x + 1j * y).T[:, None], angles.T[:, None]))
