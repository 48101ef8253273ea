"""Cases a pencil can solve: pendulums, a loop, an impact, complementarity."""

from __future__ import annotations

import math

import numpy as np
import pytest
import trebucheck as tb
from hypothesis import given
from hypothesis import strategies as st
from mechanisms import hanging_bob, slider_crank
from scipy.special import ellipk
from trebucheck.reference.contact import solve_lcp
from trebucheck.reference.equations import Equations
from trebucheck.reference.solver import solve

G = 9.81


@pytest.mark.parametrize("swing", [0.1, 1.0, 2.5])
def test_period_of_a_pendulum(swing: float) -> None:
    """T = 4 sqrt(l/g) K(sin^2(swing/2)).

    After half of it the bob stands at rest on the other side.
    """
    half = 2 * math.sqrt(2.0 / G) * float(ellipk(math.sin(swing / 2) ** 2))
    solution = solve(tb.Problem(hanging_bob(start=math.pi / 2 - swing), duration=half))
    motion = solution.motion(np.array([half]))
    assert motion.q[0, 0] == pytest.approx(math.pi / 2 + swing, abs=1e-11)
    assert motion.u[0, 0] == pytest.approx(0.0, abs=1e-10)


def test_pin_force_of_a_pendulum_at_its_lowest() -> None:
    """m g (3 - 2 cos(swing)) upwards."""
    swing = 1.2
    quarter = math.sqrt(2.0 / G) * float(ellipk(math.sin(swing / 2) ** 2))
    solution = solve(tb.Problem(hanging_bob(start=math.pi / 2 - swing), duration=2.0))
    force = solution.trajectory(np.array([quarter])).joint_reaction("pivot")[0]
    assert force == pytest.approx([0.0, 3.0 * G * (3 - 2 * math.cos(swing))], abs=1e-8)


def test_torque_of_a_rest_that_holds_a_rod() -> None:
    """A rod held level by a rest carries m g l, and stays."""
    rest = tb.Stop(name="rest", body="bob", sense=-1, limit=0.0, closed=True)
    solution = solve(tb.Problem(hanging_bob(rest), duration=1.0))
    motion = solution.motion(np.linspace(0, 1, 11))
    assert motion.stop_torques["rest"] == pytest.approx(3.0 * G * 2.0, rel=1e-14)
    assert solution.release_times["rest"] is None


def test_a_rest_that_would_have_to_pull_is_gone_at_the_start() -> None:
    rest = tb.Stop(name="rest", body="bob", sense=1, limit=0.0, closed=True)
    solution = solve(tb.Problem(hanging_bob(rest), duration=0.5))
    assert solution.release_times["rest"] == 0.0
    assert solution.motion(np.array([0.5])).q[0, 0] > 0.1


def test_an_inelastic_impact_takes_all_of_one_body_s_energy() -> None:
    """Dropped from level onto a stop straight below.

    Impulse m l sqrt(2 g l), then at rest against the stop.
    """
    stop = tb.Stop(name="stop", body="bob", sense=-1, limit=-math.pi / 2, closed=False)
    solution = solve(tb.Problem(hanging_bob(stop), duration=2.0, stop_law="unilateral"))
    ((time, impulses),) = solution.impacts
    fall = math.sqrt(2.0 / G) * float(ellipk(0.5))
    assert time == pytest.approx(fall, abs=1e-12)
    assert impulses["stop"] == pytest.approx(3.0 * 2.0 * math.sqrt(2 * G * 2.0), rel=1e-11)
    assert solution.motion(np.array([2.0])).u[0, 0] == pytest.approx(0.0, abs=1e-12)


def test_release_once_never_closes() -> None:
    stop = tb.Stop(name="stop", body="bob", sense=-1, limit=-math.pi / 2, closed=False)
    solution = solve(tb.Problem(hanging_bob(stop), duration=1.2))
    assert not solution.impacts
    assert solution.motion(np.array([1.2])).q[0, 0] > math.pi / 2 + 0.1


def test_a_loop_of_joints_holds() -> None:
    """A crank whose tip runs in a level slot.

    One loop constraint, the tip stays on the slot's line.
    """
    mechanism = slider_crank()
    trajectory = solve(tb.Problem(mechanism, duration=2.0)).trajectory(np.linspace(0, 2, 400))
    assert np.abs(trajectory.marker("tip").position[:, 1]).max() < 1e-11
    assert np.abs(trajectory.joint_reaction("slot")[:, 0]).max() < 1e-12
    assert np.ptp(trajectory.total_energy) < 1e-11 * trajectory.kinetic_energy.max()
    # Newton for the whole: both supports together carry the rate of momentum and the weight.
    h = 1e-4
    t = np.linspace(0.1, 1.9, 20)
    solution = solve(tb.Problem(mechanism, duration=2.0))
    steps = {k: solution.trajectory(t + k * h).momentum for k in (-2, -1, 1, 2)}
    rate = (8 * (steps[1] - steps[-1]) - (steps[2] - steps[-2])) / (12 * h)
    here = solution.trajectory(t)
    carried = here.joint_reaction("pivot") + here.joint_reaction("slot")
    assert carried == pytest.approx(rate + 3.0 * np.array([0.0, G]), abs=1e-5)


@given(seed=st.integers(0, 2**32 - 1), size=st.integers(1, 5))
def test_complementarity_is_solved(seed: int, size: int) -> None:
    random = np.random.default_rng(seed)
    root = random.normal(size=(size, size))
    matrix, offset = root @ root.T + 0.1 * np.eye(size), random.normal(size=size)
    x = solve_lcp(matrix, offset)
    assert x is not None
    rest = matrix @ x + offset
    assert x.min() >= 0
    assert rest.min() > -1e-9
    assert abs(x @ rest) < 1e-9


def test_mass_matrix_of_the_fixed_machine_is_the_books() -> None:
    """M_ij = c_ij cos(q_i - q_j), with the arm's inertia about the fulcrum from the paper's Eq.

    (5).
    """
    p = tb.TrebuchetParameters()
    q = np.array([0.3, 2.0, -0.7])
    inertia = p.m_a * (p.l1**3 + p.l2**3) / (p.l1 + p.l2) / 3
    c = np.array(
        [
            [
                inertia + p.m_b * p.l1**2 + p.m_cw * p.l2**2,
                p.m_b * p.l1 * p.r,
                -p.m_cw * p.l2 * p.h,
            ],
            [p.m_b * p.l1 * p.r, p.m_b * p.r**2, 0.0],
            [-p.m_cw * p.l2 * p.h, 0.0, p.m_cw * p.h**2],
        ]
    )
    expected = c * np.cos(q[:, None] - q[None, :])
    assert Equations(tb.fixed(p)).mass_matrix(q) == pytest.approx(expected, rel=1e-14, abs=1e-9)
