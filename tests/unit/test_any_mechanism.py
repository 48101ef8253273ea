"""Mechanisms that are no trebuchets go through every command.

Any markers or none, no launch, stops or gravity.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import plugin_engines
import pytest
import trebucheck as tb
from mechanisms import chain, four_bar, hanging_bob
from trebucheck.__main__ import main
from trebucheck.comparisons import converge as converging
from trebucheck.comparisons.recommend import Accuracy, recommend_study
from trebucheck.comparisons.report.html import page
from trebucheck.comparisons.report.pages.converge import document
from trebucheck.comparisons.runs.process import Worker
from trebucheck.comparisons.runs.record import EngineRuns, RunRecord
from trebucheck.comparisons.runs.results import Results
from trebucheck.comparisons.runs.runner import Runner
from trebucheck.comparisons.runs.study import Study, Until
from trebucheck.models.errors import InputError
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.mechanism import Marker

pytestmark = pytest.mark.slow

TIP = (Marker(name="tip", body="bob", point=(2.0, 0)),)
MACHINES: dict[str, tb.Mechanism] = {
    "tip": hanging_bob(markers=TIP),
    "no marker": hanging_bob(markers=()),
    "four-bar": four_bar(),
    "no gravity": chain(gravity=0.0),
}
UNTIL = {"no gravity": ["--until", "2"], "four-bar": ["--until", "0.5"]}
STEPS = (1e-2, 5e-3, 2.5e-3, 1.25e-3)
Command = Callable[..., dict[str, Any]]


@pytest.fixture(autouse=True)
def third_party(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Engines announced by entry points; runs in this process, at few steps."""
    folder = tmp_path_factory.mktemp("site")
    plugin_engines.announce(folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        patch.setattr(Study, "worker", lambda _: Worker(isolate=False))
        patch.setattr(converging, "_STEPS", STEPS)
        patch.setattr(converging, "_LONGER_STEPS", STEPS[:1])
        yield


@pytest.fixture(params=MACHINES)
def command(request: pytest.FixtureRequest, tmp_path: Path) -> Command:
    """Runs a command on the machine's file with two engines; its result file as data."""
    machine = MACHINES[request.param]
    (tmp_path / "machine.json").write_text(machine.to_json())

    def run(name: str, *arguments: str) -> dict[str, Any]:
        words = [
            name,
            "--model",
            str(tmp_path / "machine.json"),
            "--engines",
            "echo,second",
            *arguments,
        ]
        assert main([*words, *UNTIL.get(request.param, []), "--out", str(tmp_path / name)]) == 0
        return json.loads((tmp_path / name / f"{name}.json").read_text())

    return run


def test_two_engines_are_compared(tmp_path: Path) -> None:
    """This ended in a traceback for a marker of another name."""
    (tmp_path / "machine.json").write_text(MACHINES["tip"].to_json())
    words = [
        "compare",
        "--model",
        str(tmp_path / "machine.json"),
        "--engines",
        "echo,second",
        "--preset",
        "assisted",
    ]
    assert main([*words, "--until", "1", "--out", str(tmp_path / "out")]) in (0, 1)
    results = Results.from_json((tmp_path / "out" / "results.json").read_bytes())
    echo, second = (run.metric("position_max", "tip") for run in results.runs)
    # The echo is solved to another end, and so its last step before that is another one: 3e-14 a
    # step.
    assert echo is not None and echo.value <= 1e-12 and second is not None and second.value
    assert [pair.position_max for pair in results.pairs] == [pytest.approx(second.value)]


def test_orders_are_found_of_what_there_is(command: Command) -> None:
    found = command("converge", "--knobs", "timestep")["machines"][0]
    assert found["launch_time"] is None and 0 < found["judged_to"] <= found["compared_to"]
    laws = {f"{study['engine']} {study['preset']}": study["curves"] for study in found["studies"]}
    assert all([curve["quantity"] for curve in curves] == ["position"] for curves in laws.values())
    # Steps are fitted to the end, and so exact powers of two apart to some 1e-3 at most.
    assert laws["second assisted"][0]["law"]["exponent"] == pytest.approx(2.0, abs=0.01)
    assert set(found["uncertainty"]) == {"position"} and 0 < found["uncertainty"]["position"] < 1e-8


def test_budgets_are_of_what_there_is(command: Command) -> None:
    found = command("explain")
    assert found["machines"][0]["launch_time"] is None
    budgets = {f"{budget['engine']} {budget['preset']}": budget for budget in found["budgets"]}
    second = budgets["second assisted"]
    assert second["message"] is None and [
        quantity["name"] for quantity in second["quantities"]
    ] == [
        "position",
        "energy",
    ]
    assert second["quantities"][0]["largest"] > 1e-8
    assert all(
        each["second"]["torque"] is None and each["second"]["release"] is None
        for each in found["comparisons"]
    )


def test_advice_is_on_positions(command: Command) -> None:
    found = command("recommend", "--position", "1e-4", "--neighbours", "1")
    second = next(advice for advice in found["engines"] if advice["engine"] == "second")
    here = second["choice"]["here"]
    assert 1e-12 < here["position"] <= 1e-4
    assert here["torque"] is None and here["release"] is None and here["torque_share"] is None
    assert len(found["neighbours"]) == 1 and found["launch_time"] is None


@pytest.mark.parametrize("name", MACHINES)
def test_what_is_compared_is_the_farthest_point(name: str) -> None:
    """Markers, also two of them; without any, centres of mass, here computed apart."""
    machine = MACHINES[name]
    trials = EngineRuns(Runner(machine, until=Until.of(1.5)))
    engine = plugin_engines.Second(timestep=0.01)
    trial = trials.record(engine)
    run = engine.simulate(trials.runner.problem(engine))
    exact, keep = trials.solution.trajectory(run.t), run.t <= trials.end
    if machine.markers:
        errors = {m: run.marker(m).position - exact.marker(m).position for m in run.markers}
    else:
        kinematics = Kinematics(machine)
        centres = {body.name: kinematics.point(body.name, body.centre) for body in machine.bodies}
        errors = {
            b: kinematics.position(c, run.q) - kinematics.position(c, exact.q)
            for b, c in centres.items()
        }
    expected = {point: np.linalg.norm(error[keep], axis=1).max() for point, error in errors.items()}
    assert trial.position == pytest.approx(max(expected.values()), rel=1e-12)
    assert trial.curves is not None and set(trial.curves.positions) == set(expected)
    assert expected[trial.curves.farthest] == max(expected.values())
    on_grid = np.linalg.norm(trial.curves.positions[trial.curves.farthest], axis=0).max()
    assert on_grid == pytest.approx(
        max(expected.values()), rel=1e-3
    )  # the grid has the end, where it is largest


def test_without_markers_the_uncertainty_is_that_of_the_centre_at_most_some_times() -> None:
    """The bound by coordinates holds what a marker says, and is no more than rounding's and
    safety's factor above.
    """
    marked, bare = (
        EngineRuns(Runner(MACHINES[name])).uncertainty("position_max")
        for name in ("tip", "no marker")
    )
    assert marked is not None and bare is not None
    assert 0.5 * marked <= bare <= 10 * marked


def test_without_gravity_an_end_is_asked_for(tmp_path: Path, refused: Callable[..., str]) -> None:
    path = tmp_path / "machine.json"
    path.write_text(MACHINES["no gravity"].to_json())
    for words in (
        ["converge"],
        ["explain"],
        ["recommend", "--position", "1"],
        ["run", "--engine", "echo"],
    ):
        assert "has no gravity" in refused(*words, "--model", str(path), "--out", "out")


def test_a_motion_is_compared_up_to_its_predictability_horizon(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    wild = chain(start=(-2.5, -2.0), start_speeds=())
    monkeypatch.setattr(converging, "_STEPS", STEPS[:1])
    studies = converging.converge_study(
        Study([wild], ["second"], until=3.0, isolate=False), ["timestep"]
    )
    found = studies.machines[0]
    assert found.compared_to == 3.0 and found.judged_to is not None and 1.0 < found.judged_to < 2.9
    assert f"Nothing is compared beyond {found.judged_to:.6g} s" in page(document(studies))
    trial = EngineRuns(Runner(wild, until=Until.of(3.0))).record(
        plugin_engines.Second(timestep=0.05)
    )
    assert trial.curves is not None and trial.curves.end == found.judged_to


def test_what_the_reference_does_not_do_cannot_be_asked() -> None:
    quick = Study([tb.fixed()], ["second"], until=0.1, isolate=False)
    with pytest.raises(InputError, match="no stop of 'fixed' releases within the compared"):
        recommend_study(quick, Accuracy(release=1e-6), 0)
    with pytest.raises(InputError, match="has no stop that is closed at the start"):
        recommend_study(
            Study([MACHINES["tip"]], ["second"], isolate=False), Accuracy(torque=1.0), 0
        )


@pytest.mark.parametrize("until", ["release:hanger rest", "launch", "0.5"])
def test_the_end_is_that_of_the_study(until: str) -> None:
    expected = Runner(tb.fixed(), until=Until.of(until)).end
    found = converging.converge_study(
        Study([tb.fixed()], ["second"], until=until, isolate=False), ["timestep"]
    ).machines[0]
    assert found.compared_to == expected
    assert (found.launch_time is None) == (until in ("release:hanger rest", "0.5"))


def test_steps_follow_the_size(tmp_path: Path) -> None:
    """A machine of a hundredth of the size takes a tenth of the time.

    Its steps do, to the next power of two.
    """
    small = hanging_bob(markers=(Marker(name="tip", body="bob", point=(0.02, 0)),), length=0.02)
    finest: list[float] = []
    for machine in (MACHINES["tip"], small):
        found = converging.converge_study(
            Study([machine], ["second"], isolate=False), ["timestep"]
        ).machines[0]
        finest.append(min(point.value for study in found.studies for point in study.points))
    assert 10 / 2**0.5 / 1.03 <= finest[0] / finest[1] <= 10 * 2**0.5 * 1.03


def test_trials_to_another_end_are_other_trials(tmp_path: Path) -> None:
    from trebucheck.comparisons.runs.store import Store

    def trial(until: str) -> RunRecord:
        store = Store(tmp_path, resume=True, records=tmp_path)
        return EngineRuns(Runner(MACHINES["tip"], until=Until.of(until)), store).record(
            plugin_engines.Second(timestep=0.01)
        )

    first, second = trial("0.5"), trial("1.0")
    assert (
        first.position is not None
        and second.position is not None
        and first.position < second.position
    )
    assert trial("0.5") == first


def test_whole_steps_beyond_the_end_are_within_the_reference() -> None:
    """The motion that goes on behind a short end is shorter than an engine's usual time behind
    one."""
    runner = Runner(tb.fixed(), until=Until.of(1e-2))
    engine = tb.engine("reference", timestep=3e-4)
    asked, longest = runner.problem(engine).duration, runner.solution.problem.duration
    assert runner.end < asked < longest
    assert math.ceil(asked / engine.timestep) * engine.timestep <= longest


def test_steps_follow_a_short_end() -> None:
    """Ten milliseconds, or a tenth of one, have as many steps as a whole throw."""
    for until in (1e-2, 1e-4):
        study = Study([tb.fixed()], ["second"], ["assisted"], until=until, isolate=False)
        found = converging.converge_study(study, ["timestep"]).machines[0].studies[0]
        assert all(point.message is None for point in found.points)
        usual = found.points[
            -len(converging._STEPS)
        ]  # coarser ones are added where errors are tiny
        assert until / 200 < usual.value < until / 50
        assert found.points[0].value < until / 3
