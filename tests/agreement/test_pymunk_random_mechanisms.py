"""What a campaign over random mechanisms found in pymunk.

Stops that close a loop, and several of them on one body.
"""

from __future__ import annotations

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.comparisons.campaigns.random_mechanisms import random_mechanism
from trebucheck.models.elements import GROUND, FreeJoint, PointStop
from trebucheck.models.mechanism import Body, Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.reference.solver import solve

pytest.importorskip("pymunk")


def test_an_active_stop_gets_as_many_passes_as_a_joint_that_closes_a_loop() -> None:
    """With 200 passes its impulses diverged slowly, it seemed to pull, and the body that it holds
    fell.
    """
    problem = Problem(random_mechanism(288), duration=0.15)
    run = tb.engine("pymunk", timestep=1e-3).simulate(problem)
    expected = solve(problem).trajectory(run.t)
    assert run.release_times["stop 1"] is None
    held, force = run.stop_torques["stop 1"], expected.stop_torques["stop 1"]
    # From converged impulses, beyond the first steps: 1e-3 of a change in a step is let be.
    assert held[10:] == pytest.approx(force[10:], rel=1e-3)


def test_two_stops_of_one_body_are_told_apart_in_an_impact() -> None:
    """One against the ground, one against another body.

    Each has a torque of its own, and so an impulse.
    """
    problem = Problem(random_mechanism(65), duration=0.5, stop_law=StopLaw.UNILATERAL)
    run, reference = tb.engine("pymunk", timestep=5e-4).simulate(problem), solve(problem)
    (time, impulses), *_ = [impact for impact in run.impacts if len(impact[1]) > 1]
    expected = min(reference.impacts, key=lambda impact: abs(impact[0] - time))
    assert time == pytest.approx(expected[0], abs=1e-4)
    assert set(impulses) == set(expected[1])
    assert np.array(list(impulses.values())) == pytest.approx(
        [expected[1][name] for name in impulses], rel=1e-2
    )


G, STEP = 9.81, 1e-3  # [m/s^2], [s]


@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_a_table_that_rocks_to_rest_does_so(restitution: float) -> None:
    """Each foot that is met lets the other one part.

    Impacts of rockings as short as a step went on for ever.
    """
    arm, mass = 0.3, 2.0
    floor = {
        "relative_to": GROUND,
        "normal": (0.0, 1.0),
        "offset": 0.0,
        "closed": False,
        "restitution": restitution,
    }
    feet = (("left", -arm), ("right", arm))
    table = Mechanism(
        name="table",
        # Three times the inertia of which each foot is the other one's centre of percussion.
        bodies=(
            Body(
                name="table",
                angle="tilt",
                mass=mass,
                centre=(0.0, 0.0),
                inertia=3.0 * mass * arm**2,
            ),
        ),
        joints=(
            FreeJoint(
                name="free",
                child="table",
                parent_point=(0.0, 0.0),
                child_point=(0.0, 0.0),
                coordinates=("x", "y"),
            ),
        ),
        stops=tuple(
            PointStop(name=name, body="table", point=(x, 0.0), **floor) for name, x in feet
        ),
        gravity=G,
        start=(0.05, 0.0, 0.1),
    )
    problem = Problem(table, duration=0.8, stop_law=StopLaw.UNILATERAL)
    run, reference = tb.engine("pymunk", timestep=STEP).simulate(problem), solve(problem)
    assert len(run.impacts) < len(reference.impacts)
    assert run.impacts[-1][0] < reference.impacts[-1][0] < 0.8
    # As high as a foot is that falls for the three steps in which none is followed.
    assert np.abs(run.q - reference.trajectory(run.t).q).max() < G * (3 * STEP) ** 2 / 2
    for foot, _ in feet:
        assert run.stop_torques[foot][-1] == pytest.approx(mass * G / 2, rel=1e-6)
