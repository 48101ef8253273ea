"""Claims on the fulcrum's position: Sec. V and Fig. 5."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from ..evidence.claims import (
    BACKWARD_L1,
    BEST_L1,
    BEST_RATIO,
    BEST_SPEED,
    END_L1,
    LAUNCH_SPEED,
    LEVER_RATIO,
    NO_SPEED,
    ZERO_L1,
    Quantity,
)
from ..evidence.quantities import LAUNCH_SPEED as SPEED
from ..evidence.quantities import fit
from ..evidence.verdicts import (
    FIXED,
    Cause,
    Evidence,
    Row,
    as_printed,
    at_least,
    at_most,
    occurs,
    positive,
    undecided,
)
from ..sweep.study import Position, Sweep

_SEC, _FIG = "Sec. V", "Sec. V, Fig. 5"
_LINEAR = 0.99  # 'linear-like': a line accounts for 99 % of the variance
_TRENDLESS = 0.9  # of the variance: 'no general trend' allows no curve that accounts for more
_ABRUPT = 0.5  # 'abruptly': the slope changes by half of itself
_BEST_RATIO, _BACKWARD = "best lever ratio", "falls backward below l1 = 9.9"
"""Facts that several rows state: where the speed is largest, and what happens below 9.9 m."""


def rows(sweep: Sweep, evidence: Evidence) -> Iterator[Row]:
    """Rows of this section."""
    rising = _rising(sweep)
    yield from _peak(sweep, rising)
    yield from _ratios(sweep, evidence, rising)
    yield _optimised(sweep, evidence, rising)
    yield _falls_backward(sweep)
    yield _past_pivot(sweep)
    yield from _below(sweep)
    yield _suspect(sweep)
    yield _regime(sweep)
    yield from _beyond(sweep)
    yield from _trend(sweep)


def _rising(sweep: Sweep) -> Cause:
    peak, at_printed = sweep.peak, sweep.position(BEST_L1.value)
    return Cause(
        at_printed is not None
        and at_printed.speed is not None
        and peak.speed.value > at_printed.speed.value,
        f"the speed goes on rising to {peak.speed.value:.2f} m/s at l1 = {peak.l1.value:.2f} m, a "
        f"lever ratio of {peak.lever_ratio:.2f}:1",
    )


def _peak(sweep: Sweep, rising: Cause) -> Iterator[Row]:
    peak, at_printed, judge = (
        sweep.peak,
        sweep.position(BEST_L1.value),
        partial(as_printed, causes=[rising]),
    )
    if at_printed is not None and at_printed.speed is not None:
        yield Row(
            "launch speed at l1 = 9.91",
            _FIG,
            BEST_SPEED,
            "speed when the velocity is at 45 deg",
            at_printed.speed,
            as_printed,
            FIXED,
            at_printed.engines,
        )
    quantity, swept = (
        f"l1 of the largest launch speed, {_swept(sweep)}",
        f"over all places, {_swept(sweep)}",
    )
    peaks = partial(Row, judge=judge, machine=FIXED, fact=_BEST_RATIO)
    yield peaks("place of the largest launch speed", _FIG, BEST_L1, quantity, peak.l1)
    yield peaks("largest launch speed", _FIG, BEST_SPEED, swept, peak.speed)


def _swept(sweep: Sweep) -> str:
    """Within which a verdict on all places holds."""
    return f"l1 being {sweep.start:g} to {sweep.end:g} m"


def _ratios(sweep: Sweep, evidence: Evidence, rising: Cause) -> Iterator[Row]:
    # d(l1 / l2) = beam / l2^2 dl1, the beam being kept.
    l1, p, quantity = (
        sweep.peak.l1,
        evidence.parameters,
        f"l1 / l2 of the largest launch speed, {_swept(sweep)}",
    )
    width = sweep.beam / (sweep.beam - l1.value) ** 2 * (l1.uncertainty or 0.0)
    ratio = Quantity(value=sweep.peak.lever_ratio, uncertainty=width, unit="")
    judge = partial(as_printed, causes=[rising])
    just = LEVER_RATIO.value + LEVER_RATIO.half - (BEST_RATIO.value - BEST_RATIO.half)
    yield Row(_BEST_RATIO, "Secs. V, VII", BEST_RATIO, quantity, ratio, judge, FIXED)
    yield Row(
        "best lever ratio just below the machine's",
        _SEC,
        f"{BEST_RATIO.digits} < {LEVER_RATIO.digits}",
        "machine's l1 / l2 less that of the largest launch speed",
        Quantity(value=p.l1 / p.l2 - ratio.value, uncertainty=width, unit=""),
        lambda q, _: at_most(
            q, just, "'just less': by no more than the two printed numbers are apart", [rising]
        ),
        FIXED,
        fact=_BEST_RATIO,
    )
    why = (
        "the cited machine is another: its arm starts backward and its sling lies on a trough; its "
        "own dimensions are not in the paper"
    )
    yield Row(
        "best lever ratio of a similar system", _SEC, "3 to 5", quantity, ratio, undecided(why)
    )


def _optimised(sweep: Sweep, evidence: Evidence, rising: Cause) -> Row:
    """Nearness to the best machine: 98.9 % by the paper's numbers, with rounding in its favour."""
    low, high = LAUNCH_SPEED, BEST_SPEED
    need = round((low.value - low.half) / (high.value + high.half), 4)
    share = evidence.ours[FIXED, SPEED] / sweep.peak.speed.value
    return Row(
        "machine nearly optimised",
        "Secs. V, VII",
        f"{low.digits} of {high.digits}",
        f"launch speed at l1 = 10 to the largest, {_swept(sweep)}",
        Quantity(value=share, uncertainty=None, unit=""),
        lambda q, _: at_least(q, need, f"the paper's {low.digits} to its {high.digits}", [rising]),
        FIXED,
        fact=_BEST_RATIO,
    )


def _falls_backward(sweep: Sweep) -> Row:
    positions = [position for position in sweep.positions if position.l1 < BACKWARD_L1.value]
    back = min((position.furthest_back for position in positions), default=0.0)
    turning = min(
        (position.arm_torque for position in positions), default=sweep.backward.least_torque
    )
    falls = any(position.arm_torque < 0 or position.furthest_back < 0 for position in positions)
    never = Cause(
        not falls,
        f"at all {len(positions)} places below {BACKWARD_L1} that were looked at gravity turns the "
        f"arm forward, with {turning:.4g} N m or more, and the arm never comes behind its start",
    )
    return Row(
        _BACKWARD,
        _SEC,
        f"l1 < {BACKWARD_L1}",
        f"least theta - theta(0) before the launch, below {BACKWARD_L1}",
        Quantity(value=back, unit="rad"),
        occurs(falls, "an arm that turns backward", [never]),
        FIXED,
        min(positions, key=lambda position: position.l1).engines_furthest_back if positions else (),
    )


def _past_pivot(sweep: Sweep) -> Row:
    past, falls = sweep.backward.counterweight_past_pivot, sweep.backward.l1
    quantity = "l1 below which the counterweight starts behind the fulcrum"
    name = "counterweight starts past the pivot"
    row = partial(Row, name, _SEC, BACKWARD_L1, quantity, machine=FIXED, fact=_BACKWARD)
    if past is None:
        never = Cause(True, "on no part of the beam does it start behind the fulcrum")
        return row(ours=None, judge=occurs(False, "such a place", [never]))
    other = Cause(
        falls is not None,
        f"only below l1 = {falls or 0.0:.4g} m would gravity turn the arm backward",
    )
    position = Quantity(value=past, uncertainty=1e-12 * past, unit="m")
    return row(ours=position, judge=partial(as_printed, causes=[other]))


def _below(sweep: Sweep) -> Iterator[Row]:
    """Slopes of our curve on both sides of a place, and the trend of a parabola below it."""
    limit = BACKWARD_L1.value
    pairs = [
        (x, y)
        for x, y in zip(sweep.curve.l1, sweep.curve.release_once, strict=True)
        if y is not None
    ]
    l1, speed = np.array(pairs).T
    slope = np.gradient(speed, l1)
    i = int(np.argmin(np.abs(l1 - limit)))
    before, after = float(slope[max(i - 3, 0)]), float(slope[min(i + 3, len(slope) - 1)])
    change = abs(before - after) / abs(after) if after else 0.0
    smooth = Cause(
        change < _ABRUPT,
        f"the slope is {before:.3g} m/s per m just below and {after:.3g} just above",
    )
    yield Row(
        "launch speed changes abruptly at 9.9",
        _FIG,
        BACKWARD_L1,
        f"change of the slope across l1 = {BACKWARD_L1}, of itself",
        Quantity(value=change, unit=""),
        lambda q, _: at_least(q, _ABRUPT, "'abruptly' asks for half", [smooth]),
        FIXED,
        fact=_BACKWARD,
    )
    inside = l1 < limit
    parabola = fit(l1[inside], speed[inside], 2)
    if parabola is None:
        return
    thrown = Cause(
        int(inside.sum()) == sum(x < limit for x in sweep.curve.l1),
        f"all {inside.sum()} places from {l1[inside][0]:g} m on throw forward, with "
        f"{speed[inside].min():.4g} to {speed[inside].max():.4g} m/s",
    )
    yield Row(
        "no trend below l1 = 9.9",
        _FIG,
        "no trend",
        "R² of a parabola through the curve there",
        Quantity(value=parabola.determination, unit=""),
        lambda q, _: at_most(
            q, _TRENDLESS, "what accounts for nine tenths of the variance is a trend", [thrown]
        ),
        FIXED,
        fact=_BACKWARD,
    )


def _suspect(sweep: Sweep) -> Row:
    """Claim on the plotted speed of zero, which the paper itself calls a likely error."""
    near, position = sweep.suspect, sweep.position(ZERO_L1.value)
    ours = position.speed if position and position.speed else Quantity(value=near.speed, unit="m/s")
    miss = abs(ours.value - near.from_neighbours)
    smooth = (
        "a launch with the speed that its neighbours on the curve give, "
        f"{near.from_neighbours:.6g} m/s"
    )
    return Row(
        "zero launch speed at l1 = 10.3 is an error",
        _FIG,
        NO_SPEED,
        "speed when the velocity is at 45 deg",
        ours,
        occurs(
            miss <= LAUNCH_SPEED.half < ours.value,
            f"{smooth}, to half a unit of the last digit of the speeds",
        ),
        FIXED,
        position.engines if position else (),
    )


def _regime(sweep: Sweep) -> Row:
    row = partial(Row, "place where the launch begins to fail", _FIG, END_L1, machine=FIXED)
    if sweep.regime.l1 is None:
        missing = occurs(False, "a change of the regime on the beam")
        return row(quantity="l1 at which a rest would have to pull", ours=None, judge=missing)
    quantity = "l1 beyond which the hanger's rest would have to pull at the start"
    return row(quantity=quantity, ours=sweep.regime.l1, judge=as_printed)


def _beyond(sweep: Sweep) -> Iterator[Row]:
    """Value at the first place beyond the change that engines ran at, else just above it."""
    change, swing = sweep.regime.l1, sweep.regime.swing
    if change is None:
        return
    with_engines = [
        position for position in sweep.positions if position.engines and position.l1 > change.value
    ]
    above: Position | None = min(
        with_engines, key=lambda position: position.l1, default=sweep.regime.above
    )
    if above is None or above.speed is None:
        return
    speed = above.bilateral_speed
    launches = "does not launch" if speed is None else f"launches with {speed:.4g} m/s"
    causes = [
        Cause(True, f"a rest that may pull as well, as the paper's, {launches}"),
        Cause(
            swing is not None and not swing.zeros,
            "in the paper's order of events the hanger's multiplier never comes to zero there: "
            "both constraints then hold for ever and nothing is launched, with which its zero "
            "agrees",
        ),
    ]
    yield Row(
        "zero launch speed beyond l1 = 12.7",
        _FIG,
        NO_SPEED,
        f"speed at l1 = {above.l1:.6g} m, rests that can only push",
        above.speed,
        partial(as_printed, causes=causes),
        FIXED,
        above.engines,
    )


def _trend(sweep: Sweep) -> Iterator[Row]:
    yield Row(
        "launch speed falls with l1",
        _FIG,
        "slope < 0",
        f"least fall of the speed between {BEST_L1} and the change",
        Quantity(value=-sweep.trend.flattest, unit="m/s per m"),
        lambda q, _: positive(q, "the fall of the speed per metre of l1, where it is least,"),
        FIXED,
    )
    yield Row(
        "curve is linear-like",
        _FIG,
        "linear",
        "R² of a line through the curve there",
        Quantity(value=sweep.trend.determination, unit=""),
        lambda q, _: at_least(
            q, _LINEAR, "'linear-like' asks that a line accounts for 99 % of the variance"
        ),
        FIXED,
    )
