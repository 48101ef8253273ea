"""Convergence studies without any engine's library.

Fits, floors, limits, steps, and the command's manners.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import jsonschema
import numpy as np
import plugin_engines
import pytest
import trebucheck as tb
from trebucheck.cli.app import main
from trebucheck.comparisons import converge as floors
from trebucheck.comparisons import converge as studying
from trebucheck.comparisons.converge import (
    ASYMPTOTIC,
    FEWEST,
    SLOPE,
    Level,
    Site,
    Studies,
    converge_study,
    fitting,
    floor,
    largest,
    limit,
    observed_order,
    parameter_names,
    power_law,
    refinements,
    swept_parameters,
    weights,
)
from trebucheck.comparisons.report.html import page
from trebucheck.comparisons.report.pages.converge import document
from trebucheck.comparisons.runs.record import make
from trebucheck.comparisons.runs.runner import Runner, run_duration
from trebucheck.comparisons.runs.store import Store
from trebucheck.comparisons.runs.study import Study
from trebucheck.engines.registry import engine_study
from trebucheck.engines.study import ConstraintKinds
from trebucheck.models.spec import schema_text

STEPS = 1e-2 / 2.0 ** np.arange(9)


# the observed order


@pytest.mark.parametrize("exponent", [-2.0, -1.0, 0.5, 1.0, 2.0, 4.0])
def test_a_pure_power_is_found_over_all_of_its_range(exponent: float) -> None:
    law = power_law(list(STEPS), list(3.0 * STEPS**exponent))
    assert law is not None
    assert law.exponent == pytest.approx(exponent, abs=1e-12)
    assert law.factor == pytest.approx(3.0, rel=1e-10)
    assert (law.low, law.high) == pytest.approx((STEPS[-1], STEPS[0]))
    assert law.half_width < 1e-6
    assert law.at(1e-3) == pytest.approx(3.0 * 1e-3**exponent)


@pytest.mark.parametrize("order", [1.0, 2.0])
def test_a_floor_and_a_coarse_end_are_left_out(order: float) -> None:
    h = 1.0 / 2.0 ** np.arange(20)
    errors = h**order * (1 + (h / 0.3) ** 2) + 1e-5**order
    law = power_law(list(h), list(errors))
    assert law is not None
    assert law.exponent == pytest.approx(order, abs=SLOPE)
    assert law.low > 1e-5, "the floor is as large as the error there"
    assert law.high < 0.3, "two orders more are at work above"


def test_growth_at_the_fine_end_is_left_out() -> None:
    law = power_law(list(STEPS), list(STEPS**2 + 1e-16 / STEPS**2))
    assert law is not None
    assert law.exponent == pytest.approx(2.0, abs=SLOPE)
    assert law.low > 1e-4


@pytest.mark.parametrize(
    "errors",
    [
        np.full(9, 3e-3),
        3e-3 * (1 + 0.01 * STEPS / STEPS[0]),
        np.where(np.arange(9) % 2, 1.0, 1e-3),
        np.array([1e-2, 1e-3, 1e-4, 0, 0, 0, 0, 0, 0]),
    ],
    ids=["constant", "hardly moved", "scattered", "too few"],
)
def test_no_exponent_is_claimed_where_there_is_none(errors: np.ndarray) -> None:
    assert power_law(list(STEPS), list(errors)) is None


def test_a_failed_run_parts_its_neighbours() -> None:
    errors: list[float | None] = list(STEPS**2)
    errors[3] = None
    law = power_law(list(STEPS), errors)
    assert law is not None
    assert law.high == pytest.approx(STEPS[4])
    assert law.points == 5


def test_what_the_reference_cannot_tell_is_not_fitted() -> None:
    law = power_law(list(STEPS), list(STEPS**2), uncertainty=1e-7)
    assert law is not None
    assert law.low**2 > 1e-7


def test_the_band_is_a_95_percent_interval() -> None:
    generator = np.random.default_rng(20)
    inside = 0
    for _ in range(200):
        law = power_law(
            list(STEPS), list(STEPS**2 * np.exp(generator.normal(0.0, 0.01, len(STEPS))))
        )
        assert law is not None and law.points == len(STEPS)
        inside += abs(law.exponent - 2.0) <= law.half_width
    # 190 expected, with a standard deviation of 3.1: three of them either way.
    assert 181 <= inside <= 199


def test_the_order_of_points_does_not_matter() -> None:
    errors = STEPS**1.5 * (1 + 0.01 * np.cos(np.arange(9)))
    assert power_law(list(STEPS), list(errors)) == power_law(list(STEPS[::-1]), list(errors[::-1]))
    assert FEWEST == 4


# Richardson's limit


def _levels(steps: Sequence[float], power: float, noise: float = 0.0) -> list[Level]:
    t = np.linspace(0.0, 1.0, 101)
    generator = np.random.default_rng(3)
    exact, first, second = (
        np.stack([np.sin(t), t]),
        np.stack([t**2, np.cos(t)]),
        np.stack([t, -(t**3)]),
    )
    return [
        Level(
            h,
            1e-3 * exact
            + first * h**power
            + second * h ** (power + 1)
            + noise / h**2 * generator.normal(size=exact.shape),
            (first * h**power)[:1],
        )
        for h in steps
    ]


@pytest.mark.parametrize("power", [1, 2, 4])
def test_the_limit_is_what_the_levels_tend_to(power: int) -> None:
    steps = [
        h * (1 + 0.02 * np.sin(k)) for k, h in enumerate(STEPS[:6])
    ]  # uneven ratios, as of fitted steps
    found = limit(_levels(steps, power))
    assert found is not None
    exact = 1e-3 * np.stack([np.sin(np.linspace(0, 1, 101)), np.linspace(0, 1, 101)])
    assert found.power == power
    assert found.levels == tuple(steps[3:])
    assert largest(found.position_three - exact) < 1e-14
    assert largest(found.position - exact) == pytest.approx(found.estimate, rel=1e-6)
    assert np.abs(found.torques).max() < 1e-14


def test_levels_lost_in_noise_are_not_chosen() -> None:
    # Truncation of the limit is about h^3, the noise 1e-15 / h^2: they balance at 1e-3 s.
    found = limit(_levels(list(STEPS), 2, noise=1e-15))
    assert found is not None
    assert 3e-4 < found.levels[-1] < 4e-3
    assert found.estimate < 1e-7


def test_there_is_no_limit_without_a_whole_order() -> None:
    assert limit(_levels(list(STEPS), 1.5)) is None
    assert limit(_levels(list(STEPS[:2]), 2)) is None
    assert 1.5 + ASYMPTOTIC < 2


def test_observed_order_with_uneven_ratios() -> None:
    for p in (0.7, 1.0, 2.0, 3.3):
        h = (1e-2, 4e-3, 3e-3)
        assert observed_order(h, h[0] ** p - h[1] ** p, h[1] ** p - h[2] ** p) == pytest.approx(p)
    assert observed_order((4e-3, 2e-3, 1e-3), 0.0, 1.0) is None
    assert observed_order((4e-3, 2e-3, 1e-3), 1.0, 2.0) is None, (
        "differences that grow have no order"
    )


def test_weights_cancel_the_powers_and_keep_constants() -> None:
    steps = (3e-3, 1.4e-3, 1e-3)
    w = weights(steps, (2, 3))
    assert w.sum() == pytest.approx(1.0)
    assert np.dot(w, np.array(steps) ** 2) == pytest.approx(0.0, abs=1e-18)
    assert np.dot(w, np.array(steps) ** 3) == pytest.approx(0.0, abs=1e-20)


# floors


def _site(answers: dict[str, float], error: float = 1.0, **others: object) -> Site:
    """A floor at which options have these effects; anything else has none."""

    def measure(change: dict[str, object]) -> float | None:
        return error * min((answers[name] for name in change if name in answers), default=1.0)

    settings = tb.engine("mujoco", "default", timestep=1e-3).model_dump(mode="json")  # type: ignore[attr-defined]
    fields = {
        "engine": "mujoco",
        "settings": settings,
        "swept": ("timestep",),
        "error": error,
        "value": 1e-3,
    }
    return Site(**{**fields, "measure": measure, "constraints": ConstraintKinds(), **others})  # type: ignore[arg-type]


def test_a_floor_is_set_by_what_moves_it() -> None:
    assert floor(_site({"solimp": 0.5, "tolerance": 0.9}), 0.0).cause == "softness of the limits"
    found = floor(_site({"preload": 0.001, "solimp": 0.5}), 0.0)
    assert found.cause == "option preload"
    assert "leaves 0.001" in found.evidence and "leaves 0.5" in found.evidence


def test_a_floor_that_nothing_moves_is_called_that(monkeypatch: pytest.MonkeyPatch) -> None:
    assert floor(_site({}), 0.0).cause == "not found"
    single = replace(engine_study("mujoco"), single_precision=lambda _: True)
    monkeypatch.setattr(floors, "engine_study", lambda _: single)
    found = floor(_site({}), 0.0)
    assert found.cause == "single precision" and "rounds to 6.0e-08" in found.evidence
    assert floor(_site({"solimp": 0.5}), 0.0).cause == "softness of the limits"


def test_a_floor_of_the_reference_or_of_rounding() -> None:
    assert floor(_site({}, error=1e-11), 2e-12).cause == "the reference's uncertainty"
    found = floor(_site({}), 0.0, [(5e-4, 4.0)])
    assert found.cause == "rounding" and "h^-2.0" in found.evidence
    assert (
        floor(_site({"solimp": 0.5}, swept=("tolerance",)), 0.0, [(1e-12, 4.0)]).cause != "rounding"
    )


def test_the_studys_own_knob_is_left_alone() -> None:
    settings = tb.engine("pymunk", "default").model_dump(mode="json")  # type: ignore[attr-defined]
    changed = [
        set(change)
        for _, change in refinements("pymunk", settings, ("iterations",), ConstraintKinds())
    ]
    assert {"timestep"} in changed and {"joints"} in changed
    assert not any("iterations" in change for change in changed)


def test_every_notch_is_an_option_the_engine_takes() -> None:
    for name in ("mujoco", "pymunk", "exudyn"):
        for preset in ("assisted", "default"):
            settings = tb.engine(name, preset).model_dump(mode="json")  # type: ignore[attr-defined]
            found = list(refinements(name, settings, (), ConstraintKinds()))
            assert len(found) >= 3
            for _, change in found:
                assert set(change) <= set(settings)
                tb.engine(name, preset, **change)


def test_an_error_that_still_falls_has_no_floor() -> None:
    falling = studying._still_falls
    assert falling([(h, h**2 + 1e-5 * h) for h in STEPS]), "another law, not a floor"
    assert not falling([(h, h**2 + 1e-6) for h in STEPS])
    assert not falling([(h, h**2 + 1e-16 / h**2) for h in STEPS / 8])
    assert not falling([(1e-3, 3e-3)])


# knobs and steps


def test_knobs_are_options_of_their_engines_and_go_from_coarse_to_fine() -> None:
    for name in ("mujoco", "pymunk", "exudyn"):
        knobs = swept_parameters(name)
        assert len(knobs) > 1
        for knob in knobs:
            made = [
                tb.engine(name, knob.preset, **{**knob.base, **knob.options(v)})
                for v in knob.values
            ]
            assert len({one.model_dump_json() for one in made}) == len(made), (
                f"{name} {knob.name}: equal settings"
            )  # type: ignore[attr-defined]
            assert np.all(np.diff(np.log(knob.values)) < 0) or np.all(
                np.diff(np.log(knob.values)) > 0
            )
            assert knob.name in parameter_names()


def test_the_bias_leaves_an_error_standing_for_the_lag() -> None:
    knob = next(knob for knob in swept_parameters("pymunk") if knob.name == "error_bias")
    h = knob.base["timestep"]
    assert len(knob.values) > 0
    for lag in knob.values:
        share = float(knob.options(lag)["error_bias"]) ** h  # of an error that is left after a step
        assert h * share / (1 - share) == pytest.approx(lag, rel=1e-9)


def test_the_radius_is_that_of_the_dissipation() -> None:
    knob = next(knob for knob in swept_parameters("exudyn") if knob.name == "spectral_radius")
    assert len(knob.values) > 0
    for dissipation in knob.values:
        rho = knob.options(dissipation)["spectral_radius"]
        assert (1 - rho) / (1 + rho) == pytest.approx(dissipation)


@pytest.mark.parametrize("asked", [1e-2, 1e-3, 1e-4])
def test_fitting_steps_are_hardly_shortened(asked: float) -> None:
    end, events = 2.7428, (1.19494, 1.43734)
    step = fitting(asked, end, events)
    assert step == pytest.approx(asked, rel=0.03)

    def shortening(h: float) -> float:
        left = np.array([run_duration(end, h) - start for start in (0.0, *events)]) / h
        return float(np.max((np.ceil(left - 1e-9) - left) / left))

    assert shortening(step) < 0.2 * max(
        shortening(asked * f) for f in (0.981, 0.993, 1.0, 1.007, 1.019)
    )


@pytest.mark.usefixtures("third_party")
@pytest.mark.parametrize("step", [4e-3, 5e-4])
def test_durations_are_those_of_trials(step: float, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[float] = []

    def simulate(self: plugin_engines.Echo, problem: tb.Problem) -> tb.Trajectory:
        asked.append(problem.duration)
        return tb.engine("reference", timestep=5e-3).simulate(problem)

    monkeypatch.setattr(plugin_engines.Echo, "simulate", simulate)
    runner = Runner(tb.fixed())
    make(runner, plugin_engines.Echo(timestep=step))
    assert asked[-1] == run_duration(runner.judged_to, step)


# the whole, on engines of a third party


@pytest.fixture(scope="module")
def studies(tmp_path_factory: pytest.TempPathFactory) -> Studies:
    """Engines of a third party, which are announced while they are studied."""
    folder = tmp_path_factory.mktemp("site")
    plugin_engines.announce(folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        return converge_study(Study([tb.fixed()], ["echo", "raiser"], until=0.5, isolate=False))


@pytest.mark.slow
def test_plugins_are_studied_and_failures_are_points(studies: Studies) -> None:
    machine = studies.machines[0]
    assert {study.label for study in machine.studies} == {
        "echo assisted",
        "echo default",
        "raiser assisted",
        "raiser default",
    }
    for study in machine.studies:
        messages = {point.message for point in study.points}
        if study.engine == "raiser":
            assert messages == {"ZeroDivisionError: careless"}
            assert study.curve("position").law is None and study.curve("position").floor is None
        else:
            assert messages == {None}
            # What gives the reference back is no distance from it, and nothing is claimed of it.
            assert all(point.position == 0.0 for point in study.points)
            assert study.curve("position").law is None
    text = page(document(studies))
    assert "ZeroDivisionError: careless" in text and "Fixed machine" in text
    assert not re.search(r"<(script|link|img)[^>]+(src|href)=.(https?:)?//", text), (
        "the page must need nothing else"
    )


def test_options_hold_in_every_point_of_a_sweep() -> None:
    if not tb.engines()["pymunk"].installed:
        pytest.skip("pymunk is not installed here")
    own = {"pymunk.leapfrog": False, "timestep": 2e-3}
    study = Study(["pendulum"], ["pymunk"], options=own, until=0.1, isolate=False)
    (swept,) = converge_study(study, ["iterations"]).machines[0].studies
    assert swept.base == {"timestep": 2e-3, "leapfrog": False}
    assert swept.settings["leapfrog"] is False and swept.settings["timestep"] == 2e-3
    (plain,) = converge_study(replace(study, options={}), ["iterations"]).machines[0].studies
    assert plain.settings["leapfrog"] is True
    assert plain.points[-1].steps > 1.5 * swept.points[-1].steps
    assert plain.points[-1].position != swept.points[-1].position


@pytest.mark.slow
def test_what_sets_a_floor_is_looked_for_by_the_engine_itself() -> None:
    """pymunk's iterations converge soon: what is left is set by the time step."""
    if not tb.engines()["pymunk"].installed:
        pytest.skip("pymunk is not installed here")
    found = converge_study(
        Study([tb.fixed()], ["pymunk"], until=0.5, isolate=False), ["iterations"]
    )
    explained = found.machines[0].studies[0].curve("position").floor
    assert explained is not None and explained.cause == "time step"
    assert "half the time step leaves 0.25" in explained.evidence


@pytest.mark.slow
def test_the_data_keep_to_the_published_schema(studies: Studies) -> None:
    published = (
        files("trebucheck.comparisons")
        .joinpath("schemas/converge.schema.json")
        .read_text(encoding="utf-8")
    )
    assert published == schema_text(Studies), "run docs/generate.py"
    jsonschema.validate(json.loads(studies.to_json()), json.loads(published))
    assert Studies.from_json(studies.to_json()) == studies


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--engines", "mujoko"], "did you mean 'mujoco'"),
        (["--engines", "reference"], "'reference' is what the others are measured against"),
        (["--knobs", "colour"], "there is no knob 'colour'; there are: timestep, solref"),
        (["--knobs", ","], "--knobs is empty"),
        (
            ["--engines", "pymunk", "--knobs", "solref"],
            "none of the engines pymunk has any of the knobs solref",
        ),
        (["--models", "floating"], "no model 'floating'"),
        (["--set", "l9=3"], "there is no such parameter"),
        (
            ["--option", "mujoco.solref=-40000,-400"],
            "option solref of mujoco is what its knob 'solref' turns",
        ),
        (
            ["--engines", "mujoco", "--option", "timestep=1e-3"],
            "is what its knob 'timestep' turns; leave the option",
        ),
        (["--engines", "pymunk", "--knobs", "timestep", "--option", "iterations=0"], "iterations"),
        (
            ["--engines", "pymunk", "--option", "mujoco.solref=1,1"],
            "'mujoco' is not among the engines asked for",
        ),
        (["--timeout", "0"], "'--timeout': 0.0 must be positive"),
        (["--timeout", "nan"], "'--timeout': nan must be positive"),
    ],
)
def test_wrong_input_gets_a_sentence(
    arguments: list[str], complaint: str, refused: Callable[..., str]
) -> None:
    of_options = {argument.partition(".")[0] for argument in arguments if "knob" in complaint}
    for engine in {"mujoco", "pymunk"}.intersection({*arguments, *of_options}):
        pytest.importorskip(engine)
    assert complaint in refused("converge", *arguments)


def test_an_interrupt_is_exit_code_130(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(studying, "converge", interrupted)
    assert main(["converge", "--out", str(tmp_path / "out")]) == 130
    assert "--resume" in capsys.readouterr().err
    assert not (tmp_path / "out" / "converge.html").exists()


@pytest.mark.slow
def test_an_interrupted_study_goes_on(third_party: None, tmp_path: Path) -> None:
    def stop(what: str, done: int, of: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    store = Store(tmp_path, records=tmp_path)
    with pytest.raises(KeyboardInterrupt):
        converge_study(
            Study([tb.fixed()], ["echo"], until=0.2, store=store, isolate=False, progress=stop)
        )
    kept = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    assert kept
    converge_study(
        Study([tb.fixed()], ["echo"], until=0.2, store=replace(store, resume=True), isolate=False)
    )
    assert all(path.stat().st_mtime_ns == time for path, time in kept.items())
