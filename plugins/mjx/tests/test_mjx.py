"""MJX against the reference, and its measured order."""

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.reference.solver import solve

FREE_SWING = tb.fixed().model_copy(update={"stops": ()})


def _run(problem: tb.Problem, preset: str, step: float) -> tuple[float, float]:
    """Greatest distance of a marker from where it should be [m]; greatest error of a reaction, of the greatest."""
    found = tb.engine("mjx", preset, timestep=step).simulate(problem)
    truth = solve(problem).trajectory(found.t)
    forces = [np.abs(f - truth.joint_reactions[n]).max() for n, f in found.joint_reactions.items()]
    peak = max(np.abs(force).max() for force in truth.joint_reactions.values())
    points = [np.abs(m.position - truth.markers[name].position).max() for name, m in found.markers.items()]
    return float(max(points)), float(max(forces) / peak)


def test_the_order_is_four_and_forces_are_of_it() -> None:
    problem = tb.Problem(FREE_SWING, duration=2.0)
    coarse, fine = (_run(problem, "tuned", step) for step in (8e-3, 4e-3))
    assert np.log2(coarse[0] / fine[0]) == pytest.approx(4.0, abs=0.3)
    assert fine[1] < coarse[1] / 2**3.5
    assert _run(problem, "tuned", 1e-3)[0] < 1e-8


@pytest.mark.parametrize("model", ["fixed", "rolling"])
def test_it_agrees_with_stops(model: str) -> None:
    results = tb.compare([model], ["mjx"], ["tuned"], isolate=False).results
    (run,) = results.runs
    assert run.equality is not None
    judged = [metric for metric in run.metrics if metric.tolerance is not None]
    assert {"position_max", "release_time", "stop_torque_max"} <= {m.name for m in judged if m.source == "claim"}
    assert all(metric.holds for metric in judged), [m for m in judged if not m.holds]


def test_single_precision_has_its_floor() -> None:
    positions, forces = _run(tb.Problem(FREE_SWING, duration=1.0), "stock", 2e-3)
    assert 1e-7 < positions < 1e-3 and forces < 1e-3
