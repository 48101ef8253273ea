"""Time-stepping schemes for engines that leave the stepping to their users."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from trebucheck.models.arrays import FloatArray

State = tuple[FloatArray, FloatArray]
"""Positions and speeds, each of shape (n,)."""
Acceleration = Callable[[FloatArray, FloatArray], FloatArray]


def semi_implicit_euler(acceleration: Acceleration, state: State, step: float) -> State:
    """Speeds first, then positions by the new speeds (symplectic Euler), order 1."""
    q, u = state
    u = u + step * acceleration(q, u)
    return q + step * u, u


def rk4(acceleration: Acceleration, state: State, step: float) -> State:
    """The classical scheme of order 4."""
    q, u = state
    half = 0.5 * step
    a1 = acceleration(q, u)
    u2 = u + half * a1
    a2 = acceleration(q + half * u, u2)
    u3 = u + half * a2
    a3 = acceleration(q + half * u2, u3)
    u4 = u + step * a3
    a4 = acceleration(q + step * u3, u4)
    return q + step / 6 * (u + 2 * u2 + 2 * u3 + u4), u + step / 6 * (a1 + 2 * a2 + 2 * a3 + a4)


SCHEMES: Mapping[str, Callable[[Acceleration, State, float], State]] = {
    "semi-implicit Euler": semi_implicit_euler,
    "RK4": rk4,
}
