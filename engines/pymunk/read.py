"""Reading the mechanism's motion and the forces of its joints and stops from Chipmunk's bodies.

Forces come from the bodies' changes of momentum in a step, because Chipmunk gives only the
magnitude of a joint's impulse: constraint forces are the rates of change of momentum and angular
momentum, less gravity and what the force elements exert. A joint of the tree carries all bodies
that it supports; the forces of joints that close a loop and of active stops are the least-squares
solution of G^T lam = r, with the residual r of the equations of motion without them:

    r_k = for an angle, the couple on the bodies that turn with it beyond gravity, force elements
          and the tree's forces; for a slide, the force along it.

Couplers hold angles here, by couples on their bodies.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ...models.applied_forces import AppliedForces
from ...models.arrays import ComplexArray, FloatArray, IndexArray, as_vectors
from ...models.elements import GROUND, AnyJoint, Stop
from ...models.kinematics import Kinematics
from ...models.mechanism import Mechanism
from ...models.spec import Vector
from ...models.trajectory import PointMotion
from ..events import Contacts
from ..impact import mass_matrix
from ..supplied import has_loops
from .bodies import Assembly, BodyPart, is_pin

_SINGULAR = 1e-10  # of the largest singular value: dependent constraints share their force
_Forces = dict[str, ComplexArray]


@dataclass(frozen=True)
class BodySamples:
    """Engine bodies at the samples: values, first and second rates, shape (3, n, n_bodies)."""

    points: ComplexArray  # position [m], velocity [m/s] and acceleration [m/s^2], complex
    angles: FloatArray
    """Angle [rad], angular velocity [rad/s] and acceleration [rad/s^2], counter-clockwise."""


PointMotions = ComplexArray
"""Position, velocity and acceleration of a point at the samples [m, s], shape (3, n)."""


@dataclass(frozen=True)
class Frame:
    """A body of the mechanism: motion of a reference point and of its clockwise angle, (n,)."""

    reference: complex
    at: PointMotions
    q: FloatArray
    u: FloatArray
    a: FloatArray

    @cached_property
    def _turn(self) -> ComplexArray:
        """Factor from the body's frame to the world; each point of the body asks for it."""
        return np.exp(-1j * self.q)

    def world(self, direction: complex) -> ComplexArray:
        """A direction given in the body's frame."""
        return direction * self._turn

    def component(
        self, direction: complex, vector: PointMotions
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Along a direction of this frame: a vector's component, and its first and second rate."""
        position, velocity, acceleration = vector
        along = self.world(direction).conjugate()  # turns with exp(+i q)
        rate = velocity + 1j * self.u * position
        second = acceleration + 2j * self.u * velocity + (1j * self.a - self.u**2) * position
        return (along * position).real, (along * rate).real, (along * second).real

    def point(self, local: complex) -> PointMotions:
        """A point given in the body's frame [m]."""
        arm = self.world(local - self.reference)
        position, velocity, acceleration = self.at
        velocity = velocity - 1j * self.u * arm
        return np.stack([position + arm, velocity, acceleration - (1j * self.a + self.u**2) * arm])


@dataclass
class MotionReading:
    """The mechanism's motion, from the engine bodies' samples."""

    assembly: Assembly
    samples: BodySamples
    near: FloatArray | None = None
    """Coordinates that tell the full turns of the first sample; None: those of the start."""
    acting: FloatArray | None = None
    """Time whose recorded efforts act at each sample [s], shape (n,); None: no effort changes."""
    frames: dict[str, Frame] = field(default_factory=dict[str, Frame])

    def __post_init__(self) -> None:
        _, n, _ = self.samples.points.shape
        rest, origin = np.zeros(n), np.zeros((3, n), dtype=np.complex128)
        self.frames[GROUND] = Frame(0j, origin, rest, rest, rest)
        for i, (name, part) in enumerate(self.assembly.parts.items()):
            self.frames[name] = self._frame(i, part)
        for name, place in self.assembly.placements.items():
            if name not in self.frames:  # welded to its carrier, whose reference it shares
                frame = self.frames[place.carrier]
                reference = (frame.reference - place.origin) * np.exp(1j * place.angle)
                self.frames[name] = Frame(
                    reference, frame.at, frame.q + place.angle, frame.u, frame.a
                )

    def _frame(self, i: int, part: BodyPart) -> Frame:
        body = self.samples.points[:, :, i]
        if part.turns:
            angle, spin, spin_rate = self.samples.angles[:, :, i]
            return Frame(part.reference, body, 0.0 - angle, 0.0 - spin, -spin_rate)
        # A bob's rod points from its pin to its mass: rod = arm exp(-i q).
        rigid = self.assembly.rigid
        joint, (index, _) = rigid.joint_of(part.name), rigid.attitudes[part.name]
        assert index is not None
        rod, velocity, acceleration = body - self.point(joint.parent, joint.parent_point)
        q = np.unwrap(-np.angle(rod / (part.reference - part.pin)))
        near = rigid.start[index] if self.near is None else float(self.near[index])
        turns = round((near - float(q[0])) / (2 * np.pi))
        u, a = -(velocity / rod).imag, -(acceleration / rod).imag
        return Frame(part.reference, body, q + 2 * np.pi * turns, u, a)

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism that the assembly was built from."""
        return self.assembly.mechanism

    def point(self, body: str, local: Vector) -> PointMotions:
        """A point of a body, or of the ground."""
        return self.frames[body].point(complex(*local))

    def between(self, joint: AnyJoint) -> PointMotions:
        """The vector from a joint's point of the parent to that of the child."""
        parent = self.point(joint.parent, joint.parent_point)
        return self.point(joint.child, joint.child_point) - parent

    @cached_property
    def motion(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Coordinates q, speeds u and accelerations, shape (n, n_q)."""
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
            position, velocity, _ = self.point(marker.body, marker.point)
            motions[marker.name] = PointMotion(as_vectors(position), as_vectors(velocity))
        return motions

    def energies(self) -> tuple[FloatArray, FloatArray]:
        """Kinetic and potential energy [J], shape (n,)."""
        kinetic, potential = np.zeros((2, self.samples.points.shape[1]))
        weight = complex(*self.mechanism.gravity_vector)
        for body in self.mechanism.bodies:
            (centre, velocity, _), u = self.point(body.name, body.centre), self.frames[body.name].u
            kinetic += 0.5 * (body.mass * np.abs(velocity) ** 2 + body.inertia * u**2)
            potential -= body.mass * (centre * weight.conjugate()).real
        if self.mechanism.force_elements:
            q, speeds, _ = self.motion
            potential += self._applied.potential_energy(q)
            kinetic += self._applied.kinematics.rotor_energy(speeds)
        return kinetic, potential

    @cached_property
    def _applied(self) -> AppliedForces:
        """The mechanism's force elements."""
        return AppliedForces(Kinematics(self.mechanism))

    def _stages(self) -> Iterator[tuple[IndexArray, AppliedForces]]:
        """Samples between the same instants, and the force elements that act there."""
        times = np.zeros(self.samples.points.shape[1]) if self.acting is None else self.acting
        return self._applied.at_times(times)

    @cached_property
    def applied_on_bodies(self) -> dict[str, ComplexArray]:
        """Resultant force of the force elements on each body that one acts on [N], shape (n,)."""
        q, u, _ = self.motion
        forces: dict[str, ComplexArray] = {}
        for at, applied in self._stages():
            for name, force in applied.on_bodies(q[at], u[at]).items():
                whole = forces.setdefault(name, np.zeros(len(q), dtype=np.complex128))
                whole[at] = force[..., 0] + 1j * force[..., 1]
        return forces

    @cached_property
    def applied_couples(self) -> FloatArray:
        """Couples of the force elements on the bodies of each angle [N m], (n, n_angles).

        Their generalized forces, those of rotors included, less those of the same forces at the
        centres.
        """
        kinematics, (q, u, a) = self._applied.kinematics, self.motion
        couples, rates = np.zeros(q.shape), kinematics.rates(q)
        for at, applied in self._stages():
            couples[at] = applied.generalized(q[at], u[at])
        for body, centre in zip(self.mechanism.bodies, kinematics.centres, strict=True):
            if body.name in self.applied_on_bodies:
                force = self.applied_on_bodies[body.name].conj()[:, None]
                couples -= (force * kinematics.gradient(centre, q, rates)).real
        if kinematics.rotor_inertias is not None:
            couples -= a @ kinematics.rotor_inertias
        return couples[:, : len(self.mechanism.angles)]

    def gaps(self) -> dict[str, FloatArray]:
        """Constraint drift [m], shape (n,): distance of points, or error of a bob's rod."""
        gaps: dict[str, FloatArray] = {}
        for joint in self.mechanism.joints:
            part, vector = self.assembly.parts.get(joint.child), self.between(joint)
            if is_pin(joint) and part and not part.turns and joint in self.mechanism.tree_joints:
                rod = self.frames[joint.child].at - self.point(joint.parent, joint.parent_point)
                length = np.abs(rod[0])
                gaps[joint.name] = np.abs(length - abs(part.reference - part.pin))
            elif not joint.free_directions:
                gaps[joint.name] = np.abs(vector[0])
            elif joint.held_directions:
                (across,) = joint.held_directions
                gaps[joint.name] = np.abs(self.frames[joint.parent].component(across, vector)[0])
        return gaps


def reading_of(assembly: Assembly, accelerations: FloatArray | None = None) -> MotionReading:
    """The bodies' present state as one sample; accelerations as its rates, zero if left out."""
    places = np.array([[*body.position, body.angle] for body in assembly.bodies])
    rates = assembly.rates
    second = np.zeros_like(rates) if accelerations is None else accelerations
    x, y, angles = np.stack([places, rates, second]).T
    return MotionReading(assembly, BodySamples((x + 1j * y).T[:, None], angles.T[:, None]))


# --- Forces


def forces_of(
    reading: MotionReading, active: Contacts
) -> tuple[dict[str, ComplexArray], dict[str, FloatArray]]:
    """Force of each joint on its child, complex [N], and torque of each active stop [N m or N].

    At the samples, each of shape (n,).
    """
    mechanism = reading.mechanism
    # The force that each body's momentum needs beyond gravity and force elements [N].
    needed: _Forces = {}
    weight = complex(*mechanism.gravity_vector)
    for body in mechanism.bodies:
        _, _, acceleration = reading.point(body.name, body.centre)
        needed[body.name] = body.mass * (acceleration - weight)
    if mechanism.force_elements:
        for name, force in reading.applied_on_bodies.items():
            _act(needed, name, -force)

    points = [stop for stop in mechanism.point_stops if stop.name in active]
    turn_together = any(joint.holds_angle for joint in mechanism.tree_joints)
    # A stop's torque is known from the body farther out, but not those of two stops from one body.
    outer = {_outer(reading, stop) for stop in mechanism.angle_stops if stop.name in active}
    one_by_one = not (points or turn_together) and len(outer) == len(active)
    if not has_loops(mechanism) and (not active or one_by_one):
        reactions = _tree_reactions(reading, needed)
        return reactions, _angle_torques(reading, reactions, active)

    multipliers = iter(_multipliers(reading, needed, active).T)
    loops: _Forces = {}
    for joint in mechanism.loop_joints:
        frame = reading.frames[joint.parent if joint.free_directions else GROUND]
        held = [next(multipliers) * frame.world(along) for along in joint.held_directions]
        force = loops[joint.name] = np.sum(held, axis=0)
        if joint.holds_angle:
            next(multipliers)  # a couple
        _act(needed, joint.child, -force)
        _act(needed, joint.parent, force)
    for _ in mechanism.couplers:
        next(multipliers)  # a couple
    torques = dict(zip(active, multipliers, strict=True))
    for stop in points:
        push = reading.frames[stop.relative_to].world(complex(*stop.normal)) * torques[stop.name]
        _act(needed, stop.body, -push)
        _act(needed, stop.relative_to, push)
    return _tree_reactions(reading, needed) | loops, torques


def _act(needed: _Forces, body: str, force: ComplexArray) -> None:
    if body != GROUND:
        needed[body] = needed[body] + force


def _tree_reactions(reading: MotionReading, needed: _Forces) -> _Forces:
    """Force of each joint of the tree on its child [N]."""
    forces: _Forces = {}
    for joint in reading.mechanism.tree_joints:
        force = np.zeros_like(needed[joint.child])
        for body in reading.mechanism.subtree(joint.child):
            force += needed[body.name]
        forces[joint.name] = force
    return forces


def _outer(reading: MotionReading, stop: Stop) -> int:
    """Index of the stop's body that is farther out in the tree."""
    names = [body.name for body in reading.mechanism.bodies]
    return max(names.index(name) for name in (stop.body, stop.relative_to) if name != GROUND)


def _angle_torques(
    reading: MotionReading, reactions: _Forces, active: Contacts
) -> dict[str, FloatArray]:
    """Torques of active stops on angles, if all joints are of the tree.

    The large forces nearer to the ground do not enter the equation of a stop's outer body.
    """
    if not active:
        return {}
    mechanism = reading.mechanism
    by_name = {stop.name: stop for stop in mechanism.angle_stops}
    stops = [by_name[name] for name in active]
    couples: list[FloatArray] = []
    columns: list[list[float]] = []  # derivatives of the stops' gaps by the body's angle
    for i in sorted({_outer(reading, stop) for stop in stops}):
        name = mechanism.bodies[i].name
        couple = _couple(reading, name, reactions)
        if mechanism.force_elements:
            couple = couple - reading.applied_couples[:, i]
        couples.append(couple)
        columns.append(
            [float(s.sense * ((name == s.body) - (name == s.relative_to))) for s in stops]
        )
    solved = np.linalg.lstsq(np.array(columns), np.array(couples), rcond=None)[0]
    return dict(zip(active, solved, strict=True))


def _couple(reading: MotionReading, name: str, reactions: _Forces) -> FloatArray:
    """Clockwise couple that acts on a body besides gravity and the tree's forces [N m]."""
    body, frame = reading.mechanism.body(name), reading.frames[name]
    centre = reading.point(name, body.centre)[0]
    couple = body.inertia * frame.a
    for joint in reading.mechanism.tree_joints:
        if joint.child == name:
            arm = reading.point(name, joint.child_point)[0] - centre
            couple = couple + (arm.conjugate() * reactions[joint.name]).imag
        elif joint.parent == name:
            at = (name, joint.parent_point)
            if joint.free_directions:  # a child that slides pushes where it is
                at = (joint.child, joint.child_point)
            arm = reading.point(*at)[0] - centre
            couple = couple - (arm.conjugate() * reactions[joint.name]).imag
    return couple


def _multipliers(reading: MotionReading, needed: _Forces, active: Contacts) -> FloatArray:
    """Multipliers of the loop joints' components, couplers, active stops, (n, n_constraints).

    Errors of r are those of accelerations times the mass matrix M, so the inverse of M is their
    weight: the equation of a light body determines a small force better than that of a heavy one
    nearer to the ground.
    """
    mechanism, kinematics = reading.mechanism, Kinematics(reading.mechanism)
    q = reading.motion[0]
    # r: the generalized forces that no joint of the tree exerts [N m or N].
    reactions = _tree_reactions(reading, needed)
    residual = np.zeros(q.shape)
    for body in mechanism.bodies:
        index, _ = mechanism.attitudes[body.name]
        if index is not None:
            residual[:, index] += _couple(reading, body.name, reactions)
    if mechanism.force_elements:
        residual[:, : len(mechanism.angles)] -= reading.applied_couples
    for k, slide in enumerate(mechanism.slides, start=len(mechanism.angles)):
        along = reading.frames[slide.joint.parent].world(slide.direction)
        residual[:, k] = (reactions[slide.joint.name] * along.conjugate()).real
    # G: Jacobian of the loop joints' and active stops' gaps, shape (n, n_constraints, n_q).
    rows = list(np.moveaxis(kinematics.loop_jacobian(q), -2, 0))
    rows += [kinematics.gap_jacobian(name, q) for name in active]
    root = np.linalg.cholesky(mass_matrix(kinematics, q))
    columns = np.linalg.solve(root, np.swapaxes(np.stack(rows, axis=-2), 1, 2))
    weighted = np.linalg.solve(root, residual[..., None])
    solution = np.linalg.pinv(columns, rcond=_SINGULAR) @ weighted
    return np.asarray(solution[..., 0], dtype=np.float64)
