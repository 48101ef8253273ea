"""MJX against the reference, and its measured order."""

import numpy as np
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


def test_single_precision_has_its_floor() -> None:
    positions, forces = _run(tb.Problem(FREE_SWING, duration=1.0), "stock", 2e-3)
    assert 1e-7 < positions < 1e-3 and forces < 1e-3
