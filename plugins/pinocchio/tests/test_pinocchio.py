"""Pinocchio against the reference, and its measured orders."""

import numpy as np
import trebucheck as tb
from trebucheck.models.library.registry import benchmark
from trebucheck.reference.solver import solve

FREE_SWING = tb.fixed().model_copy(update={"stops": ()})


def _error(problem: tb.Problem, preset: str, step: float) -> float:
    """Greatest distance of a marker from where it should be [m]."""
    found = tb.engine("pinocchio", preset, timestep=step).simulate(problem)
    truth = solve(problem).trajectory(found.t)
    return max(
        float(np.abs(m.position - truth.markers[name].position).max())
        for name, m in found.markers.items()
    )


def test_branches_are_added_depth_first() -> None:
    """With the bodies in the mechanism's order Pinocchio's mass matrix of two branches is wrong."""
    assert (
        _error(
            benchmark("n-four-bar").problem().model_copy(update={"duration": 1.0}), "assisted", 2e-3
        )
        < 1e-8
    )
