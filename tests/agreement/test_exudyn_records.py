"""Exudyn follows recorded efforts: loads that are functions of the time, or motions from change to
change."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from records import EFFORTS, INERTIA, INSTANTS, cart, record, wheel
from trebucheck.comparisons.diagnosis.equivalence import check_model
from trebucheck.reference.solver import solve

STEP = 2e-3  # [s] a whole number of them fits between instants


def _errors(mechanism: tb.Mechanism, preset: str, step: float) -> tuple[float, float]:
    """Largest errors of coordinates and forces of joints [m, rad; N]."""
    found = tb.engine("exudyn", preset, timestep=step).simulate(tb.Problem(mechanism, 1.5))
    exact = solve(tb.Problem(mechanism, 1.5)).trajectory(found.t)
    forces = (
        np.abs(found.joint_reactions[joint] - force).max()
        for joint, force in exact.joint_reactions.items()
    )
    return float(np.abs(found.q - exact.q).max()), float(max(forces))


@pytest.mark.parametrize("preset", ["default", "settings", "assisted"])
@pytest.mark.parametrize("mechanism", [wheel(), cart()], ids=lambda m: m.name)
def test_the_model_holds_the_efforts(mechanism: tb.Mechanism, preset: str) -> None:
    assert check_model(tb.engine("exudyn", preset), mechanism).holds


def test_with_assistance_the_order_is_that_of_the_trapezoidal_rule() -> None:
    """Each motion from change to change begins with its own accelerations."""
    # Constant accelerations are exact, but for the rounding of 1500 steps.
    assert _errors(wheel(), "assisted", STEP)[0] < 1e-12
    (coarse, force), (fine, finer_force) = (
        _errors(cart(), "assisted", step) for step in (STEP, STEP / 2)
    )
    assert coarse / fine == pytest.approx(4, rel=0.1)
    assert force / finer_force == pytest.approx(4, rel=0.1)


@pytest.mark.parametrize("preset", ["default", "settings"])
def test_by_itself_a_change_is_late_by_half_a_step(preset: str) -> None:
    """Implicit rules begin a step with the accelerations of the last one's end.

    So half of the first step after a change moves by the effort before it.
    """
    found = tb.engine("exudyn", preset, timestep=STEP).simulate(tb.Problem(wheel(), 1.5))
    late = (0.0, *(instant + STEP / 2 for instant in INSTANTS[1:]))
    exact = solve(tb.Problem(wheel(force_elements=(record(times=late),)), 1.5)).trajectory(found.t)
    # In the step with a change speed is a straight line in place of two: an eighth of h^2 each. The
    # default, generalised alpha, damps the jump over some steps.
    jumps = float(np.abs(np.diff(EFFORTS)).sum()) / INERTIA
    bound = STEP**2 * jumps * (1 / 8 if preset == "settings" else 1)
    assert np.abs(found.q - exact.q).max() < 1.001 * bound
    (coarse, _), (fine, _) = (_errors(cart(), preset, step) for step in (STEP, STEP / 2))
    assert coarse / fine == pytest.approx(2, rel=0.1)


def test_a_stop_opens_at_the_instant_at_which_its_torque_changes_its_sign() -> None:
    pressed = wheel(
        stops=(tb.Stop(name="rest", body="wheel", sense=1, limit=0.3, closed=True),),
        start_speeds=(),
        force_elements=(record(times=(0.0, 0.4), torques=(-3.0, 5.0)),),
    )
    for law in tb.StopLaw:
        found = tb.engine("exudyn").simulate(tb.Problem(pressed, 1.0, stop_law=law))
        assert found.release_times["rest"] == pytest.approx(0.4, abs=1e-12)
        assert found.stop_torques["rest"][0] == pytest.approx(3.0, abs=1e-9)
        angle = 0.3 + 0.5 * 5.0 / INERTIA * 0.6**2
        assert found.q[-1, 0] == pytest.approx(angle, abs=1e-10)


@pytest.mark.parametrize("later", [-1e-4, -1e-13, 0.0, 1e-13, 1e-4])
def test_an_instant_may_be_that_of_an_impact(later: float) -> None:
    """A wheel meets a stop without rebound at 0.5 s, where its torque turns round."""
    met = wheel(
        stops=(tb.Stop(name="wall", body="wheel", sense=-1, limit=-0.25, closed=False),),
        start=(0.0,),
        start_speeds=(),
        force_elements=(record(times=(0.0, 0.5 + later), torques=(2 * INERTIA, -2 * INERTIA)),),
    )
    problem = tb.Problem(met, 1.0, stop_law=tb.StopLaw.UNILATERAL)
    found, exact = tb.engine("exudyn").simulate(problem), solve(problem)
    # Constant accelerations are exact; an impact is found to 1e-13 s at 1 rad/s.
    assert np.abs(found.q[-1] - exact.motion(np.array([1.0])).q).max() < 1e-9


def test_own_limits_follow_it_too() -> None:
    engine = tb.engine("exudyn", own_limits=True, locate_releases=False, timestep=STEP)
    found = engine.simulate(tb.Problem(wheel(), 1.5))
    exact = solve(tb.Problem(wheel(), 1.5)).trajectory(found.t)
    jumps = float(np.abs(np.diff(EFFORTS)).sum()) / INERTIA
    assert 0 < np.abs(found.u - exact.u).max() < STEP * jumps


def test_the_program_of_a_run_follows_the_record() -> None:
    engine, problem = tb.engine("exudyn", "settings"), tb.Problem(cart(), 0.5)
    names: dict[str, Any] = {}
    exec(engine.script(problem), names)
    assert np.abs(names["q"] - engine.simulate(problem).q).max() < 1e-13
