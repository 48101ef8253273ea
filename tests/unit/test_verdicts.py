"""From judged figures to verdicts, counts, exit and sentences: pure data."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from formulas import END, Formula, times, trolley
from trebucheck.comparisons.report.pages.compare import verdict
from trebucheck.comparisons.report.pages.tables import complaints
from trebucheck.comparisons.runs.record import RunErrors, pair_of
from trebucheck.comparisons.runs.results import (
    COMPARED,
    Check,
    Diagnosis,
    Equality,
    Metric,
    Outcome,
    RankedCause,
    Results,
    Run,
    verdict_on,
)
from trebucheck.models.launch import Launch


def _metric(value: float | None = 1.0, tolerance: float | None = 2.0, **more: Any) -> Metric:
    source = None if tolerance is None else "default"
    return Metric(
        **{
            "name": "position_max",
            "value": value,
            "unit": "m",
            "tolerance": tolerance,
            "source": source,
            **more,
        }
    )


def _run(outcome: Outcome = Outcome.AGREES, *metrics: Metric, **more: Any) -> Run:
    return Run(
        model="m",
        engine="e",
        preset="assisted",
        outcome=outcome,
        engine_version="1",
        metrics=metrics,
        **more,
    )


def _results(*runs: Run) -> Results:
    return Results.made_here(machines=(), runs=runs, pairs=())


HELD, BROKEN = _metric(), _metric(3.0)
BARE = _metric(tolerance=None)
UNSEEN = _metric(None, None, observed=False)
FOLLOWS = _metric(9.0, None, follows="position_max")


@pytest.mark.parametrize(
    ("value", "tolerance", "holds"),
    [
        (2.0, 2.0, True),
        (-2.0, 2.0, True),
        (-2.1, 2.0, False),
        (2.1, 2.0, False),
        (None, 2.0, False),
        (1.0, None, None),
        (None, None, None),
        (0.0, 0.0, True),
    ],
)
def test_a_figure_holds_within_its_tolerance_on_either_side(
    value: float | None, tolerance: float | None, holds: bool | None
) -> None:
    assert _metric(value, tolerance).holds is holds


def test_what_was_compared_or_asked_for_and_has_no_tolerance_is_unjudged() -> None:
    assert BARE.unjudged and _metric(None, None).unjudged
    assert not any(metric.unjudged for metric in (HELD, BROKEN, UNSEEN, FOLLOWS))
    assert _metric(None, None, observed=False, source="need").unjudged
    assert not _metric(None, 1.0, observed=False, source="need").unjudged


@pytest.mark.parametrize(
    ("metrics", "outcome"),
    [
        ((HELD,), Outcome.AGREES),
        ((HELD, UNSEEN, FOLLOWS), Outcome.AGREES),
        ((HELD, BARE), Outcome.NOT_JUDGED),
        ((HELD, BROKEN), Outcome.DISAGREES),
        ((BROKEN, BARE), Outcome.DISAGREES),
        ((_metric(None),), Outcome.DISAGREES),
        ((), Outcome.NOT_JUDGED),
        ((UNSEEN, FOLLOWS), Outcome.NOT_JUDGED),
        ((BARE,), Outcome.NOT_JUDGED),
    ],
)
def test_a_verdict_needs_figures_and_every_figure_a_verdict(
    metrics: tuple[Metric, ...], outcome: Outcome
) -> None:
    assert verdict_on(metrics) is outcome


def test_figures_of_a_run() -> None:
    run = _run(Outcome.DISAGREES, HELD, BROKEN, BARE, UNSEEN, FOLLOWS)
    assert (run.judged, run.broken, run.unjudged) == ((HELD, BROKEN), (BROKEN,), (BARE,))
    assert run.metric("position_max") is HELD and run.metric("position_max", "tip") is None
    assert (run.label, run.steps, run.settings, run.diagnosis) == ("e assisted", 0, {}, None)
    assert (HELD.label, _metric(subject="tip").label) == ("position_max", "position_max (tip)")


@pytest.mark.parametrize(
    ("outcomes", "passed"),
    [
        ((Outcome.AGREES,), True),
        ((Outcome.AGREES, Outcome.ABSENT, Outcome.UNSUPPORTED, Outcome.NOT_JUDGED), True),
        ((Outcome.AGREES, Outcome.DISAGREES), False),
        ((Outcome.NOT_EQUIVALENT, Outcome.AGREES), False),
        ((Outcome.AGREES, Outcome.FAILED), False),
        ((Outcome.ABSENT,), False),
        ((Outcome.UNSUPPORTED, Outcome.ABSENT), False),
        ((Outcome.NOT_JUDGED,), False),
        ((), False),
    ],
)
def test_a_comparison_passes_if_nothing_is_wrong_and_something_was_judged(
    outcomes: tuple[Outcome, ...], passed: bool
) -> None:
    figures = {
        Outcome.AGREES: (HELD,),
        Outcome.DISAGREES: (HELD, BROKEN),
        Outcome.NOT_JUDGED: (BARE,),
    }
    results = _results(*(_run(outcome, *figures.get(outcome, ())) for outcome in outcomes))
    assert results.passed is passed
    assert [run.outcome for run in results.ran] == [each for each in outcomes if each in COMPARED]


def test_a_check_holds_up_to_its_tolerance() -> None:
    def check(value: float | None) -> Check:
        return Check(name="mass matrix", value=value, unit="1", tolerance=1e-10, reason="rounding")

    assert check(1e-10).holds and not check(1.1e-10).holds and not check(None).holds
    both = Equality(exposed=True, checks=(check(0.0), check(None)))
    assert not both.holds and both.broken == (check(None),)
    assert Equality(exposed=False).holds and Equality(exposed=False).states == 0
    assert Equality(exposed=True, checks=(check(0.0),)).holds
    assert check(0.0).label == "mass matrix"
    assert check(0.0).model_copy(update={"subject": "arm"}).label == "mass matrix (arm)"


def test_the_causes_that_are_named() -> None:
    causes = tuple(RankedCause(name=name, kind="machine", explained=0.5) for name in "abc")
    assert Diagnosis(leads="x", causes=causes, likeliest=2).named == causes[:2]
    assert Diagnosis(leads="x", causes=causes).named == ()


# sentences


def test_the_headline_counts_every_verdict() -> None:
    equal, other, dark = (
        Equality(exposed=True),
        Equality(
            exposed=True,
            checks=(Check(name="start", value=1, unit="1", tolerance=0.1, reason="-"),),
        ),
        Equality(exposed=False),
    )
    assert verdict(_results(_run(Outcome.AGREES, HELD, HELD, equality=equal))) == (
        "Agreement holds. Runs: 1 agree; 2 of 2 judged quantities hold; 1 of 1 built models "
        "equivalent."
    )
    assert verdict(
        _results(
            _run(Outcome.AGREES, HELD, equality=equal),
            _run(Outcome.NOT_EQUIVALENT, equality=other),
            _run(Outcome.DISAGREES, HELD, BROKEN, BARE, equality=dark),
            _run(Outcome.ABSENT),
            _run(Outcome.ABSENT),
        )
    ) == (
        "Agreement does not hold. Runs: 1 agree, 1 disagree, 1 not equivalent, 2 not installed; 2 "
        "of 3 judged "
        "quantities hold; 1 of 2 built models equivalent, 1 not checked."
    )
    assert verdict(_results(_run(Outcome.NOT_JUDGED, BARE))) == (
        "Nothing was judged. Runs: 1 not judged; 0 of 0 judged quantities hold; 0 of 0 built "
        "models equivalent."
    )
    assert verdict(_results()).startswith("Nothing was judged. Runs: none; 0 of 0")


def test_complaints_are_worst_first_and_the_rest_is_counted() -> None:
    worst, missing = (
        _metric(8.0, subject="worst", reason="why"),
        _metric(None, subject="missing", note="only one has it"),
    )
    run = _run(
        Outcome.DISAGREES,
        _metric(-3.0, subject="mild"),
        worst,
        HELD,
        missing,
        _metric(4.0, subject="middle"),
    )
    sentences = complaints(run)
    assert [sentence.split(":")[0] for sentence in sentences] == [
        f"position_max ({name})" for name in ("missing", "worst", "middle", "mild")
    ]
    assert sentences[1] == "position_max (worst): 8.0e0 m, tolerance 2.0e0 m (default: why)"
    assert "only one has it, tolerance 2.0e0 m" in sentences[0]
    assert complaints(run, 3) == [
        *sentences[:3],
        "1 more of 5 judged quantities break their tolerance.",
    ]
    assert complaints(run, 1) == [
        *sentences[:1],
        "3 more of 5 judged quantities break their tolerance.",
    ]
    assert complaints(run, 4) == complaints(run, 9) == sentences
    assert complaints(_run(Outcome.AGREES, HELD)) == []


# two engines against each other


def _compared(
    t: Any,
    off: Any = 0.0,
    rest: float | None = 0.5,
    speed: float | None = 2.0,
    markers: tuple[str, ...] = ("hook",),
) -> RunErrors:
    launch = None if speed is None else Launch(1.0, speed, (0.0, 0.0))
    errors = {name: np.stack([0 * t, off + 0 * t], axis=1) for name in markers}
    return RunErrors(t, errors, {"rest": rest}, launch)


T = times()


def test_two_runs_are_compared_at_the_times_of_the_coarser_one() -> None:
    pair = pair_of("m", ("a", "b"), _compared(times(0.1), 3e-3), _compared(T, -1e-3 * T), END)
    assert (pair.model, pair.first, pair.second) == ("m", "a", "b")
    assert pair.position_max == pytest.approx(4.5e-3)
    assert pair.release_time_max == 0.0 and pair.launch_speed == 0.0
    swapped = pair_of(
        "m", ("b", "a"), _compared(T, -1e-3 * T, speed=1.0), _compared(times(0.1), 3e-3), END
    )
    assert swapped.position_max == pytest.approx(4.5e-3) and swapped.launch_speed == -1.0


def test_what_lies_between_samples_is_interpolated_and_what_is_missing_left_out() -> None:
    step = (T > 0.505) * 1.0  # between two samples of the finer one
    assert (
        pair_of(
            "m", ("a", "b"), _compared(np.array([0.0, 0.505, 1.0])), _compared(T, T), END
        ).position_max
        == 1.0
    )
    assert pair_of(
        "m", ("a", "b"), _compared(np.array([0.0, 0.505])), _compared(T, step), END
    ).position_max == pytest.approx(0.5)
    short = _compared(T[T < 1.0], 0.0)
    assert pair_of(
        "m", ("a", "b"), short, _compared(times(0.005), times(0.005)), END
    ).position_max == pytest.approx(0.99)
    short = _compared(times(0.001, 0.8), 0.0)
    assert pair_of("m", ("a", "b"), short, _compared(T, T), END).position_max == pytest.approx(0.8)
    across = RunErrors(T, {"hook": np.stack([3 + 0 * T, 4 + 0 * T], axis=1)}, {}, None)
    assert pair_of("m", ("a", "b"), across, _compared(T), END).position_max == pytest.approx(5.0)


def test_only_markers_of_both_are_compared_and_the_worst_counts() -> None:
    first, second = _compared(T, T, markers=("x", "hook")), _compared(T, 0.5, markers=("hook", "y"))
    assert pair_of("m", ("a", "b"), first, second, END).position_max == pytest.approx(1.0)
    assert pair_of("m", ("a", "b"), first, _compared(T, markers=()), END).position_max is None
    both = RunErrors(
        T, {"x": np.stack([5 * T, T], axis=1), "hook": np.zeros((len(T), 2))}, {}, None
    )
    assert pair_of("m", ("a", "b"), first, both, END).position_max == pytest.approx(5 * END)


@pytest.mark.parametrize(
    ("first", "second", "difference"),
    [
        (0.5, 0.7, 0.2),
        (0.7, 0.5, 0.2),
        (None, 0.5, None),
        (0.5, None, None),
        (None, None, None),
        (1.6, None, None),
        (None, END, None),
        (1.4, 1.6, 0.2),
        (1.6, 1.7, None),
    ],
)
def test_releases_of_two_runs(
    first: float | None, second: float | None, difference: float | None
) -> None:
    pair = pair_of("m", ("a", "b"), _compared(T, rest=first), _compared(T, rest=second), END)
    assert pair.release_time_max == (None if difference is None else pytest.approx(difference))


def test_a_release_after_the_end_does_not_hide_an_earlier_one() -> None:
    one, other = _compared(T), _compared(T)
    one.release_times.update({"late": 1.6, "rest": 0.5})
    other.release_times.update({"late": None, "rest": 0.6})
    assert pair_of("m", ("a", "b"), one, other, END).release_time_max == pytest.approx(0.1)
    one.release_times["late"] = END * (1 + 1.1e-9)
    assert pair_of("m", ("a", "b"), one, other, END).release_time_max == pytest.approx(0.1)
    for within in (1.4, END, END * (1 + 0.9e-9)):  # to rounding
        one.release_times["late"] = within
        assert pair_of("m", ("a", "b"), one, other, END).release_time_max is None


def test_speeds_need_two_launches() -> None:
    assert (
        pair_of("m", ("a", "b"), _compared(T, speed=None), _compared(T), END).launch_speed is None
    )


def test_what_a_run_brings_to_its_pairs() -> None:
    reference = Formula()
    own = Formula(q=lambda t: [0 * t, reference.q(t)[1], 0.25 + 0 * t]).trajectory(T)
    compared = RunErrors.of(own, reference.trajectory(T))
    assert set(compared.errors) == {"projectile", "hook"}
    assert np.allclose(compared.errors["hook"], [0.25, 0.0])
    assert compared.launch is not None and compared.launch.speed == pytest.approx(2.0)
    assert compared.release_times == {"rest": 0.5} and compared.t is T
    assert RunErrors.of(own, reference.trajectory(T), "nothing").launch is None
    assert RunErrors.of(own, reference.trajectory(T), "hook").launch is None
    assert trolley().marker("hook") is not None
