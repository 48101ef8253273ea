"""MuJoCo's joints, walls and force elements of every kind.

The built model, the motion, its order, seeded faults.
"""

from __future__ import annotations

import re

import numpy as np
import pytest
from elements import ELEMENTS, UP, WALLS, lever
from mechanisms import everything
from trebucheck.comparisons.campaigns.random_mechanisms import random_mechanism
from trebucheck.comparisons.diagnosis.equivalence import EXACT, check_model, random_states
from trebucheck.engines.mujoco.engine import MujocoEngine
from trebucheck.models.elements import PointStop
from trebucheck.models.errors import UnsupportedProblemError
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.library.registry import benchmark
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.reference.solution import Solution
from trebucheck.reference.solver import characteristic_time, solve

pytest.importorskip("mujoco")
BAR = 1e-6  # of the size (a metre, a radian), at 1e-3 of the characteristic time


@pytest.mark.parametrize("name", ELEMENTS)
def test_the_built_model_is_the_described_mechanism(name: str) -> None:
    found = check_model(MujocoEngine(), ELEMENTS[name])
    expected = {
        "total mass",
        "start",
        "start speed",
        "centre of mass",
        "mass matrix",
        "force",
        "acceleration",
    }
    assert {check.name for check in found.checks} >= expected
    assert [
        (c.name, c.subject, c.value) for c in found.checks if c.value is None or c.value > EXACT
    ] == []


def errors(exact: Solution, **options: object) -> dict[str, float]:
    """Largest errors of a run.

    Of coordinates, of potential energy, and of reactions in parts of the largest one.
    """
    run = MujocoEngine(**options).simulate(exact.problem)
    there = exact.trajectory(run.t)
    # At an impact and at a release reactions jump, within rounding of the time.
    events = [time for time, _ in exact.impacts] + [
        time for time in exact.release_times.values() if time is not None
    ]
    smooth = np.all([np.abs(run.t - time) > 1e-6 for time in events] or [run.t >= 0], axis=0)
    pairs = {
        name: (run.joint_reactions[name], force) for name, force in there.joint_reactions.items()
    }
    assert set(pairs) == set(run.joint_reactions)
    pairs |= {name: (run.stop_torques[name], force) for name, force in there.stop_torques.items()}
    largest = (
        max((float(np.abs(right[smooth]).max()) for _, right in pairs.values()), default=0.0) or 1.0
    )
    return {
        "q": float(np.abs(run.q - there.q).max()),
        "potential energy": float(np.abs(run.potential_energy - there.potential_energy).max()),
        "forces": max((float(np.abs(a - b)[smooth].max()) for a, b in pairs.values()), default=0.0)
        / largest,
        "events": max(
            (abs(a - b) for (a, _), (b, _) in zip(run.impacts, exact.impacts, strict=True)),
            default=0.0,
        ),
    }


@pytest.mark.parametrize("name", ELEMENTS)
def test_motion_energy_and_forces_are_the_references(name: str) -> None:
    time = characteristic_time(ELEMENTS[name])
    found = errors(solve(Problem(ELEMENTS[name], 0.1)), timestep=1e-3 * time)
    assert max(found["q"], found["forces"]) <= BAR
    assert found["potential energy"] <= 10 * BAR  # [J] forces of some 10 N


def test_a_loop_passes_a_singular_position_with_the_error_of_its_steps() -> None:
    """Equal links lie flat at 0.71 s.

    There softness cost 5e-6 rad at these steps, four times the usual.
    """
    mechanism = benchmark("n-four-bar").problem().mechanism
    exact = solve(Problem(mechanism, 1.0))
    (passage,) = exact.singular_passages
    run = MujocoEngine(timestep=4e-3 * characteristic_time(mechanism)).simulate(exact.problem)
    there = exact.trajectory(run.t)
    assert (
        np.abs(run.q - there.q).max() <= 0.1 * BAR
    )  # ten passages in the ten seconds of the problem
    away = np.abs(run.t - passage.time) > 0.1
    for name, force in there.joint_reactions.items():
        error = np.linalg.norm(run.joint_reactions[name] - force, axis=1)
        assert error[away].max() <= 10 * BAR * np.abs(force[away]).max()


def test_without_constraints_the_errors_are_runge_kuttas() -> None:
    """Slides, springs and dampers are no constraints in MuJoCo's joint coordinates: order four."""
    exact = solve(Problem(everything(), 0.5))
    coarse, fine = (errors(exact, timestep=h, free_substeps=1) for h in (1e-2, 5e-3))
    for name in ("q", "forces"):
        assert coarse[name] / fine[name] == pytest.approx(16, rel=0.3)


@pytest.mark.parametrize("name", WALLS)
def test_walls_of_moving_bodies(name: str) -> None:
    mechanism, duration, law = WALLS[name]
    assert check_model(MujocoEngine(), mechanism).holds
    exact = solve(Problem(mechanism, duration, stop_law=law))
    assert exact.impacts or exact.release_times["wall"]
    found = errors(exact, timestep=1e-3 * characteristic_time(mechanism))
    assert max(found["q"], found["events"]) <= BAR


# Of these loops lock a part of the mechanism (22), stops or joints are redundant (21, 31), a gap is
# constant (10).
@pytest.mark.parametrize("seed", [2, 10, 21, 22, 31])
def test_random_mechanisms(seed: int) -> None:
    mechanism = random_mechanism(seed)
    assert check_model(MujocoEngine(), mechanism).holds
    exact = solve(Problem(mechanism, 0.05, stop_law=StopLaw.UNILATERAL))
    run = MujocoEngine(timestep=1e-3 * min(1.0, characteristic_time(mechanism))).simulate(
        exact.problem
    )
    assert np.abs(run.q - exact.trajectory(run.t).q).max() <= BAR


@pytest.mark.parametrize("speed", [-1.0, 1.0])
def test_a_start_that_drives_into_a_stop_or_off_it_is_looked_at_at_rest(speed: float) -> None:
    moving = Mechanism(**(dict(lever(UP, True, 0.0)) | {"start_speeds": (speed, 0.0)}))
    state = random_states(moving)[0]
    assert state.closed == ("wall",)
    assert Kinematics(moving).gap_jacobian("wall", state.q) @ state.u == pytest.approx(
        0.0, abs=1e-14
    )
    assert check_model(MujocoEngine(), moving).holds


def test_a_stop_of_a_body_against_itself_is_refused() -> None:
    plain = lever(UP, True, 0.0)
    wall = PointStop(
        name="wall", body="bob", point=(1, 0), relative_to="bob", normal=UP, offset=-1, closed=False
    )
    alone = Mechanism(**(dict(plain) | {"stops": (wall,)}))
    with pytest.raises(
        UnsupportedProblemError, match="'wall' holds a point of 'bob' against itself"
    ):
        MujocoEngine().simulate(Problem(alone, 0.1))


FAULTS = {
    "a stiffness": ('stiffness="40"', 'stiffness="40.04"'),
    "a damping": ('damping="1.5"', 'damping="1.501"'),
    "a rest length": ('springlength="0.3"', 'springlength="0.301"'),
    "a spring's sense": ('<joint joint="pin" coef="-1" />', '<joint joint="pin" coef="1" />'),
    "a slide's axis": (
        r'name="slot_slide" type="slide" axis="\S+ 0 \S+"',
        'name="slot_slide" type="slide" axis="0.6 0 0.8"',
    ),
    "a welded angle": (r'euler="0 -0.7 0">(?=\s+<inertial pos="0.2)', 'euler="0 -0.701 0">'),
    "a force's direction": ('gear="2 0 -1 0 0 0"', 'gear="2 0 1 0 0 0"'),
    "a force that turns with its body": (' refsite="ground_directions"', ""),
    "a motor's sense": ('biasprm="0.9"', 'biasprm="-0.9"'),
    "gravity": (r'gravity="\S+ 0 \S+"', 'gravity="0 0 -9.81"'),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_in_an_element_shows(fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    from trebucheck.engines.mujoco import build

    rightly = build.mjcf

    def wrongly(mechanism: Mechanism, timestep: float) -> str:
        text, changes = re.subn(*FAULTS[fault], rightly(mechanism, timestep))
        assert changes >= 1
        return text

    monkeypatch.setattr(build, "mjcf", wrongly)
    assert not check_model(MujocoEngine(), everything()).holds
