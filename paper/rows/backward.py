"""Claims on short arms, l1 below 9.9 m, where the paper sees the machine fall backward: Sec. V and Fig. 5."""

from __future__ import annotations

import numpy as np

from ..evidence import made
from ..printed import parse
from ..results import Claim, Quantity
from ..sweep.results import Sweep
from ..throws.multipliers import fit
from ..verdicts import Cause, as_printed, at_least, at_most, occurs

_SEC, _FIG = "Sec. V", "Sec. V, Fig. 5"
_BACKWARD = "9.9"
_TRENDLESS = 0.9  # of the variance: 'no general trend' allows no curve that accounts for more
_ABRUPT = 0.5  # 'abruptly' asks that the slope changes by half of itself


def claims(sweep: Sweep) -> list[Claim]:
    """All of them."""
    limit = parse(_BACKWARD).value
    places = [place for place in sweep.positions if place.l1 < limit]
    back = min((place.furthest_back for place in places), default=0.0)
    turning = Quantity(value=min((p.arm_torque for p in places), default=sweep.backward.least_torque), unit="N m")
    falls = any(place.arm_torque < 0 or place.furthest_back < 0 for place in places)
    never = Cause(
        not falls,
        f"at all {len(places)} places below {_BACKWARD} m that were looked at gravity turns the arm forward, with "
        f"{turning.value:.4g} N m or more, and the arm never comes behind its start",
    )
    back_engines = min(places, key=lambda place: place.l1).engines_furthest_back if places else ()
    return [
        made(
            "falls backward below l1 = 9.9",
            _SEC,
            "l1 < 9.9 m",
            "least theta - theta(0) before the launch, below 9.9 m",
            Quantity(value=back, unit="rad"),
            occurs(falls, "an arm that turns backward", [never]),
            back_engines,
            "fixed",
        ),
        _past_pivot(sweep),
        _abrupt(sweep, limit),
        *_trendless(sweep, limit),
    ]


def _past_pivot(sweep: Sweep) -> Claim:
    quantity, past = (
        "l1 below which the counterweight starts behind the fulcrum",
        sweep.backward.counterweight_past_pivot,
    )
    name = "counterweight starts past the pivot"
    if past is None:
        never = Cause(True, "on no part of the beam does it start behind the fulcrum")
        return made(name, _SEC, "9.9 m", quantity, None, occurs(False, "such a place", [never]), machine="fixed")
    falls = sweep.backward.l1
    other = Cause(falls is not None, f"only below l1 = {falls or 0.0:.4g} m would gravity turn the arm backward")
    place = Quantity(value=past, uncertainty=1e-12 * past, unit="m")
    return made(name, _SEC, "9.9 m", quantity, place, as_printed(place, _BACKWARD, causes=[other]), machine="fixed")


def _abrupt(sweep: Sweep, limit: float) -> Claim:
    """The slope of our curve on both sides of a place."""
    pairs = [(x, y) for x, y in zip(sweep.curve.l1, sweep.curve.release_once, strict=True) if y is not None]
    l1, speed = np.array([x for x, _ in pairs]), np.array([y for _, y in pairs])
    slope = np.gradient(speed, l1)
    i = int(np.argmin(np.abs(l1 - limit)))
    before, after = float(slope[max(i - 3, 0)]), float(slope[min(i + 3, len(slope) - 1)])
    change = Quantity(value=abs(before - after) / abs(after) if after else 0.0, unit="")
    smooth = Cause(change.value < _ABRUPT, f"the slope is {before:.3g} m/s per m just below and {after:.3g} just above")
    return made(
        "launch speed changes abruptly at 9.9",
        _FIG,
        "9.9 m",
        "change of the slope across l1 = 9.9 m, of itself",
        change,
        at_least(change, _ABRUPT, "'abruptly' asks for half", [smooth]),
        machine="fixed",
    )


def _trendless(sweep: Sweep, limit: float) -> list[Claim]:
    """The paper sees no trend below the place: a parabola through our curve there sees one, or not."""
    pairs = [
        (x, y) for x, y in zip(sweep.curve.l1, sweep.curve.release_once, strict=True) if x < limit and y is not None
    ]
    l1, speed = np.array(pairs).reshape(-1, 2).T
    found = fit(l1, speed, 2)
    if found is None:
        return []
    share = Quantity(value=found.determination, unit="")
    thrown = Cause(
        len(pairs) == sum(x < limit for x in sweep.curve.l1),
        f"all {len(pairs)} places from {pairs[0][0]:g} m on throw forward, with {min(y for _, y in pairs):.4g} to "
        f"{max(y for _, y in pairs):.4g} m/s",
    )
    return [
        made(
            "no trend below l1 = 9.9",
            _FIG,
            "no trend",
            "R² of a parabola through the curve there",
            share,
            at_most(share, _TRENDLESS, "what accounts for nine tenths of the variance is a trend", [thrown]),
            machine="fixed",
        )
    ]
