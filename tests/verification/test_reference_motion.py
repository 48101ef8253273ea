"""Functions for users: the continuous reference motion, and its derivatives."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.models.library.registry import library_problem, model
from trebucheck.reference import solver
from trebucheck.reference.motion import StopImpact, StopOpening, problem_of, solve
from trebucheck.reference.sensitivity.release import whipper_sensitivities
from trebucheck.reference.sensitivity.sensitivities import sensitivities
from trebucheck.reference.sensitivity.variational import moved

TIMES = np.linspace(0.0, 2.9, 8)


def test_everything_is_that_of_a_trajectory() -> None:
    motion = solve(tb.rolling())
    read = solver.solve(tb.Problem(tb.rolling())).trajectory(TIMES)
    np.testing.assert_array_equal(motion.q(TIMES), read.q)
    np.testing.assert_array_equal(motion.u(TIMES), read.u)
    for name in ("projectile", "counterweight"):
        np.testing.assert_array_equal(motion.marker(name, TIMES), read.marker(name).position)
        velocity = motion.marker_velocity(name, TIMES)
        np.testing.assert_array_equal(velocity, read.marker(name).velocity)
    np.testing.assert_array_equal(motion.kinetic_energy(TIMES), read.kinetic_energy)
    np.testing.assert_array_equal(motion.potential_energy(TIMES), read.potential_energy)
    for name, torque in motion.stop_torques(TIMES).items():
        np.testing.assert_array_equal(torque, read.stop_torques[name])
    assert read.joint_reactions is not None
    assert motion.joint_reactions(TIMES).keys() == read.joint_reactions.keys()
    for name, force in motion.joint_reactions(TIMES).items():
        np.testing.assert_array_equal(force, read.joint_reactions[name])
    np.testing.assert_array_equal(motion.trajectory(TIMES).q, read.q)


def test_one_time_has_no_axis_of_times() -> None:
    motion = solve("fixed")
    assert motion.q(0.5).shape == motion.u(0.5).shape == motion.a(0.5).shape == (3,)
    assert motion.marker("projectile", 0.5).shape == (2,)
    assert np.shape(motion.kinetic_energy(0.5)) == ()
    assert motion.q([0.5]).shape == (1, 3)
    step = 1e-4
    difference = (motion.q(0.5 + step) - motion.q(0.5 - step)) / (2 * step)
    np.testing.assert_allclose(motion.u(0.5), difference, rtol=1e-6)
    difference = (motion.u(0.5 + step) - motion.u(0.5 - step)) / (2 * step)
    np.testing.assert_allclose(motion.a(0.5), difference, rtol=1e-6)


def test_events_are_records_in_the_order_of_time() -> None:
    motion = solve("fixed")
    openings, launch = motion.events[:2], motion.events[2]
    assert [type(event) for event in openings] == [StopOpening, StopOpening]
    releases = motion.solution.release_times
    opened = {name: time for name, time in releases.items() if time is not None}
    assert {event.stop: event.time for event in openings} == opened
    assert isinstance(launch, tb.Launch)
    assert launch == motion.solution.launch
    times = [event.time for event in motion.events]
    assert times == sorted(times)
    bounces = [event for event in solve("bouncing").events if isinstance(event, StopImpact)]
    assert [(b.time, b.impulses) for b in bounces] == list(solve("bouncing").solution.impacts)
    assert "sling rest opens" in motion._repr_html_()
    assert "launch" in motion._repr_html_()


def test_a_mechanism_a_name_a_problem_and_a_path_are_taken(tmp_path: Path) -> None:
    path, mechanism = tmp_path / "machine.json", model("pendulum")
    path.write_text(mechanism.to_json())
    problem = tb.Problem(mechanism, duration=1.5, stop_law=tb.StopLaw.UNILATERAL)
    motions = [solve(each, 1.5) for each in (mechanism, "pendulum", path, str(path))]
    motions += [solve(problem), solve(problem, 1.5)]
    for motion in motions:
        assert motion.duration == 1.5
        np.testing.assert_array_equal(motion.q(1.0), motions[0].q(1.0))
    assert problem_of(problem) == problem
    assert problem_of(problem, stop_law="release-once").stop_law is tb.StopLaw.RELEASE_ONCE
    library = library_problem("pendulum")
    assert library is not None
    assert solve("pendulum").duration == library.duration
    assert solve(mechanism).duration == tb.Problem(mechanism).duration


def test_mistakes_are_sentences() -> None:
    motion = solve("fixed", 0.5)
    with pytest.raises(tb.InputError, match=r"no marker 'stone'.*projectile"):
        motion.marker("stone", 0.1)
    for outside in (-0.1, 0.6, float("nan"), [[0.1]]):
        with pytest.raises(tb.InputError):
            motion.q(outside)
    with pytest.raises(tb.InputError, match="fxied"):
        solve("fxied")
    with pytest.raises(tb.InputError, match=r"nothing\.json"):
        solve("nothing.json")
    with pytest.raises(tb.InputError, match="duration"):
        solve("fixed", -1.0)
    with pytest.raises(tb.InputError, match="stop_law"):
        solve("fixed", stop_law="sticky")


def test_a_coarser_tolerance_is_taken() -> None:
    coarse, fine = solve("fixed", 1.0, tolerance=1e-6), solve("fixed", 1.0)
    assert coarse.solution.evaluations < fine.solution.evaluations
    assert 1e-12 < np.abs(coarse.q(1.0) - fine.q(1.0)).max() < 1e-4


def test_derivatives_are_those_of_the_motion() -> None:
    mechanism, at, step = tb.hinged(), 0.9, 1e-5
    numbers = ["gravity", "mass of arm", "start speed of theta"]
    table = sensitivities(mechanism, at, numbers=numbers)
    paths = {"gravity": "gravity", "mass of arm": "bodies.arm.mass"}
    for number, path in paths.items():
        up, down = (solve(moved(mechanism, {path: sign * step})) for sign in (1.0, -1.0))
        for i, name in enumerate(mechanism.coordinates):
            difference = (up.q(at) - down.q(at))[i] / (2 * step)
            assert table.derivative("coordinate", name, number) == pytest.approx(
                difference, rel=1e-5, abs=1e-6
            )
        place = (up.marker("projectile", at) - down.marker("projectile", at)) / (2 * step)
        found = [table.derivative(axis, "projectile", number) for axis in "xy"]
        np.testing.assert_allclose(found, place, rtol=1e-5, atol=1e-6)
    assert {row.number for row in table.derivatives} == set(numbers)
    assert len(table.to_dataframe()) == len(table.derivatives)
    assert "Sensitivities of" in table._repr_html_()


def test_derivatives_of_the_launch_are_those_of_the_whipper() -> None:
    table, whipper = sensitivities(tb.fixed()), whipper_sensitivities(tb.fixed)
    assert table.time == pytest.approx(whipper.launch_time, rel=1e-14)
    i = whipper.names.index("g")
    launch = (
        table.derivative("launch time", "projectile", "gravity"),
        table.derivative("launch speed", "projectile", "gravity"),
    )
    assert launch == pytest.approx((whipper.d_launch_time[i], whipper.d_launch_speed[i]), rel=1e-8)
    for stop in ("hanger rest", "sling rest"):
        opening = table.derivative("opening time", stop, "gravity")
        assert opening == pytest.approx(whipper.d_release_times[stop][i], rel=1e-8)


def test_a_motion_is_differentiated_at_its_launch_or_at_its_end() -> None:
    still = tb.sensitivities("pendulum", numbers=["gravity"], duration=0.3)
    assert still.time == 0.3
    thrown = tb.sensitivities("catapult", numbers=["gravity"], duration=2.5)
    launch = solve(tb.Problem(tb.catapult(), duration=2.5)).launch
    assert launch is not None and thrown.time == launch.time
    assert {row.quantity for row in thrown.derivatives} >= {"launch time", "launch speed"}


def test_impact_times_have_derivatives() -> None:
    """A ball dropped from rest: t = sqrt(2 h / g), dt/dg = -t / (2 g)."""
    first = solve("bouncing").events[0]
    table = sensitivities("bouncing", first.time + 0.1, numbers=["gravity"])
    gravity = model("bouncing").gravity
    expected = -first.time / (2 * gravity)
    assert table.derivative("impact time", "1", "gravity") == pytest.approx(expected, rel=1e-9)


def test_unknown_numbers_and_quantities_are_refused() -> None:
    with pytest.raises(tb.InputError, match=r"'colour'.*gravity"):
        sensitivities("pendulum", 1.0, numbers=["colour"])
    table = sensitivities("pendulum", 1.0, numbers=["gravity"])
    with pytest.raises(tb.InputError, match="'x' of 'stone'"):
        table.derivative("x", "stone", "gravity")
    with pytest.raises(tb.InputError, match="outside"):
        sensitivities("pendulum", -1.0)


def test_numbers_that_would_lock_the_mechanism_are_noted() -> None:
    table = sensitivities("three-cranks", 0.1)
    names = {row.number for row in table.derivatives}
    locked = [note for note in table.notes if "lock the mechanism" in note]
    assert locked
    assert "gravity" in names
    for note in locked:
        assert not any(f"by the {name}:" in note for name in names)


def test_a_derivative_that_does_not_exist_is_nan_and_noted() -> None:
    """A bob held by a wall from which it would rebound for ever, were it kicked."""
    bob = tb.Body(name="bob", angle="b", mass=1.0, centre=(1.0, 0.0), inertia=0.0)
    pin = tb.PinJoint(
        name="pin", parent="ground", child="bob", parent_point=(0, 0), child_point=(0, 0)
    )
    wall = tb.Stop(
        name="wall", body="bob", sense=-1, limit=-np.pi / 3, closed=True, restitution=1.0
    )
    mechanism = tb.Mechanism(
        name="hanging",
        bodies=(bob,),
        joints=(pin,),
        stops=(wall,),
        gravity=9.81,
        start=(np.pi / 3,),
    )
    table = sensitivities(mechanism, 0.1)
    for row in table.derivatives:
        assert np.isnan(row.value) == (row.number == "start speed of b")
    assert any("no derivative by start speed of b" in note for note in table.notes)
