r"""Which stops push: the linear complementarity problem of unilateral constraints.

With A = G M^{-1} G^T (symmetric, positive semidefinite) and b = G (what the gaps do without the stops),

    0 <= x  complementary to  A x + b >= 0

has x as torques when b are gap accelerations, and as impulses when b are gap speeds (Moreau; Lötstedt 1982).
It is the optimality condition of min 1/2 x^T A x + b^T x over x >= 0, a non-negative least-squares problem, so
all stops are decided at once and no order has to be chosen.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from ..models.arrays import FloatArray


def solve_lcp(matrix: FloatArray, offset: FloatArray) -> FloatArray:
    """X >= 0 with matrix x + offset >= 0 and x . (matrix x + offset) = 0; shapes (m, m), (m,) -> (m,)."""
    values, vectors = np.linalg.eigh(matrix)
    kept = values > values[-1] * len(values) * np.finfo(np.float64).eps * 16
    root = (np.sqrt(values[kept]) * vectors[:, kept]).T  # matrix = root^T root
    target = -(vectors[:, kept].T @ offset) / np.sqrt(values[kept])
    return nnls(root, target)[0]
