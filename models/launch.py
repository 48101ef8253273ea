"""The launch: the instant when the projectile's velocity comes down to the launch angle.

The component of the velocity across the launch direction (:func:`lead`) falls through zero there,
with the velocity pointing along the direction and not against it, after the last rest of the
projectile's own body has opened. Such roots are bracketed by extremes: between two events, or two
samples, the velocity is smooth, its Chebyshev interpolant gives the instants where the component is
stationary, and between two of them it is monotone. So two roots within one step are not missed, and
no time or length of the mechanism enters.

At an impact the velocity jumps. The launch is then that of a stiff contact in the limit: as the
impulse grows the velocity moves along a straight line, and where that line crosses the launch
direction the projectile is let go. While a rest of its own body pushes it, or strikes it, there is
no launch.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from .arrays import FloatArray
from .mechanism import Mechanism

LAUNCH_ANGLE = math.pi / 4
"""45 degrees above the horizontal, the paper's choice."""

_NEIGHBOURS = 4  # samples used on either side of the crossing: a polynomial of degree 15
# Parts of the time: samples closer than this (an event on a grid time) count once.
_SAME_TIME = 1e-12

_DEGREE = 16  # of the interpolant of a step; it is halved where that does not resolve it
# Chebyshev's extreme points, from 0 to 1.
_NODES = 0.5 - 0.5 * np.cos(np.pi * np.arange(_DEGREE + 1) / _DEGREE)
# Values at the nodes to coefficients.
_TO_CHEBYSHEV = np.linalg.inv(chebyshev.chebvander(2.0 * _NODES - 1.0, _DEGREE)).T
_RESOLVED = 1e-8  # last coefficients over the largest; an extreme's value then errs by their square
_HALVINGS = 8
_CHUNK = 32  # steps that are sampled at once
_ROUNDING = 1e-14  # of a velocity, in parts of it
# Of speeds, in parts of their scale: a chain of light bodies may turn a hundred times faster than
# it falls.
_NOISE = 1e-12
AT_REST = 1e-8  # parts of the scale: slower than this nothing is thrown, and a rest may rattle
# [rad] a motion that ends this little above the launch direction ends with its launch.
_AT_END = 1e-12

Component = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Launch:
    """Time [s], speed [m/s] and velocity [m/s] (2,) at the launch angle."""

    time: float
    speed: float
    velocity: tuple[float, float]


@dataclass(frozen=True)
class SmoothVelocity:
    """A point's velocity between two events."""

    knots: FloatArray
    """Increasing instants [s], shape (n,), between which it is analytic, such as steps."""
    at: Callable[[FloatArray], FloatArray]
    """Velocities [m/s], shape (n, 2), at times [s], shape (n,)."""


def rest_opened(
    mechanism: Mechanism, body: str, release_times: Mapping[str, float | None]
) -> float | None:
    """Time at which the last rest of a body opened [s]: 0 without rests, None if one is closed."""
    opened = 0.0
    for stop in mechanism.stops:
        if stop.body == body and stop.closed:
            time = release_times.get(stop.name)
            if time is None:
                return None
            opened = max(opened, time)
    return opened


def lead(velocity: FloatArray, angle: float = LAUNCH_ANGLE) -> FloatArray:
    """Velocity across the launch direction, shape (...,); it falls through zero at the launch."""
    return velocity[..., 1] * math.cos(angle) - velocity[..., 0] * math.sin(angle)


def is_launch(
    velocity: FloatArray | tuple[float, float], angle: float = LAUNCH_ANGLE, scale: float = 0.0
) -> bool:
    """Tell whether a velocity (2,) on the launch direction's line points along it and is not zero.

    Args:
        scale: of the mechanism's speeds [m/s] (:meth:`.kinematics.Kinematics.speed_scale`).
    """
    return bool(velocity[0] * math.cos(angle) + velocity[1] * math.sin(angle) > AT_REST * scale)


def launch_interval(velocity: FloatArray, angle: float = LAUNCH_ANGLE) -> int | None:
    """Index i of the first interval [i, i+1] where the velocity falls through the direction.

    The straight line between the two velocities must cross the direction itself, not its opposite.
    """
    across = lead(velocity, angle)
    for i in np.flatnonzero((across[:-1] > 0) & (across[1:] <= 0)).tolist():
        if is_launch(_on_line(velocity[i], velocity[i + 1], angle), angle):
            return i
    return None


def first_launch(
    pieces: Iterable[SmoothVelocity | None], angle: float = LAUNCH_ANGLE, scale: float = 0.0
) -> Launch | None:
    """The first launch of a motion made of smooth pieces, one after the other.

    Args:
        pieces: at the instant between two of them the velocity may jump; None while the projectile
        is on its rest.
        angle: above the horizontal [rad].
        scale: of the mechanism's speeds [m/s]: below small parts of it a speed is rounding, or a
            rest that rattles.
    """
    noise = _NOISE * scale
    # The last instant at which the component was positive, if it was not negative since.
    above: float | None = None
    last: SmoothVelocity | None = None
    for piece in pieces:
        if piece is None:
            above, last = None, None
            continue
        if above is not None and last is not None:
            above = float(piece.knots[0])
            start = piece.at(piece.knots[:1])[0]
            if lead(start, angle) < -noise:
                above, velocity = None, _on_line(last.at(last.knots[-1:])[0], start, angle)
                if is_launch(velocity, angle, scale):
                    return _launch(float(piece.knots[0]), velocity)
        for first in range(0, len(piece.knots) - 1, _CHUNK):
            t = _monotone_between(
                lambda t, at=piece.at: lead(at(t), angle),
                piece.knots[first : first + _CHUNK + 1],
                noise,
            )
            velocity = piece.at(t)
            across = lead(velocity, angle)
            # Instants where it is within rounding of zero are left out.
            clear = np.abs(across) > noise + _ROUNDING * np.linalg.norm(velocity, axis=1)
            t, positive = t[clear], np.append(above is not None, across[clear] > 0)
            before = np.concatenate([t[:1] if above is None else [above], t])[:-1]
            for i in np.flatnonzero(positive[:-1] & ~positive[1:]).tolist():
                launch = _launch_between(piece.at, float(before[i]), float(t[i]), angle)
                if is_launch(np.array(launch.velocity), angle, scale):
                    return launch
            if not positive[-1]:
                above = None
            elif len(t):
                above = float(t[-1])
        last = piece
    if above is None or last is None:
        return None
    # The velocity may have just come down to the launch direction at the end of the motion.
    end = float(last.knots[-1])
    earlier, velocity = last.at(np.array([0.5 * (last.knots[-2] + end), end]))
    across, speed = float(lead(velocity, angle)), float(np.linalg.norm(velocity))
    falls = across < lead(earlier, angle) and across <= _AT_END * speed
    return _launch(end, velocity) if falls and is_launch(velocity, angle, scale) else None


def _monotone_between(function: Component, knots: FloatArray, noise: float) -> FloatArray:
    """Instants between which a function is monotone wherever it may be zero, the knots among them.

    Args:
        function: analytic between the knots.
        knots: [s], shape (n,).
        noise: what of the function is rounding.
    """
    coefficients = _interpolated(function, knots)
    for _ in range(_HALVINGS):
        sizes = np.abs(coefficients)
        coarse = sizes[:, -2:].max(axis=1) > _RESOLVED * sizes.max(axis=1) + noise
        if not np.any(coarse):
            break
        knots = np.unique(np.concatenate([knots, 0.5 * (knots[:-1] + knots[1:])[coarse]]))
        coefficients = _interpolated(function, knots)
    sizes = np.abs(coefficients)
    may_be_zero = sizes[:, 0] <= (1.0 + _RESOLVED) * sizes[:, 1:].sum(axis=1) + noise
    times = [knots]
    for i in np.flatnonzero(may_be_zero).tolist():
        # Stationary points of the series in (-1, 1), exact or nearly so.
        size = np.abs(coefficients[i]).max()
        series = chebyshev.chebtrim(coefficients[i], _ROUNDING * size)
        roots = chebyshev.chebroots(chebyshev.chebder(series)).real
        roots = roots[np.abs(roots) < 1]
        times.append(knots[i] + (knots[i + 1] - knots[i]) * 0.5 * (1.0 + roots))
    return np.unique(np.concatenate(times))


def _interpolated(function: Component, knots: FloatArray) -> FloatArray:
    """Chebyshev coefficients of a function between the knots, shape (n - 1, _DEGREE + 1)."""
    t = knots[:-1, None] + np.diff(knots)[:, None] * _NODES
    t[:, -1] = knots[1:]
    return function(t.ravel()).reshape(t.shape) @ _TO_CHEBYSHEV


def _launch_between(
    velocity_at: Callable[[FloatArray], FloatArray], t0: float, t1: float, angle: float
) -> Launch:
    """Root of :func:`lead` between t0 and t1 [s] on a continuous velocity [m/s]."""
    from scipy.optimize import brentq  # a third of a second, which lists of engines do not need

    def across(t: float) -> float:
        return float(lead(velocity_at(np.array([t]))[0], angle))

    # An end that is the launch itself may be evaluated a rounding beside where its interval began.
    if across(t0) <= 0:
        time = t0
    elif across(t1) >= 0:
        time = t1
    else:
        shortest = max(1e-15 * (t1 - t0), np.finfo(np.float64).tiny)
        time = float(brentq(across, t0, t1, xtol=shortest, rtol=1e-15))
    return _launch(time, velocity_at(np.array([time]))[0])


def _on_line(start: FloatArray, end: FloatArray, angle: float) -> FloatArray:
    """Intersection of the line between two velocities with the launch direction's, shape (2,)."""
    before, after = lead(start, angle), lead(end, angle)
    return start + np.clip(before / (before - after), 0.0, 1.0) * (end - start)


def _launch(time: float, velocity: FloatArray) -> Launch:
    vx, vy = (float(v) for v in velocity)
    return Launch(time, math.hypot(vx, vy), (vx, vy))


def locate_launch(
    t: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    angle: float | None = None,
    after: float = 0.0,
) -> Launch | None:
    """Launch from samples, by the Hermite polynomial through the eight samples around the crossing.

    Both positions and velocities are used: at a coarse step that is worth several digits over
    velocities alone. An interval at whose two ends the component across the direction is positive,
    but small, is searched as well.

    Args:
        t: sample times [s], shape (n,).
        position: of the projectile [m], shape (n, 2).
        velocity: of the projectile [m/s], shape (n, 2).
        angle: above the horizontal [rad]; 45 degrees if left out.
        after: only crossings later than this count [s] (a projectile on its rest is not launched).
    """
    launch_angle = LAUNCH_ANGLE if angle is None else angle
    keep = np.concatenate([[True], np.diff(t) > _SAME_TIME * np.abs(t[1:])]) & (t >= after)
    t, position, velocity = t[keep], position[keep], velocity[keep]
    across = lead(velocity, launch_angle)
    scale = float(np.linalg.norm(velocity, axis=1).max(initial=0.0))
    for i in _suspects(across, _NOISE * scale):
        near = slice(max(0, i + 1 - _NEIGHBOURS), i + 1 + _NEIGHBOURS)
        step = float(t[i + 1] - t[i])
        velocity_at = _hermite(
            (t[near] - t[i]) / step, position[near] - position[i], velocity[near] * step
        )
        launch = first_launch([SmoothVelocity(np.array([0.0, 1.0]), velocity_at)], launch_angle)
        # The polynomial's rounding at an end that is the launch itself.
        if launch is None and across[i + 1] <= 0:
            launch = _launch_between(velocity_at, 0.0, 1.0, launch_angle)
        if launch and is_launch(np.array(launch.velocity) / step, launch_angle, scale):
            return _launch(float(t[i]) + step * launch.time, np.array(launch.velocity) / step)
    return None


def _suspects(across: FloatArray, least: float) -> list[int]:
    """Intervals [i, i+1] of samples in which a component falls through zero, or may dip below it.

    It may dip where it has its smallest sample, or the two smallest, and those are small for how
    sharply it turns.
    """
    falls = (across[:-1] > 0) & (across[1:] <= 0)
    slopes = np.diff(across)
    dips = np.zeros_like(falls)
    if len(across) > 3:
        bend = 2.0 * np.maximum(np.abs(np.diff(slopes)[:-1]), np.abs(np.diff(slopes)[1:]))
        lowest = np.minimum(across[1:-2], across[2:-1])
        dips[1:-1] = (slopes[:-2] < 0) & (slopes[2:] > 0) & (lowest > least) & (lowest <= bend)
    return np.flatnonzero(falls | dips).tolist()


def _hermite(
    x: FloatArray, values: FloatArray, slopes: FloatArray
) -> Callable[[FloatArray], FloatArray]:
    """Derivative from 0 to 1 of the polynomial that takes the values and slopes at x.

    It is given as its Chebyshev series there, which is exact: its degree is below `_DEGREE`. One
    value of that costs some twentieth of one by divided differences.
    """
    from scipy.interpolate import KroghInterpolator  # as above

    both = np.empty((2 * len(x), values.shape[1]))
    both[::2], both[1::2] = values, slopes
    # Nodes nearest to the interval first: Krogh's divided differences then lose the fewest digits.
    order = np.argsort(np.abs(x - 0.5), kind="stable")
    nodes = np.repeat(x[order], 2)
    data = both.reshape(len(x), 2, -1)[order].reshape(both.shape)
    polynomial = KroghInterpolator(nodes, data)
    series = _TO_CHEBYSHEV.T @ np.asarray(polynomial.derivative(_NODES, 1), dtype=np.float64)
    return lambda s: np.asarray(chebyshev.chebval(2.0 * s - 1.0, series).T, dtype=np.float64)
