"""Recorded efforts: closed forms between instants, stops that open at one, and who refuses them."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest
import trebucheck as tb
from records import EFFORTS, INERTIA, INSTANTS, cart, push, record, summed, wheel
from trebucheck.comparisons.diagnosis.equivalence import check_model
from trebucheck.models.applied_forces import AppliedForces
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.mjcf.writer import mjcf
from trebucheck.reference.certification.redundant import solve_redundant
from trebucheck.reference.solver import solve
from trebucheck.reference.taylor.solve import solve_taylor

TIMES = np.linspace(0.0, 1.5, 61)


def test_a_wheel_turns_as_its_record_says() -> None:
    motion = solve(tb.Problem(wheel(), 1.5)).motion(TIMES)
    speed = 0.5 + summed(TIMES, 1) / INERTIA
    angle = 0.3 + 0.5 * TIMES + summed(TIMES, 2) / INERTIA
    assert np.abs(motion.u[:, 0] - speed).max() < 1e-12
    assert np.abs(motion.q[:, 0] - angle).max() < 1e-12
    held = np.array(EFFORTS)[np.searchsorted(INSTANTS, TIMES, side="right") - 1]
    assert np.abs(motion.a[:, 0] - held / INERTIA).max() < 1e-11


def test_momentum_along_a_rail_is_the_record_s_impulse() -> None:
    mechanism = cart()
    solution = solve(tb.Problem(mechanism, 1.5))
    motion, kinematics = solution.motion(TIMES), Kinematics(mechanism)
    momentum = np.zeros(len(TIMES))
    for body in mechanism.bodies:
        centre = kinematics.point(body.name, body.centre)
        momentum += body.mass * kinematics.velocity(centre, motion.q, motion.u)[:, 0]
    assert np.abs(momentum - summed(TIMES, 1)).max() < 1e-11
    # The rail holds nothing along itself: the record's force is taken off.
    assert np.abs(solution.joint_reactions(motion)["rail"][:, 0]).max() < 1e-10


def test_each_stage_is_that_of_a_constant_effort_by_the_second_formulation() -> None:
    mechanism = cart()
    solution = solve(tb.Problem(mechanism, 1.5))
    for begin, end in zip(INSTANTS, (*INSTANTS[1:], 1.5), strict=True):
        first, last = (solution.motion(np.array([t])) for t in (begin, end))
        start: dict[str, Any] = {
            "start": tuple(first.q[0].tolist()), "start_speeds": tuple(first.u[0].tolist())
        }  # fmt: skip
        stage = mechanism.at(begin).model_copy(update=start)
        other = solve_redundant(tb.Problem(stage, end - begin))
        q, u = other.state(end - begin)
        assert q == pytest.approx(last.q[0], abs=1e-11)
        assert u == pytest.approx(last.u[0], abs=1e-11)


def test_a_stop_opens_at_the_instant_at_which_its_torque_changes_its_sign() -> None:
    stop = tb.Stop(name="rest", body="wheel", sense=1, limit=0.3, closed=True)
    pressed = wheel(
        stops=(stop,),
        start_speeds=(),
        force_elements=(record(times=(0.0, 0.4), torques=(-3.0, 5.0)),),
    )
    solution = solve(tb.Problem(pressed, 1.0, stop_law=tb.StopLaw.UNILATERAL))
    assert solution.release_times["rest"] == 0.4
    motion = solution.motion(np.array([0.2, 0.4, 1.0]))
    assert motion.stop_torques["rest"] == pytest.approx([3.0, 0.0, 0.0], abs=1e-12)
    assert motion.q[-1, 0] == pytest.approx(0.3 + 0.5 * 5.0 / INERTIA * 0.6**2, abs=1e-12)


@pytest.mark.parametrize("later", [-1e-13, -1e-15, 0.0, 1e-15, 1e-13])
def test_an_instant_may_be_that_of_an_impact(later: float) -> None:
    """A wheel meets its stop where its torque turns round, and so leaves it at once.

    With the angle t^2 up to 0.5 s and a stop without rebound at 0.25 rad it is 0.25 - (t - 0.5)^2
    after that.
    """
    stop = tb.Stop(name="wall", body="wheel", sense=-1, limit=-0.25, closed=False)
    met = wheel(
        stops=(stop,),
        start=(0.0,),
        start_speeds=(),
        force_elements=(record(times=(0.0, 0.5 + later), torques=(2 * INERTIA, -2 * INERTIA)),),
    )
    solution = solve(tb.Problem(met, 1.0, stop_law=tb.StopLaw.UNILATERAL))
    motion = solution.motion(np.array([0.3, 0.7, 1.0]))
    assert motion.q[:, 0] == pytest.approx([0.09, 0.25 - 0.04, 0.0], abs=1e-9)


def test_an_instant_that_changes_nothing_leaves_the_motion() -> None:
    constant = cart().model_copy(
        update={"force_elements": (record(times=(0.0,), torques=(2.0,), name="hip", body="rod"),)}
    )
    cut = cart().model_copy(
        update={
            "force_elements": (
                record(times=(0.0, 0.6, 0.9), torques=(2.0, 2.0, 2.0), name="hip", body="rod"),
            )
        }
    )
    one, other = (solve(tb.Problem(each, 1.5)).motion(TIMES).q for each in (constant, cut))
    assert np.abs(one - other).max() < 1e-11


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"times": (0.0, 0.3)}, "2 times for 4 torques"),
        ({"times": (0.1, 0.2, 0.3, 0.4)}, "0.1"),
        ({"times": (0.0, 0.3, 0.2, 0.4)}, "0.2"),
        ({"times": (0.0, float("nan"), 0.2, 0.4)}, "times"),
        ({"times": (), "torques": ()}, "times"),
    ],
)
def test_a_record_that_is_none_is_refused(changes: dict[str, Any], named: str) -> None:
    with pytest.raises(tb.InputError, match=r"motor|times") as raised:
        record(**changes)
    assert named in str(raised.value)


def test_a_slide_that_the_joint_has_not_is_refused() -> None:
    with pytest.raises(tb.InputError, match="'s'"):
        wheel(force_elements=(push(body="wheel"),))


def test_who_follows_no_record_refuses_it_by_its_name() -> None:
    mechanism = wheel()
    problem = tb.Problem(mechanism, 1.5)
    q, u = np.zeros((2, 1)), np.zeros((2, 1))
    for computed in (
        lambda: AppliedForces(Kinematics(mechanism)).generalized(q, u),
        lambda: AppliedForces(Kinematics(mechanism)).power(q, u),
        lambda: solve_taylor(problem),
        lambda: solve_redundant(problem),
        lambda: tb.prove(problem, until=0.5),
    ):
        with pytest.raises(tb.UnsupportedProblemError, match=r"motor|recorded"):
            computed()


@pytest.mark.parametrize("preset", ["settings", "assisted"])
@pytest.mark.parametrize("mechanism", [wheel(), cart()], ids=lambda m: m.name)
def test_mujoco_follows_it(mechanism: tb.Mechanism, preset: str) -> None:
    """The record is the control of an actuator; accelerations change with the steps' beginnings."""
    engine = tb.engine("mujoco", preset, timestep=1e-3)
    assert check_model(engine, mechanism).holds
    found = engine.simulate(tb.Problem(mechanism, 1.5))
    exact = solve(tb.Problem(mechanism, 1.5)).trajectory(found.t)
    # RK4 at 1 ms: h^4 of accelerations below 1e3, and forces by masses of some kilograms.
    assert np.abs(found.q - exact.q).max() < 1e-9
    for joint, force in exact.joint_reactions.items():
        assert np.abs(found.joint_reactions[joint] - force).max() < 1e-8, joint


def test_an_instant_inside_a_step_acts_from_the_next_step_on() -> None:
    """The angle of the wheel is late by the step's rest: at most effort / inertia * h * t."""
    late = wheel(force_elements=(record(times=(0.0, 0.2504), torques=(0.0, 8.0)),))
    found = tb.engine("mujoco", "settings", timestep=1e-3).simulate(tb.Problem(late, 1.0))
    exact = solve(tb.Problem(late, 1.0)).trajectory(found.t)
    speed = 8.0 / INERTIA * 0.0006  # what it has not gained by the beginning of the next step
    assert exact.u[-1, 0] - found.u[-1, 0] == pytest.approx(speed, rel=1e-9)


def test_a_comparison_judges_forces_away_from_instants() -> None:
    (run,) = tb.compare(
        [cart()], ["mujoco"], ["settings"], duration=1.5, isolate=False
    ).results.runs
    assert run.outcome == "agrees"
    forces = [m for m in run.metrics if m.name == "joint_reaction_max"]
    assert len(forces) == 2
    # Three instants, and one and a half steps of 1 ms to either side
    assert all(0 < (m.left_out or 0.0) <= 3 * 5e-3 for m in forces)


def test_the_file_of_a_mechanism_has_its_record_as_keyframes() -> None:
    """Whoever takes the file steps it with their controls."""
    model = mujoco.MjModel.from_xml_string(mjcf(wheel()))
    assert [float(model.key(k).ctrl[0]) for k in range(model.nkey)] == list(EFFORTS)
    assert [float(model.key(k).time[0]) for k in range(model.nkey)] == list(INSTANTS)


def test_the_program_of_a_run_steps_with_the_record() -> None:
    problem = tb.Problem(cart(), 0.5)
    engine = tb.engine("mujoco", "settings")
    names: dict[str, Any] = {}
    exec(engine.script(problem), names)
    assert np.abs(names["q"] - engine.simulate(problem).q).max() < 1e-13


def test_it_comes_back_from_json() -> None:
    mechanism = wheel()
    read = tb.Mechanism.model_validate_json(mechanism.model_dump_json())
    assert read == mechanism and read.content_hash == mechanism.content_hash
