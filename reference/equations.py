r"""Equations of motion of a mechanism in its minimal coordinates, constraints by multipliers.

With w = (-i e^{-i q}) on angles and 1 on slides (:mod:`..models.kinematics`) and K = C^H diag(m) C over the
bodies' centres C, one Hermitian matrix H_ij = conj(w_i) K_ij w_j holds everything quadratic:

    M(q)   = Re H + diag(I)                    mass matrix (M_ij = Re(K_ij e^{i(q_i - q_j)}) for two angles)
    b(q,u) = Im(H) (s u^2),  s = 1 on angles   centrifugal forces, on the left: M a + b = Q + G^T lam
    Q(q)   = Re(conj(w) (C^H m) (-i g))        gravity

Constraints (closed stops, loops of joints) enter by the index-1 form of KKT: G a = -gamma.

Consistent initialisation: the nearest coordinates and speeds that fulfil the constraints. Gauss-Newton with the least
step that removes the linearised residual, G(q) dq = -residual; speeds are projected onto the null space of G (e.g.
Haug, Computer Aided Kinematics and Dynamics of Mechanical Systems, 1989, Sec. 3.6). "Nearest" is in the plain norm of
the coordinates, not in the metric of the mass matrix: no force acts here.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from ..models.arrays import ComplexArray, FloatArray
from ..models.kinematics import Kinematics
from ..models.mechanism import Mechanism

_ITERATIONS = 30  # from a slightly changed mechanism's start it takes three or four
_FITS = 1e-14  # [rad or m] relative to the size of the coordinates


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
        closures = self.kinematics.loop_closures
        # Complex rows L whose Re(L . w) is each loop constraint's rate.
        self._loops = np.array([row.coefficients for row in closures]).reshape(len(closures), len(self._angles))
        self._loop_offsets = np.array([row.offset for row in closures], dtype=np.complex128)
        self._gaps = self.kinematics.gaps

    @cached_property
    def n_loops(self) -> int:
        """Number of scalar constraints of the loop joints."""
        return len(self._loops)

    def loop_residual(self, q: FloatArray) -> FloatArray:
        """Loop-closure residual: difference of each loop joint's two points, by component [m], shape (..., n_loops)."""
        return (self.kinematics.phasors(q) @ self._loops.T + self._loop_offsets).real

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

    def potential_energy(self, q: FloatArray) -> FloatArray:
        """Potential energy of gravity [J], zero at the world's origin, shape (...,)."""
        return self.kinematics.potential_energy(q)

    def _forces(self, q: FloatArray, u: FloatArray, rates: ComplexArray, quadratic: ComplexArray) -> FloatArray:
        """Q - b: generalized forces without the constraints', shape (..., n_q)."""
        return (rates.conj() * self._weights).real - self._bias(quadratic, u)

    def _quadratic(self, rates: ComplexArray) -> ComplexArray:
        return rates.conj()[..., :, None] * self._products * rates[..., None, :]

    def _bias(self, quadratic: ComplexArray, u: FloatArray) -> FloatArray:
        return (quadratic.imag @ (self._angles * u * u)[..., None])[..., 0]

    def constraint_jacobian(self, q: FloatArray, closed: Sequence[str]) -> FloatArray:
        """G(q): loop joints first, then the gaps of the closed stops, shape (..., n_constraints, n_q)."""
        rates = self._rates(q)
        loops = (self._loops * rates[..., None, :]).real
        gaps = np.empty((*q.shape[:-1], len(closed), len(self._angles)))
        for k, name in enumerate(closed):
            gaps[..., k, :] = self._gaps[name].jacobian(rates)
        return np.concatenate([loops, gaps], axis=-2)

    def constraint_bias(self, q: FloatArray, u: FloatArray, closed: Sequence[str]) -> FloatArray:
        """gamma(q, u) = dG/dt u; 0 for gaps of angles, which are linear in q; shape (..., n_constraints)."""
        curvature = -1j * self._angles * self._rates(q) * u * u
        loops = (curvature @ self._loops.T).real
        gaps = np.empty((*q.shape[:-1], len(closed)))
        for k, name in enumerate(closed):
            gaps[..., k] = self._gaps[name].bias(curvature)
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
        forces = self._forces(q, u, rates, quadratic)
        n_q = q.shape[-1]
        if self.n_loops + len(closed) == 0:
            return _solve(mass, forces), np.zeros((*q.shape[:-1], 0))
        jacobian = self.constraint_jacobian(q, closed)
        right = np.concatenate([forces, -self.constraint_bias(q, u, closed)], axis=-1)
        solution = _solve(kkt_matrix(mass, jacobian), right)
        return solution[..., :n_q], solution[..., n_q:]


def kkt_matrix(mass: FloatArray, jacobian: FloatArray) -> FloatArray:
    """((M, -G^T), (G, 0)), shape (..., n_q + n_constraints, n_q + n_constraints)."""
    n_q, n_c = mass.shape[-1], jacobian.shape[-2]
    kkt = np.zeros((*mass.shape[:-2], n_q + n_c, n_q + n_c))
    kkt[..., :n_q, :n_q] = mass
    kkt[..., :n_q, n_q:] = -np.swapaxes(jacobian, -1, -2)
    kkt[..., n_q:, :n_q] = jacobian
    return kkt


def _solve(matrix: FloatArray, right: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0], dtype=np.float64)


def consistent_coordinates(
    equations: Equations, q: FloatArray, closed: Sequence[str], gaps: FloatArray | None = None
) -> FloatArray | None:
    """The coordinates near q at which loops close and the closed stops have given gaps.

    Args:
        q: first guess, shape (n_q,) [rad or m].
        closed: names of the closed stops.
        gaps: of each of them, where its wall is to be, shape (n_closed,) [rad or m]; 0 where left out.

    Returns:
        Shape (n_q,); None if the iteration does not converge.
    """
    targets = np.zeros(len(closed)) if gaps is None else gaps
    for _ in range(_ITERATIONS):
        open_by = np.array([float(equations.kinematics.gap(name, q)) for name in closed]) - targets
        residual = np.concatenate([np.atleast_1d(equations.loop_residual(q)), open_by])
        if np.abs(residual).max(initial=0.0) <= _FITS * (1 + np.abs(q).max()):
            return q
        step = np.linalg.lstsq(equations.constraint_jacobian(q, closed), residual, rcond=None)[0]
        q = np.asarray(q - step, dtype=np.float64)
    return None


def consistent_speeds(equations: Equations, q: FloatArray, u: FloatArray, closed: Sequence[str]) -> FloatArray:
    """The speeds nearest to u that keep loops closed and the closed stops touching, shape (n_q,)."""
    jacobian = equations.constraint_jacobian(q, closed)
    return u - np.linalg.lstsq(jacobian, jacobian @ u, rcond=None)[0] if len(jacobian) else u
