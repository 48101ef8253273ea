"""PyBullet against the reference, and its measured orders."""

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.reference.solver import solve

FREE_SWING = tb.fixed().model_copy(update={"stops": ()})
CONVERGED = {"solver_iterations": 500, "solver_threshold": 0.0}


def _error(problem: tb.Problem, preset: str, step: float) -> float:
    """Greatest distance of a marker from where it should be [m]."""
    found = tb.engine("pybullet", preset, timestep=step).simulate(problem)
    truth = solve(problem).trajectory(found.t)
    return max(float(np.abs(m.position - truth.markers[name].position).max()) for name, m in found.markers.items())


@pytest.mark.parametrize(("preset", "order", "step"), [("tuned", 4.0, 8e-3), ("stock", 1.0, 4e-3)])
def test_the_order_is_that_of_the_scheme(preset: str, order: float, step: float) -> None:
    problem = tb.Problem(FREE_SWING, duration=2.0)
    coarse, fine = _error(problem, preset, step), _error(problem, preset, step / 2)
    assert np.log2(coarse / fine) == pytest.approx(order, abs=0.3)
    claimed = tb.engine("pybullet", preset).study().step_orders[preset]  # type: ignore[attr-defined]
    assert claimed.order == order


def test_the_limit_of_its_own_steps_is_the_reference() -> None:
    """By Richardson's extrapolation of steps h and h / 2 at the end, of the first order."""
    problem = tb.Problem(FREE_SWING, duration=2.0)
    (coarse, fine) = (tb.engine("pybullet", "stock", timestep=h).simulate(problem) for h in (1e-3, 5e-4))
    limit = 2 * fine.q[-1] - coarse.q[-1]
    truth = solve(problem).trajectory(np.array([2.0])).q[-1]
    assert np.abs(limit - truth).max() < 0.02 * np.abs(coarse.q[-1] - truth).max()


@pytest.mark.parametrize("model", ["fixed", "rolling"])
def test_it_agrees_with_stops(model: str) -> None:
    (run,) = tb.compare([model], ["pybullet"], ["tuned"], isolate=False).results.runs
    assert run.equality is not None
    judged = [metric for metric in run.metrics if metric.tolerance is not None]
    assert {"position_max", "release_time", "stop_torque_max"} <= {m.name for m in judged if m.source == "claim"}
    assert all(metric.holds for metric in judged), [m for m in judged if not m.holds]


@pytest.mark.parametrize("model", ["fixed", "rolling"])
def test_its_own_limits_hold_where_their_solver_converges(model: str) -> None:
    problem = tb.Problem(tb.model(model), duration=1.4)
    found = tb.engine("pybullet", "stock", **CONVERGED).simulate(problem)
    truth = solve(problem)
    torques = truth.trajectory(found.t).stop_torques
    for name, time in truth.trajectory(found.t).release_times.items():
        assert (found.release_times[name] is None) == (time is None)
        # A step late by the scheme, and one by its end.
        assert time is None or abs(found.release_times[name] - time) <= 2e-3
        # First order in the step: of a torque that ends in some tenths of a second, a step is a hundredth.
        assert np.abs(found.stop_torques[name] - torques[name]).max() <= 1e-2 * max(torques[name].max(), 1.0)


def test_loops_and_rebounds_are_refused_by_its_own_step() -> None:
    from trebucheck.models.problems.registry import benchmark

    with pytest.raises(tb.UnsupportedProblemError, match="closes a loop"):
        tb.engine("pybullet", "stock").simulate(benchmark("slider-crank").problem())
    with pytest.raises(tb.UnsupportedProblemError, match="restitution"):
        tb.engine("pybullet", "stock").simulate(benchmark("bouncing").problem())
