"""Newton against the reference, and its measured order."""

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.models.problems.registry import benchmark
from trebucheck.reference.solver import solve

FREE_SWING = tb.Problem(tb.fixed().model_copy(update={"stops": ()}), duration=2.0)


def _error(preset: str, step: float) -> float:
    """Greatest distance of a marker from where it should be [m]."""
    found = tb.engine("newton", preset, timestep=step).simulate(FREE_SWING)
    truth = solve(FREE_SWING).trajectory(found.t)
    return max(float(np.abs(m.position - truth.markers[name].position).max()) for name, m in found.markers.items())


def test_featherstone_is_of_first_order() -> None:
    assert np.log2(_error("stock", 8e-3) / _error("stock", 4e-3)) == pytest.approx(1.0, abs=0.2)


def test_mujoco_is_at_the_floor_of_single_precision() -> None:
    """A state of 10 rad is rounded by 5e-7 in each of 500 steps, at 16 m: sqrt(500) times, if the signs are random."""
    assert _error("tuned", 4e-3) < np.sqrt(500) * 5e-7 * 16


@pytest.mark.parametrize("model", ["fixed", "rolling"])
def test_its_limits_release_in_the_step_of_the_reference(model: str) -> None:
    problem = tb.Problem(tb.model(model), duration=1.3)
    found = tb.engine("newton").simulate(problem)
    truth = solve(problem).trajectory(found.t)
    for name, time in truth.release_times.items():
        assert (found.release_times[name] is None) == (time is None)
        assert time is None or abs(found.release_times[name] - time) <= 2e-3
        # 25 times of the limits' time constant (damping over stiffness, 0.02 s) after the start they have settled.
        settled = found.t > 0.5
        error = np.abs(found.stop_torques[name] - truth.stop_torques[name])[settled].max()
        assert error <= 1e-2 * max(truth.stop_torques[name].max(), 1.0)


def test_loops_are_refused() -> None:
    with pytest.raises(tb.UnsupportedProblemError, match="loop"):
        tb.engine("newton").simulate(benchmark("slider-crank").problem())
    with pytest.raises(tb.UnsupportedProblemError, match="does not tell"):
        tb.engine("newton", "stock").simulate(tb.Problem(tb.fixed(), duration=0.1))
