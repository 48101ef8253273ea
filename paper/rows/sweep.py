"""Claims on the fulcrum's place: Sec. V and Fig. 5."""

from __future__ import annotations

from ..evidence import Evidence, made
from ..printed import parse
from ..results import Claim, Quantity
from ..sweep.results import Position, Sweep
from ..verdicts import Cause, Judgement, as_printed, at_least, not_told, occurs, positive, vanishes
from . import backward

_SEC, _FIG = "Sec. V", "Sec. V, Fig. 5"
_BEST, _ZERO, _END = "9.91", "10.3", "12.7"
_LINEAR = 0.99  # 'linear-like' asks that a line accounts for 99 % of the variance


def claims(sweep: Sweep, evidence: Evidence) -> list[Claim]:
    """All of them."""
    parts = (
        _peak(sweep, evidence),
        _optimised(sweep, evidence),
        backward.claims(sweep),
        _suspect(sweep),
        _regime(sweep),
        _trend(sweep),
    )
    return [claim for part in parts for claim in part]


def _rising(sweep: Sweep) -> list[Cause]:
    peak, there = sweep.peak, sweep.position(parse(_BEST).value)
    faster = there is not None and there.speed is not None and peak.speed.value > there.speed.value
    sentence = (
        f"the speed goes on rising to {peak.speed.value:.2f} m/s at l1 = {peak.l1.value:.2f} m, "
        f"a lever ratio of {peak.lever_ratio:.2f}:1"
    )
    return [Cause(faster, sentence)]


def _peak(sweep: Sweep, evidence: Evidence) -> list[Claim]:
    peak, there, rising = sweep.peak, sweep.position(parse(_BEST).value), _rising(sweep)
    found = [
        made(
            "place of the largest launch speed",
            _FIG,
            "9.91 m",
            "l1 of the largest launch speed",
            peak.l1,
            as_printed(peak.l1, _BEST, causes=rising),
            machine="fixed",
        ),
        made(
            "largest launch speed",
            _FIG,
            "100.55 m/s",
            "over all places of the fulcrum",
            peak.speed,
            as_printed(peak.speed, "100.55", causes=rising),
            machine="fixed",
        ),
        *_ratios(sweep, evidence),
    ]
    if there is None or there.speed is None:
        return found
    judgement = as_printed(there.speed, "100.55")
    return [
        made(
            "launch speed at l1 = 9.91",
            _FIG,
            "100.55 m/s",
            "speed when the velocity is at 45 deg",
            there.speed,
            judgement,
            there.engines,
            "fixed",
        ),
        *found,
    ]


def _ratios(sweep: Sweep, evidence: Evidence) -> list[Claim]:
    ratio = Quantity(value=sweep.peak.lever_ratio, uncertainty=_of_ratio(sweep), unit="")
    p = evidence.parameters
    below = Quantity(value=p.l1 / p.l2 - ratio.value, uncertainty=ratio.uncertainty, unit="")
    return [
        made(
            "best lever ratio",
            "Secs. V, VII",
            "2.42:1",
            "l1 / l2 of the largest launch speed",
            ratio,
            as_printed(ratio, "2.42:1", causes=_rising(sweep)),
            machine="fixed",
        ),
        made(
            "best lever ratio below the machine's",
            _SEC,
            "2.42 < 2.5",
            "machine's l1 / l2 less that of the largest launch speed",
            below,
            positive(below, "the machine's ratio less the best"),
            machine="fixed",
        ),
        made(
            "best lever ratio of a similar system",
            _SEC,
            "3 to 5",
            "l1 / l2 of the largest launch speed",
            ratio,
            not_told(
                "the cited machine is another: its arm starts backward and its sling lies on a trough; its own "
                "dimensions are not in the paper"
            ),
        ),
    ]


def _of_ratio(sweep: Sweep) -> float:
    """d(l1 / l2) = beam / l2² dl1, the beam being kept."""
    peak = sweep.peak.l1
    return sweep.beam / (sweep.beam - peak.value) ** 2 * (peak.uncertainty or 0.0)


def _optimised(sweep: Sweep, evidence: Evidence) -> list[Claim]:
    """How near the machine is to the best: by the paper's numbers 98.9 %, counting their rounding in its favour."""
    low, high = parse("99.4"), parse("100.55")
    need = (low.value - low.half) / (high.value + high.half)
    ours = evidence.ours["fixed: launch_speed"] / sweep.peak.speed.value
    share = Quantity(value=ours, uncertainty=None, unit="")
    judgement = at_least(share, round(need, 4), "the paper's 99.4 to its 100.55", _rising(sweep))
    return [
        made(
            "machine nearly optimised",
            "Secs. V, VII",
            "99.4 of 100.55",
            "launch speed at l1 = 10 to the largest",
            share,
            judgement,
            machine="fixed",
        )
    ]


def _suspect(sweep: Sweep) -> list[Claim]:
    near, place = sweep.suspect, sweep.position(parse(_ZERO).value)
    speed = place.speed if place and place.speed else Quantity(value=near.speed, unit="m/s")
    engines = place.engines if place else ()
    smooth = Cause(True, f"its neighbours on the curve alone give {near.from_neighbours:.4f} m/s there")
    missing = [search for search in sweep.artefact.searches if near.l1 in search.fails_at]
    alone = [search for search in missing if len(search.fails_at) == 1]
    newton = Cause(bool(alone), "a root search that starts every place from one guess can miss the release just there")
    others = Cause(
        bool(missing) and not alone,
        "a root search from one guess that misses the release there misses it elsewhere, too: that does not explain it",
    )
    error = Quantity(value=near.speed - near.from_neighbours, unit="m/s")
    return [
        made(
            "zero launch speed at l1 = 10.3",
            _FIG,
            "0 m/s",
            "speed when the velocity is at 45 deg",
            speed,
            as_printed(speed, "0", causes=[smooth, newton, others]),
            engines,
            "fixed",
        ),
        made(
            "that zero is an error of computation",
            _SEC,
            "10.3 m",
            "launch speed there less what its neighbours give",
            error,
            vanishes(error, parse("99.4").half, "half a unit of the last digit of the speeds"),
            machine="fixed",
        ),
    ]


def _regime(sweep: Sweep) -> list[Claim]:
    regime, name = sweep.regime, "place where the launch begins to fail"
    if regime.l1 is None:
        missing = occurs(False, "a change of the regime on the beam")
        return [made(name, _FIG, "12.7 m", "l1 at which a rest would have to pull", None, missing, machine="fixed")]
    quantity = "l1 beyond which the hanger's rest would have to pull at the start"
    return [
        made(name, _FIG, "12.7 m", quantity, regime.l1, as_printed(regime.l1, _END), machine="fixed"),
        *_beyond(sweep),
    ]


def _beyond(sweep: Sweep) -> list[Claim]:
    above = _first_beyond(sweep)
    if above is None or above.speed is None:
        return []
    causes = [_both_laws(above), _held_for_ever(sweep)]
    return [
        made(
            "zero launch speed beyond l1 = 12.7",
            _FIG,
            "0 m/s",
            f"speed at l1 = {above.l1:.6g} m, rests that can only push",
            above.speed,
            as_printed(above.speed, "0", causes=causes),
            above.engines,
            "fixed",
        ),
    ]


def _first_beyond(sweep: Sweep) -> Position | None:
    """The first place beyond the change that engines were asked about; else the one a hair above it."""
    change = sweep.regime.l1
    asked = [place for place in sweep.positions if place.engines and change is not None and place.l1 > change.value]
    return min(asked, key=lambda place: place.l1, default=sweep.regime.above)


def _both_laws(above: Position) -> Cause:
    speed = above.bilateral_speed
    text = "does not launch" if speed is None else f"launches with {speed:.4g} m/s"
    return Cause(True, f"a rest that may pull as well, as the paper's, {text}")


def _held_for_ever(sweep: Sweep) -> Cause:
    swing = sweep.regime.swing
    return Cause(
        swing is not None and not swing.zeros,
        "in the paper's order of events the hanger's multiplier never comes to zero there: both constraints then hold "
        "for ever and nothing is launched, with which its zero agrees",
    )


def _trend(sweep: Sweep) -> list[Claim]:
    trend = sweep.trend
    fall = Quantity(value=-trend.flattest, unit="m/s per m")
    line = Quantity(value=trend.determination, unit="")
    falling: Judgement = positive(fall, "the fall of the speed per metre of l1, where it is least,")
    return [
        made(
            "launch speed falls with l1",
            _FIG,
            "slope < 0",
            "least fall of the speed between 9.91 m and the change",
            fall,
            falling,
            machine="fixed",
        ),
        made(
            "curve is linear-like",
            _FIG,
            "linear",
            "R² of a line through the curve there",
            line,
            at_least(line, _LINEAR, "'linear-like' asks that a line accounts for 99 % of the variance"),
            machine="fixed",
        ),
    ]
