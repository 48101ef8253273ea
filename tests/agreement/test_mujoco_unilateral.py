"""MuJoCo's assisted preset under the unilateral law.

Impacts, rebounds, rest, loops, and machines that run into a stop.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Iterable, Mapping

import numpy as np
import pytest
from conftest import again
from mechanisms import (
    TABLE_ONE,
    G,
    angle_stop,
    chain,
    floor,
    four_bar,
    hanging_bob,
    parallel_cranks,
    rod_pendulum,
    slider_crank,
)
from trebucheck.comparisons.campaigns.random_mechanisms import random_mechanism
from trebucheck.engines.mujoco.engine import MujocoEngine
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import GROUND, PinJoint, PointStop, SlotJoint, Stop
from trebucheck.models.library.trebuchet import ARM_STOP
from trebucheck.models.mechanism import Body, Marker, Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.models.trajectory import Trajectory
from trebucheck.reference.solution import Solution
from trebucheck.reference.solver import solve

pytest.importorskip("mujoco")

STEPS = (8e-3, 4e-3, 2e-3)
LEAST_RATIO = (
    3.0  # of the errors at a step and at half of it: 4, but for where in a step the events are
)
# [rad, m] free flights are of fourth order: below this there is nothing to see of the order
RESOLVED = 1e-9


def ball(restitution: float, height: float = 1.0) -> Mechanism:
    """A ball of 2 kg on a vertical rail over a floor."""
    stop = PointStop(
        name="floor",
        body="ball",
        point=(0, 0),
        normal=(0, 1),
        offset=0.0,
        closed=False,
        restitution=restitution,
    )
    rail = SlotJoint(
        name="rail",
        child="ball",
        parent_point=(0, 0),
        child_point=(0, 0),
        axis=(0, 1),
        coordinate="height",
    )
    return Mechanism(
        name="ball",
        bodies=(Body(name="ball", angle="turn", mass=2.0, centre=(0, 0), inertia=1.0),),
        joints=(rail,),
        stops=(stop,),
        markers=(Marker(name="centre", body="ball", point=(0, 0)),),
        gravity=G,
        start=(0.0, height),
    )


def between_stops(restitution: float, low: float = 0.6, high: float = 0.6) -> Mechanism:
    """A double pendulum whose elbow turns between two stops."""
    stops = tuple(
        Stop(
            name=name, body="lower", relative_to="upper", sense=sense, limit=-limit, closed=False,
            restitution=restitution,
        )
        for name, sense, limit in (("back", -1, low), ("front", 1, high))
    )  # fmt: skip
    return Mechanism(
        name="double pendulum",
        bodies=(
            Body(name="upper", angle="a", mass=2, centre=(0.5, 0), inertia=0.2),
            Body(name="lower", angle="b", mass=1, centre=(0.4, 0), inertia=0.05),
        ),
        joints=(
            PinJoint(
                name="shoulder",
                parent=GROUND,
                child="upper",
                parent_point=(0, 0),
                child_point=(0, 0),
            ),
            PinJoint(
                name="elbow", parent="upper", child="lower", parent_point=(1, 0), child_point=(0, 0)
            ),
        ),
        stops=stops,
        markers=(Marker(name="tip", body="lower", point=(1, 0)),),
        gravity=G,
        start=(0.1, 0.4),
    )


def rod_over_a_floor(restitution: float) -> Mechanism:
    """A rod with inertia, a point of which off its axis meets a floor."""
    return Mechanism(
        **{
            **dict(rod_pendulum()),
            "stops": (floor(1.2, restitution, body="rod", point=(1.6, 0.1)),),
        }
    )


def rebounding(mechanism: Mechanism, restitution: float) -> Mechanism:
    """The mechanism with one restitution of all stops."""
    stops = tuple(stop.model_copy(update={"restitution": restitution}) for stop in mechanism.stops)
    return mechanism.model_copy(update={"stops": stops})


CASES: dict[str, tuple[Mechanism, float]] = {
    "fixed": (TABLE_ONE["fixed"], 3.5),
    "rolling": (TABLE_ONE["rolling"], 3.1),
    "fixed, e = 0.5": (rebounding(TABLE_ONE["fixed"], 0.5), 3.5),
    "between two stops, e = 0": (between_stops(0.0), 3.0),
    "between two stops, e = 0.9": (between_stops(0.9), 3.0),
    "rod over a floor, e = 0": (rod_over_a_floor(0.0), 2.0),
    "rod over a floor, e = 0.5": (rod_over_a_floor(0.5), 2.0),
    "bob over a floor, e = 0.9": (hanging_bob(floor(1.5, 0.9)), 3.0),
    "two stops met at one instant": (
        hanging_bob(floor(1.0, 0.5), angle_stop(math.pi / 6, 0.5)),
        1.5,
    ),
    "crank of a four-bar": (four_bar(stops=(angle_stop(1.0, 0.5, body="crank"),)), 1.3),
    "tip of a slider crank": (
        slider_crank(
            stops=(
                PointStop(
                    name="end", body="rod", point=(2.0, 0), normal=(1, 0), offset=-1.0, closed=False
                ),
                angle_stop(1.5, 0.9, body="crank"),
            )
        ),
        1.4,
    ),
    "redundant cranks, e = 0.5": (parallel_cranks(3, angle_stop(1.9, 0.5, body="crank 1")), 1.0),
}
SAME = (
    "rolling",
    "between two stops, e = 0.9",
    "rod over a floor, e = 0",
    "tip of a slider crank",
    "crank of a four-bar",  # as the redundant cranks, and as the loops that drifted below
)
cases = pytest.mark.parametrize(
    "name", [pytest.param(name, marks=again if name in SAME else ()) for name in CASES]
)


@functools.cache
def reference(name: str) -> Solution:
    mechanism, duration = CASES[name]
    return solve(Problem(mechanism, duration, stop_law=StopLaw.UNILATERAL))


@functools.cache
def run(name: str, timestep: float) -> Trajectory:
    return MujocoEngine(timestep=timestep).simulate(reference(name).problem)


def misplaced(found: Trajectory, exact: Solution) -> float:
    """Largest error of a coordinate [rad, m]."""
    return float(np.abs(found.q - exact.trajectory(found.t).q).max())


@cases
def test_of_second_order_through_impacts(name: str) -> None:
    errors = [misplaced(run(name, step), reference(name)) for step in STEPS]
    for coarse, fine in itertools.pairwise(errors):
        assert fine <= RESOLVED or coarse / fine > LEAST_RATIO
    assert errors[-1] < 1e-6


@cases
def test_impacts_in_number_time_and_impulse(name: str) -> None:
    found, exact = run(name, STEPS[-1]), reference(name)
    assert exact.impacts
    both = noticeable(exact, found.impacts), noticeable(exact, exact.impacts)
    for (mine, push), (time, impulses) in zip(*both, strict=True):
        assert mine == pytest.approx(time, abs=1e-6)
        # Where two touch at one instant only what they do together is determined, and not which of
        # them does it. The error of a speed is that of the motion, which counts for more the slower
        # the impact.
        largest = np.abs(together(exact, exact.impacts[0])).max()
        assert together(exact, (time, push)) == pytest.approx(
            together(exact, (time, impulses)), abs=1e-6 * largest
        )


Impacts = Iterable[tuple[float, Mapping[str, float]]]


def noticeable(exact: Solution, impacts: Impacts) -> list[tuple[float, Mapping[str, float]]]:
    """The impacts with at least 1e-5 of the largest impulse.

    The last rebounds are no question of accuracy: the reference follows them down to a part of the
    mechanism's speeds, an engine to a speed in SI.
    """
    least = 1e-5 * max(size(exact, impact) for impact in exact.impacts)
    return [impact for impact in impacts if size(exact, impact) >= least]


def taking_part(exact: Solution, impacts: Impacts) -> list[set[str]]:
    """The stops that have at least 1e-5 of the largest impulse, by impact."""
    least = 1e-5 * max(size(exact, impact) for impact in exact.impacts)
    return [
        {name for name, push in pushes.items() if size(exact, (t, {name: push})) >= least}
        for t, pushes in impacts
    ]


def size(exact: Solution, impact: tuple[float, Mapping[str, float]]) -> float:
    """Largest component of the generalized impulse of an impact."""
    return float(np.abs(together(exact, impact)).max())


def together(exact: Solution, impact: tuple[float, Mapping[str, float]]) -> FloatArray:
    """Generalized impulse of an impact, shape (n_q,)."""
    time, impulses = impact
    q = exact.trajectory(np.array([time])).q[0]
    rows = [
        exact.equations.kinematics.gap_jacobian(name, q) * push for name, push in impulses.items()
    ]
    return np.sum(rows, axis=0)


@cases
def test_no_stop_is_penetrated_or_pulls(name: str) -> None:
    found = run(name, STEPS[-1])
    assert np.all(np.diff(found.t) > 0)
    assert found.t[-1] == CASES[name][1]
    for stop in found.mechanism.stops:
        # As far as a soft limit gives way, (1 - impedance) h^2 times the acceleration that it
        # holds.
        assert found.stop_gap(stop.name).min() > -1e-7
        assert np.all(found.stop_torque(stop.name) >= 0)


@pytest.mark.parametrize("name", TABLE_ONE)
def test_the_arm_stop_is_met_to_the_micrometre(name: str) -> None:
    found, exact = run(name, 1e-3), reference(name)
    time = exact.impacts[0][0]
    error = np.abs(
        found.marker("projectile").position
        - exact.trajectory(found.t).marker("projectile").position
    )
    assert error[found.t < time].max() < 1e-6
    assert found.impacts[0][0] == pytest.approx(time, abs=1e-6)
    there = exact.trajectory(found.t).stop_torque(ARM_STOP)
    later = found.t > time
    assert there[later].max() > 0
    assert np.abs(found.stop_torque(ARM_STOP) - there)[later].max() < 1e-5 * there.max()


@pytest.mark.parametrize("e", [0.0, 0.5, 0.9, 1.0])
def test_a_ball_falls_and_rebounds_as_in_the_books(e: float) -> None:
    """Fall sqrt(2 H / g), rebounds of 2 e^k v / g, impulses (1 + e) m e^k v.

    With e < 1 at rest in the end.
    """
    height, until = 0.25, 3.0
    found = MujocoEngine().simulate(Problem(ball(e, height), until, stop_law=StopLaw.UNILATERAL))
    speed = math.sqrt(2 * G * height)
    speeds = speed * e ** np.arange(40)
    times = speed / G + np.concatenate([[0.0], np.cumsum(2 * e * speeds / G)])[:40]
    expected = [
        (t, v) for t, v in zip(times, speeds, strict=True) if t < until and v > 1e-3 * speed
    ]
    assert len(found.impacts) >= len(expected)
    for (time, push), (t, v) in zip(found.impacts, expected, strict=False):
        assert time == pytest.approx(t, abs=1e-12)
        assert push["floor"] == pytest.approx(2.0 * (1 + e) * v, rel=1e-9)
    energy = 2.0 * G * height
    if e == 1.0:
        assert len(found.impacts) == len(expected)
        assert found.total_energy == pytest.approx(energy, rel=1e-11)
    elif times[-1] < until:
        assert found.q[-1, 1] == pytest.approx(0.0, abs=1e-9)
        assert found.stop_torque("floor")[-1] == pytest.approx(2.0 * G, rel=1e-9)


def test_it_starts_with_an_impact_or_an_opening() -> None:
    rest = Stop(name="rest", body="bob", sense=-1, limit=0.0, closed=True, restitution=0.5)
    driven, leaving = (hanging_bob(rest, start_speeds=(speed,)) for speed in (2.0, -2.0))
    for mechanism in (driven, leaving):
        problem = Problem(mechanism, 0.3, stop_law=StopLaw.UNILATERAL)
        found, exact = MujocoEngine().simulate(problem), solve(problem)
        assert found.release_times == exact.release_times == {"rest": 0.0}
        assert len(found.impacts) == len(exact.impacts)
        for (time, push), (_, impulses) in zip(found.impacts, exact.impacts, strict=True):
            assert (time, push) == (0.0, pytest.approx(impulses, rel=1e-12))
        assert found.u[0] == pytest.approx(exact.trajectory(found.t).u[0], rel=1e-12)
        assert misplaced(found, exact) < RESOLVED


def test_a_stop_that_is_met_and_left_within_one_step() -> None:
    """A point passes 1e-6 m inside the floor, between two samples that are both above it."""
    dip = 1e-6
    mechanism = hanging_bob(floor(2.0 - dip), start=0.3)
    problem = Problem(mechanism, 1.4, stop_law=StopLaw.UNILATERAL)
    exact = solve(problem)
    (time, impulses), *_ = exact.impacts
    inside = 2 * math.sqrt(2 * dip / G)  # [s] as long as the floor is below the circle, roughly
    step = time / (math.floor(time / (4 * inside)) + 0.5)
    found = MujocoEngine(timestep=step).simulate(problem)
    assert found.impacts[0][0] == pytest.approx(time, abs=1e-9)
    assert found.impacts[0][1] == pytest.approx(impulses, rel=1e-5)


def test_nothing_is_met_before_the_launch() -> None:
    """Under either law the same motion, to the last bit."""
    laws = [
        MujocoEngine().simulate(Problem(TABLE_ONE["fixed"], 2.7, stop_law=law)) for law in StopLaw
    ]
    assert np.array_equal(laws[0].q, laws[1].q)
    assert laws[0].release_times == laws[1].release_times


def test_a_stop_given_twice_acts_as_once() -> None:
    once = hanging_bob(floor(1.0, 0.5))
    (stop,) = once.stops
    twice = once.model_copy(update={"stops": (stop, stop.model_copy(update={"name": "twin"}))})
    single, double = (
        MujocoEngine(timestep=4e-3).simulate(Problem(mechanism, 1.5, stop_law=StopLaw.UNILATERAL))
        for mechanism in (once, twice)
    )
    assert all(set(impulses) == {"floor", "twin"} for _, impulses in double.impacts)
    assert double.q[-1] == pytest.approx(single.q[-1], abs=1e-9)


@pytest.mark.parametrize("seed", [*range(2), *(pytest.param(k, marks=again) for k in range(2, 10))])
def test_random_machines(seed: int) -> None:
    """Chains of two bodies, off every axis, between two stops on each joint and over a floor.

    Each with its own e.
    """
    rng = np.random.default_rng(seed)
    base = chain(start_speeds=tuple(rng.normal(0.0, 2.0, 2)), hook=tuple(rng.uniform(-0.3, 0.3, 2)))
    a, b = base.start
    e = iter(rng.choice([0.0, 0.3, 0.7, 1.0], 5).tolist())
    room = iter(rng.uniform(0.3, 1.5, 5).tolist())
    stops = [
        Stop(
            name=f"{body} {sense}",
            body=body,
            relative_to=other,
            sense=sense,
            limit=sense * angle - next(room),
            closed=False,
            restitution=next(e),
        )
        for body, other, angle in (("upper", GROUND, a), ("lower", "upper", b - a))
        for sense in (1, -1)
    ]
    under = PointStop(
        name="floor",
        body="lower",
        point=(0.1, -1.5),
        normal=(0, 1),
        offset=-next(room) - 1.0,
        closed=False,
        restitution=next(e),
    )
    problem = Problem(
        Mechanism(**{**dict(base), "stops": (*stops, under)}), 1.5, stop_law=StopLaw.UNILATERAL
    )
    exact, found = solve(problem), MujocoEngine().simulate(problem)
    assert len(exact.impacts) > 0
    mine, theirs = noticeable(exact, found.impacts), noticeable(exact, exact.impacts)
    assert taking_part(exact, mine) == taking_part(exact, theirs)
    assert np.array([t for t, _ in mine]) == pytest.approx(
        np.array([t for t, _ in theirs]), abs=1e-6
    )
    assert misplaced(found, exact) < 1e-6


@pytest.mark.slow
def test_what_loops_drifted_by_is_no_force_after_an_impact() -> None:
    """A slot 2e-11 m off, in balance with its rate until then, was a force of 1.2e-3 of 0.23 N for
    some steps.
    """
    problem = Problem(random_mechanism(171), duration=0.428, stop_law=StopLaw.UNILATERAL)
    found, exact = MujocoEngine(timestep=1.83e-4).simulate(problem), solve(problem)
    (time, _), *_ = exact.impacts
    after = found.t > time + 1e-9
    forces = exact.trajectory(found.t[after]).stop_torques["stop 0"]
    assert after.sum() > 5
    assert found.stop_torques["stop 0"][after] == pytest.approx(
        forces, rel=1e-5
    )  # (h / T)^2 is 1e-6, T = 0.18 s
