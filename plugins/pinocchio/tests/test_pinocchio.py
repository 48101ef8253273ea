"""Pinocchio against the reference, and its measured orders."""

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.models.problems.registry import benchmark
from trebucheck.reference.solver import solve

FREE_SWING = tb.fixed().model_copy(update={"stops": ()})


def _error(problem: tb.Problem, preset: str, step: float) -> float:
    """Greatest distance of a marker from where it should be [m]."""
    found = tb.engine("pinocchio", preset, timestep=step).simulate(problem)
    truth = solve(problem).trajectory(found.t)
    return max(float(np.abs(m.position - truth.markers[name].position).max()) for name, m in found.markers.items())


@pytest.mark.parametrize(("preset", "order", "step"), [("tuned", 4.0, 8e-3), ("stock", 1.0, 2e-3)])
def test_the_order_is_that_of_the_scheme(preset: str, order: float, step: float) -> None:
    problem = tb.Problem(FREE_SWING, duration=2.0)
    coarse, fine = _error(problem, preset, step), _error(problem, preset, step / 2)
    assert np.log2(coarse / fine) == pytest.approx(order, abs=0.3)
    claimed = tb.engine("pinocchio", preset).study().step_orders[preset]  # type: ignore[attr-defined]
    assert claimed.order == order


def test_the_free_swing_is_within_its_bar() -> None:
    assert _error(tb.Problem(FREE_SWING, duration=2.0), "tuned", 1e-3) < 1e-8


@pytest.mark.parametrize("model", ["fixed", "rolling"])
def test_it_agrees_with_stops(model: str) -> None:
    results = tb.compare([model], ["pinocchio"], ["tuned"], isolate=False).results
    (run,) = results.runs
    assert run.equality is not None
    judged = [metric for metric in run.metrics if metric.tolerance is not None]
    assert {"position_max", "release_time", "stop_torque_max"} <= {m.name for m in judged if m.source == "claim"}
    assert all(metric.holds for metric in judged), [m for m in judged if not m.holds]


def test_branches_are_added_depth_first() -> None:
    """With the bodies in the mechanism's order Pinocchio's mass matrix of two branches is wrong."""
    assert _error(benchmark("n-four-bar").problem().model_copy(update={"duration": 1.0}), "tuned", 2e-3) < 1e-8
