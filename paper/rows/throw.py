"""Claims on the throw: constraint torques and events (Secs. III, VI, VII), the fixed machine's release (Sec. IV)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from ...models.arrays import FloatArray
from ...models.machines.trebuchet import HANGER_REST, PROJECTILE, SLING_REST
from ...models.problem import StopLaw
from ...models.trajectory import Trajectory
from ..evidence import quantities as of
from ..evidence.claims import (
    BEST_ANGLE,
    CAPTION_STEP,
    LAUNCH_SPEED,
    RELEASE_TIME,
    SLING_ANGLE,
    SLING_RADIANS,
    TIME_STEP,
    Quantity,
)
from ..evidence.throws import MachineThrow
from ..evidence.verdicts import (
    FIXED,
    ROLLING,
    Cause,
    Evidence,
    Grid,
    Row,
    as_printed,
    at_least,
    coincides,
    positive,
    vanishes,
)

_SIGNIFICANT = 0.1
_ROUNDING = 64 * 2.2e-16 * 10  # of angles up to ten radians
_DEGREE = 180 / math.pi


_ACROSS = 1.0  # [deg] the paper finds the right angle between two angles that it rounds to a degree each
_roughly = partial(at_least, need=0.99, reason="'roughly' asks that the curve accounts for 99 % of the variance")


def rows(evidence: Evidence) -> Iterator[Row]:
    """All of them."""
    for name, where in ((FIXED, "Sec. III"), (ROLLING, "Sec. VI")):
        yield _order(name, where)
    for name, where, printed in ((FIXED, "Eqs. (1), (6), (7)", "λ with G1"), (ROLLING, "Sec. VI", "G2 kept")):
        yield _pairing(evidence, name, where, printed)
    yield from _shapes()
    for name in (FIXED, ROLLING):
        yield from _signs(name)
    for name in evidence.throws:
        yield _rigid(name)
    for name in evidence.throws:
        yield from _third_constraint(name)
    throw = evidence.throws[FIXED]
    yield from _best_release()
    yield from _grids(throw)
    yield from _angles(evidence, throw)
    yield from _peak(throw)


def _later(name: str, first: str, second: str) -> of.Formula:
    return of.release_time(second).of(name) - of.release_time(first).of(name)


def _order(name: str, where: str) -> Row:
    return Row(
        f"hanger released first, {name}",
        where,
        "λ, then γ",
        "sling's release less hanger's",
        _later(name, HANGER_REST, SLING_REST),
        lambda q, _: positive(q, "the time from the hanger's release to the sling's"),
        name,
    )


def _pairing(evidence: Evidence, name: str, where: str, printed: str) -> Row:
    """By Eq. (1) lambda is the multiplier of G1, by Eq. (6) that of the sling's angle: then it is the sling's."""
    first, second = (evidence.throws[name].values[of.release_time(stop)] for stop in (HANGER_REST, SLING_REST))
    swapped = Cause(
        first < second,
        f"the hanger's multiplier, which Eqs. (1) and (7) call γ, is zero first, at {first:.4g} s; with the symbols "
        "the other way round, as in Figs. 2 and 3, all agrees",
    )
    return Row(
        f"which multiplier vanishes first, {name}",
        where,
        printed,
        "release of G2 (hanger) less that of G1 (sling)",
        _later(name, SLING_REST, HANGER_REST),
        lambda q, _: positive(q, "the time from the release of G1 (λ's by Eq. (1)) to that of G2", [swapped]),
        name,
    )


def _shapes() -> Iterator[Row]:
    for symbol, stop, body, figure, sense, printed in (
        ("λ", HANGER_REST, "hanger", "Fig. 2", "falls", "decreasing"),
        ("γ", SLING_REST, "sling", "Fig. 3", "rises", "increasing"),
    ):
        yield Row(
            f"{symbol} like a parabola",
            f"Sec. III, {figure}",
            "quadratic",
            "R² of a parabola through the torque while both rests push",
            of.parabola(stop).of(FIXED),
            lambda q, _: _roughly(q),
            FIXED,
        )
        yield Row(
            f"{symbol} only {sense}",
            f"Sec. III, {figure}",
            printed,
            f"largest growth of the {body}'s torque before the first release, of its start",
            of.climb(stop).of(FIXED),
            lambda q, _: vanishes(q, 0.0, "a torque that fades does not grow"),
            FIXED,
        )
    yield Row(
        "γ nearly linear after λ is gone",
        "Sec. III, Fig. 3",
        "linear",
        "R² of a line through the sling's torque between the releases",
        of.line(SLING_REST).of(FIXED),
        lambda q, _: _roughly(q),
        FIXED,
    )
    yield Row(
        "constraints depend on each other",
        "Secs. III, VII",
        "> 0",
        "change of the slope of γ where λ is gone, of its slope before",
        of.slope_change(SLING_REST).of(FIXED),
        lambda q, _: at_least(q, _SIGNIFICANT, "'significantly' asks for a tenth"),
        FIXED,
    )
    yield Row(
        "projectile freed sooner by the counterweight's swing",
        "Sec. III, Fig. 3",
        "> 1",
        "slope of γ once λ is gone, over its slope before",
        of.steepening(SLING_REST).of(FIXED),
        lambda q, _: at_least(q, 1 + _SIGNIFICANT, "quicker by a tenth"),
        FIXED,
    )


def _signs(name: str) -> Iterator[Row]:
    # Stops' torques here push their gaps open; in the paper's L = T - U + lambda G the hanger's multiplier, of
    # theta - alpha, has the same sign, and the sling's, of theta - phi, the opposite one.
    yield Row(
        f"λ at the start, {name}",
        "Sec. III, Fig. 2",
        "> 0",
        "hanger's multiplier at the start, in the paper's sign",
        of.start_torque(HANGER_REST).of(name),
        lambda q, _: positive(q, "the multiplier"),
        name,
    )
    yield Row(
        f"γ at the start, {name}",
        "Sec. III, Fig. 3",
        "< 0",
        "sling's multiplier at the start, in the paper's sign",
        of.start_torque(SLING_REST).of(name).times(-1),
        lambda q, _: positive(negated(q), "minus the multiplier"),
        name,
    )


def negated(q: Quantity) -> Quantity:
    """Minus a quantity."""
    return Quantity(value=-q.value, uncertainty=q.uncertainty, unit=q.unit)


def _rigid(name: str) -> Row:
    return Row(
        f"one rigid mass at first, {name}",
        "Sec. III",
        "rigid",
        "largest bend at the two rests before the first release",
        of.BEND.of(name),
        lambda q, _: vanishes(q, _ROUNDING, "rounding of angles"),
        name,
    )


def _third_constraint(name: str) -> Iterator[Row]:
    acting = StopLaw.UNILATERAL
    yield Row(
        f"launched before the arm is upright, {name}",
        "Sec. III",
        "> 0",
        "arm at 3π/2 less launch",
        of.ARM_DELAY.of(name),
        lambda q, _: positive(q, "the time from the launch to the arm's arrival"),
        name,
    )
    yield Row(
        f"arm stop acts after the launch, {name}",
        "Sec. III",
        "> 0",
        "first blow on a stop that acts, less launch",
        of.FIRST_BLOW.of(name) - of.LAUNCH_TIME.under(acting).of(name),
        lambda q, _: positive(q, "the time from the launch to the blow"),
        name,
    )
    speed, distance = ("launch", of.LAUNCH_SPEED, "launch speed"), ("range", of.RANGE, "range at 45 deg")
    for what, quantity, compared in (speed, distance):
        yield Row(
            f"third constraint leaves the {what} alone, {name}",
            "Sec. III",
            "0",
            f"{compared} with an arm stop that acts, less that without",
            quantity.under(acting).of(name) - quantity.of(name),
            lambda q, _: vanishes(q, 0.0, "the same launch"),
            name,
        )


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
    ranges = [value for _, value in time_grid(throw, throw.values[of.BEST_TIME], of.vacuum_ranges).values]
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
