"""The comparison harness itself, on the reference and on engines of a third party.

No engine library needed.
"""

from __future__ import annotations

import html
import json
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
import trebucheck as tb
from trebucheck.comparisons.compare import Comparison, RunKey, compare_study
from trebucheck.comparisons.report.html import page
from trebucheck.comparisons.report.pages.compare import document
from trebucheck.comparisons.runs.metrics import measure
from trebucheck.comparisons.runs.process import Worker, simulate_warm
from trebucheck.comparisons.runs.results import Metric, Outcome, Results, Run
from trebucheck.comparisons.runs.scales import LIMIT
from trebucheck.comparisons.runs.store import Store
from trebucheck.comparisons.runs.stretching import stretching_at
from trebucheck.comparisons.runs.study import Study
from trebucheck.comparisons.runs.tolerances import judge
from trebucheck.engines.reference.engine import ReferenceEngine
from trebucheck.models.arrays import FloatArray
from trebucheck.models.spec import schema_text
from trebucheck.models.trajectory import load, save
from trebucheck.reference.solution import Solution
from trebucheck.reference.solver import solve


def _reference(**parameters: float) -> tb.Trajectory:
    machine = tb.fixed(tb.TrebuchetParameters(**parameters))
    return tb.engine("reference", timestep=5e-3).simulate(tb.Problem(machine, duration=2.8))


def _compare(**changes: object) -> Comparison:
    options = {
        "models": ["fixed"],
        "engines": ["reference"],
        "presets": ["assisted"],
        "isolate": False,
    }
    return tb.compare(**{**options, **changes})  # type: ignore[arg-type]


# metrics


def test_the_reference_is_no_distance_from_itself() -> None:
    solution = solve(tb.Problem(tb.fixed(), duration=3.0))
    assert solution.launch is not None
    for metric in measure(_reference(), solution, solution.launch.time):
        if not metric.name.startswith(("energy", "stop_gap", "launch")):
            assert metric.value == 0.0, metric.label


@pytest.mark.parametrize(
    ("name", "subject", "change", "expected"),
    [
        ("position_max", "projectile", lambda t: _moved(t, 3e-4, 4e-4), 5e-4),
        ("position_rms", "projectile", lambda t: _moved(t, 3e-4, 4e-4), 5e-4),
        ("angle_max", "phi", lambda t: replace(t, q=t.q + np.array([0, 2e-3, 0])), 2e-3),
        ("stop_torque_max", "hanger rest", lambda t: _twisted(t, 7.0), 7.0),
        ("release_time", "sling rest", lambda t: _later(t, 1e-4), 1e-4),
        (
            "energy_drift",
            None,
            lambda t: replace(t, kinetic_energy=t.kinetic_energy + 208.1015257),
            1e-3,
        ),
        ("joint_reaction_max", "fulcrum", lambda t: _pulled(t, 30.0, 40.0), 50.0),
    ],
)
def test_a_known_difference_is_measured(
    name: str, subject: str | None, change: object, expected: float
) -> None:
    solution = solve(tb.Problem(tb.fixed(), duration=3.0))
    metrics = measure(change(_reference()), solution, 2.7)  # type: ignore[operator]
    found = next(m for m in metrics if (m.name, m.subject) == (name, subject))
    assert found.value == pytest.approx(expected, rel=1e-6)


def _moved(trajectory: tb.Trajectory, dx: float, dy: float) -> tb.Trajectory:
    motion = trajectory.marker("projectile")
    moved = replace(motion, position=motion.position + np.array([dx, dy]))
    return replace(trajectory, markers={**trajectory.markers, "projectile": moved})


def _twisted(trajectory: tb.Trajectory, torque: float) -> tb.Trajectory:
    torques = dict(trajectory.stop_torques)
    torques["hanger rest"] = torques["hanger rest"] + torque
    return replace(trajectory, stop_torques=torques)


def _later(trajectory: tb.Trajectory, by: float) -> tb.Trajectory:
    times = dict(trajectory.release_times)
    times["sling rest"] = (times["sling rest"] or 0.0) + by
    return replace(trajectory, release_times=times)


def _pulled(trajectory: tb.Trajectory, fx: float, fy: float) -> tb.Trajectory:
    forces = dict(trajectory.joint_reactions)
    forces["fulcrum"] = forces["fulcrum"] + np.array([fx, fy])
    return replace(trajectory, joint_reactions=forces)


def test_a_release_only_one_of_them_has_is_a_missing_figure_that_does_not_hold() -> None:
    solution = solve(tb.Problem(tb.fixed(), duration=3.0))
    trajectory = replace(
        _reference(), release_times={"hanger rest": None, "sling rest": 1.4, "arm stop": None}
    )
    found = next(
        m for m in measure(trajectory, solution, 2.7) if m.label == "release_time (hanger rest)"
    )
    assert found.value is None
    assert found.note is not None and "1.19494057 s by the reference" in found.note
    assert found.model_copy(update={"tolerance": 1.0}).holds is False


def test_an_engine_that_observes_no_forces_has_no_metric_of_them() -> None:
    solution = solve(tb.Problem(tb.fixed(), duration=3.0))
    blind = replace(_reference(), stop_torques={}, joint_reactions={})
    forces = [
        m
        for m in measure(blind, solution, 2.7)
        if m.name.startswith(("stop_torque", "joint_reaction"))
    ]
    assert forces and all(m.value is None and not m.observed and m.note for m in forces)
    with pytest.raises(tb.InputError, match="no stop torque 'hanger rest' here; there is none"):
        blind.stop_torque("hanger rest")


# tolerances

WAY = 25.111
"""Longest way of a point of the fixed machine up to its launch [m]: the projectile's."""


def _tolerance(timestep: float, name: str = "position_max", **machine: object) -> float | None:
    setup = _compare().results.machines[0].model_copy(update=machine)
    metric = Metric(name=name, subject="projectile", value=0.0, unit="m")
    run = Run(
        model="fixed",
        engine="pymunk",
        preset="assisted",
        outcome=Outcome.AGREES,
        engine_version="1",
        settings={"timestep": timestep},
        metrics=(metric,),
    )
    return judge(run, setup)[0].tolerance


def test_tolerances_grow_with_the_order_and_do_not_sharpen() -> None:
    assert _tolerance(1e-3) == pytest.approx(2e-3)
    assert _tolerance(2e-3) == pytest.approx(8e-3)
    assert _tolerance(1e-4) == pytest.approx(2.5e-5)
    assert _tolerance(5e-4) == pytest.approx(25 * 2.5e-5)
    assert _tolerance(1e-5) == pytest.approx(2.5e-5)
    assert _tolerance(1e-4, table_one=False) == pytest.approx(100 * 2.5e-5)
    assert _tolerance(1e-3, table_one=False) == pytest.approx(
        1e-3 * WAY, rel=1e-4
    )  # the default is stricter
    assert _tolerance(1e-3, name="position_rms") is None  # it follows from the largest
    assert _tolerance(1e-2) == pytest.approx(
        1e-3 * WAY, rel=1e-4
    )  # no claim is looser than the default


def test_the_papers_allowances_and_a_comparison_apply_the_same_tolerance() -> None:
    """At a longer step, and away from Table I, where the paper's allowances once lacked a factor of
    ten.
    """
    from trebucheck_paper.evidence.engine_runs import allowances, allowed
    from trebucheck_paper.evidence.quantities import ThrowQuantity

    quantity = ThrowQuantity("a position", "m")
    runner = tb.engine("pymunk", timestep=2e-3)
    for parameters, expected in (
        (tb.TrebuchetParameters(), 8e-3),
        (tb.TrebuchetParameters(l1=9.5), 8e-2),
    ):
        mechanism = tb.fixed(parameters)
        assert allowed(runner, mechanism).position == pytest.approx(expected)
        assert allowances(runner, mechanism, {}, {quantity: 1.0})[quantity] == pytest.approx(
            expected
        )
        assert _tolerance(2e-3, table_one=expected < 1e-2) == pytest.approx(
            min(expected, 1e-3 * WAY), rel=1e-4
        )


def test_a_tolerance_finer_than_the_reference_is_refused_and_the_report_says_why() -> None:
    comparison = _compare(tolerances={"launch-speed": 1e-13})
    (run,) = comparison.results.runs
    metric = run.metric("launch_speed")
    assert metric is not None and metric.holds is None and metric.note is not None
    assert run.outcome is Outcome.NOT_JUDGED and run.unjudged == (metric,)
    assert html.escape(metric.note, quote=True).replace("&#x27;", "&#39;") in page(
        document(comparison)
    )


@pytest.mark.slow
def test_beyond_the_predictability_horizon_only_invariants_are_judged() -> None:
    """The reference itself, so far that a hundred-thousandth of an inertia moves it by more than
    the default.
    """
    far = _compare(models=["rolling"], duration=8.0, timestep=5e-3)
    (machine,), (run,) = far.results.machines, far.results.runs
    assert machine.judged_to < machine.compared_to == 8.0
    assert machine.stretching <= LIMIT < stretching_at(far.solutions["rolling"], 8.0)
    cut = replace_after(far.trajectories["rolling", "reference assisted"], machine.judged_to)
    changed = {
        m.label for m in measured(far, cut) if m.value != run.metric(m.name, m.subject).value
    }  # type: ignore[union-attr]
    assert changed == {
        "energy_balance",
        "energy_drift",
        "energy_drift_kinetic",
        "horizontal_momentum",
    }


def replace_after(trajectory: tb.Trajectory, time: float) -> tb.Trajectory:
    """The trajectory with everything else than before from a time on."""
    late = trajectory.t > time
    return replace(
        trajectory,
        q=trajectory.q + late[:, None],
        u=trajectory.u + late[:, None],
        kinetic_energy=trajectory.kinetic_energy + late,
        markers={
            name: replace(motion, position=motion.position + late[:, None])
            for name, motion in trajectory.markers.items()
        },
    )


def measured(comparison: Comparison, trajectory: tb.Trajectory) -> tuple[Metric, ...]:
    """As a comparison of one machine measures it."""
    (machine,) = comparison.results.machines
    solution = comparison.solutions[machine.model]
    ends = {"end": machine.judged_to, "invariants_to": machine.compared_to}
    return measure(trajectory, solution, scales=machine.scales, **ends)  # type: ignore[arg-type]


# campaigns


def test_results_follow_their_published_schema() -> None:
    schema = schema_text(Results)
    published = Path(__file__).parents[2] / "comparisons" / "schemas" / "results.schema.json"
    assert published.read_text() == schema
    results = _compare().results
    jsonschema.validate(json.loads(results.to_json()), json.loads(schema))
    assert Results.from_json(results.to_json()) == results


@pytest.mark.usefixtures("third_party")
def test_a_plug_in_is_compared_like_any_engine() -> None:
    assert tb.engines()["echo"].version == "1.0"
    comparison = _compare(engines=["echo"])
    assert comparison.passed
    assert comparison.results.runs[0].metric("position_max", "projectile").value == 0.0  # type: ignore[union-attr]


@pytest.mark.slow
@pytest.mark.usefixtures("third_party")
@pytest.mark.parametrize("isolate", [False, True])
def test_a_failing_engine_costs_its_row_only(isolate: bool) -> None:
    comparison = _compare(engines=["raiser", "reference"], isolate=isolate)
    failed, fine = comparison.results.runs
    assert (failed.outcome, fine.outcome) == (Outcome.FAILED, Outcome.AGREES)
    assert failed.message == "ZeroDivisionError: careless"
    assert not comparison.passed
    assert "ZeroDivisionError: careless" in page(document(comparison))


@pytest.mark.slow
@pytest.mark.usefixtures("third_party")
def test_a_crashing_engine_costs_its_row_only() -> None:
    comparison = _compare(engines=["crasher", "reference"], isolate=True)
    failed, fine = comparison.results.runs
    assert (failed.outcome, fine.outcome) == (Outcome.FAILED, Outcome.AGREES)
    assert failed.message == "crasher crashed: its process ended by itself."


@pytest.mark.slow
@pytest.mark.usefixtures("third_party")
def test_several_runs_at_once_give_the_same_results(tmp_path: Path) -> None:
    """One that crashes costs its row only, a finished one is taken from the store, and rows keep
    their order.
    """
    store = Store(tmp_path / "trajectories", records=tmp_path / "runs")
    study = Study(["fixed"], ["crasher", "reference", "echo"], ["assisted"], until=0.3, store=store)
    one_at_a_time = compare_study(study).results
    resumed = compare_study(replace(study, jobs=2, store=replace(store, resume=True)))
    assert _without_times(resumed.results) == _without_times(one_at_a_time)


def _without_times(results: Results) -> Results:
    times = dict.fromkeys(("wall_time", "processor_time", "reading_time"))
    runs = tuple(run.model_copy(update=times) for run in results.runs)
    return results.model_copy(update={"runs": runs, "jobs": 1})


@pytest.mark.slow
def test_diagnoses_are_the_same_however_many_are_made_at_once() -> None:
    study = Study(["pendulum"], ["pymunk"], options={"timestep": 2e-2}, until=1.0, isolate=False)
    here, at_once = (
        compare_study(each).results for each in (study, replace(study, isolate=True, jobs=2))
    )
    assert _without_times(at_once) == _without_times(here)
    assert any(run.diagnosis and run.diagnosis.causes for run in here.runs)


@pytest.mark.slow
@pytest.mark.usefixtures("third_party")
def test_an_engine_that_never_ends_is_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    """The limit is the run's alone.

    On a busy machine the reference and the model check may take as long.
    """
    call = Worker.call

    def patient(worker: Worker, function: Any, runner: Any, given: Any) -> Any:
        limit = worker.timeout
        worker.timeout = limit if function is simulate_warm else 600.0
        try:
            return call(worker, function, runner, given)
        finally:
            worker.timeout = limit

    monkeypatch.setattr(Worker, "call", patient)
    comparison = _compare(engines=["sleeper"], isolate=True, timeout=1.0)
    (failed,) = comparison.results.runs
    assert failed.outcome is Outcome.TIMED_OUT and failed.time_limit == 1.0
    assert not comparison.passed
    assert failed.message == "sleeper did not finish within 1 s and was stopped."


def test_a_time_limit_in_the_words_of_an_earlier_release_is_read() -> None:
    fields: dict[str, Any] = {"model": "fixed", "engine": "e", "preset": "p", "engine_version": "1"}
    words = "e did not finish within 120 s and was stopped."
    old = Run.model_validate({**fields, "outcome": "failed", "message": words})
    assert (old.outcome, old.time_limit, old.message) == (Outcome.TIMED_OUT, 120.0, words)
    assert Run.model_validate(old.model_dump()) == old
    crashed = Run.model_validate({**fields, "outcome": "failed", "message": "e crashed."})
    assert crashed.outcome is Outcome.FAILED and crashed.time_limit is None


def test_an_engine_that_is_not_installed_is_said_and_no_disagreement(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from trebucheck.engines.registry import engine_class

    monkeypatch.setattr(engine_class("mujoco"), "is_installed", classmethod(lambda cls: False))
    comparison = _compare(engines=["mujoco", "reference"])
    absent = comparison.results.runs[0]
    assert absent.outcome is Outcome.ABSENT
    assert absent.message is not None and "pip install mujoco" in absent.message
    assert comparison.passed


def test_one_own_mechanism_and_no_launch() -> None:
    """A pendulum: no projectile, no stops, nothing that launches.

    The report is made all the same.
    """
    pendulum = tb.Mechanism(
        name="pendulum",
        bodies=(tb.Body(name="bob", angle="beta", mass=3.0, centre=(2.0, 0), inertia=1.0),),
        joints=(
            tb.PinJoint(
                name="pivot", parent="ground", child="bob", parent_point=(0, 0), child_point=(0, 0)
            ),
        ),
        gravity=9.81,
        start=(0.0,),
    )
    comparison = _compare(models=[pendulum], duration=1.0)
    assert comparison.passed
    assert comparison.results.machines[0].compared_to == 1.0
    assert "does not launch" in page(document(comparison))


def test_wrong_names_cost_no_waiting() -> None:
    with pytest.raises(tb.InputError, match="no engine 'foo'"):
        _compare(engines=["reference", "foo"])
    with pytest.raises(tb.InputError, match="no model 'floating'"):
        _compare(models=["floating"])
    with pytest.raises(tb.InputError, match="stop_law = 'x'"):
        _compare(stop_law="x")
    with pytest.raises(tb.InputError, match="duration = 0"):
        _compare(duration=0.0)


def test_progress_is_told() -> None:
    told: list[tuple[RunKey, int, int]] = []
    _compare(presets=["assisted", "default"], progress=lambda *row: told.append(row))
    assert [(case.label, done, of) for case, done, of in told] == [
        ("reference assisted", 0, 2),
        ("reference default", 1, 2),
    ]


@pytest.mark.slow
def test_an_interrupted_comparison_goes_on(tmp_path: Path) -> None:
    class Stopped(Exception):
        pass

    def stop_at_second(case: RunKey, done: int, of: int) -> None:
        if done == 1:
            raise Stopped

    with pytest.raises(Stopped):
        _compare(presets=["assisted", "default"], store=Store(tmp_path), progress=stop_at_second)
    kept = tmp_path / "fixed-reference-assisted.nc"
    before = kept.stat().st_mtime_ns
    comparison = _compare(presets=["assisted", "default"], store=Store(tmp_path, resume=True))
    assert len(comparison.results.runs) == 2
    assert kept.stat().st_mtime_ns == before
    _compare(store=Store(tmp_path, resume=True), timestep=2e-3)  # another setting: made anew
    assert kept.stat().st_mtime_ns != before


def test_a_broken_kept_file_is_made_anew(tmp_path: Path) -> None:
    (tmp_path / "fixed-reference-assisted.nc").write_bytes(b"not NetCDF")
    assert _compare(store=Store(tmp_path, resume=True)).passed
    assert load(tmp_path / "fixed-reference-assisted.nc").mechanism == tb.fixed()


def test_runs_of_another_version_of_the_engine_are_made_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from trebucheck.engines.registry import engine_class

    _compare(store=Store(tmp_path))
    kept = tmp_path / "fixed-reference-assisted.nc"
    before = kept.stat().st_mtime_ns
    monkeypatch.setattr(engine_class("reference"), "version", classmethod(lambda cls: "another"))
    comparison = _compare(store=Store(tmp_path, resume=True))
    assert kept.stat().st_mtime_ns != before
    assert (
        comparison.trajectories["fixed", "reference assisted"].provenance.engine_version
        == "another"
    )


def test_a_finished_comparison_is_not_measured_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from trebucheck.comparisons.runs import runner

    store = Store(tmp_path / "trajectories", records=tmp_path / "runs")
    presets = ["assisted", "default"]
    first = _compare(presets=presets, store=store)
    assert not first.repeated
    monkeypatch.setattr(runner, "measure", None)
    again = _compare(presets=presets, store=replace(store, resume=True))
    assert again.repeated and again.results == first.results
    key = "fixed", "reference default"
    assert np.array_equal(again.trajectories[key].q, first.trajectories[key].q)
    assert again.solutions["fixed"].release_times == first.solutions["fixed"].release_times


@pytest.mark.slow
@pytest.mark.parametrize("name", ["runs/fixed.json", "runs/fixed-reference-assisted.json"])
@pytest.mark.parametrize("content", ["not JSON", '{"conditions": "of another"}', None])
def test_a_broken_or_foreign_record_is_made_anew(
    name: str, content: str | None, tmp_path: Path
) -> None:
    store = Store(tmp_path / "trajectories", records=tmp_path / "runs")
    first = _compare(store=store)
    path = tmp_path / name
    path.unlink() if content is None else path.write_text(content)
    again = _compare(store=replace(store, resume=True))
    assert not again.repeated and again.results == first.results
    assert _compare(store=replace(store, resume=True)).repeated


@pytest.mark.slow
def test_a_record_is_of_one_trajectory_and_of_one_end(tmp_path: Path) -> None:
    store = Store(tmp_path / "trajectories", records=tmp_path / "runs")
    _compare(store=store)
    resumed = replace(store, resume=True)
    (tmp_path / "trajectories" / "fixed-reference-assisted.nc").write_bytes(b"not NetCDF")
    assert not _compare(store=resumed).repeated
    assert _compare(store=resumed).repeated
    assert not _compare(store=resumed, duration=1.0).repeated
    assert not _compare(store=resumed, duration=1.0, stop_law="unilateral").repeated


# files


def test_a_trajectory_survives_its_file(tmp_path: Path) -> None:
    before = _reference()
    save(before, tmp_path / "a.nc")
    after = load(tmp_path / "a.nc")
    for name in ("t", "q", "u", "kinetic_energy", "potential_energy"):
        assert np.array_equal(getattr(before, name), getattr(after, name))
    assert after.mechanism == before.mechanism
    assert after.release_times == before.release_times
    assert after.provenance == before.provenance
    assert np.array_equal(after.stop_torque("hanger rest"), before.stop_torque("hanger rest"))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.nc"]


def test_datasets_carry_units() -> None:
    dataset = _reference().to_dataset()
    assert {
        name: dataset[name].attrs["units"]
        for name in ("time", "position", "stop_torque", "joint_reaction")
    } == {
        "time": "s",
        "position": "m",
        "stop_torque": "N m",
        "joint_reaction": "N",
    }
    assert dataset["q"].sel(coordinate="phi").values[0] == pytest.approx(np.pi)


@pytest.mark.skipif(sys.platform == "win32", reason="/dev/null is a Unix file")
def test_an_unwritable_place_is_said_and_nothing_is_left(tmp_path: Path) -> None:
    for path in ("/dev/null/a.nc", tmp_path):
        with pytest.raises(tb.InputError, match="cannot be written"):
            save(_reference(), path)
    assert not list(tmp_path.iterdir())


def test_a_file_that_is_no_trajectory_is_said(tmp_path: Path) -> None:
    (tmp_path / "x.nc").write_text("no")
    for path in (tmp_path / "x.nc", tmp_path / "absent.nc"):
        with pytest.raises(tb.InputError, match=r"\.nc"):
            load(path)


# studies


@pytest.mark.parametrize(
    ("inputs", "complaint"),
    [
        ({"models": []}, "no model was named"),
        ({"engines": ["mujoko"]}, "did you mean 'mujoco'"),
        ({"timeout": 0.0}, "timeout = 0.0 s must be positive"),
        ({"jobs": 0}, "jobs = 0 must be between 1 and"),
        ({"jobs": 2, "isolate": False}, "jobs = 2 needs isolated runs"),
        ({"timeout": float("nan")}, "timeout = nan s must be positive"),
    ],
)
def test_a_study_is_checked_before_anything_runs(inputs: dict[str, Any], complaint: str) -> None:
    with pytest.raises(tb.InputError, match=complaint):
        Study(**inputs)


def test_no_names_stand_for_every_engine_and_the_reference_is_not_measured() -> None:
    assert Study().every_engine == tuple(tb.engines())
    assert Study().measured_engines == tuple(name for name in tb.engines() if name != "reference")
    assert Study(engines=["pymunk", "mujoco", "pymunk"]).measured_engines == ("pymunk", "mujoco")
    with pytest.raises(tb.InputError, match="'reference' is what the others are measured against"):
        _ = Study(engines=["reference"]).measured_engines


def test_a_studys_mechanisms_have_one_name_each() -> None:
    own = tb.TrebuchetParameters(l1=9.5)
    assert Study(["fixed", "rolling", "fixed"], parameters=own).mechanisms == (
        tb.fixed(own),
        tb.rolling(own),
    )
    # Another one with a name that is there gets a number; the same one again is none.
    both = Study(["fixed", tb.fixed(own), tb.fixed(), tb.fixed(own)]).mechanisms
    assert [each.name for each in both] == ["fixed", "fixed 2"]
    assert both == (tb.fixed(), tb.fixed(own).model_copy(update={"name": "fixed 2"}))


def test_the_reference_is_evaluated_once_a_grid_for_metrics_and_pairs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    evaluated: list[tuple[Solution, bytes]] = []
    evaluate = Solution.trajectory

    def counted(self: Solution, t: FloatArray, *rest: Any) -> tb.Trajectory:
        evaluated.append((self, t.tobytes()))
        return evaluate(self, t, *rest)

    monkeypatch.setattr(Solution, "trajectory", counted)
    monkeypatch.setattr(ReferenceEngine, "default_options", {"timestep": 2e-3})
    comparison = _compare(presets=["assisted", "default"])
    assert len(comparison.results.pairs) == 1
    # The reference as an engine has solutions of its own.
    grids = [grid for solution, grid in evaluated if solution is comparison.solutions["fixed"]]
    assert grids and len(grids) == len(set(grids))


def test_a_comparison_without_engines_is_the_reference_alone() -> None:
    found = tb.compare(["fixed"], [])
    assert not found.results.runs and not found.passed  # nothing was judged
    assert found.solutions["fixed"].launch is not None


@pytest.mark.parametrize(("cores", "load", "idle"), [(8, 0.0, 8), (8, 2.4, 6), (2, 7.0, 1)])
def test_as_many_processes_as_cores_are_idle(
    cores: int, load: float, idle: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(cores)), raising=False)
    monkeypatch.setattr(os, "getloadavg", lambda: (load, 0.0, 0.0), raising=False)
    study = Study(["fixed"], ["reference"])
    assert study.at_once == 1 and study.on_idle_cores().at_once == idle
    assert replace(study, jobs=3).on_idle_cores().at_once == 3
    assert replace(study, isolate=False).on_idle_cores().at_once == 1
