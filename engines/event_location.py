"""Where in a step an event is: whether a gap may fall through zero, and the zero of a function over part of a step."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from ..models.arrays import FloatArray

_RESOLVED = 1e-13  # of the step in which an event is: error of its time


def may_be_met(gap: FloatArray, speed: FloatArray, least: float, step: float) -> NDArray[np.bool_]:
    """Whether a stop may be met between states that are a step apart; shapes (n + 1,) -> (n,).

    It is met if it closes in penetration at one of the two, or at the lowest point of the cubic
    between them.

    Args:
        gap: in each state [rad, m].
        speed: of the gap [rad/s, m/s].
        least: closing speed from which it is met.
        step: [s].
    """
    closing = (gap < 0) & (speed < -least)
    (g0, g1), (v0, v1) = (gap[:-1], gap[1:]), (speed[:-1] * step, speed[1:] * step)
    turns = (g0 > 0) & (speed[:-1] < -least) & (speed[1:] > 0)
    s = np.where(turns, v0 / np.where(turns, v0 - v1, 1.0), 0.0)
    lowest = (g0 * (1 + 2 * s) + v0 * s) * (1 - s) ** 2 + (g1 * (3 - 2 * s) - v1 * (1 - s)) * s**2
    return closing[:-1] | closing[1:] | (turns & (lowest < 0))


def onto_zero_gap(
    motion: Callable[[float], tuple[float, float]],
    gap: float,
    speeds: tuple[float, float],
    step: float,
    least: float,
) -> float | None:
    """The part of a step [s] after which a stop is met; None if it only comes near, or too slowly to be met.

    Args:
        motion: gap [rad, m] and its speed [rad/s, m/s] after a part of the step [s].
        gap: before the step.
        speeds: of the gap, before the step and after it.
        step: [s].
        least: closing speed from which it is met.
    """
    speed, last_speed = speeds
    if gap <= 0 and speed < -least:
        return 0.0
    turn = root_in(lambda part: motion(part)[1], 0.0, step) if speed * last_speed < 0 else 0.0
    # Where the gap grew at first the turn is its top, else its lowest point.
    low, high = (turn, step) if speed >= 0 else (0.0, turn or step)
    if motion(high)[0] >= 0:
        return None
    if motion(low)[0] > 0:
        low = root_in(lambda part: motion(part)[0], low, high)
    if motion(low)[1] < -least:
        return low
    return (
        root_in(lambda part: motion(part)[1] + least, low, high)
        if motion(high)[1] < -least
        else None
    )


def root_in(function: Callable[[float], float], low: float, high: float) -> float:
    """Zero of a function that changes its sign over part of a step [s]; the nearer end if rounding hides the change."""
    # An engine's warm start makes a last bit depend on the steps before: each value is taken once.
    function = functools.cache(function)
    first, last = function(low), function(high)
    if first * last >= 0:
        return low if abs(first) <= abs(last) else high
    return float(brentq(function, low, high, xtol=_RESOLVED * high))
