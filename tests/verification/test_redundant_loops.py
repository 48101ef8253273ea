"""Loops with more joints than they need.

The motion is unique and is found, forces are not and are said not to be.
"""

from __future__ import annotations

import numpy as np
import pytest
import trebucheck as tb
from mechanisms import G, four_bar, parallel_cranks, pin
from trebucheck.models.elements import SlotJoint, WeldJoint
from trebucheck.models.errors import SimulationError, UnsupportedProblemError
from trebucheck.models.library.trebuchet import HANGER_REST, fixed
from trebucheck.models.mechanism import Body, Mechanism
from trebucheck.models.problem import Problem
from trebucheck.reference.certification.redundant import solve_redundant
from trebucheck.reference.equations import Equations, consistent_coordinates, consistent_speeds
from trebucheck.reference.solver import solve

TIMES = np.linspace(0.0, 1.5, 31)


def _as_one_pendulum(n: int) -> Mechanism:
    """The beam only translates: n cranks and its mass on their end are one pendulum."""
    mass, moment = n * 1.0 + 3.0, n * 0.25 + 3.0 * 0.5
    inertia = n * (0.02 + 0.25**2) + 3.0 * 0.5**2 - moment**2 / mass
    body = Body(name="all", angle="a", mass=mass, centre=(moment / mass, 0), inertia=inertia)
    return Mechanism(
        name="one", bodies=(body,), joints=(pin("foot", "ground", "all"),), gravity=G, start=(0.3,)
    )


@pytest.mark.parametrize("n", [2, 3, 5])
def test_parallel_cranks_move_as_one_pendulum(n: int) -> None:
    motion = solve(Problem(parallel_cranks(n), 1.5)).motion(TIMES)
    pendulum = solve(Problem(_as_one_pendulum(n), 1.5)).motion(TIMES)
    # A local error of 3e-14 a step, over some 100 steps, grows by the motion's own sensitivity.
    assert np.abs(motion.q - pendulum.q * np.array([1, 0] + [1] * (n - 1))).max() < 1e-10
    assert np.abs(motion.a[:, 0] - pendulum.a[:, 0]).max() < 1e-9


def test_redundant_coordinates_find_the_same_motion() -> None:
    problem = Problem(parallel_cranks(3, hung=True), 1.0)
    solution, other = solve(problem), solve_redundant(problem)
    for t in (0.3, 0.7, 1.0):
        assert np.abs(solution.motion(np.array([t])).q[0] - other.state(t)[0]).max() < 1e-10


def test_forces_that_are_not_unique_are_named_and_others_are_right() -> None:
    mechanism = parallel_cranks(3, hung=True)
    solution, simple = (
        solve(Problem(mechanism, 1.0)),
        solve(Problem(parallel_cranks(2, hung=True), 1.0)),
    )
    assert set(solution.undetermined_joints) == {joint.name for joint in mechanism.joints} - {
        "hook"
    }
    assert not solution.undetermined_stops
    assert not simple.undetermined_joints
    hook = solution.trajectory(TIMES[:20]).joint_reaction("hook")
    weight = np.array([0.0, 0.5 * G])
    bob = solution.equations.kinematics.point("bob", (0.4, 0))
    motion = solution.motion(TIMES[:20])
    needed = (
        0.5 * solution.equations.kinematics.acceleration(bob, motion.q, motion.u, motion.a) + weight
    )
    assert np.allclose(hook, needed, rtol=0, atol=1e-12)


def test_forces_of_the_cranks_hold_the_beam() -> None:
    mechanism = parallel_cranks(4)
    solution = solve(Problem(mechanism, 1.0))
    trajectory, motion = solution.trajectory(TIMES[:20]), solution.motion(TIMES[:20])
    centre = solution.equations.kinematics.point("beam", (0.7, 0.1))
    acceleration = solution.equations.kinematics.acceleration(centre, motion.q, motion.u, motion.a)
    # The beam is the child of every head: together they carry it, and without a moment about its
    # centre.
    heads = [trajectory.joint_reaction(f"head {k}") for k in range(4)]
    assert np.allclose(np.sum(heads, axis=0), 3.0 * (acceleration + np.array([0.0, G])), atol=1e-10)
    moment = sum((k - 0.7) * head[:, 1] + 0.1 * head[:, 0] for k, head in enumerate(heads))
    assert np.abs(moment).max() < 1e-10


def test_a_stop_held_twice_releases_when_a_single_one_does() -> None:
    machine = fixed()
    again = machine.stop(HANGER_REST).model_copy(update={"name": "again"})
    twice = Mechanism.model_validate({**machine.model_dump(), "stops": (*machine.stops, again)})
    one, two = solve(Problem(machine, 1.5)), solve(Problem(twice, 1.5))
    assert two.release_times[HANGER_REST] == pytest.approx(
        one.release_times[HANGER_REST], abs=1e-10
    )
    assert two.release_times["again"] == pytest.approx(one.release_times[HANGER_REST], abs=1e-10)
    t = np.array([0.05])
    torques = two.motion(t).stop_torques
    assert torques[HANGER_REST] + torques["again"] == pytest.approx(
        one.motion(t).stop_torques[HANGER_REST], rel=1e-9
    )
    assert set(two.undetermined_stops) == {HANGER_REST, "again"}


def test_a_position_beside_a_redundant_one_is_made_consistent() -> None:
    """Newton's iteration must not take the contradictions of dependent constraints for a way to
    move.
    """
    equations = Equations(parallel_cranks(3))
    start = np.array([0.3, 0.0, 0.3, 0.3])
    q = consistent_coordinates(equations, start + np.array([0.1, 0.03, 0.04, 0.05]), ())
    assert q is not None
    assert np.abs(q - start).max() < 0.2
    assert np.abs(q - np.array([q[0], 0.0, q[0], q[0]])).max() < 1e-12
    u = consistent_speeds(equations, q, np.array([1.0, 0.0, 1.0, 1.0]), ())
    assert np.abs(u - np.array([1.0, 0.0, 1.0, 1.0])).max() < 1e-9


@pytest.mark.parametrize("n", [2, 3])
def test_a_start_at_rest_in_a_singular_position_is_told(n: int) -> None:
    with pytest.raises(
        SimulationError, match="is in a singular position: the constraints of head 1"
    ):
        solve(Problem(parallel_cranks(n, start=0.0), 1.0))


def test_what_needs_independent_constraints_says_so() -> None:
    pytest.importorskip("heyoka")
    with pytest.raises(
        UnsupportedProblemError,
        match="the Taylor integrator needs constraints that are independent",
    ):
        tb.engine("reference", integrator="taylor").simulate(Problem(parallel_cranks(3), 1.0))


def test_a_slot_through_a_fixed_point_adds_nothing() -> None:
    """Its constraint is zero in every position."""
    linkage = four_bar()
    rail = SlotJoint(
        name="rail", child="crank", parent_point=(0, 0), child_point=(0, 0), axis=(1, 0)
    )
    held = Mechanism.model_validate({**linkage.model_dump(), "joints": (*linkage.joints, rail)})
    motion = solve(Problem(held, 1.0)).motion(TIMES[:20])
    free = solve(Problem(linkage, 1.0)).motion(TIMES[:20])
    assert np.abs(motion.q - free.q).max() < 1e-10


def test_a_weld_that_repeats_a_pin_is_followed_from_a_start_with_speeds() -> None:
    """Its three constraints hold one angle.

    No position beside the start has more independent ones.
    """
    arm = {"mass": 1.0, "centre": (0.5, 0.1), "inertia": 0.1}
    mechanism = Mechanism(
        name="held twice",
        bodies=(Body(name="free", angle="a", **arm), Body(name="held", angle="b", **arm)),
        joints=(
            pin("foot", "ground", "free"),
            pin("hook", "ground", "held", (0.7, 0.4), (0.3, -0.2)),
            WeldJoint(
                name="weld",
                parent="ground",
                child="held",
                parent_point=(0.9, 0.9),
                child_point=(0.5, 0.3),
            ),
        ),
        gravity=G,
        start=(0.3, 0.0),
        start_speeds=(1.0, 0.0),
    )
    problem = Problem(mechanism, 1.0)
    solution, other = solve(problem), solve_redundant(problem)
    assert np.abs(solution.motion(np.array([1.0])).q[0] - other.state(1.0)[0]).max() < 1e-10
