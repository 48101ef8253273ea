"""What a trial remembers, how often it is timed, and how often the reference is evaluated for it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import plugins
import pytest
import trebucheck as tb
from pydantic import JsonValue
from trebucheck.comparisons.runs.store import Store
from trebucheck.comparisons.runs.trials import Trial, Trials, deviation
from trebucheck.models.arrays import FloatArray
from trebucheck.models.errors import SimulationError
from trebucheck.reference.solution import Solution

SHORT, LONG = (
    0.01,
    2.0,
)  # [s] claimed wall times, far below and above what is long enough to be timed once


@dataclass(frozen=True)
class Claims(plugins.Echo):
    """Gives the reference back, and claims to have taken so long."""

    takes: float = SHORT
    fails_after: int = 1000
    runs: list[float] = field(default_factory=list[float], compare=False)

    @property
    def settings(self) -> dict[str, JsonValue]:
        return {"timestep": self.timestep, "takes": self.takes, "fails_after": self.fails_after}

    def simulate(self, problem: tb.Problem) -> tb.Trajectory:
        found = super().simulate(problem)
        if problem.duration > 1.0:  # not the one that warms up
            self.runs.append(problem.duration)
            if len(self.runs) > self.fails_after:
                raise SimulationError("it fell over")
        return replace(found, provenance=replace(found.provenance, wall_time=self.takes))


@pytest.fixture
def trials(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Trials:
    for module in ("trials", "store"):
        monkeypatch.setattr(
            f"trebucheck.comparisons.runs.{module}.engine_class", lambda _: plugins.Echo
        )
    return Trials(tb.fixed(), store=Store(tmp_path, resume=True, records=tmp_path))


def test_further_repeats_are_added_to_what_is_known(trials: Trials) -> None:
    engine = Claims(timestep=0.01)
    once = trials.trial(engine)
    assert len(once.wall_times) == len(engine.runs) == 1
    thrice = trials.trial(engine, repeats=3)
    assert len(thrice.wall_times) == len(engine.runs) == 3
    assert thrice.deviation == once.deviation
    assert trials.trial(engine, repeats=2) is thrice and len(engine.runs) == 3
    again = Trials(trials.mechanism, store=trials._store)
    assert again.trial(engine, repeats=3) == thrice and len(engine.runs) == 3, "kept on disk, too"


def test_a_long_run_is_timed_once(trials: Trials) -> None:
    engine = Claims(timestep=0.01, takes=LONG)
    assert trials.trial(engine, repeats=3).wall_times == (LONG,)
    assert trials.trial(engine, repeats=3).wall_times == (LONG,)
    assert len(engine.runs) == 1


def test_a_repeat_that_fails_costs_a_time_and_not_the_trial(trials: Trials) -> None:
    found = trials.trial(Claims(timestep=0.01, fails_after=2), repeats=3)
    assert found.message is None and found.position == 0.0 and len(found.wall_times) == 2


def test_a_run_that_fails_is_not_repeated(trials: Trials) -> None:
    engine = Claims(timestep=0.01, fails_after=0)
    found = trials.trial(engine, repeats=3)
    assert found.message == "it fell over" and found.wall_times == () and len(engine.runs) == 1
    assert isinstance(trials.trial(engine, repeats=3), Trial) and len(engine.runs) == 1


def test_the_reference_is_evaluated_once_a_grid(
    trials: Trials, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int] = []
    evaluate = Solution.trajectory

    def counted(self: Solution, t: FloatArray, *rest: Any) -> tb.Trajectory:
        if self is trials.solution:
            asked.append(len(t))
        return evaluate(self, t, *rest)

    monkeypatch.setattr(Solution, "trajectory", counted)
    trials.trial(Claims(timestep=0.01))
    assert len(asked) == 1
    trials.trial(
        Claims(timestep=0.01, takes=LONG)
    )  # another engine to the trials, on the same grid
    assert len(asked) == 1
    trials.trial(Claims(timestep=0.02))
    assert len(asked) == 2 and asked[0] > asked[1]


def test_a_known_reference_changes_nothing() -> None:
    solution = Trials(tb.fixed()).solution
    assert solution.launch is not None
    end = solution.launch.time
    run = solution.trajectory(np.linspace(0.0, end + 0.02, 200))
    rest = run.stop_torques["sling rest"] + 1.0
    off = replace(run, q=run.q + 1e-6, stop_torques={**run.stop_torques, "sling rest": rest})
    with_it = deviation(off, solution, end, solution.trajectory(off.t))
    assert with_it == deviation(off, solution, end)
    assert with_it.metrics["stop_torque_max (sling rest)"] == pytest.approx(1.0)
