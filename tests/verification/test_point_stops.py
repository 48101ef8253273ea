"""Stops on points: a ladder that leaves its wall, a bob that falls on a floor, and what is
refused."""

from __future__ import annotations

import math
from importlib.util import find_spec

import numpy as np
import pytest
import trebucheck as tb
from conftest import machines
from hypothesis import given
from hypothesis import strategies as st
from mechanisms import G, floor, hanging_bob
from trebucheck.reference.certification.redundant import solve_redundant
from trebucheck.reference.sensitivity.tangent import state_tangent
from trebucheck.reference.sensitivity.variational import VariationalEquations, consistent_direction
from trebucheck.reference.solver import solve

LENGTH, MASS = 3.0, 7.0


def ladder(lean: float, tilt: float = 0.0) -> tb.Mechanism:
    """A uniform rod whose foot slides on a level slot and whose top leans on an upright wall.

    Args:
        lean: start angle above the horizontal [rad].
        tilt: both slot and wall turned by this, counter-clockwise; gravity stays [rad].
    """
    along, up = (math.cos(tilt), math.sin(tilt)), (-math.sin(tilt), math.cos(tilt))
    rod = tb.Body(
        name="rod", angle="beta", mass=MASS, centre=(LENGTH / 2, 0), inertia=MASS * LENGTH**2 / 12
    )
    return tb.Mechanism(
        name="ladder",
        bodies=(rod,),
        joints=(
            tb.SlotJoint(
                name="foot",
                child="rod",
                parent_point=(0, 0),
                child_point=(0, 0),
                axis=along,
                coordinate="s",
            ),
        ),
        stops=(
            tb.PointStop(
                name="wall", body="rod", point=(LENGTH, 0), normal=along, offset=0.0, closed=True
            ),
        ),
        markers=(
            tb.Marker(name="top", body="rod", point=(LENGTH, 0)),
            tb.Marker(name="up", body="ground", point=up),
        ),
        gravity=G,
        start=(math.pi + lean - tilt, LENGTH * math.cos(lean)),
    )


@pytest.mark.slow
@machines(10)
@given(lean=st.floats(0.4, 1.5))
def test_a_ladder_leaves_its_wall_at_two_thirds_of_its_height(lean: float) -> None:
    """Where sin a = 2/3 sin a0: a classic.

    The wall's force before is 3/4 m g cos a (3 sin a - 2 sin a0).
    """
    problem = tb.Problem(ladder(lean), duration=3.0)
    solution = solve(problem)
    time = solution.release_times["wall"]
    assert time is not None
    height = solution.trajectory(np.array([time])).marker("top").position[0, 1]
    assert height == pytest.approx(2 / 3 * LENGTH * math.sin(lean), abs=1e-10)
    until_then = tb.Problem(problem.mechanism, duration=1.01 * time)
    assert solve_redundant(until_then).release_times["wall"] == pytest.approx(time, abs=1e-10)
    t = np.linspace(0, 0.99 * time, 7)
    trajectory = solution.trajectory(t)
    a = trajectory.q[:, 0] - math.pi
    expected = 0.75 * MASS * G * np.cos(a) * (3 * np.sin(a) - 2 * math.sin(lean))
    assert trajectory.stop_torque("wall") == pytest.approx(expected, abs=1e-8)


def test_after_the_wall_nothing_pushes_along_the_floor() -> None:
    """Speed of the centre along the slot is then sqrt(g l sin^3 a0) / 3, for good."""
    lean = 1.2
    solution = solve(tb.Problem(ladder(lean), duration=2.0))
    time = solution.release_times["wall"]
    assert time is not None
    t = np.linspace(time, solution.segments[-1].end, 20)
    motion = solution.motion(t)
    momentum = solution.equations.kinematics.momentum(motion.q, motion.u)[:, 0]
    assert momentum == pytest.approx(
        MASS * math.sqrt(G * LENGTH * math.sin(lean) ** 3) / 3, rel=1e-11
    )


def test_a_tilted_wall_is_the_same_in_every_formulation() -> None:
    problem = tb.Problem(ladder(1.0, tilt=0.3), duration=1.0)
    solution, motion = solve(problem), solve_redundant(problem)
    assert motion.release_times["wall"] == pytest.approx(solution.release_times["wall"], abs=1e-11)
    q, _ = motion.state(0.9)
    assert q == pytest.approx(solution.motion(np.array([0.9])).q[0], abs=1e-10)


@given(depth=st.floats(0.3, 1.9))
def test_a_bob_falls_on_a_floor(depth: float) -> None:
    """It arrives with sqrt(2 g depth) along its circle; the floor's impulse has to stop that.

    M v / (n . t).
    """
    solution = solve(tb.Problem(hanging_bob(floor(depth)), duration=2.0, stop_law="unilateral"))
    ((_, impulses),) = solution.impacts
    along = math.sqrt(1 - (depth / 2.0) ** 2)
    assert impulses["floor"] == pytest.approx(3.0 * math.sqrt(2 * G * depth) / along, rel=1e-10)
    end = solution.motion(np.array([2.0]))
    assert end.u[0, 0] == pytest.approx(0.0, abs=1e-12)
    assert end.stop_torques["floor"][0] == pytest.approx(
        3.0 * G, rel=1e-12
    )  # the rod carries nothing: it lies still


def test_a_bob_bounces_on_a_floor() -> None:
    """With e the speed after the first impact is e times that before it.

    E^2 of the height is reached again.
    """
    depth, e = 1.0, 0.6
    solution = solve(tb.Problem(hanging_bob(floor(depth, e)), duration=1.2, stop_law="unilateral"))
    (first, _), (second, _) = solution.impacts[:2]
    t = np.linspace(first, second, 2001)
    heights = -2.0 * np.sin(solution.motion(t).q[:, 0])
    assert heights.max() == pytest.approx(
        -depth + e**2 * depth, abs=1e-5
    )  # the top lies between two samples


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(tb.InputError, match=r"normal of 'wall' must have length 1"):
        tb.PointStop(name="wall", body="rod", point=(0, 0), normal=(1, 1), offset=0.0, closed=True)
    machine = ladder(1.0)
    with pytest.raises(
        tb.InputError, match=r"'wall' is closed, but its gap at the start is .* m, not 0"
    ):
        tb.Mechanism(**machine.model_dump() | {"start": (math.pi + 1.0, 2.0)})
    wall = machine.stops[0].model_dump() | {"body": "roof"}
    with pytest.raises(tb.InputError, match=r"stop 'wall' names the body 'roof'"):
        tb.Mechanism(**machine.model_dump() | {"stops": [wall]})
    assert tb.Mechanism.from_json(machine.to_json()) == machine


@pytest.mark.skipif(
    find_spec("heyoka") is None, reason="heyoka, the Taylor integrator, is not installed here"
)
@pytest.mark.parametrize("restitution", [0.0, 0.6])
def test_taylor_meets_the_same_floor(restitution: float) -> None:
    """The gap is an expression of its own there, found on the series."""
    from trebucheck.reference.taylor.solve import solve_taylor

    problem = tb.Problem(hanging_bob(floor(1.0, restitution)), duration=1.2, stop_law="unilateral")
    expected, found = solve(problem), solve_taylor(problem)
    assert [t for t, _ in found.impacts[:3]] == pytest.approx(
        [t for t, _ in expected.impacts[:3]], abs=1e-11
    )
    wall = tb.Problem(ladder(1.0, tilt=0.3), duration=1.0)
    assert solve_taylor(wall).release_times["wall"] == pytest.approx(
        solve(wall).release_times["wall"], abs=1e-11
    )


def test_the_release_s_derivative_follows_from_its_closed_form() -> None:
    """Of sin a = 2/3 sin a0, by the start angle; with gravity all times go as 1 / sqrt(g)."""
    lean = 1.0
    solution = solve(tb.Problem(ladder(lean), duration=1.0))
    directions = [consistent_direction(ladder(lean), {"start.0": 1.0}), {"gravity": 1.0}]
    time = solution.release_times["wall"]
    assert time is not None
    state = state_tangent(solution, VariationalEquations(ladder(lean), directions), time)
    shift = state.d_release_times["wall"]
    angle = math.asin(2 / 3 * math.sin(lean))
    expected = 2 / 3 * math.cos(lean) / math.cos(angle) * directions[0]["start.0"]
    assert state.dq[0, 0] + state.u[0] * shift[0] == pytest.approx(expected, abs=1e-9)
    assert shift[1] == pytest.approx(-time / (2 * G), abs=1e-9)
