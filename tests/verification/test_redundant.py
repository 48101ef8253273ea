"""Redundant coordinates against minimal ones: two formulations, two event finders, one motion.

Needs: release times to 1e-9 s, states up to the launch to 1e-9 (rad, m, rad/s, m/s), forces to 1e-9
relative.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
import trebucheck as tb
from conftest import again, machine_parameters, machines
from hypothesis import assume, given, seed
from mechanisms import everything, slider_crank
from trebucheck.comparisons.campaigns.random_mechanisms import random_mechanism
from trebucheck.reference.certification.certificate import estimate_uncertainty
from trebucheck.reference.certification.redundant import (
    RedundantMotion,
    RedundantSystem,
    solve_redundant,
)
from trebucheck.reference.equations import Equations
from trebucheck.reference.solution import Solution
from trebucheck.reference.solver import solve

pytestmark = pytest.mark.slow  # many machines, or many integrations: not in `make quick`
Build = Callable[[tb.TrebuchetParameters], tb.Mechanism]
NEED, DRIFT = 1e-9, 1e-11


def _both(mechanism: tb.Mechanism) -> tuple[Solution, RedundantMotion, float]:
    solution = solve(tb.Problem(mechanism, duration=4.0))
    # A machine that does not launch spins on, and soon every rounding grows: two seconds are
    # compared.
    end = solution.launch.time if solution.launch else 2.0
    return solution, solve_redundant(tb.Problem(mechanism, duration=end + 0.02)), end


def _agree(solution: Solution, motion: RedundantMotion, end: float, samples: int) -> None:
    for name, time in motion.release_times.items():
        expected = solution.release_times[name]
        if expected is not None and expected > end:
            expected = None
        if time is not None and time > end:
            time = None  # noqa: PLW2901
        assert time == (None if expected is None else pytest.approx(expected, abs=NEED))
    if solution.launch is not None:
        assert motion.launch is not None
        assert motion.launch.time == pytest.approx(solution.launch.time, abs=NEED)
        assert motion.launch.speed == pytest.approx(solution.launch.speed, abs=NEED)
    times = np.linspace(0.0, end, samples)
    trajectory = solution.trajectory(times)
    for i, time in enumerate(times):
        q, u = motion.state(float(time))
        assert q == pytest.approx(trajectory.q[i], abs=NEED)
        assert u == pytest.approx(trajectory.u[i], abs=NEED)
        assert motion.drift(float(time)) < DRIFT


same_machines = seed(
    1
)  # motion and estimate are asked of the same machines, each of which is solved once


@cache
def _both_of(
    build: Build, parameters: tb.TrebuchetParameters
) -> tuple[Solution, RedundantMotion, float]:
    return _both(build(parameters))


@same_machines
@machines(12, few=2)
@given(parameters=machine_parameters())
def test_same_motion_on_random_machines(build: Build, parameters: tb.TrebuchetParameters) -> None:
    _agree(*_both_of(build, parameters), samples=15)


@same_machines
@machines(12, few=2)
@given(parameters=machine_parameters())
def test_estimate_covers_the_distance_to_redundant_coordinates(
    build: Build, parameters: tb.TrebuchetParameters
) -> None:
    solution, other, _ = _both_of(build, parameters)
    assume(solution.launch is not None)
    assert solution.launch is not None
    uncertainties = estimate_uncertainty(solution)
    assert other.launch is not None
    for found, expected, metric in (
        (other.launch.time, solution.launch.time, "launch_time"),
        (other.launch.speed, solution.launch.speed, "launch_speed"),
    ):
        allowed = uncertainties.of(metric)
        assert allowed is not None
        assert abs(found - expected) <= allowed
    for name, time in other.release_times.items():
        expected = solution.release_times[name]
        allowed = uncertainties.of("release_time", name)
        if time is not None and expected is not None and allowed is not None:
            assert abs(time - expected) <= allowed


@pytest.fixture(scope="module", params=[tb.fixed, tb.rolling], ids=["fixed", "rolling"])
def table_one(request: pytest.FixtureRequest) -> tuple[Solution, RedundantMotion, float]:
    return _both(request.param())


def test_same_motion_on_table_one(table_one: tuple[Solution, RedundantMotion, float]) -> None:
    _agree(*table_one, samples=100)


def test_multipliers_are_the_newtonian_reactions(
    table_one: tuple[Solution, RedundantMotion, float],
) -> None:
    solution, motion, end = table_one
    times = np.linspace(0.0, end, 60)
    trajectory = solution.trajectory(times)
    assert len(trajectory.joint_reactions) > 0
    for name, force in trajectory.joint_reactions.items():
        found = np.array([motion.joint_reactions(float(t))[name] for t in times])
        assert np.abs(found - force).max() < NEED * np.linalg.norm(force, axis=1).max()


def test_same_stop_torques_and_markers(table_one: tuple[Solution, RedundantMotion, float]) -> None:
    solution, motion, end = table_one
    times = np.linspace(0.0, end, 60)
    trajectory = solution.trajectory(times)
    for stop in ("hanger rest", "sling rest", "arm stop"):
        torque = trajectory.stop_torque(stop)
        found = np.array([motion.stop_torques(float(t))[stop] for t in times])
        assert np.abs(found - torque).max() <= NEED * torque.max(initial=0.0)
    for name, point in trajectory.markers.items():
        found = np.array([motion.marker(name, float(t))[:2] for t in times])
        assert found[:, 0] == pytest.approx(point.position, abs=NEED)
        assert found[:, 1] == pytest.approx(point.velocity, abs=NEED)


def _slider_crank(moving: bool) -> tb.Mechanism:
    """A loop: pin, pin, and the rod's tip in a level slot; centres of mass off their axes."""
    here = slider_crank(centres=((0.5, 0.1), (1.0, -0.2)), markers=())
    a, b = here.start
    # The tip stays level: cos(a) da + 2 cos(b) db = 0.
    return slider_crank(
        centres=((0.5, 0.1), (1.0, -0.2)),
        markers=(),
        start_speeds=(1.5, -1.5 * math.cos(a) / (2 * math.cos(b))) if moving else (),
    )


@pytest.mark.parametrize("moving", [False, True], ids=["at rest", "moving"])
def test_a_loop_of_joints(moving: bool) -> None:
    problem = tb.Problem(_slider_crank(moving), duration=2.0)
    solution, motion = solve(problem), solve_redundant(problem)
    times = np.linspace(0.0, 2.0, 40)
    trajectory = solution.trajectory(times)
    assert len(times) > 0
    for i, t in enumerate(times):
        assert motion.state(float(t))[0] == pytest.approx(trajectory.q[i], abs=NEED)
        for name, force in motion.joint_reactions(float(t)).items():
            assert force == pytest.approx(
                trajectory.joint_reaction(name)[i], abs=1e-7
            )  # 1e-9 of some 100 N


def test_a_stop_that_would_have_to_pull_is_gone_at_the_start() -> None:
    machine = tb.fixed(
        tb.TrebuchetParameters.with_beam(13.0)
    )  # PHYSICS: beyond 12.7255 m the hanger's rest would pull
    solution, motion, _ = _both(machine)
    assert motion.release_times["hanger rest"] == 0.0 == solution.release_times["hanger rest"]


def test_projection_puts_a_state_back_on_its_joints() -> None:
    system = RedundantSystem(tb.rolling())
    broken = system.start + 1e-6 * np.random.default_rng(1).normal(size=len(system.start))
    held = ("hanger rest", "sling rest")
    back = system.projected(broken, held)
    assert (
        np.abs(system.joint_errors(back[: system.n])).max() < 1e-14 * 10
    )  # a few roundings of 10 m
    assert max(abs(system.gap(back[: system.n], name)) for name in held) < 1e-14


def test_another_law_is_refused() -> None:
    with pytest.raises(tb.UnsupportedProblemError, match="release-once"):
        solve_redundant(tb.Problem(tb.fixed(), duration=1.0, stop_law="unilateral"))


@pytest.mark.parametrize("closed", [(), ("deck",)], ids=["open", "on a moving wall"])
def test_every_element_has_the_same_accelerations_and_energy(closed: tuple[str, ...]) -> None:
    """To rounding: both solve linear equations of condition 1e3 or so."""
    mechanism, random = everything(), np.random.default_rng(3)
    q, u = (
        np.array(start) + random.uniform(-1, 1, 7)
        for start in (mechanism.start, mechanism.start_speeds)
    )
    system = RedundantSystem(
        mechanism.model_copy(update={"start": tuple(q), "start_speeds": tuple(u)})
    )
    equations, y = Equations(mechanism), system.start
    accelerations, forces = equations.solve(q, u, closed)
    assert system.coordinates(y[: system.n]) == pytest.approx(q, abs=1e-12)
    assert system.speeds(y) == pytest.approx(u, abs=1e-12)
    assert system.accelerations(y, closed) == pytest.approx(accelerations, rel=1e-12, abs=1e-11)
    assert system.torques(y, closed) == pytest.approx(forces, rel=1e-12)
    energy = equations.kinematics.kinetic_energy(q, u) + equations.potential_energy(q)
    assert system.energy(y) == pytest.approx(float(energy), rel=1e-12)


def test_every_element_makes_the_same_motion() -> None:
    problem = tb.Problem(everything(), duration=1.0)
    solution, motion = solve(problem), solve_redundant(problem)
    times = np.linspace(0.0, 1.0, 9)
    trajectory = solution.trajectory(times)
    assert len(times) > 0
    for i, t in enumerate(times):
        assert motion.state(float(t))[0] == pytest.approx(trajectory.q[i], abs=NEED)
        assert motion.state(float(t))[1] == pytest.approx(trajectory.u[i], abs=NEED)
        for name, force in motion.joint_reactions(float(t)).items():
            if name in trajectory.joint_reactions:
                assert force == pytest.approx(
                    trajectory.joint_reaction(name)[i], abs=1e-8
                )  # 1e-9 of some 10 N


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(k, marks=again) for k in (2, 3))])
def test_random_mechanisms_of_all_elements_move_the_same(seed: int) -> None:
    """Two hundred of them agree to 4e-12 of their size over 1 s."""
    problem = tb.Problem(random_mechanism(seed), duration=0.5)
    solution, motion = solve(problem), solve_redundant(problem)
    expected = solution.motion(np.array([0.5]))
    q, u = motion.state(0.5)
    assert q == pytest.approx(expected.q[0], rel=NEED, abs=NEED)
    assert u == pytest.approx(expected.u[0], rel=NEED, abs=NEED)
