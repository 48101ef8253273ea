"""Error budgets on deviations that are known in closed form: no engine simulates."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from io import StringIO
from itertools import permutations
from typing import Any, cast

import jsonschema
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console
from trebucheck.comparisons.explain import (
    Budget,
    Cause,
    ExplainedMachine,
    Explanation,
    Intervention,
    Reread,
    budget,
    by_kinematics,
    causes_of,
    compare_presets,
    explain_study,
    orders,
    with_filtered_torques,
)
from trebucheck.comparisons.report import html, terminal
from trebucheck.comparisons.report.pages.explain import document, main_quantities
from trebucheck.comparisons.runs.process import Worker
from trebucheck.comparisons.runs.record import GRID, Curves, EngineRuns, RunRecord
from trebucheck.comparisons.runs.results import Metric, Outcome
from trebucheck.comparisons.runs.runner import Runner
from trebucheck.comparisons.runs.study import Study
from trebucheck.engines.exudyn.engine import ExudynEngine
from trebucheck.engines.mujoco.engine import MujocoEngine
from trebucheck.engines.mujoco.options import effective_solref
from trebucheck.engines.protocol import BuiltinEngine, Engine
from trebucheck.engines.pymunk.engine import PymunkEngine
from trebucheck.engines.reference.engine import ReferenceEngine
from trebucheck.engines.registry import engine, engine_study, with_options
from trebucheck.engines.study import ConstraintKinds
from trebucheck.models.arrays import FloatArray
from trebucheck.models.errors import InputError
from trebucheck.models.library.registry import model
from trebucheck.models.library.trebuchet import HANGER_REST, fixed
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem
from trebucheck.models.spec import schema_text
from trebucheck.models.trajectory import Trajectory

ENGINES: tuple[type[BuiltinEngine], ...] = (MujocoEngine, PymunkEngine, ExudynEngine)
T = np.linspace(0.0, 1.0, GRID + 1)
ROUNDING = 1e-9  # sums and differences of a dozen numbers of size one

Model = Callable[[Mapping[str, Any], Mechanism], FloatArray]


@dataclass
class ClosedForm:
    """Stands for EngineRuns.

    The deviation is a formula of the options, times the same shape in x and in the torque.
    """

    error: Model
    refuses: Callable[[Mapping[str, Any]], bool] = lambda _: False
    mechanism: Mechanism = field(default_factory=fixed)
    end: float = 1.0
    seen: list[dict[str, Any]] = field(default_factory=list)

    def record(self, engine: Engine, repeats: int = 1, given: Mechanism | None = None) -> RunRecord:
        settings = engine.settings
        self.seen.append(settings)
        made = RunRecord(
            engine=engine.name,
            engine_version="0",
            preset="default",
            settings=settings,
            given_hash="",
            wall_times=(1.0,) * repeats,
        )
        if self.refuses(settings):
            return made.model_copy(update={"outcome": Outcome.FAILED, "message": "it flew apart"})
        e = self.error(settings, given or self.mechanism)
        largest = float(np.abs(e).max())
        metrics = (
            Metric(name="position_max", subject="projectile", value=largest, unit="m"),
            Metric(name="stop_torque_max", subject=HANGER_REST, value=1e3 * largest, unit="N m"),
        )
        return made.model_copy(update={"curves": _curves(e), "metrics": metrics})


def _curves(e: FloatArray) -> Curves:
    return Curves(
        end=1.0,
        positions={"projectile": (tuple(e.tolist()), tuple((0 * e).tolist()))},
        torques={HANGER_REST: tuple((1e3 * e).tolist())},
        energy=tuple(e.tolist()),
        release_times={HANGER_REST: float(e[-1])},
        launch_time=None,
        launch_speed=float(e[0]),
    )


def _budget(error: Model, engine: Engine, **options: Any) -> Budget:
    return budget(cast("EngineRuns", ClosedForm(error, **options)), engine)


def _shares(found: Budget, name: str = "position") -> dict[str, float]:
    quantity = found.quantity(name)
    assert quantity is not None
    return {share.cause: share.fraction or 0.0 for share in quantity.shares}


# the arithmetic


def test_causes_that_add_are_told_apart_and_the_unknown_stays_unexplained() -> None:
    """Three causes of known size and something no option reaches."""
    unknown = 0.05 * np.sin(40.0 * T)

    def error(s: Mapping[str, Any], _: Mechanism) -> FloatArray:
        return (
            0.5 * T * (not s["leapfrog"])
            + 0.3 * T**2 * s["error_bias"] / 0.00179701
            - 0.2 * T * (not s["locate_releases"])
            + unknown
        )

    found = _budget(error, PymunkEngine.presets()["default"]())
    whole = error(PymunkEngine.presets()["default"]().settings, fixed())
    bias = PymunkEngine.presets()["default"]().error_bias / 0.00179701
    parts = {
        "start and labels": 0.5 * T,
        "error bias": 0.3 * bias * T**2,
        "event location": -0.2 * T,
    }
    shares = _shares(found)
    for cause, part in parts.items():
        assert shares[cause] == pytest.approx(part @ whole / (whole @ whole), abs=ROUNDING)
    others = [cause for cause in shares if cause not in parts]
    assert "time step" in others
    assert all(abs(shares[cause]) < ROUNDING for cause in others)
    position = found.quantity("position")
    assert position is not None and position.explained is not None
    assert position.explained == pytest.approx(
        1.0 - np.linalg.norm(unknown) / np.linalg.norm(whole), abs=ROUNDING
    )
    assert sum(shares.values()) + (position.rest.fraction or 0.0) == pytest.approx(
        1.0, abs=ROUNDING
    )
    assert position.rms == pytest.approx(np.sqrt(np.mean(whole**2)))


def test_pairwise_interactions_are_shared_as_by_shapley() -> None:
    """Bias and labels do harm in proportion to the step.

    Products of two, against all orders written out.
    """

    def size(s: Mapping[str, Any]) -> float:
        h, bias, labels = s["timestep"] / 1e-3, s["error_bias"] > 0, not s["leapfrog"]
        return h * (3.0 * bias + 2.0 * labels) + 0.7 * bias * labels + 0.5 * h**2

    found = _budget(lambda s, _: size(s) * T, PymunkEngine.presets()["default"]())
    default = PymunkEngine.presets()["default"]().settings
    removals = {
        c.name: c.removal.options
        for c in causes_of(PymunkEngine.presets()["default"]())
        if c.removal is not None
    }
    players = ("time step", "error bias", "start and labels")
    expected = dict.fromkeys(players, 0.0)
    for order in permutations(players):
        settings = dict(default)
        for player in order:
            before = size(settings)
            settings |= removals[player]
            expected[player] += (before - size(settings)) / 6 / size(default)
    shares = _shares(found)
    for player, share in expected.items():
        assert shares[player] == pytest.approx(share, abs=ROUNDING)
    position = found.quantity("position")
    assert position is not None
    bands = {share.cause: share.interaction / position.rms for share in position.shares}
    assert bands["rod lengths"] == pytest.approx(0.0, abs=ROUNDING)
    assert min(bands[player] for player in players) > 0.01


def test_a_removal_that_leaves_a_known_part_is_extrapolated() -> None:
    """Exudyn's time step is refined by four.

    An error of second order is accounted for as a whole.
    """
    found = _budget(lambda s, _: 1e8 * s["timestep"] ** 2 * T, ExudynEngine())
    position = found.quantity("position")
    assert position is not None
    assert _shares(found)["time step"] == pytest.approx(1.0, abs=ROUNDING)
    assert position.explained == pytest.approx(1.0, abs=ROUNDING)


def test_an_error_that_falls_otherwise_than_assumed_stays_partly_unexplained() -> None:
    found = _budget(lambda s, _: 1e4 * s["timestep"] * T, ExudynEngine())
    position = found.quantity("position")
    assert position is not None
    assert position.explained == pytest.approx(0.8, abs=ROUNDING)  # (1 - 1/4) / (1 - 1/16)


def test_softness_is_told_from_the_time_step_although_it_is_scaled_with_it() -> None:
    """MuJoCo's assisted limits follow the step.

    With them written out, a shorter step leaves them as they are.
    """

    def error(s: Mapping[str, Any], _: Mechanism) -> FloatArray:
        stiffness = 1.0 / s["timestep"] ** 2 if s["solref"] is None else -s["solref"][0]
        return 1e10 * (1.0 - s["solimp"][0]) / stiffness * T + 1e5 * s["timestep"] ** 2 * T**2

    found = _budget(error, MujocoEngine())
    e = error(MujocoEngine().settings, fixed())
    shares = _shares(found)
    left = 1.0 / 64.0  # of both, at an eighth of the step
    assert shares["constraint softness"] == pytest.approx((1 - left) * T @ e / (e @ e), rel=1e-6)
    assert shares["time step"] == pytest.approx((1 - left) * 0.1 * T**2 @ e / (e @ e), rel=1e-6)
    position = found.quantity("position")
    assert position is not None
    softness = next(share for share in position.shares if share.cause == "constraint softness")
    assert softness.second == pytest.approx(
        T @ e / (e @ e), rel=1e-6
    )  # by doubling 1 - d: nothing is left of it


def test_roundoff_is_measured_and_taken_off_the_rest_in_quadrature() -> None:
    def error(s: Mapping[str, Any], mechanism: Mechanism) -> FloatArray:
        # A run's random part depends on every bit of what it is given.
        seed = abs(hash((mechanism.gravity, s["timestep"], s["iterations"]))) % 2**32
        noise = np.random.default_rng(seed).normal(0.0, 0.3, len(T))
        return 1e6 * s["timestep"] ** 2 * (1 + T) + noise

    found = _budget(error, PymunkEngine())
    position = found.quantity("position")
    assert position is not None and position.explained is not None
    # A thousand samples know their spread to 1/sqrt(2000); five times that.
    assert position.roundoff == pytest.approx(0.3, rel=5 / np.sqrt(2 * len(T)))
    assert position.roundoff_left == pytest.approx(0.3, rel=5 / np.sqrt(2 * len(T)))
    assert position.explained > 0.9 > 1.0 - position.rest_rms / position.rms


@given(st.lists(st.integers(0, 7), max_size=8), st.data())
def test_orders_take_out_every_cause_once_and_keep_to_precedence(
    numbers: list[int], data: st.DataObject
) -> None:
    names = [str(n) for n in dict.fromkeys(numbers)]
    causes: list[Cause] = []
    for i, name in enumerate(names):
        before = data.draw(st.sets(st.sampled_from(names[:i]))) if i else set()
        causes.append(Cause(name, "", Intervention(), after=(*before, "absent")))
    data.draw(st.randoms()).shuffle(causes)
    for order in orders(causes):
        assert sorted(cause.name for cause in order) == sorted(names)
        for i, cause in enumerate(order):
            done = {earlier.name for earlier in order[:i]}
            assert set(cause.after) - {"absent"} <= done


def test_without_precedence_the_second_order_is_the_reverse() -> None:
    causes = [Cause(name, "", Intervention()) for name in "abc"]
    first, second = orders(causes)
    assert first == second[::-1] == tuple(causes)


# failures


def test_a_cause_that_cannot_be_measured_says_so_and_counts_as_unexplained() -> None:
    def error(s: Mapping[str, Any], _: Mechanism) -> FloatArray:
        return (3.0 * (s["error_bias"] > 0) + (not s["leapfrog"])) * T

    found = _budget(
        error, PymunkEngine.presets()["default"](), refuses=lambda s: s["error_bias"] == 0.0
    )
    messages = {cause.name: cause.message for cause in found.causes if cause.message}
    assert messages == {"error bias": "it flew apart"}
    assert "error bias" not in _shares(found)
    assert _shares(found)["start and labels"] == pytest.approx(0.25, abs=ROUNDING)
    position = found.quantity("position")
    assert position is not None and position.explained == pytest.approx(0.25, abs=ROUNDING)


def test_a_run_that_fails_is_a_budget_without_shares() -> None:
    found = _budget(lambda _s, _m: T, PymunkEngine.presets()["default"](), refuses=lambda _: True)
    assert (found.message, found.quantities) == ("it flew apart", ())


def test_no_error_makes_no_share() -> None:
    found = _budget(lambda _s, _m: 0.0 * T, PymunkEngine())
    assert main_quantities(found) == []
    assert all(share.fraction is None for quantity in found.quantities for share in quantity.shares)


# the tables


@pytest.mark.parametrize("engine_type", ENGINES, ids=lambda e: e.name)
@pytest.mark.parametrize("preset", ["default", "assisted"])
def test_every_intervention_is_valid_and_changes_something(
    engine_type: type[BuiltinEngine], preset: str
) -> None:
    engine = engine_type.presets()[preset]()
    causes = causes_of(engine)
    assert "time step" in {cause.name for cause in causes}
    for cause in causes:
        assert cause.explanation
        assert set(cause.after) <= {other.name for other in causes} - {cause.name}
        for done in (cause.removal, cause.scaling):
            if done is not None:
                changed = with_options(engine, done.options)
                assert (
                    changed != engine
                    or done.own_kinematics
                    or done.filtered_torques
                    or done.point_inertia
                )


@pytest.mark.parametrize("engine_type", ENGINES, ids=lambda e: e.name)
def test_what_is_taken_out_already_is_no_cause(engine_type: type[BuiltinEngine]) -> None:
    default = {cause.name for cause in causes_of(engine_type.presets()["default"]())}
    assisted = {cause.name for cause in causes_of(engine_type())}
    assert "event location" in default - assisted
    assert assisted < default


def test_softness_that_is_no_more_than_the_step_allows_is_reduced_with_it() -> None:
    default, assisted = (
        next(c for c in causes_of(engine) if c.name == "constraint softness")
        for engine in (MujocoEngine.presets()["default"](), MujocoEngine())
    )
    assert (default.after, default.scaling) == ((), None)
    assert (
        assisted.after == ("time step",)
        and assisted.scaling is not None
        and assisted.scaling.leaves == 2.0
    )


MANUAL = {"RK4": (2.0, 1.5), "Euler": (1.0, 1.0), "implicit": (1.0, 1.0)}
"""Damping times the step: of limits, and of points that are held exactly."""


@pytest.mark.parametrize("integrator", MANUAL)
@pytest.mark.parametrize("moving_points", [True, False])
@pytest.mark.parametrize(
    "kinds", [ConstraintKinds(), ConstraintKinds(True, True), ConstraintKinds(False, True)]
)
def test_the_softness_that_follows_from_the_step_is_the_same_wherever_it_is_written_out(
    integrator: str, moving_points: bool, kinds: ConstraintKinds
) -> None:
    """In the built model, where a cause takes the softness out, and where a refinement halves its
    time constant.
    """
    h, (limits, points) = 2e-3, MANUAL[integrator]
    made = engine("mujoco", integrator=integrator, moving_points=moving_points, timestep=h)
    damping = points if moving_points and not kinds.angles else limits
    assert effective_solref(made.settings, kinds) == (-1 / h**2, -damping / h)
    study = engine_study("mujoco")
    softer = next(each for each in study.refinements if "time constant" in each.description)
    assert softer.change(made.settings, kinds) == {"solref": (-4 / h**2, -2 * damping / h)}
    finer = next(each for each in study.causes(made.settings, kinds) if each.name == "time step")
    # Points that are not held exactly yet are by the time that the step is taken out (`after`).
    taken = limits if kinds.angles else points
    assert list(finer.options["solref"]) == [-1 / h**2, -taken / h]  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["fixed", "floating-arm"])
@pytest.mark.parametrize("integrator", ["RK4", "implicit"])
def test_the_softness_written_out_is_that_of_the_built_model(name: str, integrator: str) -> None:
    pytest.importorskip("mujoco")
    from trebucheck.engines.mujoco.build import load

    mechanism = model(name)
    made = MujocoEngine(integrator=integrator)  # type: ignore[arg-type]
    built = load(mechanism, made)
    kinds = ConstraintKinds.of(mechanism)
    given = (
        built.jnt_solref if kinds.angles else built.pair_solref if built.npair else built.eq_solref
    )
    assert tuple(given[0]) == effective_solref(made.settings, kinds)


@pytest.mark.usefixtures("third_party")
def test_of_a_plug_in_the_time_step_alone_is_known() -> None:
    causes = causes_of(engine("plain"))
    assert [cause.name for cause in causes] == ["time step"]
    assert with_options(engine("plain"), causes[0].options) == engine("plain", timestep=1e-2 / 8)


@pytest.mark.usefixtures("third_party")
def test_an_engine_that_does_not_tell_its_options_is_completed() -> None:
    made = engine("plain", "default", timestep=5e-3)
    assert isinstance(made, Engine)
    assert (made.preset, made.settings, made.timestep) == ("default", {"timestep": 5e-3}, 5e-3)
    assert pickle.loads(pickle.dumps(made)) == made
    assert made.simulate(Problem(fixed(), duration=0.1)).t[1] == pytest.approx(5e-3)
    with Worker() as worker:
        trial = EngineRuns(Runner(fixed(), worker)).record(made)
    assert (
        trial.position == 0.0 and trial.preset == "default" and trial.settings == {"timestep": 5e-3}
    )


@pytest.mark.usefixtures("third_party")
def test_options_of_an_unknown_kind_of_engine_cannot_be_changed() -> None:
    with pytest.raises(InputError, match="'strange' cannot be changed"):
        with_options(engine("strange"), {"timestep": 1.0})


# reading otherwise


def _reference(step: float = 2e-3) -> Trajectory:
    return ReferenceEngine(timestep=step).simulate(Problem(fixed(), duration=1.4))


def _with_torque(trajectory: Trajectory, torque: FloatArray) -> Trajectory:
    from dataclasses import replace

    return replace(trajectory, stop_torques={**trajectory.stop_torques, HANGER_REST: torque})


def test_the_filter_stops_what_alternates_and_leaves_cubics() -> None:
    run = _reference()
    k = np.arange(len(run.t))
    smooth = 1.0 + run.t - 2.0 * run.t**2 + 3.0 * run.t**3
    filtered = with_filtered_torques(_with_torque(run, smooth + (-1.0) ** k)).stop_torque(
        HANGER_REST
    )
    release = run.release_time(HANGER_REST)
    assert release is not None
    inside = (k >= 2) & (k < len(k) - 2) & (np.abs(run.t - release) > 3 * 2e-3)
    assert np.abs(filtered - smooth)[inside].max() < 1e-12
    # At the ends and around the release a sample has not four like itself around it.
    assert np.abs(filtered - smooth)[[0, -1]].min() > 0.9
    assert np.abs(filtered - smooth)[np.abs(run.t - release) < 2e-3].min() > 0.9


def test_by_its_own_kinematics_the_reference_is_where_it_was() -> None:
    run, again = _reference(), by_kinematics(_reference())
    for name, motion in run.markers.items():
        assert (
            np.abs(again.marker(name).position - motion.position).max() < 1e-13
        )  # a few ulps of 24 m
    assert np.abs(again.total_energy / run.total_energy - 1).max() < 1e-12


def test_a_reread_engine_is_remembered_as_another_one() -> None:
    engine = PymunkEngine()
    reread = Reread(engine, own_kinematics=True, filtered_torques=False)
    assert (
        reread.name == "pymunk"
        and reread.preset == "assisted"
        and reread.timestep == engine.timestep
    )
    assert reread.settings != engine.settings


# default against assisted


def test_each_option_is_changed_alone_from_either_end() -> None:
    def error(s: Mapping[str, Any], _: Mechanism) -> FloatArray:
        return (1.0 + 10.0 * (s["error_bias"] > 0)) * (1.0 + 4.0 * (not s["leapfrog"])) * T

    study = ClosedForm(error)
    plain = PymunkEngine(error_bias=0.1, leapfrog=False, hold_lengths=False, pivot_mass=1.0)
    found = compare_presets(cast("EngineRuns", study), plain, PymunkEngine())
    by_option = {change.option: change for change in found.changes}
    default, assisted = plain.settings, PymunkEngine().settings
    assert set(by_option) == {name for name in default if default[name] != assisted[name]}
    assert (found.first.position, found.second.position) == (55.0, 1.0)
    assert (by_option["error_bias"].alone.position, by_option["error_bias"].back.position) == (
        5.0,
        11.0,
    )
    assert (by_option["leapfrog"].alone.position, by_option["leapfrog"].back.position) == (
        11.0,
        5.0,
    )
    for seen in study.seen:
        differing = [name for name in default if seen[name] != default[name]]
        assert len(differing) in (0, 1, len(by_option) - 1, len(by_option))
    # An option that does nothing unless others change as well is no failure of the comparison.
    settings = PymunkEngine.presets()["settings"]()
    found = compare_presets(cast("EngineRuns", study), settings, PymunkEngine())
    (leapfrog,) = (change for change in found.changes if change.option == "leapfrog")
    assert "joints" in (leapfrog.alone.message or "") and leapfrog.back.position == 5.0


def test_presets_are_compared_at_the_same_step() -> None:
    study = ClosedForm(lambda s, _: s["timestep"] * T)
    found = compare_presets(
        cast("EngineRuns", study), ExudynEngine.presets()["default"](), ExudynEngine()
    )
    assert (
        {s["timestep"] for s in study.seen}
        == {found.timestep}
        == {ExudynEngine.presets()["default"]().timestep}
    )


# how it is shown


@pytest.fixture(scope="module")
def explanation() -> Explanation:
    def error(s: Mapping[str, Any], _: Mechanism) -> FloatArray:
        return (3.0 * (s["error_bias"] > 0) + (not s["leapfrog"])) * T + 0.2 * T**3

    machine = fixed()
    study = cast("EngineRuns", ClosedForm(error, refuses=lambda s: s["locate_releases"]))
    broken = _budget(error, PymunkEngine(), refuses=lambda _: True)
    return Explanation(
        trebucheck_version="0",
        python_version="3",
        platform="x",
        machines=(
            ExplainedMachine(
                model="fixed",
                mechanism=machine,
                mechanism_hash=machine.content_hash,
                launch_time=1.0,
            ),
        ),
        budgets=(budget(study, PymunkEngine.presets()["default"]()), broken),
        comparisons=(compare_presets(study, PymunkEngine.presets()["default"](), PymunkEngine()),),
    )


def test_the_page_shows_causes_failures_and_needs_nothing_else(explanation: Explanation) -> None:
    page = html.page(document(explanation))
    for text in (
        "error bias",
        "start and labels",
        "unexplained",
        "it flew apart",
        "default, leapfrog = True",
    ):
        assert text in page
    assert "could not be measured" in page and "No budget" in page
    body = page[page.index("</script>") :]
    assert 'src="http' not in body and 'href="http' not in body


def test_engines_without_an_error_can_be_shown(explanation: Explanation) -> None:
    study = cast("EngineRuns", ClosedForm(lambda _s, _m: 0.0 * T))
    default = PymunkEngine.presets()["default"]()
    found = compare_presets(study, default, PymunkEngine())
    spotless = explanation.model_copy(
        update={"budgets": (budget(study, default),), "comparisons": (found,)}
    )  # fmt: skip
    assert "No error to explain" in html.page(document(spotless))
    console = Console(record=True, file=StringIO())
    terminal.show(document(spotless), console)
    assert "Nothing to explain" in console.export_text()


def test_the_terminal_shows_the_same(explanation: Explanation) -> None:
    console = Console(width=110, record=True, file=StringIO())
    terminal.show(document(explanation), console)
    text = console.export_text()
    for part in (
        "pymunk default",
        "error bias",
        "it flew apart",
        "leapfrog as assisted",
        "or more of every error",
    ):
        assert part in text


def test_explain_json_keeps_to_its_published_schema(explanation: Explanation) -> None:
    from importlib.resources import files

    text = (
        files("trebucheck.comparisons")
        .joinpath("schemas/explain.schema.json")
        .read_text(encoding="utf-8")
    )
    assert text == schema_text(Explanation)
    jsonschema.validate(json.loads(explanation.to_json()), json.loads(text))
    assert Explanation.from_json(explanation.to_json()) == explanation


# wrong input


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--engines", "mujco"], "did you mean 'mujoco'?"),
        (["--preset", "best"], "no preset 'best'"),
        (["--timeout", "0"], "'--timeout': 0.0 must be positive"),
        (["--timestep", "-1"], "timestep = -1.0"),
        (["--models", "sliding"], "sliding"),
        (["--set", "l1"], "NAME=VALUE"),
    ],
)
def test_wrong_input_is_refused_before_anything_runs(
    arguments: list[str], sentence: str, refused: Callable[..., str]
) -> None:
    assert sentence in refused("explain", "--out", "out", *arguments)


def test_a_machine_that_cannot_throw_is_refused() -> None:
    still = fixed().model_copy(update={"gravity": 0.0})
    with pytest.raises(InputError, match="gravity"):
        explain_study(Study([still], engines=["reference"], isolate=False))


def test_an_engine_that_is_not_installed_is_a_row_of_the_explanation(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(ExudynEngine, "is_installed", classmethod(lambda _: False))
    explanation = explain_study(
        Study([fixed()], engines=["exudyn"], presets=["assisted"], isolate=False)
    )
    (absent,) = explanation.budgets
    assert absent.message is not None and "pip install exudyn" in absent.message
    assert explanation.comparisons == ()
    assert "pip install exudyn" in html.page(document(explanation))
