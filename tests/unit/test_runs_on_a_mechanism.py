"""What studies know of the runs on one mechanism: units of steps, the reference's uncertainty, and
how often a run is timed.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import plugin_engines
import pytest
import trebucheck as tb
from mechanisms import chain_on_a_slot, hanging_bob, rod_pendulum
from trebucheck.comparisons.diagnosis.case import Case
from trebucheck.comparisons.runs.process import Worker
from trebucheck.comparisons.runs.record import EngineRuns
from trebucheck.comparisons.runs.runner import Runner
from trebucheck.comparisons.runs.study import Until
from trebucheck.models.errors import InputError
from trebucheck.models.problem import StopLaw
from trebucheck.reference.certification.certificate import Uncertainties
from trebucheck.reference.solver import solve

KNOWN = {
    "angle_max": 3e-9,
    "angle_max (a)": 2e-9,
    "slide_max": 5e-8,
    "position_max": 7e-7,
    "position_max (tip)": 4e-7,
    "position_max (peg)": 6e-7,
    "velocity_max (tip)": 1e-5,
}


def _runs(mechanism: tb.Mechanism, end: float = 0.4) -> EngineRuns:
    return EngineRuns(Runner(mechanism, until=Until.of(end)))


def _known(runs: EngineRuns, monkeypatch: pytest.MonkeyPatch, **values: float) -> None:
    known = Uncertainties(source="estimate", values={**KNOWN, **values})
    monkeypatch.setitem(runs.runner.__dict__, "uncertainties", known)


def test_the_uncertainty_of_a_metric_is_that_of_its_worst_subject(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    runs = _runs(chain_on_a_slot())
    _known(runs, monkeypatch)
    assert runs.uncertainty("position_max") == 7e-7
    assert runs.uncertainty("velocity_max") == 1e-5
    assert runs.uncertainty("energy_balance") is None


@pytest.mark.parametrize(("mechanism", "slides"), [(chain_on_a_slot(), 1), (rod_pendulum(), 0)])
def test_without_markers_it_follows_from_angles_and_slides(
    mechanism: tb.Mechanism, slides: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A centre is at the end of a chain as long as the mechanism, pushed by each slide."""
    runs = _runs(mechanism.model_copy(update={"markers": ()}))
    _known(runs, monkeypatch)
    expected = runs.runner.scales.length * 3e-9 + slides * 5e-8
    assert runs.uncertainty("position_max") == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("end", "gravity", "speed", "expected"),
    [
        (40.0, 9.81, 0.0, math.sqrt(2.0 / 9.81)),  # the pendulum's own
        (0.05, 9.81, 0.0, 0.05),  # the end is earlier
        (40.0, 0.0, 0.5, 2.0),  # without gravity: length over speed, 2 m at 1 m/s
    ],
)
def test_steps_are_parts_of_the_characteristic_time_or_of_the_end(
    end: float, gravity: float, speed: float, expected: float
) -> None:
    runs = _runs(hanging_bob(gravity=gravity, start_speeds=(speed,), start=0.1), end)
    assert runs.time_scale == pytest.approx(expected, rel=1e-9)


def test_a_run_is_timed_as_often_as_is_asked_and_kept() -> None:
    runs, engine = _runs(hanging_bob()), tb.engine("reference", timestep=0.02)
    assert len(runs.record(engine, repeats=3).wall_times) == 3
    first = runs.record(engine)
    assert len(first.wall_times) == 3 and first is runs.record(engine, repeats=2)
    assert len(runs.record(engine, repeats=4).wall_times) == 4
    assert runs.record(tb.engine("reference", timestep=0.01)) is not first


class _TooLong(plugin_engines.Echo):
    """Adds one sample at a time of its own."""

    last = 1.0

    def simulate(self, problem: tb.Problem) -> tb.Trajectory:
        solution = solve(tb.Problem(problem.mechanism, duration=3.0))
        return solution.trajectory(np.array([0.0, 0.2, 0.3, self.last]))


@pytest.mark.parametrize(("past", "valid"), [(0.0, True), (1e-6, False), (1.0, False)])
def test_a_single_sample_beyond_the_longest_run_makes_it_invalid(past: float, valid: bool) -> None:
    runner = Runner(hanging_bob(), until=Until.of(0.4), worker=Worker(isolate=False))
    engine = _TooLong(timestep=0.1)
    object.__setattr__(engine, "last", runner.solution.problem.duration + past)
    if valid:
        assert runner.simulate(engine).t[-1] == runner.solution.problem.duration
    else:
        with pytest.raises(tb.SimulationError, match="it goes on to"):
            runner.simulate(engine)


def test_without_an_end_a_motion_that_throws_nothing_is_compared_all_the_same() -> None:
    """Only who asks for the launch needs one."""
    assert Runner(hanging_bob()).end > 0.0
    with pytest.raises(InputError):
        assert Runner(hanging_bob(), until=Until()).end


def test_runs_at_other_times_and_shorter_ones_are_carried_over() -> None:
    """A signature at other times is that at the case's own, as far as the other motion goes."""
    mechanism = chain_on_a_slot()
    solution = solve(tb.Problem(mechanism, duration=0.6))
    t = np.linspace(0.0, 0.6, 61)
    heavy = mechanism.model_copy(update={"gravity": 1.03 * mechanism.gravity})
    moved = solve(tb.Problem(heavy, duration=0.6))

    def trajectory(times: Any) -> tb.Trajectory:
        return replace(moved.trajectory(np.asarray(times)), mechanism=mechanism)

    case = Case(trajectory(t), solution, 0.6, frozenset({"position_max"}), None)
    here = case.signature(trajectory(case.t))
    for times in (np.linspace(0.0, 0.6, 1201), np.linspace(0.0, 0.5, 1001), case.t):
        carried = case.carried(trajectory(times))
        reached = np.repeat(case.t <= times[-1], len(here) // len(case.t))
        assert carried.shape == here.shape
        assert np.abs(carried - here)[reached].max() < 1e-3 * np.abs(here).max()


def test_unilateral_stops_and_others_are_moved_by_the_law_that_is_asked_for() -> None:
    runs = [Runner(hanging_bob(), until=Until.of(0.1), law=law) for law in StopLaw]
    assert [runner.problem(tb.engine("reference")).stop_law for runner in runs] == list(StopLaw)


def test_a_limit_of_time_is_the_one_that_is_asked_for_or_the_longest_there_is() -> None:
    assert Worker(5.0, isolate=False).timeout == 5.0
    assert 1e6 < Worker(math.inf, isolate=False).timeout < 2**31 / 1000  # in ms, 32 bits
