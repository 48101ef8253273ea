"""Reading the mechanism's motion from Chipmunk's bodies: angles, points, energies.

All quantities come from the engine bodies' positions and velocities, and forces (:mod:`.forces`) from their changes
of momentum in a step, because Chipmunk gives only the magnitude of a joint's impulse.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ...models.arrays import ComplexArray, FloatArray
from ...models.mechanism import GROUND, Mechanism, SlotJoint
from ...models.spec import Vector
from ...models.trajectory import PointMotion
from .build import Assembly, Part


@dataclass(frozen=True)
class Samples:
    """Engine bodies at the sample times, each array of shape (n, n_bodies); planar vectors are complex."""

    position: ComplexArray
    """[m]"""
    angle: FloatArray
    """Counter-clockwise [rad]."""
    velocity: ComplexArray
    """[m/s]"""
    spin: FloatArray
    """[rad/s]"""
    acceleration: ComplexArray
    """[m/s^2]"""
    spin_rate: FloatArray
    """[rad/s^2]"""


@dataclass(frozen=True)
class PointState:
    """A point at the sample times: position [m], velocity [m/s], acceleration [m/s^2], complex, shape (n,)."""

    position: ComplexArray
    velocity: ComplexArray
    acceleration: ComplexArray


@dataclass(frozen=True)
class Frame:
    """A body of the mechanism: the motion of a reference point and of its angle, clockwise, shape (n,)."""

    reference: complex
    at: PointState
    q: FloatArray
    u: FloatArray
    a: FloatArray

    def point(self, local: complex) -> PointState:
        """A point given in the body's frame [m]."""
        arm = (local - self.reference) * np.exp(-1j * self.q)
        return PointState(
            self.at.position + arm,
            self.at.velocity - 1j * self.u * arm,
            self.at.acceleration - (1j * self.a + self.u**2) * arm,
        )


@dataclass
class Reading:
    """The mechanism's motion, from the engine bodies' samples."""

    assembly: Assembly
    samples: Samples
    near: FloatArray | None = None
    """Coordinates near those of the first sample, for its angles' full turns; the mechanism's start if left out."""
    frames: dict[str, Frame] = field(default_factory=dict[str, Frame])

    def __post_init__(self) -> None:
        for i, (name, part) in enumerate(self.assembly.parts.items()):
            self.frames[name] = self._turning(i, part) if part.turns else self._swinging(i, part)

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism that the assembly was built from."""
        return self.assembly.mechanism

    def point(self, body: str, local: Vector) -> PointState:
        """A point of a body, or of the ground."""
        if body != GROUND:
            return self.frames[body].point(complex(*local))
        rest = np.zeros(len(self.samples.position), dtype=np.complex128)
        return PointState(rest + complex(*local), rest, rest)

    def _body(self, i: int) -> PointState:
        s = self.samples
        return PointState(s.position[:, i], s.velocity[:, i], s.acceleration[:, i])

    def _turning(self, i: int, part: Part) -> Frame:
        s = self.samples
        return Frame(part.reference, self._body(i), 0.0 - s.angle[:, i], 0.0 - s.spin[:, i], -s.spin_rate[:, i])

    def _swinging(self, i: int, part: Part) -> Frame:
        """A bob's rod points from its pin to its mass: rod = arm exp(-i q)."""
        joint = next(joint for joint in self.mechanism.tree_joints if joint.child == part.name)
        pin, bob = self.point(joint.parent, joint.parent_point), self._body(i)
        rod = bob.position - pin.position
        q = np.unwrap(-np.angle(rod / (part.reference - part.pin)))
        near = self.mechanism.start[i] if self.near is None else float(self.near[i])
        turns = round((near - float(q[0])) / (2 * np.pi))
        u = -((bob.velocity - pin.velocity) / rod).imag
        a = -((bob.acceleration - pin.acceleration) / rod).imag
        return Frame(part.reference, bob, q + 2 * np.pi * turns, u, a)

    def coordinates(self) -> tuple[FloatArray, FloatArray]:
        """Coordinates q and speeds u, shape (n, n_q)."""
        q = [self.frames[body.name].q for body in self.mechanism.bodies]
        u = [self.frames[body.name].u for body in self.mechanism.bodies]
        for joint in self.mechanism.slides:
            pin, axis = self.point(joint.child, joint.child_point), complex(*joint.axis)
            q.append(((pin.position - complex(*joint.parent_point)) * axis.conjugate()).real)
            u.append((pin.velocity * axis.conjugate()).real)
        return np.stack(q, axis=-1), np.stack(u, axis=-1)

    def markers(self) -> dict[str, PointMotion]:
        """Markers by name."""
        found: dict[str, PointMotion] = {}
        for marker in self.mechanism.markers:
            at = self.point(marker.body, marker.point)
            found[marker.name] = PointMotion(as_vectors(at.position), as_vectors(at.velocity))
        return found

    def energies(self) -> tuple[FloatArray, FloatArray]:
        """Kinetic and potential energy [J], shape (n,)."""
        kinetic, potential = np.zeros(len(self.samples.position)), np.zeros(len(self.samples.position))
        for body in self.mechanism.bodies:
            centre = self.point(body.name, body.centre)
            kinetic += 0.5 * (body.mass * np.abs(centre.velocity) ** 2 + body.inertia * self.frames[body.name].u ** 2)
            potential += body.mass * self.mechanism.gravity * centre.position.imag
        return kinetic, potential

    def accelerations(self) -> FloatArray:
        """Second derivatives of the coordinates, shape (n, n_q) [rad/s^2 or m/s^2]."""
        found = [self.frames[body.name].a for body in self.mechanism.bodies]
        for slot in self.mechanism.slides:
            pin = self.point(slot.child, slot.child_point).acceleration
            found.append((pin * complex(*slot.axis).conjugate()).real)
        return np.stack(found, axis=-1)

    def gaps(self) -> dict[str, FloatArray]:
        """Constraint drift: distance of a joint's points [m], shape (n,); for a bob, the error of its rod's length."""
        found: dict[str, FloatArray] = {}
        tree = self.mechanism.tree_joints
        for joint in self.mechanism.joints:
            parent = self.point(joint.parent, joint.parent_point).position
            difference = self.point(joint.child, joint.child_point).position - parent
            if isinstance(joint, SlotJoint):
                difference = (difference * complex(*joint.axis).conjugate()).imag
            elif joint in tree and not self.assembly.parts[joint.child].turns:
                part = self.assembly.parts[joint.child]
                difference = np.abs(self.frames[joint.child].at.position - parent) - abs(part.reference - part.pin)
            found[joint.name] = np.abs(difference)
        return found


def samples_of(states: FloatArray, h: float, leapfrog: bool) -> Samples:
    """Samples 0 ... n from rows -1 ... n.

    In a leapfrog, the velocity at a sample is the mean of those half a step before and after it: the energy of this
    state does not drift. Forces are those of the velocity increment at the sample, of second order there.

    Args:
        states: shape (n + 2, n_bodies, 6).
        h: the step [s].
        leapfrog: velocities of row k are at (k + 1/2) h, not at k h.
    """
    position, rates = states[1:, :, 0] + 1j * states[1:, :, 1], states[..., 3] + 1j * states[..., 4]
    spins, share = states[..., 5], 0.5 if leapfrog else 1.0
    return Samples(
        position=position,
        angle=states[1:, :, 2],
        velocity=share * rates[1:] + (1 - share) * rates[:-1],
        spin=share * spins[1:] + (1 - share) * spins[:-1],
        acceleration=(rates[1:] - rates[:-1]) / h,
        spin_rate=(spins[1:] - spins[:-1]) / h,
    )


def as_vectors(z: ComplexArray) -> FloatArray:
    """Planar vectors, shape (..., 2)."""
    return np.stack([z.real, z.imag], axis=-1)
