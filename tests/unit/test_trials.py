"""What a trial remembers, how often it is timed, and how often the reference is evaluated for
it."""

from __future__ import annotations

import pickle
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import plugin_engines
import pytest
import trebucheck as tb
from pydantic import JsonValue
from trebucheck.comparisons.runs.metrics import against, measure
from trebucheck.comparisons.runs.process import ProcessError, TimeLimitError
from trebucheck.comparisons.runs.record import EngineRuns, RunRecord, curves_of
from trebucheck.comparisons.runs.results import Metric, Outcome
from trebucheck.comparisons.runs.runner import Runner
from trebucheck.comparisons.runs.store import Store
from trebucheck.models.arrays import FloatArray
from trebucheck.models.errors import SimulationError
from trebucheck.reference.solution import Solution

SHORT, LONG = (
    0.01,
    2.0,
)  # [s] claimed wall times, far below and above what is long enough to be timed once


@dataclass(frozen=True)
class Claims(plugin_engines.Echo):
    """Gives the reference back, and claims to have taken so long."""

    takes: float = SHORT
    fails_after: int = 1000
    error: type[SimulationError] = SimulationError
    runs: list[float] = field(default_factory=list[float], compare=False)

    @property
    def settings(self) -> dict[str, JsonValue]:
        return {"timestep": self.timestep, "takes": self.takes, "fails_after": self.fails_after}

    def simulate(self, problem: tb.Problem) -> tb.Trajectory:
        found = super().simulate(problem)
        if problem.duration > 1.0:  # not the one that warms up
            self.runs.append(problem.duration)
            if len(self.runs) > self.fails_after:
                raise self.error("it fell over")
        return replace(found, provenance=replace(found.provenance, wall_time=self.takes))


@pytest.fixture
def trials(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> EngineRuns:
    for module in ("record", "store"):
        monkeypatch.setattr(
            f"trebucheck.comparisons.runs.{module}.engine_class", lambda _: plugin_engines.Echo
        )
    return EngineRuns(Runner(tb.fixed()), Store(tmp_path, resume=True, records=tmp_path))


def test_what_was_made_and_what_was_taken_is_counted_apart(tmp_path: Path) -> None:
    engine = tb.engine("pymunk", timestep=4e-3)
    counts: list[tuple[int, int]] = []
    for _ in range(2):
        store = Store(tmp_path, resume=True, records=tmp_path)
        EngineRuns(Runner(tb.fixed()), store).record(engine)
        counts.append((len(store.made), len(store.taken)))
    assert counts == [(1, 0), (0, 1)]


def test_further_repeats_are_added_to_what_is_known(trials: EngineRuns) -> None:
    engine = Claims(timestep=0.01)
    once = trials.record(engine)
    assert len(once.wall_times) == len(engine.runs) == 1
    thrice = trials.record(engine, repeats=3)
    assert len(thrice.wall_times) == len(engine.runs) == 3
    assert thrice.curves == once.curves
    assert trials.record(engine, repeats=2) is thrice and len(engine.runs) == 3
    again = EngineRuns(Runner(trials.mechanism), trials._store)
    assert again.record(engine, repeats=3) == thrice and len(engine.runs) == 3, "kept on disk, too"


def test_a_long_run_is_timed_once(trials: EngineRuns) -> None:
    engine = Claims(timestep=0.01, takes=LONG)
    assert trials.record(engine, repeats=3).wall_times == (LONG,)
    assert trials.record(engine, repeats=3).wall_times == (LONG,)
    assert len(engine.runs) == 1


def test_a_repeat_that_fails_costs_a_time_and_not_the_trial(trials: EngineRuns) -> None:
    found = trials.record(Claims(timestep=0.01, fails_after=2), repeats=3)
    assert found.message is None and found.position == 0.0 and len(found.wall_times) == 2


def test_a_run_that_fails_is_not_repeated(trials: EngineRuns) -> None:
    engine = Claims(timestep=0.01, fails_after=0)
    found = trials.record(engine, repeats=3)
    assert found.message == "it fell over" and found.wall_times == () and len(engine.runs) == 1
    assert isinstance(trials.record(engine, repeats=3), RunRecord) and len(engine.runs) == 1


@pytest.mark.parametrize("error", [SimulationError, ProcessError, TimeLimitError])
def test_only_what_failed_for_its_process_is_made_again(
    error: type[SimulationError], trials: EngineRuns
) -> None:
    """Where a study goes on, with the runs on disk."""
    engine = Claims(timestep=0.01, fails_after=0, error=error)
    assert trials.record(engine).process_failed is (error is not SimulationError)
    again = EngineRuns(Runner(trials.mechanism), trials._store)
    again.record(engine)
    assert len(engine.runs) == (1 if error is SimulationError else 2)


def test_the_reference_is_evaluated_once_a_grid(
    trials: EngineRuns, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int] = []
    evaluate = Solution.trajectory

    def counted(self: Solution, t: FloatArray, *rest: Any) -> tb.Trajectory:
        if self is trials.solution:
            asked.append(len(t))
        return evaluate(self, t, *rest)

    monkeypatch.setattr(Solution, "trajectory", counted)
    trials.record(Claims(timestep=0.01))
    assert len(asked) == 1
    trials.record(
        Claims(timestep=0.01, takes=LONG)
    )  # another engine to the trials, on the same grid
    assert len(asked) == 1
    trials.record(Claims(timestep=0.02))
    assert len(asked) == 2 and asked[0] > asked[1]


def test_a_known_reference_changes_nothing() -> None:
    solution = Runner(tb.fixed()).solution
    assert solution.launch is not None
    end = solution.launch.time
    run = solution.trajectory(np.linspace(0.0, end + 0.02, 200))
    rest = run.stop_torques["sling rest"] + 1.0
    off = replace(run, q=run.q + 1e-6, stop_torques={**run.stop_torques, "sling rest": rest})
    reference = solution.trajectory(off.t)
    with_it = curves_of(against(off, solution, end, reference))
    assert with_it == curves_of(against(off, solution, end))
    assert max(with_it.torques["sling rest"]) == pytest.approx(1.0)
    assert measure(off, solution, end, reference) == measure(off, solution, end)


def test_a_run_that_timed_out_is_an_outcome_with_its_limit(trials: EngineRuns) -> None:
    record = trials.record(Claims(timestep=0.01))
    assert record.ran and record.time_limit is None
    stopped = record.failed(TimeLimitError("it did not finish within 3 s and was stopped.", 3.0))
    assert (stopped.outcome, stopped.time_limit) == (Outcome.TIMED_OUT, 3.0)
    assert not stopped.ran and "3 s" in (stopped.message or "")
    crashed = record.failed(SimulationError("it crashed"))
    assert (crashed.outcome, crashed.time_limit) == (Outcome.FAILED, None)
    assert pickle.loads(pickle.dumps(TimeLimitError("x", 3.0))).limit == 3.0


def test_the_largest_value_is_of_one_metric_and_the_ones_that_are_known(
    trials: EngineRuns,
) -> None:
    record = trials.record(Claims(timestep=0.01)).model_copy(
        update={
            "metrics": (
                Metric(name="position_max", subject="a", value=1.0, unit="m"),
                Metric(name="position_max", subject="b", value=None, unit="m"),
                Metric(name="position_max", subject="c", value=3.0, unit="m"),
                Metric(name="position_max_of_another", value=9.0, unit="m"),
                Metric(name="release_time", subject="a", value=-2.0, unit="s"),
            )
        }
    )
    assert record.position == 3.0 and record.torque is None
    assert record.value("release_time", "a") == -2.0
    assert record.value("position_max", "b") is None and record.value("release_time") is None
