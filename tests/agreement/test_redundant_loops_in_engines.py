"""Loops with more joints than they need, in the engines."""

from __future__ import annotations

import numpy as np
import pytest
import trebucheck as tb
from mechanisms import parallel_cranks, rods_on_a_slot
from trebucheck.models.problem import Problem
from trebucheck.reference.solver import solve


@pytest.mark.parametrize("engine", ["mujoco", "pymunk", "exudyn"])
def test_redundant_joints_do_not_change_the_motion(engine: str) -> None:
    """A second pin at the same place, and a third parallel crank: motions are those of the machines without."""
    mechanism = rods_on_a_slot(inertia=0.01, tip=(0.5, 0.2))
    again = mechanism.joints[1].model_copy(update={"name": "again"})
    twice = mechanism.model_copy(update={"joints": (*mechanism.joints, again)})
    for redundant, simple in ((twice, mechanism), (parallel_cranks(3), parallel_cranks(2))):
        one, two = (tb.engine(engine, timestep=1e-3).simulate(Problem(m, 0.5)) for m in (simple, redundant))
        exact = solve(Problem(redundant, 0.5)).motion(two.t)
        error = np.abs(one.q - exact.q[:, : one.q.shape[1]]).max()
        assert np.abs(two.q - exact.q).max() < 3 * error + 1e-9
