"""Claims on the release of the fixed machine: Secs. IV and VII, Fig. 4."""

from __future__ import annotations

import math

import numpy as np

from ...models.arrays import FloatArray
from ...models.machines.trebuchet import PROJECTILE
from ...models.trajectory import Trajectory
from ..evidence import Evidence, Row, Values
from ..results import Quantity
from ..throws.grids import CAPTION_STEP, TIME_STEP, time_grid
from ..verdicts import Cause, Judgement, as_printed, coincides, positive, vanishes

_DEGREE = 180 / math.pi
_PRINTED_TIME = 2.745  # [s]
_ACROSS = 1.0  # [deg] the paper finds the right angle between two angles that it rounds to a degree each


def rows(evidence: Evidence) -> list[Row]:
    """All of them."""
    return [*_release(), *_grids(evidence), *_angles(evidence), *_peak(evidence)]


def _release() -> list[Row]:
    return [
        Row(
            "time of the best release",
            "Sec. IV",
            "2.745 s",
            "release time of the longest range, no drag",
            "s",
            lambda f: f["fixed: best_release_time, longest range"],
            lambda q: as_printed(q, "2.745"),
            "fixed",
        ),
        Row(
            "sling's angle at the best release",
            "Sec. IV",
            "585°",
            "phi at the release of the longest range",
            "deg",
            lambda f: f["fixed: coordinate (phi), longest range"] * _DEGREE,
            lambda q: as_printed(q, "585"),
            "fixed",
        ),
        Row(
            "sling's angle in radians",
            "Sec. IV",
            "10.2 rad",
            "phi at the release of the longest range",
            "rad",
            lambda f: f["fixed: coordinate (phi), longest range"],
            lambda q: as_printed(q, "10.2"),
            "fixed",
        ),
    ]


def _grids(evidence: Evidence) -> list[Row]:
    return [
        Row(
            "grid of release times, text",
            "Sec. IV",
            "2.745 s on 0.005 s",
            "best release among the multiples of 0.005 s",
            "s",
            lambda f: f[f"fixed: best release on a grid, {TIME_STEP:g} s"],
            lambda q: as_printed(q, "2.745"),
            "fixed",
        ),
        Row(
            "grid of release times, caption",
            "Fig. 4, caption",
            "2.745 s on 0.01 s",
            "best release among the multiples of 0.01 s",
            "s",
            lambda f: f[f"fixed: best release on a grid, {CAPTION_STEP:g} s"],
            lambda q: as_printed(q, "2.745", causes=_caption(evidence.ours)),
            "fixed",
        ),
        Row(
            "launch speed at l1 = 10",
            "Sec. V",
            "99.4 m/s",
            "speed when the velocity is at 45 deg",
            "m/s",
            lambda f: f["fixed: launch_speed"],
            lambda q: as_printed(q, "99.4"),
            "fixed",
        ),
    ]


def _caption(ours: Values) -> list[Cause]:
    fine = ours[f"fixed: best release on a grid, {TIME_STEP:g} s"]
    off = abs(math.remainder(fine, CAPTION_STEP)) > 1e-9  # a multiple of the step, but for rounding
    sentence = f"{fine:g} s, the best of the multiples of {TIME_STEP:g} s, is no multiple of {CAPTION_STEP:g} s"
    return [Cause(off, f"text and caption cannot both be right: {sentence}")]


def _angles(evidence: Evidence) -> list[Row]:
    throw = evidence.throws["fixed"]
    best = throw.figures["best_release_time, longest range"]
    direction = time_grid(throw, best, _direction)
    moving = _pin_speed(evidence, best)
    return [
        Row(
            "best angle of release",
            "Secs. IV, VII",
            "45°",
            "angle of the velocity at the release of the longest range",
            "deg",
            lambda f: f["fixed: best_release_angle, longest range"] * _DEGREE,
            lambda q: as_printed(q, "45", direction, [_still_faster(evidence.ours)]),
            "fixed",
        ),
        Row(
            "another best angle needs a higher speed",
            "Sec. IV",
            "> 0",
            "speed at the best angle, less that at 45 deg",
            "m/s",
            lambda f: f["fixed: best_release_speed, longest range"] - f["fixed: launch_speed"],
            lambda q: positive(q, "the higher speed that another best angle would need"),
            "fixed",
        ),
        Row(
            "velocity across the sling",
            "Sec. IV",
            "90°",
            "angle from sling to velocity at the best release, less a right angle",
            "deg",
            lambda f: f["fixed: velocity to sling, longest range"] * _DEGREE - 90.0,
            lambda q: vanishes(q, _ACROSS, "half a degree each of 585° and of 45°", [moving]),
            "fixed",
        ),
    ]


def _still_faster(ours: Values) -> Cause:
    after = ours["fixed: largest_ratio_time, fastest"] - ours["fixed: launch_time"]
    return Cause(after > 0, f"the projectile still gains speed for {after:.3g} s after the velocity is at 45 deg")


def _pin_speed(evidence: Evidence, time: float) -> Cause:
    u = evidence.throws["fixed"].at(np.array([time])).u[0]
    speed = evidence.parameters.l1 * abs(float(u[0]))
    printed = float(_to_sling(evidence.throws["fixed"].at(np.array([_PRINTED_TIME])))[0]) - 90.0
    sentence = (
        f"the sling's pin still moves with {speed:.3g} m/s; at the printed {_PRINTED_TIME} s ours is {printed:.3g} deg"
    )
    return Cause(speed > 0, sentence)


def _direction(trajectory: Trajectory) -> FloatArray:
    vx, vy = trajectory.marker(PROJECTILE).velocity.T
    return np.degrees(np.arctan2(vy, vx))


def _to_sling(trajectory: Trajectory) -> FloatArray:
    vx, vy = trajectory.marker(PROJECTILE).velocity.T
    turn = np.arctan2(vy, vx) + trajectory.q[:, 1]
    return np.degrees(np.abs(np.angle(np.exp(1j * turn))))


def _peak(evidence: Evidence) -> list[Row]:
    throw = evidence.throws["fixed"]
    ranges = [loss for _, loss in time_grid(throw, throw.figures["best_release_time, longest range"], _range).values]
    lost = throw.figures["best_range, longest range"] - min(ranges)

    def in_range(q: Quantity) -> Judgement:
        return coincides(q, lost, "what the range loses within one step of the paper's 0.005 s")

    return [
        Row(
            "peak speed at the best angle",
            "Sec. IV",
            "same instant",
            "time of the largest speed less that of the best release",
            "s",
            lambda f: f["fixed: fastest after longest range"],
            lambda q: coincides(q, TIME_STEP, "one step of the paper's release times"),
            "fixed",
        ),
        Row(
            "45 deg gives the largest range",
            "Sec. VI",
            "same range",
            "longest range less that at 45 deg",
            "m",
            lambda f: f["fixed: range gain, longest range"],
            in_range,
            "fixed",
        ),
    ]


def _range(trajectory: Trajectory) -> FloatArray:
    (x, y), (vx, vy) = trajectory.marker(PROJECTILE).position.T, trajectory.marker(PROJECTILE).velocity.T
    g = trajectory.mechanism.gravity
    return x + vx * (vy + np.sqrt(vy**2 + 2 * g * y)) / g
