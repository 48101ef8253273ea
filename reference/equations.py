r"""Equations of motion of a mechanism in its minimal coordinates, constraints by multipliers.

With w = (-i e^{-i q}) on angles and 1 on slides (:mod:`..models.kinematics`) and K = C^H diag(m) C over the
bodies' centres C, one Hermitian matrix H_ij = conj(w_i) K_ij w_j holds everything quadratic:

    M(q)   = Re H + diag(I)                    mass matrix (M_ij = Re(K_ij e^{i(q_i - q_j)}) for two angles)
    b(q,u) = Im(H) (s u^2),  s = 1 on angles   centrifugal forces, on the left: M a + b = Q + G^T lam
    Q(q)   = Re(conj(w) (C^H m) (-i g))        gravity

Constraints (closed stops, loops of joints) enter by the index-1 form of KKT: G a = -gamma.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from ..models.arrays import ComplexArray, FloatArray
from ..models.kinematics import Kinematics
from ..models.mechanism import Mechanism, SlotJoint


class Equations:
    """M a + b = Q + G^T lam and G a + gamma = 0; all functions take states of shape (n_q,) or (n, n_q)."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self.kinematics = Kinematics(mechanism)
        centres, masses = self.kinematics.centres, self.kinematics.masses
        self._angles = self.kinematics.is_angle
        self._rate_at_zero = np.where(self._angles > 0, -1j, 1.0 + 0j)
        self._exponent = -1j * self._angles
        self._products: ComplexArray = (centres.conj().T * masses) @ centres
        self._weights: ComplexArray = -1j * mechanism.gravity * (centres.conj().T @ masses)
        self._inertias = np.diag(self.kinematics.inertias)
        self._loops = self._loop_rows()
        self._angle_gaps = {stop.name: self.kinematics.gap_row(stop.name) for stop in mechanism.angle_stops}
        self._point_gaps = {stop.name: self.kinematics.gap_wave(stop.name) for stop in mechanism.point_stops}

    @cached_property
    def n_loops(self) -> int:
        """Number of scalar constraints of the loop joints."""
        return len(self._loops)

    def loop_gaps(self, q: FloatArray) -> FloatArray:
        """How far the points of the loop joints stand apart, component by component [m], shape (..., n_loops)."""
        return (self.kinematics.phasors(q) @ self._loops.T + self._loop_offsets).real

    @cached_property
    def _loop_offsets(self) -> ComplexArray:
        offsets: list[complex] = []
        for joint in self.mechanism.loop_joints:
            parent = self.kinematics.point(joint.parent, joint.parent_point)
            child = self.kinematics.point(joint.child, joint.child_point)
            apart = child.offset - parent.offset
            if isinstance(joint, SlotJoint):
                offsets.append(apart * (1j * complex(*joint.axis)).conjugate())
            else:
                offsets += [apart, -1j * apart]
        return np.array(offsets, dtype=np.complex128)

    def _loop_rows(self) -> ComplexArray:
        """Complex rows L whose Re(L . w) is each loop constraint's rate."""
        rows: list[ComplexArray] = []
        for joint in self.mechanism.loop_joints:
            parent = self.kinematics.point(joint.parent, joint.parent_point)
            child = self.kinematics.point(joint.child, joint.child_point)
            apart = child.coefficients - parent.coefficients
            if isinstance(joint, SlotJoint):
                # Re(conj(i axis) z) is the distance from the slot's line.
                rows.append(apart * np.conj(1j * complex(*joint.axis)))
            else:
                rows += [apart, -1j * apart]  # Re(-i z) = Im z
        return np.array(rows).reshape(len(rows), len(self._angles))

    def _rates(self, q: FloatArray) -> ComplexArray:
        return self._rate_at_zero * np.exp(self._exponent * q)

    def mass_matrix(self, q: FloatArray) -> FloatArray:
        """M(q), shape (..., n_q, n_q)."""
        return self._quadratic(self._rates(q)).real + self._inertias

    def bias(self, q: FloatArray, u: FloatArray) -> FloatArray:
        """b(q, u): centrifugal forces on the left-hand side, shape (..., n_q)."""
        return self._bias(self._quadratic(self._rates(q)), u)

    def gravity_forces(self, q: FloatArray) -> FloatArray:
        """Q(q): generalized forces of gravity, shape (..., n_q)."""
        return (self._rates(q).conj() * self._weights).real

    def _quadratic(self, rates: ComplexArray) -> ComplexArray:
        return rates.conj()[..., :, None] * self._products * rates[..., None, :]

    def _bias(self, quadratic: ComplexArray, u: FloatArray) -> FloatArray:
        return (quadratic.imag @ (self._angles * u * u)[..., None])[..., 0]

    def constraint_jacobian(self, q: FloatArray, closed: Sequence[str]) -> FloatArray:
        """G(q): loop joints first, then the gaps of the closed stops, shape (..., n_constraints, n_q)."""
        rates = self._rates(q)
        loops = (self._loops * rates[..., None, :]).real
        return np.concatenate([loops, self._gap_gradients(rates, closed)], axis=-2)

    def _gap_gradients(self, rates: ComplexArray, closed: Sequence[str]) -> FloatArray:
        n_q = len(self._angles)
        if not self._point_gaps:
            gaps = np.array([self._angle_gaps[name] for name in closed]).reshape(len(closed), n_q)
            return np.broadcast_to(gaps, (*rates.shape[:-1], *gaps.shape))
        rows = np.empty((*rates.shape[:-1], len(closed), n_q))
        for k, name in enumerate(closed):
            wave = self._point_gaps.get(name)
            rows[..., k, :] = self._angle_gaps[name] if wave is None else (wave.coefficients * rates).real
        return rows

    def constraint_bias(self, q: FloatArray, u: FloatArray, closed: Sequence[str]) -> FloatArray:
        """gamma(q, u) = dG/dt u; 0 for gaps of angles, which are linear in q; shape (..., n_constraints)."""
        curvature = -1j * self._angles * self._rates(q) * u * u
        loops = (curvature @ self._loops.T).real
        gaps = np.zeros((*q.shape[:-1], len(closed)))
        for k, name in enumerate(closed):
            if name in self._point_gaps:
                gaps[..., k] = (curvature @ self._point_gaps[name].coefficients).real
        return np.concatenate([loops, gaps], axis=-1)

    def solve(self, q: FloatArray, u: FloatArray, closed: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        """Accelerations and multipliers under the loop joints and the closed stops.

        Returns:
            a, shape (..., n_q) [rad/s^2 or m/s^2], and lam, shape (..., n_loops + n_closed): generalized forces
            conjugate to the constraints [N or N m].
        """
        rates = self._rates(q)
        quadratic = self._quadratic(rates)
        mass = quadratic.real + self._inertias
        forces = (rates.conj() * self._weights).real - self._bias(quadratic, u)
        n_q, n_c = q.shape[-1], self.n_loops + len(closed)
        if n_c == 0:
            return _solve(mass, forces), np.zeros((*q.shape[:-1], 0))
        jacobian = self.constraint_jacobian(q, closed)
        kkt = np.zeros((*q.shape[:-1], n_q + n_c, n_q + n_c))
        kkt[..., :n_q, :n_q] = mass
        kkt[..., :n_q, n_q:] = -np.swapaxes(jacobian, -1, -2)
        kkt[..., n_q:, :n_q] = jacobian
        right = np.concatenate([forces, -self.constraint_bias(q, u, closed)], axis=-1)
        solution = _solve(kkt, right)
        return solution[..., :n_q], solution[..., n_q:]


def _solve(matrix: FloatArray, right: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0], dtype=np.float64)
