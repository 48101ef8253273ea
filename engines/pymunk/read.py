"""Reading the mechanism's motion and forces from Chipmunk's bodies.

Angles, points and energies come from the engine bodies' positions and velocities. Forces come from the bodies' changes
of momentum in a step, because Chipmunk gives only the magnitude of a joint's impulse: constraint forces are the rates
of change of momentum and angular momentum, less gravity. A joint of the tree carries all bodies that it supports; the
forces of joints that close a loop and of active stops are the least-squares solution of G^T lam = r, with the residual
r of the equations of motion without them:

    r_k = for an angle, the couple on its body beyond gravity and the tree's forces; for a slide, the force along it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...models.arrays import ComplexArray, FloatArray
from ...models.joints import GROUND, SlotJoint
from ...models.kinematics import Kinematics
from ...models.mechanism import Mechanism
from ...models.spec import Vector
from ...models.stops import Stop
from ...models.trajectory import PointMotion
from ..contact_events import Contacts
from .build import Assembly, Part

_SINGULAR = 1e-10  # of the largest singular value: constraints more nearly dependent than this share their force evenly


@dataclass(frozen=True)
class Samples:
    """Engine bodies at the sample times: values and their first and second rates, shape (3, n, n_bodies)."""

    points: ComplexArray
    """Position [m], velocity [m/s] and acceleration [m/s^2], complex."""
    angles: FloatArray
    """Angle [rad], angular velocity [rad/s] and acceleration [rad/s^2], counter-clockwise."""


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
        rest = np.zeros(self.samples.points.shape[1], dtype=np.complex128)
        return PointState(rest + complex(*local), rest, rest)

    def _body(self, i: int) -> PointState:
        return PointState(*self.samples.points[:, :, i])

    def _turning(self, i: int, part: Part) -> Frame:
        angle, spin, spin_rate = self.samples.angles[:, :, i]
        return Frame(part.reference, self._body(i), 0.0 - angle, 0.0 - spin, -spin_rate)

    def _swinging(self, i: int, part: Part) -> Frame:
        """A bob's rod points from its pin to its mass: rod = arm exp(-i q)."""
        joint = self.mechanism.joint_of(part.name)
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
        for slide in self.mechanism.slides:
            pin, along = self.point(slide.joint.child, slide.joint.child_point), slide.direction.conjugate()
            q.append(((pin.position - complex(*slide.joint.parent_point)) * along).real)
            u.append((pin.velocity * along).real)
        return np.stack(q, axis=-1), np.stack(u, axis=-1)

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
        for body in self.mechanism.bodies:
            centre = self.point(body.name, body.centre)
            kinetic += 0.5 * (body.mass * np.abs(centre.velocity) ** 2 + body.inertia * self.frames[body.name].u ** 2)
            potential += body.mass * self.mechanism.gravity * centre.position.imag
        return kinetic, potential

    def accelerations(self) -> FloatArray:
        """Second derivatives of the coordinates, shape (n, n_q) [rad/s^2 or m/s^2]."""
        accelerations = [self.frames[body.name].a for body in self.mechanism.bodies]
        for slide in self.mechanism.slides:
            pin = self.point(slide.joint.child, slide.joint.child_point).acceleration
            accelerations.append((pin * slide.direction.conjugate()).real)
        return np.stack(accelerations, axis=-1)

    def gaps(self) -> dict[str, FloatArray]:
        """Constraint drift: distance of a joint's points [m], shape (n,); for a bob, the error of its rod's length."""
        drifts: dict[str, FloatArray] = {}
        tree = self.mechanism.tree_joints
        for joint in self.mechanism.joints:
            parent = self.point(joint.parent, joint.parent_point).position
            difference = self.point(joint.child, joint.child_point).position - parent
            if isinstance(joint, SlotJoint):
                difference = (difference * complex(*joint.axis).conjugate()).imag
            elif joint in tree and not self.assembly.parts[joint.child].turns:
                part = self.assembly.parts[joint.child]
                difference = np.abs(self.frames[joint.child].at.position - parent) - abs(part.reference - part.pin)
            drifts[joint.name] = np.abs(difference)
        return drifts


def samples_of(states: FloatArray, h: float, leapfrog: bool) -> Samples:
    """Samples 0 ... n from rows -1 ... n.

    In a leapfrog, the velocity at a sample is the mean of those half a step before and after it: the energy of this
    state does not drift. Forces are those of the velocity increment at the sample, of second order there.

    Args:
        states: shape (n + 2, n_bodies, 6).
        h: the step [s].
        leapfrog: velocities of row k are at (k + 1/2) h, not at k h.
    """
    share = 0.5 if leapfrog else 1.0

    def with_rates(values: NDArray[Any], rates: NDArray[Any]) -> NDArray[Any]:
        return np.stack([values[1:], share * rates[1:] + (1 - share) * rates[:-1], (rates[1:] - rates[:-1]) / h])

    points = states[..., 0:4:3] + 1j * states[..., 1:5:3]
    return Samples(with_rates(points[..., 0], points[..., 1]), with_rates(states[..., 2], states[..., 5]))


def as_vectors(z: ComplexArray) -> FloatArray:
    """Planar vectors, shape (..., 2)."""
    return np.stack([z.real, z.imag], axis=-1)


def reading_of(assembly: Assembly, accelerations: FloatArray | None = None) -> Reading:
    """The bodies' present state as one sample; accelerations as its rates, zero if left out."""
    places, rates = np.array([[*body.position, body.angle] for body in assembly.bodies]), assembly.rates
    x, y, angles = np.stack([places, rates, np.zeros_like(rates) if accelerations is None else accelerations]).T
    return Reading(assembly, Samples((x + 1j * y).T[:, None], angles.T[:, None]))


@dataclass(frozen=True)
class Forces:
    """Forces of joints and stops at the samples."""

    reactions: Mapping[str, ComplexArray]
    """Force of each joint on its child [N], complex, shape (n,)."""
    torques: Mapping[str, FloatArray]
    """Of the active stops [N m, or N for one on a point], shape (n,)."""


def forces_of(reading: Reading, active: Contacts) -> Forces:
    """Forces of all joints and of the active stops."""
    mechanism, needed = reading.mechanism, _needed(reading)
    points = [stop for stop in mechanism.point_stops if stop.name in active]
    if not mechanism.loop_joints and not points:
        reactions = _tree_reactions(mechanism, needed)
        return Forces(reactions, _angle_torques(reading, reactions, active))
    multipliers = _multipliers(reading, needed, active)
    loops = _loop_forces(mechanism, multipliers)
    torques = dict(zip(active, multipliers.T[multipliers.shape[1] - len(active) :], strict=True))
    for joint in mechanism.loop_joints:
        _act(needed, joint.child, -loops[joint.name])
        _act(needed, joint.parent, loops[joint.name])
    for stop in points:
        _act(needed, stop.body, -complex(*stop.normal) * torques[stop.name])
    return Forces(_tree_reactions(mechanism, needed) | loops, torques)


def _needed(reading: Reading) -> dict[str, ComplexArray]:
    """Force that each body's momentum needs beyond gravity [N]."""
    mechanism, needed = reading.mechanism, dict[str, ComplexArray]()
    for body in mechanism.bodies:
        centre = reading.point(body.name, body.centre)
        needed[body.name] = body.mass * (centre.acceleration + 1j * mechanism.gravity)
    return needed


def _act(needed: dict[str, ComplexArray], body: str, force: ComplexArray) -> None:
    if body != GROUND:
        needed[body] = needed[body] + force


def _tree_reactions(mechanism: Mechanism, needed: Mapping[str, ComplexArray]) -> dict[str, ComplexArray]:
    forces: dict[str, ComplexArray] = {}
    for joint in mechanism.tree_joints:
        force = np.zeros_like(needed[joint.child])
        for body in mechanism.subtree(joint.child):
            force += needed[body.name]
        forces[joint.name] = force
    return forces


def _angle_torques(reading: Reading, reactions: Mapping[str, ComplexArray], active: Contacts) -> dict[str, FloatArray]:
    """Torques of active stops on angles, if all joints are of the tree."""
    if not active:
        return {}
    by_name = {stop.name: stop for stop in reading.mechanism.angle_stops}
    stops = [by_name[name] for name in active]
    outer = sorted({_outer(reading.mechanism, stop) for stop in stops})
    names = [body.name for body in reading.mechanism.bodies]
    couples = [_couple(reading, names[i], reactions) for i in outer]
    rows = np.array([[_share(stop, names[i]) for i in outer] for stop in stops])
    # The large forces nearer to the ground do not enter the equation of a stop's outer body.
    solved = np.linalg.lstsq(rows.T, np.array(couples), rcond=None)[0]
    return dict(zip(active, solved, strict=True))


def _outer(mechanism: Mechanism, stop: Stop) -> int:
    names = [body.name for body in mechanism.bodies]
    return max(names.index(name) for name in (stop.body, stop.relative_to) if name != GROUND)


def _share(stop: Stop, body: str) -> float:
    """Derivative of the stop's gap by the body's angle."""
    return float(stop.sense * ((body == stop.body) - (body == stop.relative_to)))


def _couple(reading: Reading, name: str, reactions: Mapping[str, ComplexArray]) -> FloatArray:
    """Clockwise couple that acts on a body besides gravity and the tree's forces [N m]."""
    body, frame = reading.mechanism.body(name), reading.frames[name]
    centre = reading.point(name, body.centre).position
    couple = body.inertia * frame.a
    for joint in reading.mechanism.tree_joints:
        if joint.child == name:
            couple = couple + _cross(reading.point(name, joint.child_point).position - centre, reactions[joint.name])
        elif joint.parent == name:
            couple = couple - _cross(reading.point(name, joint.parent_point).position - centre, reactions[joint.name])
    return couple


def _multipliers(reading: Reading, needed: Mapping[str, ComplexArray], active: Contacts) -> FloatArray:
    """Multipliers of the loop joints, component by component, then of the active stops; shape (n, n_constraints).

    Errors of r are those of accelerations times the mass matrix M, so the inverse of M is their weight: the equation of
    a light body determines a small force better than that of a heavy one nearer to the ground.
    """
    kinematics = Kinematics(reading.mechanism)
    q = reading.coordinates()[0]
    rows = _rows(kinematics, q, active)
    root = np.linalg.cholesky(_mass_matrix(kinematics, q))
    columns = np.linalg.solve(root, np.swapaxes(rows, 1, 2))
    missing = np.linalg.solve(root, _missing(reading, needed)[..., None])
    return np.asarray((np.linalg.pinv(columns, rcond=_SINGULAR) @ missing)[..., 0], dtype=np.float64)


def _missing(reading: Reading, needed: Mapping[str, ComplexArray]) -> FloatArray:
    """r, shape (n, n_q): the generalized forces that no joint of the tree exerts [N m or N]."""
    mechanism = reading.mechanism
    reactions = _tree_reactions(mechanism, needed)
    couples = [_couple(reading, body.name, reactions) for body in mechanism.bodies]
    along = [(reactions[slide.joint.name] * slide.direction.conjugate()).real for slide in mechanism.slides]
    return np.stack([*couples, *along], axis=-1)


def _rows(kinematics: Kinematics, q: FloatArray, active: Contacts) -> FloatArray:
    """G: Jacobian of the loop joints' gaps and of the active stops', shape (n, n_constraints, n_q)."""
    rows = list(np.moveaxis(kinematics.loop_jacobian(q), -2, 0))
    rows += [kinematics.gap_jacobian(name, q) for name in active]
    return np.stack(rows, axis=-2)


def _mass_matrix(kinematics: Kinematics, q: FloatArray) -> FloatArray:
    """M(q), shape (n, n_q, n_q)."""
    jacobian = kinematics.centres * kinematics.rates(q)[:, None, :]
    products = (np.swapaxes(jacobian.conj(), 1, 2) * kinematics.masses) @ jacobian
    return products.real + np.diag(kinematics.inertias)


def _loop_forces(mechanism: Mechanism, multipliers: FloatArray) -> dict[str, ComplexArray]:
    """Force of each loop joint on its child [N]."""
    forces: dict[str, ComplexArray] = {}
    columns = iter(multipliers.T)
    for joint in mechanism.loop_joints:
        if isinstance(joint, SlotJoint):
            forces[joint.name] = next(columns) * (1j * complex(*joint.axis))
        else:
            forces[joint.name] = next(columns) + 1j * next(columns)
    return forces


def _cross(arm: ComplexArray, force: ComplexArray) -> FloatArray:
    """Moment, counter-clockwise."""
    return (arm.conjugate() * force).imag
