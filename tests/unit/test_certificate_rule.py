"""The rule of a certificate's values and uncertainties, by numbers that can be computed by hand."""

from __future__ import annotations

import pytest
import trebucheck as tb
from mechanisms import hanging_bob
from trebucheck.reference.certification.certificate import Computation
from trebucheck.reference.certification.certify import Key, _problem, judge

EPSILON = 2.0**-52


def computed(name: str, tolerance: float | None, *, independent: bool = True) -> Computation:
    return Computation(name=name, formulation="any", integrator="any", tolerance=tolerance,
                       independent=independent)  # fmt: skip


RUNG, TIGHT, SERIES = "rung", "tight", "series"
COMPUTATIONS = (
    computed(RUNG, 1e-9, independent=False),
    computed(TIGHT, 1e-12),
    computed(SERIES, None),
)
X, Y, TIME = (
    Key("position_x", "projectile", "launch", "m"),
    Key("position_y", "projectile", "launch", "m"),
    Key("launch_time", None, "launch", "s"),
)


def test_three_times_the_largest_difference_and_what_the_rungs_moved() -> None:
    """A rung at a thousand times the tolerance errs 1000^(7/8) times as much."""
    values = {RUNG: 2.0 + 8e-8, TIGHT: 2.0, SERIES: 2.0 + 2e-9}
    value, uncertainty = judge({TIME: values}, COMPUTATIONS)[TIME]
    assert value == pytest.approx(2.0 + 1e-9, abs=1e-15)  # the median
    moved = 7.9e-8 * 1e-3 ** (7 / 8)
    expected = 3 * (1e-9 + moved) + 16 * EPSILON * 2.0
    assert uncertainty == pytest.approx(expected, rel=1e-6)


def test_extended_precision_is_the_value_where_it_was_computed() -> None:
    best = "taylor, extended"
    given = (computed(TIGHT, 1e-12), computed(SERIES, None), computed(best, None))
    values = {TIGHT: 5.0, SERIES: 5.0 - 1e-10, best: 5.0 + 2e-10}
    value, uncertainty = judge({TIME: values}, given)[TIME]
    assert value == 5.0 + 2e-10
    assert uncertainty == pytest.approx(3 * 3e-10 + 16 * EPSILON * 5.0, rel=1e-5)


def test_both_components_of_a_position_are_as_uncertain_as_the_rungs_of_either() -> None:
    same = {RUNG: 1.0, TIGHT: 1.0, SERIES: 1.0}
    moved = same | {RUNG: 100.0 + 1e-7, TIGHT: 100.0, SERIES: 100.0}
    judged = judge({X: same, Y: moved, TIME: same}, COMPUTATIONS)
    rounding = 16 * EPSILON * 100.0
    expected = 3 * 1e-7 * 1e-3 ** (7 / 8) + rounding
    assert judged[X][1] == pytest.approx(expected, rel=1e-5)
    assert judged[Y][1] == pytest.approx(expected, rel=1e-5)
    assert judged[TIME] == (1.0, pytest.approx(16 * EPSILON))


def test_what_a_computation_does_not_have_is_not_known() -> None:
    full = {RUNG: 1.0, TIGHT: 1.0, SERIES: 1.0}
    judged = judge({TIME: full, X: {TIGHT: 1.0, SERIES: 1.0}}, COMPUTATIONS)
    assert set(judged) == {TIME}


def test_one_computation_alone_certifies_nothing() -> None:
    values = {RUNG: 1.0, TIGHT: 1.0}
    assert judge({TIME: values}, COMPUTATIONS[:2]) == {}


@pytest.mark.parametrize("duration", [0.15, 0.9, 1.0, 2.5, 9.9])
def test_a_given_duration_is_read_at_ten_to_a_hundred_instants(duration: float) -> None:
    problem, plan = _problem(hanging_bob(), duration, tb.StopLaw.RELEASE_ONCE)
    assert problem.duration == duration
    assert 10 <= duration / plan.step * (1 + EPSILON) < 100
    assert not plan.launches
