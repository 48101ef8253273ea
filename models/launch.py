"""The launch: the instant when the projectile's velocity comes down to the launch angle."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BarycentricInterpolator
from scipy.optimize import brentq

from .arrays import FloatArray

LAUNCH_ANGLE = math.pi / 4
"""45 degrees above the horizontal, the paper's choice."""

_NEIGHBOURS = 4  # samples used on either side of the crossing: a polynomial of degree 7
_SAME_TIME = 1e-12  # [s] samples closer than this (an event on a grid time) count once


@dataclass(frozen=True)
class Launch:
    """Time [s], speed [m/s] and velocity [m/s] (2,) at the launch angle."""

    time: float
    speed: float
    velocity: tuple[float, float]


def lead(velocity: FloatArray, angle: float = LAUNCH_ANGLE) -> FloatArray:
    """Component of the velocity across the launch direction: it falls through zero at the launch, shape (...,)."""
    return velocity[..., 1] * math.cos(angle) - velocity[..., 0] * math.sin(angle)


def _forward(velocity: FloatArray, angle: float) -> FloatArray:
    return velocity[..., 0] * math.cos(angle) + velocity[..., 1] * math.sin(angle)


def launch_interval(velocity: FloatArray, angle: float = LAUNCH_ANGLE) -> int | None:
    """Index i of the first interval [i, i+1] in which the velocity turns down through the launch direction."""
    across = lead(velocity, angle)
    falls = (across[:-1] > 0) & (across[1:] <= 0) & (_forward(velocity[1:], angle) > 0)
    found = np.flatnonzero(falls)
    return int(found[0]) if len(found) else None


def launch_on(velocity_at: Callable[[float], FloatArray], t0: float, t1: float, angle: float = LAUNCH_ANGLE) -> Launch:
    """Root of :func:`lead` between t0 and t1 on a continuous velocity [m/s]."""
    time = float(brentq(lambda t: float(lead(velocity_at(t), angle)), t0, t1, xtol=1e-15, rtol=1e-15))
    vx, vy = (float(v) for v in velocity_at(time))
    return Launch(time, math.hypot(vx, vy), (vx, vy))


def locate_launch(t: FloatArray, velocity: FloatArray, angle: float | None = None, after: float = 0.0) -> Launch | None:
    """Launch from samples, by the polynomial through the eight samples around the crossing.

    Args:
        t: sample times [s], shape (n,).
        velocity: of the projectile [m/s], shape (n, 2).
        angle: above the horizontal [rad]; 45 degrees if left out.
        after: only crossings later than this count [s] (a projectile on its rest is not launched).
    """
    wanted = LAUNCH_ANGLE if angle is None else angle
    keep = np.concatenate([[True], np.diff(t) > _SAME_TIME]) & (t >= after)
    t, velocity = t[keep], velocity[keep]
    i = launch_interval(velocity, wanted)
    if i is None:
        return None
    near = slice(max(0, i + 1 - _NEIGHBOURS), i + 1 + _NEIGHBOURS)
    # Centred on the crossing: the polynomial is then in a variable of order one step.
    polynomial = BarycentricInterpolator(t[near] - t[i], velocity[near])
    launch = launch_on(lambda s: np.asarray(polynomial(s), dtype=np.float64), 0.0, float(t[i + 1] - t[i]), wanted)
    return Launch(launch.time + float(t[i]), launch.speed, launch.velocity)
