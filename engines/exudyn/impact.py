"""The impact of all contacts that touch, in the metric of Exudyn's mass matrix.

Newton's law with complementarity (Moreau): z'+ = z'- + sum_i p_i r_i, with r_i what a unit impulse on gap i does to
the bodies in their joints, and p >= 0 complementary to v+ + e v- >= 0, v the speeds of the gaps.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.linalg import LinAlgError, cholesky, solve_triangular
from scipy.optimize import nnls

from ...models.arrays import FloatArray
from ...models.errors import SimulationError
from .build import System
from .matrices import matrices, solve_constrained
from .solver import State


def resolve_impact(system: System, state: State, restitution: Mapping[str, float]) -> tuple[State, dict[str, float]]:
    """The state after an impact, and the impulse of each contact [N m s, N s].

    Args:
        system: what moves.
        state: before.
        restitution: e of each contact that touches, active ones included.

    Raises:
        SimulationError: the contacts that touch are not independent of each other.
    """
    with matrices(system) as here:
        here.set(state.coordinates, state.rates)
        mass, joints = here.mass(), here.jacobian(())
        rows = np.array([-system.constraints[name].sense * here.stop_row(name) for name in restitution])
        still = np.zeros(len(joints))
        responses = np.array([solve_constrained(mass, joints, row, still)[0] for row in rows])
    coefficients = np.array(list(restitution.values()))
    impulses = _impulses(rows @ responses.T, (1.0 + coefficients) * (rows @ state.rates))
    after = replace(state, rates=state.rates + impulses @ responses)
    return after, dict(zip(restitution, impulses.tolist(), strict=True))


def _impulses(matrix: FloatArray, speeds: FloatArray) -> FloatArray:
    """The p >= 0 complementary to matrix p + speeds >= 0: with matrix = L L^T, the p of least |L^T p + L^-1 speeds|."""
    try:
        lower = cholesky(matrix, lower=True)
    except LinAlgError:
        raise SimulationError("exudyn's impact has no solution of its own: stops that touch are redundant.") from None
    return nnls(lower.T, -solve_triangular(lower, speeds, lower=True))[0]
