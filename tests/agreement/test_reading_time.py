"""Tests that each engine's adapter tells its reading apart, and that it is a part of the run."""

import pytest
import trebucheck as tb
from trebucheck.comparisons.matrix import distilled, sweeps_of

ENGINES = ("mujoco", "pymunk", "exudyn")


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("preset", ["default", "settings", "assisted"])
def test_reading_is_a_part_of_the_run(engine: str, preset: str) -> None:
    problem = tb.Problem(tb.fixed(), duration=1.0)
    origin = tb.engine(engine, preset, timestep=5e-3).simulate(problem).provenance
    assert origin.processor_time is not None and origin.reading_time is not None
    assert 0.0 < origin.reading_time < origin.processor_time


def test_a_sweep_has_the_step_of_the_run_and_longer_ones_with_larger_errors() -> None:
    found = tb.compare(
        "pendulum", "pymunk", "settings", until=1.0, diagnose=False, sweep=True, isolate=False
    )
    (run,) = found.results.runs
    steps = [point.timestep for point in run.sweep]
    assert len(steps) > 1 and steps == sorted(steps, reverse=True)
    assert run.settings["timestep"] in steps
    errors = [point.errors["position_max"] for point in run.sweep]
    assert errors == sorted(errors, reverse=True)
    assert all(point.cost and point.reading_time for point in run.sweep)
    again = type(found.results).model_validate_json(found.results.to_json())
    assert again.runs[0].sweep == run.sweep
    (kept,) = distilled(again, "2026-01-02").sweeps
    assert [point.timestep for point in kept.points] == steps
    assert 1.0 > kept.points[0].part > kept.points[-1].part > 0.0


def test_each_step_of_a_convergence_study_has_its_cost_and_all_its_errors() -> None:
    studies = tb.converge(
        "pendulum", "pymunk", "default", knobs="timestep", until=0.5, isolate=False
    )
    (machine,) = studies.machines
    (study,) = machine.studies
    for point in study.points:
        assert point.work is not None and point.work.timestep == point.value
        assert len(point.work.costs) == len(point.wall_times) and point.work.steps == point.steps
        assert point.work.errors["position_max"] == point.position
        assert {"angle_max", "energy_balance"} <= set(point.work.errors) <= set(machine.units)
    (swept,) = sweeps_of(studies)
    assert [point.timestep for point in swept.points] == [p.value for p in study.points]
    again = type(studies).model_validate_json(studies.to_json())
    assert again.machines[0].studies[0].points == study.points
