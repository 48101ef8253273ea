"""How long a step may be where a damper decides: DOP853's steps are then limited by stability, not by accuracy.

On the border of stability a step's end is accurate, for the error estimate of the next step
corrects it, but the dense output in between is not: with h times the decay rate at 6 it errs a
hundred times more than the step. Steps of at most `_SHARE` time constants are well inside.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..models.arrays import FloatArray
from ..models.force_elements import RotationalSpringDamper, SpringDamper
from .equations import Equations

_SHARE = 3.0


def longest_step(equations: Equations, q: FloatArray, closed: Sequence[str]) -> float:
    """Longest step in a position, shape (n_q,) [s]; infinite without dampers.

    Args:
        closed: active stops.
    """
    elements = equations.mechanism.force_elements
    if not any(
        e.damping > 0 for e in elements if isinstance(e, SpringDamper | RotationalSpringDamper)
    ):
        return np.inf
    units = np.eye(len(q))
    # Accelerations are quadratic in speeds: dampers are what is odd in them.
    up, down = (
        equations.solve(np.broadcast_to(q, units.shape), sign * units, closed)[0]
        for sign in (1.0, -1.0)
    )
    fastest = np.abs(np.linalg.eigvals((up - down).T / 2)).max()
    return _SHARE / float(fastest) if fastest > 0 else np.inf
