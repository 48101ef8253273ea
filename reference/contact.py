r"""Contacts of the stops at one state: which of them are active, and what an impact does.

Both are the linear complementarity problem of unilateral constraints. With A = G M^{-1} G^T, the Delassus matrix
(symmetric, positive semidefinite), and b = G (what the gaps do without the stops),

    0 <= x  complementary to  A x + b >= 0

has x as torques when b are gap accelerations, and as impulses when b are gap speeds (Moreau; Lötstedt 1982).
It is the optimality condition of min 1/2 x^T A x + b^T x over x >= 0, a non-negative least-squares problem, so
all stops are decided at once and no order has to be chosen.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import nnls

from ..models.arrays import FloatArray
from .equations import Equations, kkt_matrix


def solve_lcp(matrix: FloatArray, offset: FloatArray) -> FloatArray:
    """X >= 0 with matrix x + offset >= 0 and x . (matrix x + offset) = 0; shapes (m, m), (m,) -> (m,)."""
    values, vectors = np.linalg.eigh(matrix)
    kept = values > values[-1] * len(values) * np.finfo(np.float64).eps * 16
    root = (np.sqrt(values[kept]) * vectors[:, kept]).T  # matrix = root^T root
    target = -(vectors[:, kept].T @ offset) / np.sqrt(values[kept])
    return nnls(root, target)[0]


def active_contacts(equations: Equations, q: FloatArray, u: FloatArray, touching: Sequence[str]) -> tuple[str, ...]:
    """Which of the touching stops push (torque >= 0), the others being about to open.

    A stop whose torque would be negative cannot push and is left out, all stops decided at once.

    Args:
        q, u: one state, shape (n_q,).
        touching: stops whose gap and gap speed are zero.
    """
    torques = equations.solve(q, u, touching)[1][equations.n_loops :]
    if np.all(torques >= 0):
        return tuple(touching)
    matrix, free = _delassus(equations, q, u, touching)
    torques = solve_lcp(matrix, free)
    return tuple(name for name, torque in zip(touching, torques, strict=True) if torque > 0)


def resolve_impact(
    equations: Equations, q: FloatArray, u: FloatArray, touching: Sequence[str], restitution: FloatArray
) -> tuple[FloatArray, dict[str, float]]:
    """Speeds after an impact of the touching stops, and their impulses, all decided at once.

    Newton's law in the metric of the mass matrix (Moreau): u+ = u- + M^{-1} G^T P with P >= 0 complementary to
    G u+ + e G u- >= 0.

    Args:
        q, u: state before, shape (n_q,).
        touching: stops that touch, active ones included.
        restitution: e of each of them, shape (n_touching,).

    Returns:
        u+, shape (n_q,), and the impulse of each stop [N m s].
    """
    rows = gap_jacobian(equations, q, touching)
    matrix, _ = _delassus(equations, q, u, touching)
    impulses = solve_lcp(matrix, (1.0 + restitution) * (rows @ u))
    after = u + _response(equations, q, rows.T @ impulses)
    return after, dict(zip(touching, impulses.tolist(), strict=True))


def gap_jacobian(equations: Equations, q: FloatArray, names: Sequence[str]) -> FloatArray:
    """Jacobian of the stops' gaps at one state, shape (n_names, n_q)."""
    return equations.constraint_jacobian(q, names)[equations.n_loops :]


def _delassus(
    equations: Equations, q: FloatArray, u: FloatArray, touching: Sequence[str]
) -> tuple[FloatArray, FloatArray]:
    """G M^{-1} G^T and the gap accelerations without the stops, both with the loop joints."""
    rows = gap_jacobian(equations, q, touching)
    free = equations.solve(q, u, ())[0]
    response = np.array([_response(equations, q, row) for row in rows])
    return rows @ response.T, rows @ free + equations.constraint_bias(q, u, touching)[equations.n_loops :]


def _response(equations: Equations, q: FloatArray, force: FloatArray) -> FloatArray:
    """Accelerations (or speed jumps) that a generalized force (or impulse) alone causes, with the loop joints."""
    kkt = kkt_matrix(equations.mass_matrix(q), equations.constraint_jacobian(q, ()))
    right = np.concatenate([force, np.zeros(len(kkt) - len(q))])
    return np.asarray(np.linalg.solve(kkt, right)[: len(q)], dtype=np.float64)
