"""What a campaign over random mechanisms found in Exudyn.

Rebounds far lower than a step, joints that are redundant.
"""

from __future__ import annotations

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.comparisons.campaigns.random_mechanisms import random_mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.models.trajectory import Trajectory
from trebucheck.reference.solver import solve

pytest.importorskip("exudyn")


def _moved(problem: Problem, timestep: float) -> Trajectory:
    return tb.engine("exudyn", timestep=timestep).simulate(problem)


def test_rebounds_are_followed_until_the_rule_ends_them() -> None:
    """The last ones are 1e-3 of a step long, and lower than the rounding of positions over the
    step's square allows.
    """
    problem = Problem(random_mechanism(295), duration=0.52, stop_law=StopLaw.UNILATERAL)
    run, reference = _moved(problem, 5e-4), solve(problem)
    assert len(run.impacts) == len(reference.impacts) > 20
    times, expected = (
        np.array([time for time, _ in motion.impacts]) for motion in (run, reference)
    )
    # The first impact is late by the motion's error; those after it keep their distances from it.
    assert np.diff(times)[-3:] == pytest.approx(np.diff(expected)[-3:], rel=1e-2)


@pytest.mark.parametrize("seed", [75, 466])
def test_redundant_joints_leave_the_forces_of_second_order(seed: int) -> None:
    """A prismatic joint between bodies that are held to each other without its angle, too."""
    problem = Problem(random_mechanism(seed), duration=0.5, stop_law=StopLaw.UNILATERAL)
    reference = solve(problem)

    def error(timestep: float) -> float:
        run = _moved(problem, timestep)
        expected = reference.trajectory(run.t)
        unique = run.joint_reactions.keys() - set(reference.undetermined_joints)
        return max(
            float(np.abs(run.joint_reactions[name] - expected.joint_reaction(name)).max())
            for name in unique
        )

    # A quarter at second order; the steps beside an impact leave some of it.
    assert error(5e-4) < 0.3 * error(1e-3)
