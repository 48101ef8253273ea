"""Which impact of a run is which of the reference's, where rebounds become shorter than a step."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.comparisons.runs.impacts import FOLLOWED, impact_times, paired

STEP = 1e-3


def bounces(e: float, first: float = 0.4, fall: float = 0.5, least: float = 1e-7) -> list[float]:
    """Times of impacts of a point that bounces [s], to rebounds of the least length."""
    lengths = first * e ** np.arange(1 + np.log(least / first) / np.log(e))
    return (fall + np.concatenate([[0.0], np.cumsum(lengths)])).tolist()


@pytest.mark.parametrize("e", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("steps", [0.0, 1.0, 2.9])
def test_an_engine_may_end_bouncing_a_few_steps_earlier(e: float, steps: float) -> None:
    """And what is met later, in both, is compared with its own counterpart."""
    expected = bounces(e)
    own = [
        t
        for t, rebound in zip(expected, [1.0, *np.diff(expected)], strict=True)
        if rebound > steps * STEP
    ]
    pairs = paired([*own, 20.0], [*expected, 20.1], STEP)
    assert None not in {time for pair in pairs for time in pair}
    assert pairs[0] == (0.5, 0.5) and pairs[-1] == (20.0, 20.1)
    assert all(a == b for a, b in pairs[:-1])


def test_a_rebound_that_an_engine_must_follow_is_missing() -> None:
    expected = bounces(0.5)
    short = next(k for k in range(1, 20) if expected[k] - expected[k - 1] < 2 * FOLLOWED * STEP)
    pairs = paired(expected[:short], expected, STEP)
    assert pairs[short] == (None, expected[short])


@pytest.mark.parametrize(
    ("length", "counts"), [(0.4, False), (0.9, False), (1.2, True), (30.0, True)]
)
def test_an_engine_that_bounces_where_the_reference_rests_disagrees(
    length: float, counts: bool
) -> None:
    """If its rebounds are longer than a step; the reference rests from 0.7 s on."""
    own = [0.5, 0.7, *(0.7 + length * STEP * np.arange(1, 6)).tolist()]
    extra = [pair for pair in paired(own, [0.5, 0.7], STEP) if pair[1] is None]
    assert len(extra) == (5 if counts else 0)


def test_impacts_that_come_late_are_still_paired() -> None:
    late = [t + 0.02 for t in bounces(0.5, least=0.01)]
    assert paired(late, bounces(0.5), STEP)[:5] == list(
        zip(late[:5], bounces(0.5)[:5], strict=True)
    )


def test_an_impact_after_the_end_of_the_shorter_motion_is_nobodys_counterpart() -> None:
    """Nor missing in it; at the very end, where it falls on either side, it is paired."""
    own, longer = [0.5, 0.9], [0.5, 0.9, 1.24]
    assert paired(own, longer, STEP, until=1.02) == [(0.5, 0.5), (0.9, 0.9)]
    assert paired([*own, 0.95], longer, STEP, until=1.02)[2] in (
        (0.95, None),
        (0.95, 1.24),
    )  # no tolerance is so wide
    assert paired(longer, [*own, 0.9 + 0.9 * FOLLOWED * STEP], STEP, until=1.02) == [
        (0.5, 0.5),
        (0.9, 0.9),
    ]
    assert paired([0.5, 0.9999], [0.5, 1.0001], STEP, until=1.0)[1] == (0.9999, 1.0001)


def test_rounding_of_the_largest_impulse_is_no_impact() -> None:
    """A stop that only touches where another one is met has one of zero."""
    motion = tb.engine("reference").simulate(tb.Problem(tb.fixed(), duration=0.01))
    impacts = (
        (1.0, {"met": 5.0, "touched": 4e-13}),
        (2.0, {"met": 1e-6, "touched": 0.0}),
        (3.0, {}),
    )
    motion = dataclasses.replace(motion, impacts=impacts)
    assert impact_times(motion, "met") == [1.0, 2.0]
    assert impact_times(motion, "touched") == []
