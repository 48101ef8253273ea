"""A motion as one polynomial over a window that fulfils the equations of motion at Gauss's points of it.

Hairer, Norsett, Wanner, *Solving Ordinary Differential Equations I*, 1993, II.7. Where the motion
is analytic the error falls as fast as its Legendre series does. What happens between the points, at
which the equations may be singular, is never evaluated.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial import legendre
from scipy.linalg import lu_factor, lu_solve

from ..models.arrays import FloatArray

_ITERATIONS = 20
_ROUNDING, _STALLED = (
    1e-15,
    1e-12,
)  # of the largest arm: a change this small ends the iteration; where none is smaller

Accelerations = Callable[[FloatArray, FloatArray], FloatArray]
"""Of coordinates and speeds, shapes (n, n_q)."""


@dataclass(frozen=True)
class Given:
    """The state that a motion has at one time [s]."""

    time: float
    q: FloatArray
    u: FloatArray


@dataclass(frozen=True)
class Polynomial:
    """A motion over a window from `start` [s], twice `half` long: Legendre series on -1 to 1, each (n, ...)."""

    start: float
    half: float
    q: FloatArray
    u: FloatArray
    a: FloatArray

    def values(self, series: FloatArray, t: FloatArray) -> FloatArray:
        """A series at times t [s]: shape (*t.shape, ...)."""
        values = legendre.legval((np.asarray(t) - self.start) / self.half - 1.0, series)
        return np.asarray(np.moveaxis(values, 0, -1), dtype=np.float64)


def collocated(
    accelerations: Accelerations,
    given: Given,
    window: tuple[float, float],
    n: int,
    guess: Polynomial | None,
    arms: FloatArray,
) -> Polynomial | None:
    """The polynomial motion that fulfils the equations at n points of a window and has the given state.

    Args:
        accelerations: the equations of motion.
        given: the state, at the window's start or in its middle.
        window: its start and half its length [s].
        n: number of points.
        guess: another polynomial near it; constant accelerations, those of the given state, if left
        out.
        arms: weights of the coordinates, shape (n_q,), that make them comparable.

    Returns:
        None if Newton's iteration does not converge.
    """
    start, half = window
    base = (given.time - start) / half - 1.0
    x, to_series, once, twice = gauss(n, base)
    once, twice = half * once, half**2 * twice
    start_q, start_u = (
        given.q + half * np.outer(x - base, given.u),
        np.broadcast_to(given.u, (n, len(given.u))),
    )
    a = (
        _first(accelerations, given, base, n)
        if guess is None
        else guess.values(guess.a, start + half * (x + 1))
    )
    last, factors = np.inf, None
    for _ in range(_ITERATIONS):
        q, u = start_q + twice @ a, start_u + once @ a
        if factors is None:
            factors = lu_factor(_newton(accelerations, q, u, once, twice), check_finite=False)
        change = lu_solve(factors, (accelerations(q, u) - a).ravel(), check_finite=False).reshape(
            a.shape
        )
        a = a + change
        size = float((np.abs(twice @ change) * arms).max())
        if not size < 10:
            return None
        if size < _ROUNDING or (size < _STALLED and size > 0.3 * last):
            return _integrated(given, window, to_series @ a, base)
        factors = None if size > 0.1 * last else factors
        last = size
    return None


def _first(accelerations: Accelerations, given: Given, base: float, n: int) -> FloatArray:
    """Constant accelerations; none where the given state is in the middle, and so a singular position."""
    a = accelerations(given.q, given.u) if base < 0 else np.zeros_like(given.u)
    return np.broadcast_to(a, (n, len(a)))


def _integrated(
    given: Given, window: tuple[float, float], series: FloatArray, base: float
) -> Polynomial:
    start, half = window
    u = np.asarray(half * legendre.legint(series, lbnd=base), dtype=np.float64)
    u[0] += given.u
    q = np.asarray(half * legendre.legint(u, lbnd=base), dtype=np.float64)
    q[0] += given.q
    return Polynomial(start, half, q, u, series)


def _newton(
    accelerations: Accelerations, q: FloatArray, u: FloatArray, once: FloatArray, twice: FloatArray
) -> FloatArray:
    """Derivative of a - f(q, u) by the accelerations at all points, f's own by differences."""
    n, n_q = q.shape
    matrix = np.zeros((n, n_q, n, n_q))
    for j in range(n_q):
        dq, du = np.zeros(n_q), np.zeros(n_q)
        dq[j], du[j] = 1e-7, 1e-6 * max(1.0, float(np.abs(u).max()))
        by_q = (accelerations(q + dq, u) - accelerations(q - dq, u)) / (2 * dq[j])
        by_u = (accelerations(q, u + du) - accelerations(q, u - du)) / (2 * du[j])
        matrix[:, :, :, j] = -(
            by_q[:, :, None] * twice[:, None, :] + by_u[:, :, None] * once[:, None, :]
        )
    return matrix.reshape(n * n_q, n * n_q) + np.eye(n * n_q)


@lru_cache(16)
def gauss(n: int, base: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Gauss's n points, what makes Legendre series of values there, and their integrals from `base`, once and twice."""
    points, weights = legendre.leggauss(n)
    x = np.asarray(points, dtype=np.float64)
    to_series = (np.arange(n) + 0.5)[:, None] * legendre.legvander(x, n - 1).T * weights
    integrals = (legendre.legval(x, legendre.legint(to_series, m, lbnd=base)).T for m in (1, 2))
    once, twice = (np.asarray(values, dtype=np.float64) for values in integrals)
    return x, to_series, once, twice
