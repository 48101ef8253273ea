"""Loops with more joints than they need, in the engines."""

from __future__ import annotations

import math

import numpy as np
import pytest
import trebucheck as tb
from mechanisms import four_bar, parallel_cranks, rods_on_a_slot
from trebucheck.comparisons.campaigns.random_mechanisms import random_mechanism
from trebucheck.comparisons.diagnosis.equivalence import EXACT, check_model
from trebucheck.models.elements import GROUND, PrismaticJoint, SlotJoint
from trebucheck.models.mechanism import Body, Mechanism
from trebucheck.models.problem import Problem
from trebucheck.reference.solver import solve


@pytest.mark.parametrize("engine", ["mujoco", "pymunk", "exudyn"])
def test_redundant_joints_do_not_change_the_motion(engine: str) -> None:
    """A second pin at the same place, and a third parallel crank.

    Motions are those of the machines without.
    """
    mechanism = rods_on_a_slot(inertia=0.01, tip=(0.5, 0.2))
    again = mechanism.joints[1].model_copy(update={"name": "again"})
    twice = mechanism.model_copy(update={"joints": (*mechanism.joints, again)})
    for redundant, simple in ((twice, mechanism), (parallel_cranks(3), parallel_cranks(2))):
        one, two = (
            tb.engine(engine, timestep=1e-3).simulate(Problem(m, 0.5)) for m in (simple, redundant)
        )
        exact = solve(Problem(redundant, 0.5)).motion(two.t)
        error = np.abs(one.q - exact.q[:, : one.q.shape[1]]).max()
        assert np.abs(two.q - exact.q).max() < 3 * error + 1e-9


@pytest.mark.parametrize(("seed", "timestep"), [(39, 7e-4), (466, 3.2e-4)])
def test_redundant_joints_that_drift_do_not_stop_exudyn(seed: int, timestep: float) -> None:
    """They contradict each other, and no iteration has a residual below that.

    It gave up after 0.4 s and 0.16 s.
    """
    problem = Problem(random_mechanism(seed), 1.0)
    exact, errors = solve(problem), list[float]()
    for h in (timestep, timestep / 2):
        run = tb.engine("exudyn", timestep=h).simulate(problem)
        errors.append(float(np.abs(run.q - exact.trajectory(run.t).q).max()))
    assert errors[0] < 1e-5
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.25)


SLIGHT = 0.003  # [rad]


@pytest.mark.parametrize("engine", ["mujoco", "exudyn"])
def test_guides_that_are_nearly_parallel_are_the_same_model(engine: str) -> None:
    """Two guides of a sledge, a sixth of a degree from parallel, hold it.

    MuJoCo's softness settles slowly there.
    """
    sledge = Body(name="sledge", angle="a", mass=1.5, centre=(0.2, 0.1), inertia=0.2)
    points = {"parent_point": (0.0, 0.0), "child_point": (0.0, 0.0)}
    slot = SlotJoint(
        name="slot", parent=GROUND, child="sledge", axis=(1.0, 0.0), coordinate="x", **points
    )
    guide = PrismaticJoint(
        name="guide",
        parent=GROUND,
        child="sledge",
        axis=(math.cos(SLIGHT), math.sin(SLIGHT)),
        **points,
    )
    mechanism = Mechanism(
        name="sledge", bodies=(sledge,), joints=(slot, guide), gravity=9.81, start=(0.0, 0.0),
        gravity_direction=(0.6, -0.8))  # fmt: skip
    checks = check_model(tb.engine(engine), mechanism).checks
    assert checks
    assert [c.label for c in checks if c.value is None or c.value > EXACT] == []


def test_redundant_joints_that_drift_do_not_spoil_the_reactions_of_exudyn() -> None:
    """Iterations that ended above the contradiction left 8e-3 N, with the other sign after each
    step.
    """
    problem = Problem(random_mechanism(287), 0.5)
    exact, run = solve(problem), tb.engine("exudyn", timestep=2e-3).simulate(problem)
    there = exact.trajectory(run.t)
    largest = max(float(np.abs(force).max()) for force in there.joint_reactions.values())
    assert (
        np.abs(run.joint_reaction("loop 0") - there.joint_reaction("loop 0")).max() < 1e-3 * largest
    )


def test_three_parallel_cranks_are_redundant_and_loops_that_hold_one_motion_are_not() -> None:
    pytest.importorskip("exudyn")
    from trebucheck.engines.exudyn.build import build

    assert [build(parallel_cranks(n)).redundant for n in (2, 3)] == [False, True]
    assert not build(four_bar()).redundant and not build(tb.fixed()).redundant
