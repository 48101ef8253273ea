"""Drake against the reference, and its measured orders."""

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.models.problems.registry import benchmark
from trebucheck.reference.solver import solve

FREE_SWING = tb.fixed().model_copy(update={"stops": ()})


def _error(problem: tb.Problem, **options: object) -> float:
    """Greatest distance of a marker from where it should be [m]."""
    found = tb.engine("drake", **options).simulate(problem)  # type: ignore[arg-type]
    truth = solve(problem).trajectory(found.t)
    return max(float(np.abs(m.position - truth.markers[name].position).max()) for name, m in found.markers.items())


def test_the_discrete_plant_is_of_first_order() -> None:
    problem = tb.Problem(FREE_SWING, duration=2.0)
    coarse, fine = (_error(problem, preset="stock", timestep=h) for h in (2e-3, 1e-3))
    assert np.log2(coarse / fine) == pytest.approx(1.0, abs=0.1)


def test_the_continuous_plant_follows_its_accuracy_and_not_the_step() -> None:
    problem = tb.Problem(FREE_SWING, duration=2.0)
    assert _error(problem, timestep=0.1, accuracy=1e-13) < 1e-8
    assert _error(problem, timestep=0.1, accuracy=1e-3) > 1e-8


@pytest.mark.parametrize("model", ["fixed", "rolling"])
def test_it_agrees_with_stops(model: str) -> None:
    results = tb.compare([model], ["drake"], ["tuned"], isolate=False).results
    (run,) = results.runs
    assert run.equality is not None
    judged = [metric for metric in run.metrics if metric.tolerance is not None]
    assert {"position_max", "release_time", "stop_torque_max"} <= {m.name for m in judged if m.source == "claim"}
    assert all(metric.holds for metric in judged), [m for m in judged if not m.holds]


def test_the_discrete_plant_refuses_what_it_does_not_tell() -> None:
    with pytest.raises(tb.UnsupportedProblemError, match="close loops"):
        tb.engine("drake", "stock").simulate(benchmark("slider-crank").problem())
    with pytest.raises(tb.UnsupportedProblemError, match="restitution"):
        tb.engine("drake", "stock").simulate(benchmark("bouncing").problem())
