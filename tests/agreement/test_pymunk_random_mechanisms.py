"""What a campaign over random mechanisms found in pymunk: stops that close a loop, and two of them on one body."""

from __future__ import annotations

import numpy as np
import pytest
import trebucheck as tb
from random_mechanisms import random_mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.reference.solver import solve

pytest.importorskip("pymunk")


def test_an_active_stop_gets_as_many_passes_as_a_joint_that_closes_a_loop() -> None:
    """With 200 passes its impulses diverged slowly, it seemed to pull, and the body that it holds fell."""
    problem = Problem(random_mechanism(288), duration=0.15)
    run = tb.engine("pymunk", timestep=1e-3).simulate(problem)
    expected = solve(problem).trajectory(run.t)
    assert run.release_times["stop 1"] is None
    held, force = run.stop_torques["stop 1"], expected.stop_torques["stop 1"]
    # From converged impulses, beyond the first steps: 1e-3 of a change in a step is let be.
    assert held[10:] == pytest.approx(force[10:], rel=1e-3)


def test_two_stops_of_one_body_are_told_apart_in_an_impact() -> None:
    """One against the ground, one against another body: each has a torque of its own, and so an impulse."""
    problem = Problem(random_mechanism(65), duration=0.5, stop_law=StopLaw.UNILATERAL)
    run, reference = tb.engine("pymunk", timestep=5e-4).simulate(problem), solve(problem)
    (time, impulses), *_ = [impact for impact in run.impacts if len(impact[1]) > 1]
    expected = min(reference.impacts, key=lambda impact: abs(impact[0] - time))
    assert time == pytest.approx(expected[0], abs=1e-4)
    assert set(impulses) == set(expected[1])
    assert np.array(list(impulses.values())) == pytest.approx([expected[1][name] for name in impulses], rel=1e-2)
