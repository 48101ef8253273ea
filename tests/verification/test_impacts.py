"""Stops that close again: impulses, energy losses and resting against closed forms.

The law at all times.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
import trebucheck as tb
from conftest import machine_parameters, machines
from hypothesis import given
from trebucheck.comparisons.campaigns.random_mechanisms import random_mechanism
from trebucheck.reference.equations import Equations
from trebucheck.reference.solution import Solution
from trebucheck.reference.solver import solve

pytestmark = pytest.mark.slow  # many machines, or many integrations: not in `make quick`

G, MASS, LENGTH = 9.81, 3.0, 2.0
LEVEL, DOWN = 0.0, math.pi / 2


def _bob(name: str, angle: str, where: float = 0.0) -> tuple[tb.Body, tb.PinJoint]:
    body = tb.Body(name=name, angle=angle, mass=MASS, centre=(LENGTH, 0), inertia=0.0)
    pin = tb.PinJoint(
        name=f"{name} pin", parent="ground", child=name, parent_point=(where, 0), child_point=(0, 0)
    )
    return body, pin


def _pendulum(
    restitution: float, limit: float = DOWN, gravity: float = G, **changes: object
) -> tb.Mechanism:
    """A bob let go level, with a stop at `limit`."""
    body, pin = _bob("bob", "beta")
    stop = tb.Stop(
        name="stop", body="bob", sense=-1, limit=-limit, closed=False, restitution=restitution
    )
    fields = {
        "name": "pendulum",
        "bodies": (body,),
        "joints": (pin,),
        "stops": (stop,),
        "gravity": gravity,
    }
    return tb.Mechanism(**{**fields, "start": (LEVEL,), **changes})


def _unilateral(mechanism: tb.Mechanism, duration: float) -> Solution:
    return solve(tb.Problem(mechanism, duration=duration, stop_law="unilateral"))


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_one_body(e: float) -> None:
    """P = (1 + e) m l v, energy after = e^2 of the one before."""
    solution = _unilateral(_pendulum(e), 1.2)
    time, impulses = solution.impacts[0]
    speed = math.sqrt(2 * G * LENGTH)
    assert impulses["stop"] == pytest.approx((1 + e) * MASS * LENGTH * speed, rel=1e-11)
    just_after = solution.trajectory(np.array([time])).kinetic_energy[0]
    assert just_after == pytest.approx(e**2 * 0.5 * MASS * speed**2, rel=1e-10, abs=1e-9)


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_arm_stop_after_the_launch(build: Callable[..., tb.Mechanism], e: float) -> None:
    """P = (1 + e)|v| / A and loss (1 - e^2) v^2 / (2 A), with A = G M^-1 G^T the inverse inertia
    the stop feels.
    """
    fields = build().model_dump()
    fields["stops"][2]["restitution"] = e
    machine = tb.Mechanism(**fields)
    solution = _unilateral(machine, 3.05)
    assert solution.launch is not None
    time, impulses = solution.impacts[0]
    assert time > solution.launch.time
    before = solution.segments[2]
    assert before.end == time
    state = np.asarray(before.interpolant(time))
    q, u = np.split(state, 2)
    row = solution.equations.kinematics.gap_jacobian("arm stop", q)
    felt = row @ np.linalg.solve(solution.equations.mass_matrix(q), row)
    speed = float(row @ u)
    assert impulses["arm stop"] == pytest.approx(-(1 + e) * speed / felt, rel=1e-12)
    energies = solution.trajectory(np.array([np.nextafter(time, 0.0), time])).total_energy
    expected = (1 - e**2) * speed**2 / (2 * felt)
    # Relative to the energy in play: the difference of two energies keeps that many digits.
    assert energies[0] - energies[1] == pytest.approx(expected, abs=1e-11 * abs(energies[0]) + 1e-6)


def test_two_stops_at_once_on_a_double_pendulum() -> None:
    """Straight, weightless, turning as one.

    Both links meet their stops at one instant, and P = M u stops both.
    """
    omega = 1.3
    upper = tb.Body(name="upper", angle="a", mass=2.0, centre=(0.6, 0), inertia=0.1)
    lower = tb.Body(name="lower", angle="b", mass=1.0, centre=(0.9, 0), inertia=0.2)
    mechanism = tb.Mechanism(
        name="double pendulum",
        bodies=(upper, lower),
        joints=(
            tb.PinJoint(
                name="shoulder",
                parent="ground",
                child="upper",
                parent_point=(0, 0),
                child_point=(0, 0),
            ),
            tb.PinJoint(
                name="elbow",
                parent="upper",
                child="lower",
                parent_point=(1.5, 0),
                child_point=(0, 0),
            ),
        ),
        stops=tuple(
            tb.Stop(name=f"{name} stop", body=name, sense=-1, limit=-DOWN, closed=False)
            for name in ("upper", "lower")
        ),
        gravity=0.0,
        start=(0.0, 0.0),
        start_speeds=(omega, omega),
    )
    solution = _unilateral(mechanism, 2.0)
    ((time, impulses),) = solution.impacts
    assert time == pytest.approx(DOWN / omega, rel=1e-13)
    expected = Equations(mechanism).mass_matrix(np.array([DOWN, DOWN])) @ np.array([omega, omega])
    assert [impulses["upper stop"], impulses["lower stop"]] == pytest.approx(expected, rel=1e-11)
    assert solution.motion(np.array([2.0])).u[0] == pytest.approx([0.0, 0.0], abs=1e-12)


def test_two_bodies_that_meet_their_stops_together_do_not_disturb_each_other() -> None:
    (left, left_pin), (right, right_pin) = _bob("left", "a"), _bob("right", "b", where=9.0)
    stops = tuple(
        tb.Stop(name=name, body=name, sense=-1, limit=-DOWN, closed=False, restitution=e)
        for name, e in (("left", 0.0), ("right", 0.5))
    )
    both = tb.Mechanism(
        name="two",
        bodies=(left, right),
        joints=(left_pin, right_pin),
        stops=stops,
        gravity=G,
        start=(LEVEL, LEVEL),
    )
    solution = _unilateral(both, 1.0)
    (_, impulses), *_ = solution.impacts
    momentum = MASS * LENGTH * math.sqrt(2 * G * LENGTH)
    assert impulses["left"] == pytest.approx(momentum, rel=1e-11)
    assert impulses["right"] == pytest.approx(1.5 * momentum, rel=1e-11)


@pytest.mark.parametrize("e", [0.3, 0.7])
def test_bouncing_settles(e: float) -> None:
    """Against a stop at 30 degrees below level gravity presses on: rebounds die away, then the stop
    carries m g l cos.

    Close to the stop the motion is a fall with constant acceleration a, so the bounces sum up to 2
    e v / ((1 - e) a).
    """
    limit = math.pi / 6
    solution = _unilateral(_pendulum(e, limit), 12.0)
    speeds = e ** np.arange(len(solution.impacts))
    assert 0.5 * math.log(1e-6) / math.log(e) < len(speeds) < 1.5 * math.log(1e-6) / math.log(e) + 3
    end = solution.motion(np.array([12.0]))
    assert end.u[0, 0] == pytest.approx(0.0, abs=1e-12)
    assert end.q[0, 0] == pytest.approx(limit, abs=1e-12)
    assert end.stop_torques["stop"][0] == pytest.approx(
        MASS * G * LENGTH * math.cos(limit), rel=1e-12
    )
    gaps = np.array(
        [b[0] - a[0] for a, b in zip(solution.impacts, solution.impacts[1:], strict=False)]
    )
    # Late rebounds are short: each lasts e times the one before.
    assert gaps[-4:-1] / gaps[-5:-2] == pytest.approx(e, rel=1e-3)


def test_elastic_bouncing_keeps_its_energy_and_does_not_settle() -> None:
    solution = _unilateral(_pendulum(1.0, math.pi / 6), 20.0)
    assert len(solution.impacts) > 20
    energy = solution.trajectory(np.linspace(0, 20, 500)).total_energy
    assert np.abs(energy).max() < 1e-10 * MASS * G * LENGTH


def test_a_start_that_drives_into_a_closed_stop_is_an_impact_at_once() -> None:
    body, pin = _bob("bob", "beta")
    rest = tb.Stop(name="rest", body="bob", sense=-1, limit=0.0, closed=True, restitution=0.0)
    machine = tb.Mechanism(
        name="pressed",
        bodies=(body,),
        joints=(pin,),
        stops=(rest,),
        gravity=G,
        start=(0.0,),
        start_speeds=(2.0,),
    )
    solution = _unilateral(machine, 0.5)
    ((time, impulses),) = solution.impacts
    assert (time, impulses["rest"]) == (0.0, pytest.approx(MASS * LENGTH**2 * 2.0))
    assert solution.release_times["rest"] is None


def test_a_start_that_leaves_a_closed_stop_opens_it() -> None:
    body, pin = _bob("bob", "beta")
    rest = tb.Stop(name="rest", body="bob", sense=-1, limit=0.0, closed=True)
    machine = tb.Mechanism(
        name="leaving",
        bodies=(body,),
        joints=(pin,),
        stops=(rest,),
        gravity=G,
        start=(0.0,),
        start_speeds=(-2.0,),
    )
    solution = _unilateral(machine, 0.1)
    assert solution.release_times["rest"] == 0.0
    assert not solution.impacts


def test_a_loop_that_does_not_close_at_the_start_is_refused() -> None:
    body, pin = _bob("bob", "beta")
    slot = tb.SlotJoint(
        name="rail", child="bob", parent_point=(0, -0.5), child_point=(LENGTH, 0), axis=(1, 0)
    )
    open_loop = tb.Mechanism(
        name="open", bodies=(body,), joints=(pin, slot), gravity=G, start=(0.0,)
    )
    with pytest.raises(tb.InputError, match=r"start does not fit .*rail.* 0\.5 m"):
        solve(tb.Problem(open_loop, duration=0.1))


def test_up_to_launch_the_two_laws_are_the_same(build: Callable[..., tb.Mechanism]) -> None:
    once, again = (solve(tb.Problem(build(), duration=2.8, stop_law=law)) for law in tb.StopLaw)
    assert once.release_times["sling rest"] == again.release_times["sling rest"]
    assert once.launch is not None and again.launch is not None
    assert once.launch.time == pytest.approx(again.launch.time, abs=1e-14)


@machines(8)  # each goes on for six seconds, through its impacts
@given(parameters=machine_parameters())
def test_the_law_is_complementary_at_all_times(
    build: Callable[..., tb.Mechanism], parameters: tb.TrebuchetParameters
) -> None:
    """Six seconds, impacts included: gap >= 0, torque >= 0, torque * gap = 0."""
    fields = build(parameters).model_dump()
    for stop, e in zip(fields["stops"], (0.0, 0.4, 0.8), strict=True):
        stop["restitution"] = e
    solution = _unilateral(tb.Mechanism(**fields), 6.0)
    trajectory = solution.trajectory(np.linspace(0.0, 6.0, 3000))
    assert len(trajectory.mechanism.stops) > 0
    for stop in trajectory.mechanism.stops:
        torque, gap = trajectory.stop_torque(stop.name), trajectory.stop_gap(stop.name)
        peak = max(float(torque.max()), 1.0)
        # Interpolation between the integrator's steps, 1e-13 of turning some ten radians a second.
        assert gap.min() > -1e-9
        assert torque.min() > -1e-8 * peak
        assert np.abs(torque * gap).max() < 1e-9 * peak


def test_impacts_are_written_and_read(tmp_path: object) -> None:
    from trebucheck.models.trajectory import load, save

    problem = tb.Problem(_pendulum(0.5), duration=1.2, stop_law="unilateral")
    trajectory = tb.engine("reference").simulate(problem)
    save(trajectory, f"{tmp_path}/a.nc")
    assert load(f"{tmp_path}/a.nc").impacts == trajectory.impacts != ()


@pytest.mark.parametrize("coordinate", [0, 1, 2])
@pytest.mark.parametrize("kick", [1e-4, -1e-3])
def test_a_small_kick_against_the_rests_changes_little(
    build: Callable[..., tb.Mechanism], coordinate: int, kick: float
) -> None:
    """It rattles between two closed rests at once.

    What is left is a kick of the machine as a whole.
    """
    fields = build().model_dump()
    speeds = [0.0] * len(fields["start"])
    speeds[coordinate] = kick
    kicked = _unilateral(tb.Mechanism(**{**fields, "start_speeds": tuple(speeds)}), 2.8)
    plain = _unilateral(build(), 2.8)
    trajectory = kicked.trajectory(np.linspace(0.0, 2.5, 1000))
    assert min(trajectory.stop_gap(name).min() for name in ("hanger rest", "sling rest")) > -1e-12
    assert kicked.launch is not None and plain.launch is not None
    # Linear in the kick: at most two seconds of launch time per rad/s and thirty m/s of speed, on
    # either machine.
    assert abs(kicked.launch.time - plain.launch.time) < 2.0 * abs(kick)
    assert abs(kicked.launch.speed - plain.launch.speed) < 30.0 * abs(kick)


def test_stops_that_stand_against_each_other_do_not_jam_by_rounding() -> None:
    """Two stops hold a body from both sides.

    Both seem to be approached, by a rounding, and no speeds undo both.
    """
    found = _unilateral(random_mechanism(257), 1.0)
    assert found.problem.duration == 1.0
    assert all(
        abs(impulse) < 1e-12 for _, impulses in found.impacts for impulse in impulses.values()
    )
