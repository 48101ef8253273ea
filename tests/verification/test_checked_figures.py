"""Table I, both machines: the figures that two independent formulations and integrators agreed on.

Tolerances are the stated needs: times 1e-10 s, speed 1e-8 m/s, angles 1e-9 rad, torques 1e-8
relative.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.reference.solution import Solution
from trebucheck.reference.solver import solve

TIME, SPEED, ANGLE, TORQUE, LENGTH = 1e-10, 1e-8, 1e-9, 1e-8, 1e-8


@dataclass(frozen=True)
class Figures:
    torques: tuple[float, float]
    releases: tuple[float, float]
    at_sling_release: tuple[float, float, float]
    launch_time: float
    launch_speed: float
    at_launch: tuple[float, ...]
    projectile: tuple[float, float]
    ratio: float
    rightmost: float


CHECKED = {
    "fixed": Figures(
        torques=(79630.193261, 2671.729500),
        releases=(1.194940568904336, 1.437345284636296),
        at_sling_release=(0.727907956797, 3.869500610387, -0.064285109006),
        launch_time=2.742817755771455,
        launch_speed=99.400515256270967,
        at_launch=(3.987610833710, 10.186176948591, 1.029242248603),
        projectile=(-10.972922746783, 11.626074067665),
        ratio=1.424371455,
        rightmost=8.785083,
    ),
    "rolling": Figures(
        torques=(72175.546460, 1655.136734),
        releases=(0.826024273006009, 1.702658597845621),
        at_sling_release=(1.741456329850, 4.883048983440, 0.776004937362),
        launch_time=2.509621264144581,
        launch_speed=112.718321050322281,
        at_launch=(4.571534910694, 10.035971513320, 1.106846450046, -0.457082096483),
        projectile=(-6.774751988257, 13.344036624170),
        ratio=1.831618465,
        rightmost=5.481709,
    ),
}


@pytest.fixture(scope="module", params=["fixed", "rolling"])
def case(request: pytest.FixtureRequest) -> tuple[Solution, Figures]:
    machine = {"fixed": tb.fixed, "rolling": tb.rolling}[request.param]()
    return solve(tb.Problem(machine, duration=3.0)), CHECKED[request.param]


def test_torques_at_the_start(case: tuple[Solution, Figures]) -> None:
    solution, checked = case
    torques = solution.motion(np.zeros(1)).stop_torques
    assert torques["hanger rest"][0] == pytest.approx(checked.torques[0], rel=TORQUE)
    assert torques["sling rest"][0] == pytest.approx(checked.torques[1], rel=TORQUE)
    assert torques["arm stop"][0] == 0.0


def test_release_times(case: tuple[Solution, Figures]) -> None:
    solution, checked = case
    assert solution.release_times["hanger rest"] == pytest.approx(checked.releases[0], abs=TIME)
    assert solution.release_times["sling rest"] == pytest.approx(checked.releases[1], abs=TIME)
    assert solution.release_times["arm stop"] is None


def test_angles_at_the_sling_release(case: tuple[Solution, Figures]) -> None:
    solution, checked = case
    q = solution.motion(np.array([checked.releases[1]])).q[0]
    assert q[:3] == pytest.approx(checked.at_sling_release, abs=ANGLE)


def test_launch(case: tuple[Solution, Figures]) -> None:
    solution, checked = case
    launch = solution.launch
    assert launch is not None
    assert launch.time == pytest.approx(checked.launch_time, abs=TIME)
    assert launch.speed == pytest.approx(checked.launch_speed, abs=SPEED)
    at_launch = solution.trajectory(np.array([launch.time]))
    assert at_launch.q[0] == pytest.approx(checked.at_launch, abs=ANGLE)
    assert at_launch.marker("projectile").position[0] == pytest.approx(
        checked.projectile, abs=LENGTH
    )


def test_energy_ratio(case: tuple[Solution, Figures]) -> None:
    solution, checked = case
    assert solution.launch is not None
    energy = solution.trajectory(np.zeros(1)).total_energy[0]
    assert energy == pytest.approx(208101.5257, abs=5e-5)  # printed digits
    assert 0.5 * 60.0 * solution.launch.speed**2 / energy == pytest.approx(checked.ratio, abs=5e-10)


def test_counterweight_swings_out(case: tuple[Solution, Figures]) -> None:
    solution, checked = case
    # Sampled: the maximum is missed by less than half a step's curvature, 1/2 a (dt/2)^2 with a <
    # 100 m/s^2.
    t = np.arange(0.0, checked.launch_time, 1e-4)
    x = solution.trajectory(t).marker("counterweight").position[:, 0]
    assert x[0] == pytest.approx(3.071068, abs=5e-7)
    assert x.max() == pytest.approx(checked.rightmost, abs=1e-6)


def test_torques_cross_zero_with_a_kink_and_no_jump(case: tuple[Solution, Figures]) -> None:
    solution, checked = case
    for name, time in zip(("hanger rest", "sling rest"), checked.releases, strict=True):
        before = solution.motion(np.array([time - 1e-9])).stop_torques[name][0]
        start = solution.motion(np.zeros(1)).stop_torques[name][0]
        assert 0 < before < 1e-6 * start  # slopes are some 1e5 N m/s: 1e-4 N m in a nanosecond
        assert solution.motion(np.array([time + 1e-9])).stop_torques[name][0] == 0.0


def test_the_sling_is_in_compression_until_two_seconds(case: tuple[Solution, Figures]) -> None:
    """A rope would go slack: -1.15 kN (fixed, until 2.05 s), -2.34 kN (rolling, until 2.01 s)."""
    solution, checked = case
    trajectory = solution.trajectory(np.arange(0.0, 2.3, 1e-3))
    phi = trajectory.q[:, 1]
    along = np.stack([np.cos(phi), -np.sin(phi)], axis=1)
    # The pin pulls the sling back towards itself: tension is minus the pin's force along the sling.
    tension = -np.sum(trajectory.joint_reaction("sling pin") * along, axis=1)
    end, lowest = (2.05, -1150.0) if checked is CHECKED["fixed"] else (2.01, -2340.0)
    assert tension.min() == pytest.approx(lowest, abs=5.0)
    assert trajectory.t[tension < 0].max() == pytest.approx(end, abs=5e-3)  # printed digits
