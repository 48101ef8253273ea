"""Drake against the reference, and its measured orders."""

import numpy as np
import trebucheck as tb
from trebucheck.reference.solver import solve

FREE_SWING = tb.fixed().model_copy(update={"stops": ()})


def _error(problem: tb.Problem, **options: object) -> float:
    """Greatest distance of a marker from where it should be [m]."""
    found = tb.engine("drake", **options).simulate(problem)  # type: ignore[arg-type]
    truth = solve(problem).trajectory(found.t)
    return max(
        float(np.abs(m.position - truth.markers[name].position).max())
        for name, m in found.markers.items()
    )


def test_the_continuous_plant_follows_its_accuracy_and_not_the_step() -> None:
    problem = tb.Problem(FREE_SWING, duration=2.0)
    assert _error(problem, timestep=0.1, accuracy=1e-13) < 1e-8
    assert _error(problem, timestep=0.1, accuracy=1e-3) > 1e-8
