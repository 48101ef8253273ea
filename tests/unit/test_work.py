"""Tests for cost and errors of runs: what a diagram of work and precision is drawn from."""

from __future__ import annotations

import numpy as np
import pytest
from trebucheck.comparisons.report.pages import work
from trebucheck.comparisons.report.pages.work import WorkLine
from trebucheck.comparisons.runs.results import Metric, Outcome, Run, WorkPoint
from trebucheck.comparisons.runs.work import largest_errors, work_of

FAR = Metric(name="position_max", subject="far", value=-2.0, unit="m")
NEAR = Metric(name="position_max", subject="near", value=1.0, unit="m")
NEVER = Metric(name="release_time", subject="rest", value=None, unit="s", note="not released")
UNSEEN = Metric(name="joint_gap_max", subject="pin", value=None, unit="m", observed=False)
FOLLOWING = Metric(name="position_rms", subject="far", value=1.5, unit="m")


def _point(step: float, cost: float | None, reading: float | None = 0.0) -> WorkPoint:
    costs = () if cost is None else (cost, 2 * cost, 4 * cost)
    errors = {"position_max": step, "energy_balance": 0.0}
    steps = round(1 / step)
    return WorkPoint(timestep=step, steps=steps, costs=costs, reading_time=reading, errors=errors)


def test_the_largest_error_of_each_quantity_is_kept_where_all_of_it_is_known() -> None:
    assert largest_errors([NEAR, FAR, UNSEEN, FOLLOWING]) == {"position_max": 2.0}
    assert largest_errors([FAR, NEVER]) == {"position_max": 2.0}


def _run(**fields: object) -> Run:
    return Run.model_validate({
        "model": "m", "engine": "pymunk", "preset": "settings", "outcome": Outcome.DISAGREES,
        "engine_version": "1", "settings": {"timestep": 0.1}, "steps": 10, "metrics": (FAR,),
        **fields,
    })  # fmt: skip


def test_a_run_is_a_point_at_its_own_step_without_its_reading() -> None:
    (point,) = work_of(_run(processor_time=3.0, reading_time=1.0))
    assert (point.timestep, point.steps, point.cost, point.reading_time) == (0.1, 10, 2.0, 1.0)
    assert point.errors == {"position_max": 2.0}
    (point,) = work_of(_run(processor_time=3.0))
    assert (point.cost, point.reading_time) == (3.0, None)
    (point,) = work_of(_run())
    assert point.cost is None


def test_a_sweep_stands_for_its_run_and_a_failed_run_for_nothing() -> None:
    sweep = (_point(0.2, 1.0), _point(0.1, 2.0))
    assert work_of(_run(sweep=sweep)) == sweep
    assert work_of(_run(outcome=Outcome.FAILED)) == ()


def test_each_quantity_with_an_error_is_drawn_against_cost_and_against_steps() -> None:
    line = WorkLine("pymunk", "settings", "7", (_point(0.1, 1e-3), _point(0.01, 1e-2)))
    unmeasured = WorkLine("mujoco", "default", "3", (_point(0.1, None),))
    by_cost, by_steps = work.panels([line, unmeasured], {"position_max": "m"})
    assert by_cost.choice == by_steps.choice == "position"
    assert all(axis.logarithmic for plot in (by_cost, by_steps) for axis in (plot.x, plot.y))
    assert [series.name for series in by_cost.series] == ["pymunk settings"]
    assert [series.name for series in by_steps.series] == ["pymunk settings", "mujoco default"]
    (drawn,) = by_cost.series
    np.testing.assert_allclose(drawn.x, [2e-3, 2e-2])  # medians
    assert drawn.spread is not None
    np.testing.assert_allclose(drawn.spread, [[1e-3, 1e-2], [4e-3, 4e-2]])
    np.testing.assert_allclose(by_steps.series[0].x, [10, 100])
    np.testing.assert_allclose(by_steps.series[0].y, [0.1, 0.01])


@pytest.mark.parametrize("reading", [None, 1e-3])
def test_an_engine_whose_reading_is_not_told_apart_is_named(reading: float | None) -> None:
    line = WorkLine("drake", "default", "1.2.3", (_point(0.1, 1e-3, reading),))
    text = work.caption([line], "trebucheck 1 on a machine")
    assert ("drake default" in text) == (reading is None)
    assert "trebucheck 1 on a machine" in text and "1.2.3" in text
