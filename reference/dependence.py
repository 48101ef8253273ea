r"""Constraints of which some follow from others: rank, independent combinations and least-norm multipliers.

Redundant constraints (a beam on three parallel cranks) leave accelerations unique and multipliers
not: with G^T n = 0, every lam + c n exerts the same generalized forces. Let S = D_r G D_c, with
columns divided by the root of the mass matrix' diagonal, and each row by the greatest length it can
have then in any position, so that no unit matters. With S = U sigma V^T and rank r, the first r
columns of U make independent constraints of them,

    (U_r^T D_r) G a = -(U_r^T D_r) gamma,        lam = D_r U_r mu,

whose multipliers mu are unique. Of all lam that exert the same forces, this one has the least norm
of D_r^{-1} lam.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..models.arrays import FloatArray

_DEPENDENT = (
    1e-6  # of the largest singular value of S: loops need to close to 1e-9 m, and S is as far off
)


@dataclass(frozen=True)
class Scales:
    """Diagonals of D_r, shape (n_constraints,), and D_c, shape (n_q,)."""

    rows: FloatArray
    columns: FloatArray

    def rank(self, jacobian: FloatArray) -> int:
        """Number of independent constraints in one position."""
        values = np.linalg.svd(self._scaled(jacobian), compute_uv=False)
        return int((values > _DEPENDENT * values.max(initial=0.0)).sum())

    def basis(self, jacobian: FloatArray, rank: int) -> Basis:
        """The basis of constraints of a known rank, in positions (...)."""
        basis = np.swapaxes(np.linalg.svd(self._scaled(jacobian))[0], -1, -2) * self.rows
        return Basis(basis[..., :rank, :], basis[..., rank:, :])

    def _scaled(self, jacobian: FloatArray) -> FloatArray:
        """S of constraints in positions (...), shape (..., n_constraints, n_q)."""
        return self.rows[..., None] * jacobian * self.columns[..., None, :]


@dataclass(frozen=True)
class Basis:
    """Independent combinations of dependent constraints, and combinations of multipliers that exert no force."""

    rows: FloatArray
    """U_r^T D_r, shape (..., rank, n_constraints)."""
    null: FloatArray
    """Multipliers that exert no generalized force, shape (..., n_constraints - rank, n_constraints)."""


def scales_of(inertia: FloatArray, amplitudes: FloatArray) -> Scales:
    """Scales of constraints.

    Args:
        inertia: the mass matrix' diagonal, shape (..., n_q).
        amplitudes: the greatest values of the constraints' derivatives in any position, (...,
            n_constraints, n_q).
    """
    columns = 1.0 / np.sqrt(np.where(inertia > 0, inertia, 1.0))
    lengths = np.linalg.norm(amplitudes * columns[..., None, :], axis=-1)
    return Scales(1.0 / np.where(lengths > 0, lengths, 1.0), columns)


def least_step(jacobian: FloatArray, residual: FloatArray, rank: int) -> FloatArray:
    """The least dq with G dq = residual for constraints of a known rank, shape (n_q,).

    Beside the positions in which all constraints are fulfilled, dependent ones contradict each
    other: their combination is left out, as small as it is, for it would move the mechanism along
    its own motion.
    """
    if rank == len(jacobian):
        return np.asarray(np.linalg.lstsq(jacobian, residual, rcond=None)[0], dtype=np.float64)
    left, values, right = np.linalg.svd(jacobian)
    return right[:rank].T @ (left[:, :rank].T @ residual / values[:rank])
