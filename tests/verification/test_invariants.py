"""What must hold whatever the machine.

Energy, momentum, mirror image, scaling, time, complementarity.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
import trebucheck as tb
from conftest import machine_parameters
from hypothesis import given, seed
from trebucheck.models.trajectory import Trajectory
from trebucheck.reference.solution import Solution
from trebucheck.reference.solver import solve

pytestmark = pytest.mark.slow  # many machines, or many integrations: not in `make quick`

Build = Callable[[tb.TrebuchetParameters], tb.Mechanism]


same_machines = seed(1)  # the laws are asked of the same machines, each of which is solved once


@cache
def _to_launch(build: Build, parameters: tb.TrebuchetParameters) -> tuple[Solution, Trajectory]:
    """The motion, and its samples up to the launch."""
    solution = solve(tb.Problem(build(parameters), duration=4.0))
    end = solution.launch.time if solution.launch else 2.0
    return solution, solution.trajectory(np.linspace(0.0, end, 1500))


@same_machines
@given(parameters=machine_parameters())
def test_energy_is_kept(build: Build, parameters: tb.TrebuchetParameters) -> None:
    _, trajectory = _to_launch(build, parameters)
    # Stated need: 1e-12, of the energy in play (a total energy may be near zero by the choice of
    # the height).
    scale = max(abs(trajectory.total_energy[0]), trajectory.kinetic_energy.max())
    assert np.abs(trajectory.total_energy - trajectory.total_energy[0]).max() < 1e-12 * scale


@pytest.mark.parametrize("build_table_one", [tb.fixed, tb.rolling])
def test_energy_is_kept_to_1e_12_on_table_one(build_table_one: Build) -> None:
    energy = _to_launch(build_table_one, tb.TrebuchetParameters())[1].total_energy
    assert np.abs(energy / energy[0] - 1).max() < 1e-12


@same_machines
@given(parameters=machine_parameters())
def test_rolling_machine_keeps_its_horizontal_momentum(parameters: tb.TrebuchetParameters) -> None:
    _, trajectory = _to_launch(tb.rolling, parameters)
    momentum = trajectory.momentum[:, 0]
    speed = np.linalg.norm(trajectory.marker("projectile").velocity, axis=1).max()
    assert np.abs(momentum).max() < 1e-9 * parameters.m_b * speed


@same_machines
@given(parameters=machine_parameters())
def test_reactions_carry_the_whole_machine(
    build: Build, parameters: tb.TrebuchetParameters
) -> None:
    """The fulcrum's force is the rate of the total momentum plus the weight, from q and u alone."""
    solution, trajectory = _to_launch(build, parameters)
    h, mid = 1e-4, trajectory.t[20:-20:50]
    opened = [time for time in solution.release_times.values() if time is not None]
    mid = mid[[all(abs(s - time) > 2 * h for time in opened) for s in mid]]
    # Fourth-order central difference: truncation h^4/30 of the fifth derivative, rounding eps/h.
    steps = {k: solution.trajectory(mid + k * h).momentum for k in (-2, -1, 1, 2)}
    rate = (8 * (steps[1] - steps[-1]) - (steps[2] - steps[-2])) / (12 * h)
    mass = sum(body.mass for body in solution.problem.mechanism.bodies)
    expected = rate + mass * np.array([0.0, parameters.g])
    found = solution.trajectory(mid).joint_reaction("fulcrum")
    assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()


@same_machines
@given(parameters=machine_parameters())
def test_stops_are_complementary(build: Build, parameters: tb.TrebuchetParameters) -> None:
    _, trajectory = _to_launch(build, parameters)
    assert len(trajectory.mechanism.stops) > 0
    for stop in trajectory.mechanism.stops:
        torque, gap = trajectory.stop_torque(stop.name), trajectory.stop_gap(stop.name)
        scale = max(torque.max(), 1.0)
        assert torque.min() > -1e-9 * scale  # interpolation between the integrator's steps
        assert np.abs(torque * gap).max() < 1e-9 * scale
        released = trajectory.release_time(stop.name)
        if stop.closed and released is None:
            assert np.abs(gap).max() < 1e-11


@pytest.mark.parametrize("scale", [0.05, 3.0])
def test_lengths_scale_and_time_with_their_root(build: Build, scale: float) -> None:
    p = tb.TrebuchetParameters()
    lengths = {name: getattr(p, name) * scale for name in ("l1", "l2", "h", "r")}
    small = solve(
        tb.Problem(build(tb.TrebuchetParameters(**lengths)), duration=3.0 * scale**0.5)
    ).launch
    full = solve(tb.Problem(build(p), duration=3.0)).launch
    assert small is not None and full is not None
    assert small.time == pytest.approx(full.time * scale**0.5, rel=1e-12)
    assert small.speed == pytest.approx(full.speed * scale**0.5, rel=1e-11)


def test_masses_cancel(build: Build) -> None:
    p = tb.TrebuchetParameters()
    heavy = tb.TrebuchetParameters(m_b=p.m_b * 7, m_cw=p.m_cw * 7, m_a=p.m_a * 7)
    first, second = (solve(tb.Problem(build(x), duration=3.0)) for x in (p, heavy))
    assert first.launch is not None and second.launch is not None
    assert first.launch.time == pytest.approx(second.launch.time, rel=1e-12)
    torques = [s.motion(np.zeros(1)).stop_torques["hanger rest"][0] for s in (first, second)]
    assert torques[1] == pytest.approx(7 * torques[0], rel=1e-13)


def test_a_turn_of_every_angle_changes_nothing(build: Build) -> None:
    p, turn = tb.TrebuchetParameters(), 2 * np.pi
    turned = tb.TrebuchetParameters(phi0=p.phi0 - turn, alpha0=p.alpha0 + turn)
    first, second = (solve(tb.Problem(build(x), duration=3.0)).launch for x in (p, turned))
    assert first is not None and second is not None
    assert first.speed == pytest.approx(second.speed, rel=1e-11)
