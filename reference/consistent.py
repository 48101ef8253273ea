"""Consistent initialisation: the nearest coordinates and speeds that fulfil the constraints.

Gauss-Newton with the least step that removes the linearised residual, G(q) dq = -residual, where G holds the loop
joints and the closed stops; speeds are projected onto the null space of G (e.g. Haug, Computer Aided Kinematics and
Dynamics of Mechanical Systems, 1989, Sec. 3.6). "Nearest" is in the plain norm of the coordinates, not in the metric
of the mass matrix: no force acts here.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..models.arrays import FloatArray
from .equations import Equations

_ITERATIONS = 30  # from a slightly changed mechanism's start it takes three or four
_FITS = 1e-14  # [rad or m] relative to the size of the coordinates


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
    wanted = np.zeros(len(closed)) if gaps is None else gaps
    for _ in range(_ITERATIONS):
        open_by = np.array([float(equations.kinematics.gap(name, q)) for name in closed]) - wanted
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
