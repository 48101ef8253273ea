"""Claims on the release of the fixed machine: Secs. IV and VII, Fig. 4."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from ...models.arrays import FloatArray
from ...models.machines.trebuchet import PROJECTILE
from ...models.trajectory import Trajectory
from ..evidence import quantities as of
from ..evidence.printed import (
    BEST_ANGLE,
    CAPTION_STEP,
    LAUNCH_SPEED,
    RELEASE_TIME,
    SLING_ANGLE,
    SLING_RADIANS,
    TIME_STEP,
)
from ..evidence.quantities import vacuum_ranges
from ..evidence.throws import MachineThrow
from ..evidence.verdicts import FIXED, Cause, Evidence, Grid, Row, as_printed, coincides, positive, vanishes

_DEGREE = 180 / math.pi
_ACROSS = 1.0  # [deg] the paper finds the right angle between two angles that it rounds to a degree each


def rows(evidence: Evidence) -> Iterator[Row]:
    """All of them."""
    throw = evidence.throws[FIXED]
    yield from _best_release()
    yield from _grids(throw)
    yield from _angles(evidence, throw)
    yield from _peak(throw)


def _best_release() -> Iterator[Row]:
    yield Row(
        "time of the best release",
        "Sec. IV",
        RELEASE_TIME,
        "release time of the longest range, no drag",
        of.BEST_TIME.of(FIXED),
        as_printed,
        FIXED,
    )
    quantity = "phi at the release of the longest range"
    phi = of.BEST_PHI.of(FIXED)
    yield Row(
        "sling's angle at the best release",
        "Sec. IV",
        SLING_ANGLE,
        quantity,
        phi.times(_DEGREE, "deg"),
        as_printed,
        FIXED,
    )
    yield Row("sling's angle in radians", "Sec. IV", SLING_RADIANS, quantity, phi, as_printed, FIXED)


def _grids(throw: MachineThrow) -> Iterator[Row]:
    fine = throw.values[of.grid_release(TIME_STEP)]
    off = abs(math.remainder(fine, CAPTION_STEP)) > 1e-9  # a multiple of the step, but for rounding
    sentence = f"{fine:g} s, the best of the multiples of {TIME_STEP:g} s, is no multiple of {CAPTION_STEP:g} s"
    caption = [Cause(off, f"text and caption cannot both be right: {sentence}")]
    for source, where, step, causes in (
        ("text", "Sec. IV", TIME_STEP, []),
        ("caption", "Fig. 4, caption", CAPTION_STEP, caption),
    ):
        yield Row(
            f"grid of release times, {source}",
            where,
            f"{RELEASE_TIME} on {step:g} s",
            f"best release among the multiples of {step:g} s",
            of.grid_release(step).of(FIXED),
            partial(as_printed, causes=causes),
            FIXED,
        )
    yield Row(
        "launch speed at l1 = 10",
        "Sec. V",
        LAUNCH_SPEED,
        "speed when the velocity is at 45 deg",
        of.LAUNCH_SPEED.of(FIXED),
        as_printed,
        FIXED,
    )


def _angles(evidence: Evidence, throw: MachineThrow) -> Iterator[Row]:
    best = throw.values[of.BEST_TIME]
    later = throw.values[of.FASTEST_TIME] - throw.launch_time
    gaining = Cause(later > 0, f"the projectile still gains speed for {later:.3g} s after the velocity is at 45 deg")
    grid = time_grid(throw, best, _direction)
    yield Row(
        "best angle of release",
        "Secs. IV, VII",
        BEST_ANGLE,
        "angle of the velocity at the release of the longest range",
        of.BEST_ANGLE.of(FIXED).times(_DEGREE, "deg"),
        partial(as_printed, grid=grid, causes=[gaining]),
        FIXED,
    )
    yield Row(
        "another best angle needs a higher speed",
        "Sec. IV",
        "> 0",
        "speed at the best angle, less that at 45 deg",
        of.BEST_SPEED.of(FIXED) - of.LAUNCH_SPEED.of(FIXED),
        lambda q, _: positive(q, "the higher speed that another best angle would need"),
        FIXED,
    )
    moving = _pin_speed(evidence.parameters.l1, throw, best)
    yield Row(
        "velocity across the sling",
        "Sec. IV",
        "90°",
        "angle from sling to velocity at the best release, less a right angle",
        of.TO_SLING.of(FIXED).times(_DEGREE, "deg").plus(-90.0),
        lambda q, _: vanishes(q, _ACROSS, "half a degree each of 585° and of 45°", [moving]),
        FIXED,
    )


def _pin_speed(l1: float, throw: MachineThrow, time: float) -> Cause:
    speed = l1 * abs(float(throw.at(np.array([time])).u[0][0]))
    at_printed = float(_to_sling(throw.at(np.array([RELEASE_TIME.value])))[0]) - 90.0
    return Cause(
        speed > 0,
        f"the sling's pin still moves with {speed:.3g} m/s; at the printed {RELEASE_TIME} ours is {at_printed:.3g} deg",
    )


def _direction(trajectory: Trajectory) -> FloatArray:
    vx, vy = trajectory.marker(PROJECTILE).velocity.T
    return np.degrees(np.arctan2(vy, vx))


def _to_sling(trajectory: Trajectory) -> FloatArray:
    vx, vy = trajectory.marker(PROJECTILE).velocity.T
    turn = np.arctan2(vy, vx) + trajectory.q[:, 1]
    return np.degrees(np.abs(np.angle(np.exp(1j * turn))))


def _peak(throw: MachineThrow) -> Iterator[Row]:
    yield Row(
        "peak speed at the best angle",
        "Sec. IV",
        "same instant",
        "time of the largest speed less that of the best release",
        of.FASTEST_DELAY.of(FIXED),
        lambda q, _: coincides(q, TIME_STEP, "one step of the paper's release times"),
        FIXED,
    )
    ranges = [value for _, value in time_grid(throw, throw.values[of.BEST_TIME], vacuum_ranges).values]
    lost = throw.values[of.BEST_RANGE] - min(ranges)
    yield Row(
        "45 deg gives the largest range",
        "Sec. VI",
        "same range",
        "longest range less that at 45 deg",
        of.RANGE_GAIN.of(FIXED),
        lambda q, _: coincides(q, lost, f"what the range loses within one step of the paper's {TIME_STEP:g} s"),
        FIXED,
    )


def around(point: float, step: float) -> FloatArray:
    """Points of the grid k step, k whole, that lie within one step of a point."""
    first, last = math.ceil((point - step) / step - 1e-9), math.floor((point + step) / step + 1e-9)
    return np.arange(first, last + 1, dtype=np.float64) * step


def time_grid(throw: MachineThrow, time: float, value: Callable[[Trajectory], FloatArray]) -> Grid:
    """Our values at the points of the paper's grid of release times around an instant.

    Args:
        throw: whose reference is read.
        time: the instant [s].
        value: of a trajectory, shape (n,).
    """
    times = around(time, TIME_STEP)
    values = value(throw.at(times))
    return Grid(f"{TIME_STEP:g} s", tuple(zip(times.tolist(), values.tolist(), strict=True)))
