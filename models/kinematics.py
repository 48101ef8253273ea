r"""Kinematics of a mechanism's points, as complex numbers z = x + i y.

With absolute angles every point of a tree of pinned bodies is a plain sum,

    z = z_0 + sum_k c_k w_k,        w_k = exp(-i q_k) for an angle, w_k = q_k for a slide,

with constant complex coefficients c_k (positive clockwise: the exponent is -i q). So a point is a row of
coefficients, and velocities and accelerations follow by differentiating w alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .arrays import ComplexArray, FloatArray
from .mechanism import GROUND, Marker, Mechanism, SlotJoint
from .spec import Vector


@dataclass(frozen=True)
class PointCoefficients:
    """A body's point as coefficients over the coordinates: z = offset + coefficients . w(q)."""

    offset: complex
    coefficients: ComplexArray


@dataclass(frozen=True)
class AngleGap:
    """Gap of a stop on angles: constant + coefficients . q [rad]; linear, so its Jacobian is constant."""

    constant: float
    coefficients: FloatArray

    def value(self, q: FloatArray, phasors: ComplexArray) -> FloatArray:
        """The gap, shape (...,)."""
        return q @ self.coefficients + self.constant

    def jacobian(self, rates: ComplexArray) -> FloatArray:
        """D gap/dq, shape (n_q,): the same in every state."""
        return self.coefficients

    def bias(self, curvature: ComplexArray) -> FloatArray:
        """d/dt(Jacobian) u: 0."""
        return np.zeros(curvature.shape[:-1])


@dataclass(frozen=True)
class PointGap:
    """Gap of a stop on a point: constant + Re(coefficients . w(q)) [m]."""

    constant: float
    coefficients: ComplexArray

    def value(self, q: FloatArray, phasors: ComplexArray) -> FloatArray:
        """The gap, shape (...,)."""
        return (phasors @ self.coefficients).real + self.constant

    def jacobian(self, rates: ComplexArray) -> FloatArray:
        """D gap/dq, shape (..., n_q)."""
        return (rates * self.coefficients).real

    def bias(self, curvature: ComplexArray) -> FloatArray:
        """d/dt(Jacobian) u, shape (...,)."""
        return (curvature @ self.coefficients).real


@dataclass(frozen=True)
class Kinematics:
    """Point kinematics of a mechanism; arrays of states are shaped (n, n_q)."""

    mechanism: Mechanism

    @cached_property
    def is_angle(self) -> FloatArray:
        """1.0 for an angle, 0.0 for a slide; shape (n_q,)."""
        n_bodies, n_q = len(self.mechanism.bodies), len(self.mechanism.coordinates)
        return np.array([1.0] * n_bodies + [0.0] * (n_q - n_bodies))

    @cached_property
    def _frames(self) -> dict[str, PointCoefficients]:
        """The origin of each body's frame, from the ground outwards."""
        n_q = len(self.mechanism.coordinates)
        rows = {GROUND: PointCoefficients(0j, np.zeros(n_q, dtype=np.complex128))}
        for joint in self.mechanism.tree_joints:
            at = self._point(rows, joint.parent, joint.parent_point)
            coefficients = at.coefficients.copy()
            coefficients[self._index(joint.child)] -= complex(*joint.child_point)
            if joint.kind == "pin-in-slot" and joint.coordinate is not None:
                coefficients[self.mechanism.coordinates.index(joint.coordinate)] += complex(*joint.axis)
            rows[joint.child] = PointCoefficients(at.offset, coefficients)
        return rows

    def _index(self, body: str) -> int:
        return self.mechanism.coordinates.index(self.mechanism.body(body).angle)

    def _point(self, frames: dict[str, PointCoefficients], body: str, point: Vector) -> PointCoefficients:
        frame = frames[body]
        if body == GROUND:
            return PointCoefficients(frame.offset + complex(*point), frame.coefficients)
        coefficients = frame.coefficients.copy()
        coefficients[self._index(body)] += complex(*point)
        return PointCoefficients(frame.offset, coefficients)

    def point(self, body: str, point: Vector) -> PointCoefficients:
        """The row of a point given in a body's frame (or the ground's)."""
        return self._point(self._frames, body, point)

    def phasors(self, q: FloatArray) -> ComplexArray:
        """w(q), shape like q."""
        return np.where(self.is_angle > 0, np.exp(-1j * q), q)

    def rates(self, q: FloatArray) -> ComplexArray:
        """dw/dq, shape like q: -i exp(-i q) for an angle, 1 for a slide."""
        return np.where(self.is_angle > 0, -1j * np.exp(-1j * q), 1.0)

    def curvature(self, q: FloatArray, u: FloatArray) -> ComplexArray:
        """d2w/dq2 u^2, shape like q: what the rates' change adds to d2w/dt2."""
        return -1j * self.is_angle * self.rates(q) * u * u

    def position(self, row: PointCoefficients, q: FloatArray) -> FloatArray:
        """World position [m], shape (..., 2)."""
        return _as_vectors(row.offset + self.phasors(q) @ row.coefficients)

    def velocity(self, row: PointCoefficients, q: FloatArray, u: FloatArray) -> FloatArray:
        """World velocity [m/s], shape (..., 2)."""
        return _as_vectors((self.rates(q) * u) @ row.coefficients)

    def speed_scale(self, row: PointCoefficients) -> float:
        """A scale of a point's speeds [m/s]: what it would fall by all its arms, and what it moves at the start."""
        arms, speeds = np.abs(row.coefficients), np.abs(self.mechanism.start_speeds or 0.0)
        return math.sqrt(self.mechanism.gravity * float(arms @ self.is_angle)) + float(np.sum(arms * speeds))

    def acceleration(self, row: PointCoefficients, q: FloatArray, u: FloatArray, a: FloatArray) -> FloatArray:
        """World acceleration [m/s^2] for generalized accelerations a, shape (..., 2)."""
        rates = self.rates(q)
        return _as_vectors((rates * a - 1j * self.is_angle * rates * u**2) @ row.coefficients)

    def point_motion(
        self, marker: Marker, q: FloatArray, u: FloatArray, a: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position [m], velocity [m/s] and acceleration [m/s^2] of a marker, each of shape (..., 2)."""
        row = self.point(marker.body, marker.point)
        return self.position(row, q), self.velocity(row, q, u), self.acceleration(row, q, u, a)

    @cached_property
    def centres(self) -> ComplexArray:
        """Coefficients of the bodies' centres of mass, shape (n_bodies, n_q)."""
        return np.array([self.point(b.name, b.centre).coefficients for b in self.mechanism.bodies])

    @cached_property
    def masses(self) -> FloatArray:
        """Masses of the bodies [kg], shape (n_bodies,)."""
        return np.array([body.mass for body in self.mechanism.bodies])

    @cached_property
    def inertias(self) -> FloatArray:
        """Inertias about the centres of mass on the angles, 0 on slides [kg m^2], shape (n_q,)."""
        on_angles = [body.inertia for body in self.mechanism.bodies]
        return np.array(on_angles + [0.0] * (len(self.is_angle) - len(on_angles)))

    def momentum(self, q: FloatArray, u: FloatArray) -> FloatArray:
        """Linear momentum of all bodies [kg m/s], shape (..., 2)."""
        return _as_vectors((self.rates(q) * u) @ (self.masses @ self.centres))

    def kinetic_energy(self, q: FloatArray, u: FloatArray) -> FloatArray:
        """Kinetic energy [J], shape (...,)."""
        speeds = (self.rates(q) * u) @ self.centres.T
        return 0.5 * (np.abs(speeds) ** 2 @ self.masses + u**2 @ self.inertias)

    def potential_energy(self, q: FloatArray) -> FloatArray:
        """Potential energy [J], zero at the world's origin (the fulcrum's height), shape (...,)."""
        offsets = np.array([self.point(b.name, b.centre).offset.imag for b in self.mechanism.bodies])
        heights = (self.phasors(q) @ self.centres.T).imag + offsets
        return self.mechanism.gravity * heights @ self.masses

    def gap(self, stop: str, q: FloatArray) -> FloatArray:
        """Gap of a stop [its gap_unit], shape (...,)."""
        return self.gaps[stop].value(q, self.phasors(q))

    def gap_jacobian(self, stop: str, q: FloatArray) -> FloatArray:
        """Jacobian of a stop's gap with respect to q, shape (..., n_q)."""
        return np.broadcast_to(self.gaps[stop].jacobian(self.rates(q)), q.shape)

    def gap_bias(self, stop: str, q: FloatArray, u: FloatArray) -> FloatArray:
        """The gap's acceleration without accelerations of q, d/dt(Jacobian) u, shape (...,)."""
        return self.gaps[stop].bias(self.curvature(q, u))

    @cached_property
    def gaps(self) -> dict[str, AngleGap | PointGap]:
        """Coefficients of each stop's gap."""
        gaps: dict[str, AngleGap | PointGap] = {}
        for stop in self.mechanism.angle_stops:
            row = np.zeros(len(self.is_angle))
            row[self._index(stop.body)] = stop.sense
            if stop.relative_to != GROUND:
                row[self._index(stop.relative_to)] = -stop.sense
            row.flags.writeable = False  # shared by all callers
            gaps[stop.name] = AngleGap(-stop.limit, row)
        for stop in self.mechanism.point_stops:
            at, normal = self.point(stop.body, stop.point), complex(*stop.normal).conjugate()
            gaps[stop.name] = PointGap((at.offset * normal).real - stop.offset, at.coefficients * normal)
        return gaps

    @cached_property
    def loop_closures(self) -> tuple[PointCoefficients, ...]:
        """Scalar constraints Re(offset + coefficients . w) = 0 of the joints that close a loop.

        Of a pin the child's point less the parent's, along x and along y; of a slot the distance from its line.
        """
        closures: list[PointCoefficients] = []
        for joint in self.mechanism.loop_joints:
            parent = self.point(joint.parent, joint.parent_point)
            child = self.point(joint.child, joint.child_point)
            offset, coefficients = child.offset - parent.offset, child.coefficients - parent.coefficients
            # Re(conj(i axis) z) is the distance from the slot's line; Re(z) = x, Re(-i z) = y.
            slot = isinstance(joint, SlotJoint)
            directions = ((1j * complex(*joint.axis)).conjugate(),) if slot else (1.0, -1j)
            closures += [PointCoefficients(offset * along, coefficients * along) for along in directions]
        return tuple(closures)


def initial_state(mechanism: Mechanism) -> tuple[FloatArray, FloatArray]:
    """Coordinates q and speeds u at t = 0, each of shape (n_q,)."""
    q = np.array(mechanism.start, dtype=np.float64)
    return q, np.array(mechanism.start_speeds, dtype=np.float64) if mechanism.start_speeds else np.zeros_like(q)


def _as_vectors(z: ComplexArray) -> FloatArray:
    return np.stack([z.real, z.imag], axis=-1)
