"""The reference with a fault: what is altered is only the one thing."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import trebucheck as tb
from scipy.integrate import trapezoid
from trebucheck.reference.equations import Equations
from trebucheck.reference.perturbed import (
    TOLERANCE,
    solve_scheduled,
    with_joint_element,
    without_centrifugal,
)
from trebucheck.reference.solver import solve

Build = Callable[..., tb.Mechanism]
# By how much the motion grows an error until then, generously: the whip's own factor is some 1e4
AMPLIFIED = 1e6


def test_the_right_schedule_gives_the_right_motion(build: Build) -> None:
    problem = tb.Problem(build(), duration=2.4)
    right = solve(problem)
    again = solve_scheduled(problem, right.release_times)
    t = np.linspace(0.0, 2.4, 200)
    assert np.abs(again.motion(t).q - right.motion(t).q).max() < AMPLIFIED * TOLERANCE
    assert again.release_times == dict(right.release_times)


def test_a_stop_that_never_opens_pulls(build: Build) -> None:
    problem = tb.Problem(build(), duration=2.0)
    right = solve(problem).release_times
    held = solve_scheduled(problem, {**right, "sling rest": None})
    torque = held.motion(np.linspace(1.9, 2.0, 20)).stop_torques["sling rest"]
    gap = held.trajectory(np.linspace(0.0, 2.0, 50)).stop_gap("sling rest")
    assert np.all(torque < 0)
    assert np.abs(gap).max() < AMPLIFIED * TOLERANCE


def test_stops_not_named_are_open_from_the_start(build: Build) -> None:
    problem = tb.Problem(build(), duration=0.5)
    free = solve_scheduled(problem, {})
    assert free.segments[0].closed == ()


def test_an_unknown_stop_is_refused(build: Build) -> None:
    with pytest.raises(tb.InputError, match="releases names the stop 'nobody'"):
        solve_scheduled(tb.Problem(build(), duration=0.5), {"nobody": 0.1})


def test_damping_takes_energy_as_fast_as_it_should(build: Build) -> None:
    """dE/dt = -c w^2 of the joint's relative speed w; the rest of the equations conserve energy."""
    mechanism, damping = build(), 50.0
    solution = solve_scheduled(
        tb.Problem(mechanism, duration=1.0),
        {},
        with_joint_element(mechanism, "hanger pin", damping=damping),
    )
    t = np.linspace(0.0, 1.0, 4001)
    trajectory = solution.trajectory(t)
    relative = trajectory.u[:, 2] - trajectory.u[:, 0]
    taken = trapezoid(damping * relative**2, t)
    lost = trajectory.total_energy[0] - trajectory.total_energy[-1]
    assert lost == pytest.approx(
        taken, rel=1e-6
    )  # the trapezoidal rule's h^2 on a motion over some tenths of a second


def test_armature_is_kinetic_energy_of_the_relative_speed(build: Build) -> None:
    mechanism, armature = build(), 300.0
    random = np.random.default_rng(1)
    q, u = random.normal(size=(2, len(mechanism.coordinates)))
    plain, geared = (
        Equations(mechanism),
        with_joint_element(mechanism, "sling pin", armature=armature),
    )
    more = 0.5 * u @ (geared.mass_matrix(q) - plain.mass_matrix(q)) @ u
    assert more == pytest.approx(0.5 * armature * (u[1] - u[0]) ** 2, rel=1e-9)


def test_without_velocity_dependent_forces_only_they_are_missing(build: Build) -> None:
    mechanism = build()
    plain, less = Equations(mechanism), without_centrifugal(mechanism)
    random = np.random.default_rng(2)
    q, u = random.normal(size=(2, len(mechanism.coordinates)))
    still = np.zeros_like(u)
    # Equations with a fault are NumPy's, plain ones may be compiled: they differ by rounding.
    assert less.solve(q, u, ())[0] == pytest.approx(plain.solve(q, still, ())[0], rel=1e-12)
    assert not np.allclose(less.solve(q, u, ())[0], plain.solve(q, u, ())[0])
