"""OpenSim against the reference."""

import numpy as np
import trebucheck as tb
from trebucheck.models.library.registry import benchmark
from trebucheck.reference.solver import solve

FREE_SWING = tb.fixed().model_copy(update={"stops": ()})


def _error(problem: tb.Problem, preset: str = "assisted", **options: object) -> float:
    """Greatest distance of a marker from where it should be [m]."""
    found = tb.engine("opensim", preset, **options).simulate(problem)
    truth = solve(problem).trajectory(found.t)
    return max(
        float(np.abs(m.position - truth.markers[name].position).max())
        for name, m in found.markers.items()
    )


def test_the_free_swing_follows_the_accuracy() -> None:
    problem = tb.Problem(FREE_SWING, duration=2.0)
    assert _error(problem) < 1e-8
    loose, tight = (_error(problem, timestep=0.1, accuracy=accuracy) for accuracy in (1e-4, 1e-9))
    assert (
        tight < loose / 1e5**0.5
    )  # at the least: local errors that are controlled add up to their power 4/5


def test_points_move_with_the_state() -> None:
    """States that are copied keep the places of their bodies in OpenSim."""
    assert _error(tb.Problem(FREE_SWING, duration=0.2), "settings") < 1e-6


def test_limit_forces_hold_the_stops_softly() -> None:
    assert 1e-6 < _error(tb.Problem(tb.fixed(), duration=1.0), "settings") < 0.1


def test_loops_and_springs() -> None:
    for name in ("slider-crank", "oscillator"):
        problem = benchmark(name).problem().model_copy(update={"duration": 0.5})
        for preset in ("assisted", "settings"):
            assert _error(problem, preset, timestep=2e-3) < 1e-6
