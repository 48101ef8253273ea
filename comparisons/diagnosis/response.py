r"""What small faults do to the reference motion, to first order: the variational equations along it.

With y = (q, u) and the accelerations a(y) under the stops that are closed, a fault of size e moves
the state by e s(t):

    s' = da/dy s + (a_fault - a) / e,        s(0) = (start_fault - start) / e.

A stop opens where its torque is zero, so that the accelerations have no jump there, and neither has
s: a shift of the release is of second order. Impacts have a jump of s; motions with impacts are
solved anew instead (:mod:`.motion`). All faults are integrated together, by the classical
Runge-Kutta method on the times asked for, the events, and the steps of the reference's own
integrator, which are fine where the motion is fast. It serves to find suspects: what is reported of
one has been measured by solving the equations with the fault (:mod:`.motion`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...models.arrays import FloatArray
from ...models.kinematics import initial_state
from ...reference.equations import Equations
from ...reference.solution import Segment, Solution

_STEP = 1e-6  # of a state, in parts of its size, for central differences


@dataclass(frozen=True)
class _Path:
    """The reference in one segment: at the ends of its intervals and in their middles, 2 m + 1 times."""

    times: FloatArray
    y: FloatArray
    closed: tuple[str, ...]


def first_order(solution: Solution, faulty: Sequence[Equations], t: FloatArray) -> FloatArray:
    """Change of the state (q, u) that each fault causes, shape (n_faulty, n_t, 2 n_q).

    Args:
        solution: the reference's, without impacts up to the last time.
        faulty: equations of mechanisms with a small fault; their starts count.
        t: ascending times [s], shape (n_t,).
    """
    start = np.concatenate(initial_state(solution.problem.mechanism))
    s = np.stack(
        [np.concatenate(initial_state(equations.mechanism)) - start for equations in faulty], axis=1
    )
    times, states = [np.zeros(1)], [s[None]]
    for path in _paths(solution, t):
        grown = _integrated(solution.equations, faulty, path, s)
        times.append(path.times[2::2])
        states.append(grown)
        s = grown[-1]
    nodes, grown = np.concatenate(times), np.concatenate(states)
    return np.moveaxis(grown[np.searchsorted(nodes, t)], 2, 0)


def _paths(solution: Solution, t: FloatArray) -> list[_Path]:
    return [_path(segment, t) for segment in solution.segments if segment.start < t[-1]]


def _path(segment: Segment, t: FloatArray) -> _Path:
    end = min(segment.end, float(t[-1]))
    inside = [
        values[(values > segment.start) & (values < end)] for values in (t, segment.interpolant.ts)
    ]
    nodes = np.unique(np.concatenate([[segment.start, end], *inside]))
    times = np.empty(2 * len(nodes) - 1)
    times[::2], times[1::2] = nodes, 0.5 * (nodes[1:] + nodes[:-1])
    return _Path(times, np.asarray(segment.interpolant(times)).T, segment.closed)


def _integrated(
    right: Equations, faulty: Sequence[Equations], path: _Path, s: FloatArray
) -> FloatArray:
    """The change at the end of each interval, shape (m, 2 n_q, n_faulty), from that at the start of the first."""
    jacobian, forcing = _jacobian(right, path), _forcing(right, faulty, path)
    results: list[FloatArray] = []
    for i, h in zip(
        range(0, len(path.times) - 2, 2), path.times[2::2] - path.times[:-2:2], strict=True
    ):
        k1 = jacobian[i] @ s + forcing[i]
        k2 = jacobian[i + 1] @ (s + 0.5 * h * k1) + forcing[i + 1]
        k3 = jacobian[i + 1] @ (s + 0.5 * h * k2) + forcing[i + 1]
        k4 = jacobian[i + 2] @ (s + h * k3) + forcing[i + 2]
        s = s + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        results.append(s)
    return np.array(results)


def _accelerations(equations: Equations, y: FloatArray, closed: tuple[str, ...]) -> FloatArray:
    n = y.shape[-1] // 2
    return equations.solve(y[..., :n], y[..., n:], closed)[0]


def _jacobian(right: Equations, path: _Path) -> FloatArray:
    """D(u, a)/dy, shape (2 m + 1, 2 n_q, 2 n_q), by central differences."""
    n = path.y.shape[1] // 2
    size = np.concatenate([np.ones(n), np.full(n, np.abs(path.y[:, n:]).max() or 1.0)])
    jacobian = np.zeros((len(path.y), 2 * n, 2 * n))
    jacobian[:, :n, n:] = np.eye(n)
    for k, step in enumerate(_STEP * size):
        shift = np.zeros(2 * n)
        shift[k] = step
        ahead, behind = (
            _accelerations(right, path.y + sign * shift, path.closed) for sign in (1, -1)
        )
        jacobian[:, n:, k] = (ahead - behind) / (2 * step)
    return jacobian


def _forcing(right: Equations, faulty: Sequence[Equations], path: _Path) -> FloatArray:
    """What each fault adds to the rates of the same state, shape (2 m + 1, 2 n_q, n_faulty)."""
    n = path.y.shape[1] // 2
    own = _accelerations(right, path.y, path.closed)
    forcing = np.zeros((len(path.y), 2 * n, len(faulty)))
    for k, equations in enumerate(faulty):
        forcing[:, n:, k] = _accelerations(equations, path.y, path.closed) - own
    return forcing
