"""The launch: the instant when the projectile's velocity comes down to the launch angle."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import KroghInterpolator
from scipy.optimize import brentq

from .arrays import FloatArray
from .mechanism import Mechanism

LAUNCH_ANGLE = math.pi / 4
"""45 degrees above the horizontal, the paper's choice."""

_NEIGHBOURS = 4  # samples used on either side of the crossing: a polynomial of degree 15
_SAME_TIME = 1e-12  # [s] samples closer than this (an event on a grid time) count once


@dataclass(frozen=True)
class Launch:
    """Time [s], speed [m/s] and velocity [m/s] (2,) at the launch angle."""

    time: float
    speed: float
    velocity: tuple[float, float]


def rest_opened(mechanism: Mechanism, body: str, release_times: Mapping[str, float | None]) -> float | None:
    """When the last of a body's own rests opened [s]: 0 if it has none, None if one is still closed."""
    times = [release_times.get(stop.name) for stop in mechanism.stops if stop.body == body and stop.closed]
    return None if None in times else max((time for time in times if time is not None), default=0.0)


def lead(velocity: FloatArray, angle: float = LAUNCH_ANGLE) -> FloatArray:
    """Component of the velocity across the launch direction: it falls through zero at the launch, shape (...,)."""
    return velocity[..., 1] * math.cos(angle) - velocity[..., 0] * math.sin(angle)


def _forward(velocity: FloatArray, angle: float) -> FloatArray:
    return velocity[..., 0] * math.cos(angle) + velocity[..., 1] * math.sin(angle)


def launch_interval(velocity: FloatArray, angle: float = LAUNCH_ANGLE) -> int | None:
    """Index i of the first interval [i, i+1] in which the velocity turns down through the launch direction."""
    across = lead(velocity, angle)
    falls = (across[:-1] > 0) & (across[1:] <= 0) & (_forward(velocity[1:], angle) > 0)
    crossings = np.flatnonzero(falls)
    return int(crossings[0]) if len(crossings) else None


def launch_on(velocity_at: Callable[[float], FloatArray], t0: float, t1: float, angle: float = LAUNCH_ANGLE) -> Launch:
    """Root of :func:`lead` between t0 and t1 on a continuous velocity [m/s]."""

    def across(t: float) -> float:
        return float(lead(velocity_at(t), angle))

    # An end that is the launch itself may be evaluated a rounding beside where its interval was found.
    ends = [t for t, sign in ((t0, 1.0), (t1, -1.0)) if sign * across(t) <= 0]
    time = ends[0] if ends else float(brentq(across, t0, t1, xtol=1e-15, rtol=1e-15))
    vx, vy = (float(v) for v in velocity_at(time))
    return Launch(time, math.hypot(vx, vy), (vx, vy))


def locate_launch(
    t: FloatArray, position: FloatArray, velocity: FloatArray, angle: float | None = None, after: float = 0.0
) -> Launch | None:
    """Launch from samples, by the Hermite polynomial through the eight samples around the crossing.

    Both positions and velocities are used: at a coarse step that is worth several digits over velocities alone.

    Args:
        t: sample times [s], shape (n,).
        position: of the projectile [m], shape (n, 2).
        velocity: of the projectile [m/s], shape (n, 2).
        angle: above the horizontal [rad]; 45 degrees if left out.
        after: only crossings later than this count [s] (a projectile on its rest is not launched).
    """
    launch_angle = LAUNCH_ANGLE if angle is None else angle
    keep = np.concatenate([[True], np.diff(t) > _SAME_TIME]) & (t >= after)
    t, position, velocity = t[keep], position[keep], velocity[keep]
    i = launch_interval(velocity, launch_angle)
    if i is None:
        return None
    near = slice(max(0, i + 1 - _NEIGHBOURS), i + 1 + _NEIGHBOURS)
    step = float(t[i + 1] - t[i])
    velocity_at = _hermite((t[near] - t[i]) / step, position[near] - position[i], velocity[near] * step)
    launch = launch_on(lambda s: velocity_at(s / step) / step, 0.0, step, launch_angle)
    return Launch(launch.time + float(t[i]), launch.speed, launch.velocity)


def _hermite(x: FloatArray, values: FloatArray, slopes: FloatArray) -> Callable[[float], FloatArray]:
    """Derivative of the polynomial that takes the values and slopes at x."""
    both = np.empty((2 * len(x), values.shape[1]))
    both[::2], both[1::2] = values, slopes
    # Nodes nearest to the interval first: Krogh's divided differences then lose the fewest digits.
    order = np.argsort(np.abs(x - 0.5), kind="stable")
    nodes = np.repeat(x[order], 2)
    data = both.reshape(len(x), 2, -1)[order].reshape(both.shape)
    polynomial = KroghInterpolator(nodes, data)
    return lambda s: np.asarray(polynomial.derivative(s, 1), dtype=np.float64)
