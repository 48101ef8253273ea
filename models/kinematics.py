r"""Where points of a mechanism are, as complex numbers z = x + i y.

With absolute angles every point of a tree of pinned bodies is a plain sum,

    z = z_0 + sum_k c_k w_k,        w_k = exp(-i q_k) for an angle, w_k = q_k for a slide,

with constant complex coefficients c_k (positive clockwise: the exponent is -i q). So a point is a row of
coefficients, and velocities and accelerations follow by differentiating w alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .arrays import ComplexArray, FloatArray
from .mechanism import GROUND, Mechanism, PointStop
from .spec import Vector


@dataclass(frozen=True)
class PointRow:
    """A body's point as coefficients over the coordinates: z = offset + coefficients . w(q)."""

    offset: complex
    coefficients: ComplexArray


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
    def _frames(self) -> dict[str, PointRow]:
        """The origin of each body's frame, from the ground outwards."""
        n_q = len(self.mechanism.coordinates)
        rows = {GROUND: PointRow(0j, np.zeros(n_q, dtype=np.complex128))}
        for joint in self.mechanism.tree_joints:
            at = self._point(rows, joint.parent, joint.parent_point)
            coefficients = at.coefficients.copy()
            coefficients[self._index(joint.child)] -= complex(*joint.child_point)
            if joint.kind == "pin-in-slot" and joint.coordinate is not None:
                coefficients[self.mechanism.coordinates.index(joint.coordinate)] += complex(*joint.axis)
            rows[joint.child] = PointRow(at.offset, coefficients)
        return rows

    def _index(self, body: str) -> int:
        return self.mechanism.coordinates.index(self.mechanism.body(body).angle)

    def _point(self, frames: dict[str, PointRow], body: str, point: Vector) -> PointRow:
        frame = frames[body]
        if body == GROUND:
            return PointRow(frame.offset + complex(*point), frame.coefficients)
        coefficients = frame.coefficients.copy()
        coefficients[self._index(body)] += complex(*point)
        return PointRow(frame.offset, coefficients)

    def point(self, body: str, point: Vector) -> PointRow:
        """The row of a point given in a body's frame (or the ground's)."""
        return self._point(self._frames, body, point)

    def phasors(self, q: FloatArray) -> ComplexArray:
        """w(q), shape like q."""
        return np.where(self.is_angle > 0, np.exp(-1j * q), q)

    def rates(self, q: FloatArray) -> ComplexArray:
        """dw/dq, shape like q: -i exp(-i q) for an angle, 1 for a slide."""
        return np.where(self.is_angle > 0, -1j * np.exp(-1j * q), 1.0)

    def position(self, row: PointRow, q: FloatArray) -> FloatArray:
        """World position [m], shape (..., 2)."""
        return _as_vectors(row.offset + self.phasors(q) @ row.coefficients)

    def velocity(self, row: PointRow, q: FloatArray, u: FloatArray) -> FloatArray:
        """World velocity [m/s], shape (..., 2)."""
        return _as_vectors((self.rates(q) * u) @ row.coefficients)

    def acceleration(self, row: PointRow, q: FloatArray, u: FloatArray, a: FloatArray) -> FloatArray:
        """World acceleration [m/s^2] for generalized accelerations a, shape (..., 2)."""
        rates = self.rates(q)
        return _as_vectors((rates * a - 1j * self.is_angle * rates * u**2) @ row.coefficients)

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
        """Gap of a stop [rad, or m for one on a point], shape (...,)."""
        found = self.mechanism.stop(stop)
        if isinstance(found, PointStop):
            row = self.gap_wave(stop)
            return (row.offset + self.phasors(q) @ row.coefficients).real
        return q @ self.gap_row(stop) - found.limit

    def gap_gradient(self, stop: str, q: FloatArray) -> FloatArray:
        """Gradient of a stop's gap with respect to q, shape (..., n_q)."""
        if isinstance(self.mechanism.stop(stop), PointStop):
            return (self.rates(q) * self.gap_wave(stop).coefficients).real
        return np.broadcast_to(self.gap_row(stop), q.shape)

    def gap_bias(self, stop: str, q: FloatArray, u: FloatArray) -> FloatArray:
        """What a gap's acceleration is without accelerations of q, d/dt(gradient) u, shape (...,)."""
        if isinstance(self.mechanism.stop(stop), PointStop):
            return ((-1j * self.is_angle * self.rates(q) * u * u) @ self.gap_wave(stop).coefficients).real
        return np.zeros(q.shape[:-1])

    def gap_row(self, stop: str) -> FloatArray:
        """Gradient of the gap of a stop on angles (constant), shape (n_q,)."""
        if stop not in self._gap_rows:
            raise TypeError(f"stop {stop!r} is on a point: its gradient is not constant")
        return self._gap_rows[stop]

    def gap_wave(self, stop: str) -> PointRow:
        """The gap of a stop on a point as Re(offset + coefficients . w(q))."""
        if stop not in self._gap_waves:
            raise TypeError(f"stop {stop!r} is on angles: its gap is linear in them")
        return self._gap_waves[stop]

    @cached_property
    def _gap_rows(self) -> dict[str, FloatArray]:
        rows: dict[str, FloatArray] = {}
        for stop in self.mechanism.angle_stops:
            row = np.zeros(len(self.is_angle))
            row[self._index(stop.body)] = stop.sense
            if stop.relative_to != GROUND:
                row[self._index(stop.relative_to)] = -stop.sense
            row.flags.writeable = False  # everybody gets the same one
            rows[stop.name] = row
        return rows

    @cached_property
    def _gap_waves(self) -> dict[str, PointRow]:
        waves: dict[str, PointRow] = {}
        for stop in self.mechanism.point_stops:
            row, across = self.point(stop.body, stop.point), complex(*stop.normal).conjugate()
            waves[stop.name] = PointRow(row.offset * across - stop.offset, row.coefficients * across)
        return waves


def initial_state(mechanism: Mechanism) -> tuple[FloatArray, FloatArray]:
    """Coordinates q and speeds u at t = 0, each of shape (n_q,)."""
    q = np.array(mechanism.start, dtype=np.float64)
    return q, np.array(mechanism.start_speeds, dtype=np.float64) if mechanism.start_speeds else np.zeros_like(q)


def _as_vectors(z: ComplexArray) -> FloatArray:
    return np.stack([z.real, z.imag], axis=-1)
