"""Stops that are met: their gaps, by Exudyn's own coordinates, and the impact, in the metric of its mass matrix.

Newton's law for all stops that touch at once (Moreau): z'+ = z'- + sum_i p_i r_i, with r_i what a unit impulse on gap
i does to the bodies in their joints, and p >= 0 complementary to v+ + e v- >= 0, v the speeds of the gaps.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg import LinAlgError, cholesky, solve_triangular
from scipy.optimize import nnls

from ...models.arrays import FloatArray
from ...models.errors import SimulationError
from ...models.mechanism import GROUND, PointStop, Stop
from .build import System, Values
from .matrices import Closed, matrices, solve_constrained
from .solver import State


def gap(system: System, name: str, values: Values) -> float:
    """Gap of a stop [rad, m], of one row of values."""
    stop = system.mechanism.stop(name)
    if isinstance(stop, PointStop):
        return _across(stop, values, "Position") - stop.offset
    return _apart(stop, values, "CoordinatesTotal") - stop.limit


def gap_speed(system: System, name: str, values: Values) -> float:
    """Speed of a stop's gap [rad/s, m/s], of one row of values."""
    stop = system.mechanism.stop(name)
    if isinstance(stop, PointStop):
        return _across(stop, values, "Velocity")
    return _apart(stop, values, "Coordinates_t")


def _across(stop: PointStop, values: Values, quantity: str) -> float:
    return float(values(("stop", stop.name, quantity))[0, :2] @ np.array(stop.normal))


def _apart(stop: Stop, values: Values, quantity: str) -> float:
    def rotation(body: str) -> float:
        return 0.0 if body == GROUND else float(values(("body", body, quantity))[0, 2])

    # Exudyn's rotations are anticlockwise, hence the minus.
    return -stop.sense * (rotation(stop.body) - rotation(stop.relative_to))


def strike(system: System, state: State, touching: Closed, restitution: FloatArray) -> tuple[State, dict[str, float]]:
    """The state after an impact, and the impulse of each stop [N m s, N s].

    Args:
        system: what moves.
        state: before.
        touching: stops that touch, held ones included.
        restitution: e of each of them, shape (n_touching,).

    Raises:
        SimulationError: the stops that touch do not act independently of each other.
    """
    with matrices(system) as here:
        here.set(state.coordinates, state.rates)
        mass, joints = here.mass(), here.jacobian(())
        rows = np.array([-system.sense(name) * here.stop_row(name) for name in touching])
        still = np.zeros(len(joints))
        responses = np.array([solve_constrained(mass, joints, row, still)[0] for row in rows])
    impulses = _impulses(rows @ responses.T, (1.0 + restitution) * (rows @ state.rates))
    after = replace(state, rates=state.rates + impulses @ responses)
    return after, dict(zip(touching, impulses.tolist(), strict=True))


def _impulses(matrix: FloatArray, speeds: FloatArray) -> FloatArray:
    """The p >= 0 complementary to matrix p + speeds >= 0: with matrix = L L^T, the p of least |L^T p + L^-1 speeds|."""
    try:
        lower = cholesky(matrix, lower=True)
    except LinAlgError:
        raise SimulationError("exudyn's impact has no solution of its own: stops that touch are redundant.") from None
    return nnls(lower.T, -solve_triangular(lower, speeds, lower=True))[0]
