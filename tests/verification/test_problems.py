"""The problem library: published and closed-form figures against the reference.

The library wherever a machine is.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.cli.truth import problem_list
from trebucheck.comparisons.problems import ProblemCheck, check
from trebucheck.comparisons.report import markdown
from trebucheck.comparisons.report.pages.problems import library
from trebucheck.comparisons.runs.study import Study
from trebucheck.models.library.benchmark import (
    Passage,
    Period,
    suite_condition,
    swing,
    swing_period,
    turn,
    turn_period,
)
from trebucheck.models.library.linkages import SqueezerParameters
from trebucheck.models.library.pendulums import HighPendulumParameters
from trebucheck.models.library.registry import benchmark, benchmarks
from trebucheck.reference.certification.redundant import solve_redundant
from trebucheck.reference.taylor.solve import solve_taylor

_LONG = {"chain"}  # a shorter one is among the others
_SOLVED = [entry.name for entry in benchmarks() if entry.name not in _LONG]

OTHERS = [
    ("pendulum", {"length": 0.3, "g": 1.62, "amplitude": 2.9}),
    ("chain", {"N": 3, "length": 2.0, "g": 3.7}),
    ("planar-chain", {"N": 3, "length": 0.1, "fold": -2.0}),
    ("hanging-chain", {"N": 12, "length": 0.05, "amplitude": 2e-4}),
    ("n-four-bar", {"N": 2, "length": 0.7, "speed": 2.0}),
    ("slider-crank", {"crank": 0.05, "rod": 0.17, "m_slider": 0.4, "speed": 90.0}),
    ("slider-crank", {"rod": 1.3, "speed": 1.0}),  # it does not turn over
    ("singular-slider-crank", {"speed": 2.0}),
    ("trammel", {"length": 0.3, "amplitude": 3.0}),
    ("bouncing", {"restitution": 0.9}),
    ("bouncing", {"restitution": 1.0, "height": 30.0}),
    ("stopped-pendulum", {"opening": 0.2, "swing": 2.0, "restitution": 1.0}),
    ("falling-rod", {"slope": 1.2, "restitution": 0.0}),
    ("damped-oscillator", {"damping": 60.0}),  # overdamped: steps are limited by stability
    ("welded-rods", {"bend": -2.0, "amplitude": 0.3}),
    ("bead", {"turning": -9.0, "inertia": 0.01}),
]
"""Parameters that are not the published ones: closed forms hold for all."""


def _refuse_what_fails(checked: ProblemCheck) -> None:
    missed = [
        (each.figure.name, each.measured, each.figure.value)
        for each in checked.figures
        if not each.holds
    ]
    assert not missed
    # Every condition of a source is met by a factor of a hundred.
    assert all(each.error <= each.condition.limit / 100 for each in checked.conditions)


@pytest.mark.parametrize("name", _SOLVED)
def test_every_figure_is_met(name: str) -> None:
    checked = check(benchmark(name))
    assert checked.figures
    _refuse_what_fails(checked)


@pytest.mark.parametrize(
    ("name", "changes"),
    OTHERS,
    ids=[f"{name}-{next(iter(changes.values()))}" for name, changes in OTHERS],
)
def test_figures_hold_for_other_parameters(name: str, changes: dict[str, float]) -> None:
    entry = benchmark(name)
    _refuse_what_fails(check(entry, entry.parameters(**changes)))


def test_a_wrong_figure_is_seen() -> None:
    """A pendulum shorter by a part in 1e11 has a period that is shorter by five parts in 1e12."""
    entry = benchmark("pendulum")
    shorter = entry.parameters(length=1.0 - 1e-11)
    figures = ProblemCheck(entry, shorter, check(entry).motion).figures
    assert [each.holds for each in figures] == [False, False]


class _Clock:
    """A motion whose only quantity is the time; nothing is met."""

    impacts, rest_times = (), {}

    def trajectory(self, t: np.ndarray) -> Any:
        return t


@pytest.mark.parametrize("level", [250.0, 250.3])  # 500 samples of 499 s: at one of them, between
def test_a_level_is_passed_once_where_a_sample_is_on_it_and_where_none_is(level: float) -> None:
    motion: Any = _Clock()
    assert Passage(np.asarray, level, 499.0)(motion) == pytest.approx(level, abs=1e-12)
    falling = Passage(lambda t: -np.asarray(t), -level, 499.0)
    assert falling(motion) == pytest.approx(level, abs=1e-12)
    with pytest.raises(tb.SimulationError, match="is passed 1 times by t = 499 s, not 2"):
        Passage(np.asarray, level, 499.0, 2)(motion)


def test_passages_and_periods_of_a_sine() -> None:
    motion: Any = _Clock()
    sine = Passage(np.sin, 0.5, 20.0, 4)
    assert sine(motion) == pytest.approx(2 * math.pi + 5 * math.pi / 6, abs=1e-12)
    assert Period(lambda t: np.sin(2.5 * t), 0.5, 20.0)(motion) == pytest.approx(0.8 * math.pi)


class _Beside:
    """A marker on a circle of 2 m that turns clockwise by 1 rad/s, off by an error."""

    impacts, rest_times = (), {}

    def __init__(self, error: Callable[[np.ndarray], np.ndarray]) -> None:
        self.error = error

    def trajectory(self, t: np.ndarray) -> Any:
        exact = 2.0 * np.stack([np.cos(t), -np.sin(t)], axis=1)
        return SimpleNamespace(marker=lambda _: SimpleNamespace(position=exact + self.error(exact)))


@pytest.mark.parametrize(
    ("error", "expected"),
    [
        (lambda exact: 1e-4 * exact, 1e-4),
        (lambda exact: np.where(np.arange(len(exact))[:, None] < 1, 3e-4 * exact, 0.0), 1.5e-4),
        (lambda exact: [3e-4, 0.0] * exact, 3e-4 * math.sqrt(0.5)),
    ],
    ids=["all", "a quarter of the samples", "one component"],
)
def test_the_suite_s_condition_is_a_root_mean_square_of_relative_errors(
    error: Callable[[np.ndarray], np.ndarray], expected: float
) -> None:
    condition = suite_condition("end", 2.0, lambda t: t, 2.0, 4)
    motion: Any = _Beside(error)
    assert condition.error(motion) == pytest.approx(expected, rel=1e-9)


def test_the_suite_s_condition_divides_by_a_millimetre_at_least() -> None:
    """At both samples the marker is on the x axis, beside which y has no relative error."""
    condition = suite_condition("end", 2.0, lambda t: t, 2 * math.pi, 2)
    motion: Any = _Beside(lambda exact: np.full_like(exact, 4e-6) * [0.0, 1.0])
    assert condition.error(motion) == pytest.approx(4e-3 * math.sqrt(0.5), rel=1e-9)


def test_the_period_close_to_the_highest_position_by_taylor_series() -> None:
    parameters = HighPendulumParameters()
    period = parameters.figures()[0]
    for precision in ("double", "extended"):
        motion = solve_taylor(parameters.problem(), precision=precision)
        assert period.read(motion) == pytest.approx(period.value, abs=1e-12)


def test_closed_forms_in_forty_digits() -> None:
    mpmath = pytest.importorskip("mpmath")
    with mpmath.workdps(40):
        for omega, amplitude in ((3.1, 0.2), (0.7, 2.0), (3.1320919526731650, math.radians(179.9))):
            m = mpmath.sin(mpmath.mpf(amplitude) / 2) ** 2
            assert swing_period(omega, amplitude) == pytest.approx(
                float(4 * mpmath.ellipk(m) / omega), rel=3e-15
            )
            for t in (0.1, 1.0, 4.0):
                ratio = mpmath.ellipfun("cd", omega * mpmath.mpf(t), m=m)
                exact = 2 * mpmath.asin(mpmath.sqrt(m) * ratio)
                assert swing(omega, amplitude, np.array([t]))[0] == pytest.approx(
                    float(exact), abs=2e-13
                )
        for omega, speed in ((4.2, 1.0), (1.0, 7.0)):
            bottom = mpmath.sqrt(mpmath.mpf(speed) ** 2 + 4 * mpmath.mpf(omega) ** 2)
            m = (2 * omega / bottom) ** 2
            exact = 4 * mpmath.ellipk(m) / bottom
            assert turn_period(omega, speed) == pytest.approx(float(exact), rel=3e-15)
            for t in (0.2, 1.7, 9.0):
                # From the lowest position the angle is twice Jacobi's amplitude, the inverse of an
                # elliptic integral.
                angle = mpmath.mpf(float(turn(omega, speed, np.array([t]))[0])) - mpmath.pi
                since = 2 * mpmath.ellipf(angle / 2, m) / bottom
                assert float(since + exact / 2) == pytest.approx(t, abs=1e-13)


def test_tables_and_pages_have_one_name_of_a_problem() -> None:
    """The library's number is what it is sorted by; a source may have numbers of its own."""
    text = markdown.text(problem_list(benchmarks()))
    text += markdown.text(library([check(benchmark("pendulum"))]))
    text = "\n".join(line for line in text.splitlines() if not line.startswith("**Source:**"))
    names = {entry.name for entry in benchmarks()}
    first = {line.split("|")[1].strip() for line in text.splitlines() if line.startswith("| ")}
    assert names <= first and "\n## pendulum\n" in text
    for entry in benchmarks():
        text = text.replace(entry.source, "")
    assert not [entry.number for entry in benchmarks() if entry.number in text]


def test_names_numbers_and_tags() -> None:
    entries = benchmarks()
    assert (
        len({entry.number for entry in entries})
        == len({entry.name for entry in entries})
        == len(entries)
    )
    assert [entry.number for entry in entries] == sorted(entry.number for entry in entries)
    for entry in entries:
        assert benchmark(entry.number) is entry
        assert tb.model(entry.name).name == entry.name
        assert entry.problem().mechanism.name == entry.name
        assert entry.source
        assert entry.text
    assert {entry.name for entry in benchmarks("redundant")} == {"three-cranks"}
    with pytest.raises(tb.InputError, match="no problem has the tag 'lop'"):
        benchmarks("lop")
    with pytest.raises(tb.InputError, match=r"no problem 'tramel' \(did you mean 'trammel'\?\)"):
        benchmark("tramel")


def test_the_squeezer_in_redundant_coordinates() -> None:
    """The published end state by another formulation and another set of unknowns."""
    problem = SqueezerParameters().problem()
    motion = solve_redundant(problem, 1e-12)
    q, _ = motion.state(problem.duration)
    mechanism = problem.mechanism
    relative = [
        q[mechanism.coordinates.index(name)] for name in ("k1", "k2", "k3", "k4", "k5", "k6", "k7")
    ]
    k1, k2, k3, k4, k5, k6, k7 = relative
    angles = (-k1, k1 - k2, -k3, k5 - k4, -k5, k7 - k6, -k7)
    for figure, angle in zip(SqueezerParameters().figures(), angles, strict=True):
        assert angle == pytest.approx(figure.value, rel=1e-9)


def test_a_problem_brings_its_own_end_and_law() -> None:
    study = Study(
        ["D02", "pendulum", tb.Problem(tb.catapult(), duration=0.7, stop_law="unilateral"), "fixed"]
    )
    stopped, pendulum, catapult, fixed = study.mechanisms
    assert study.end_of(stopped).time == benchmark("stopped-pendulum").problem().duration
    assert study.end_of(pendulum).time == 10.0
    assert study.end_of(catapult).time == 0.7
    assert study.end_of(fixed).kind == "launch"
    laws = [study.law_of(mechanism) for mechanism in study.mechanisms]
    assert laws == ["unilateral", "release-once", "unilateral", "release-once"]
    asked = Study(["D02"], until=1.0, stop_law="release-once")
    assert asked.end_of(stopped).time == 1.0
    assert asked.law_of(stopped) == "release-once"


def test_a_compared_problem_runs_under_its_own_law() -> None:
    (bouncing,) = tb.compare(
        ["bouncing"], engines=["reference"], presets=["assisted"], isolate=False
    ).results.machines
    assert bouncing.compared_to == pytest.approx(benchmark("bouncing").problem().duration)
    assert bouncing.impacts > 10


def test_a_problem_on_the_command_line(capsys: pytest.CaptureFixture[str]) -> None:
    from trebucheck.cli.app import main

    assert main(["problems", "--tag", "slot"]) == 0
    listed = capsys.readouterr().out
    assert "trammel" in listed
    assert "double-pendulum" not in listed
    assert main(["problems", "pendulum", "--set", "length=2"]) == 0
    assert "3.3486341958" in capsys.readouterr().out
    assert main(["models", "show", "chain", "--set", "N=3"]) == 0
    assert tb.Mechanism.from_json(capsys.readouterr().out).coordinates == ("a1", "a2", "a3")
    assert main(["models", "show", "chain", "--set", "N=2.5"]) == 2
    assert "N = 2.5" in capsys.readouterr().err
    assert main(["models", "show", "chain", "--beam", "14"]) == 2
    assert "have no l1 and l2" in capsys.readouterr().err


@pytest.mark.parametrize(("changes", "sentence"), [
    ({"rod": 0.5}, r"rod = 0\.5 m is shorter than crank = 1 m"),
    ({"speed": 5.42}, (r"speed = 5\.42 rad/s brings the crank to rest upright.* than 0\.5 % from "
                      r"5\.42494 rad/s")),
])  # fmt: skip
def test_a_slider_crank_that_would_stick_is_refused(
    changes: dict[str, float], sentence: str
) -> None:
    with pytest.raises(tb.InputError, match=sentence):
        benchmark("singular-slider-crank").parameters(**changes)
