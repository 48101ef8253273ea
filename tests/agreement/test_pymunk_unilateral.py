"""pymunk under the unilateral law.

Stops that are met, rebounds, rest, and machines that run into a stop.
"""

from __future__ import annotations

import functools
import itertools
import math

import numpy as np
import pytest
from mechanisms import angle_stop, misplaced, rod_pendulum
from trebucheck.engines.pymunk.engine import PymunkEngine
from trebucheck.models.elements import GROUND, PinJoint, PointStop, Stop
from trebucheck.models.library.trebuchet import ARM_STOP, fixed, rolling
from trebucheck.models.mechanism import Body, Marker, Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.models.trajectory import Trajectory
from trebucheck.reference.solution import Solution
from trebucheck.reference.solver import solve

pytest.importorskip("pymunk")

STEPS = (4e-3, 2e-3, 1e-3)


def pendulum(
    restitution: float, *, on: str = "floor", closed: bool = False, speed: float = 0.0
) -> Mechanism:
    """A bob of 2 kg on a rod of 1 m, over a floor 0.8 m below its pin or before a stop on its
    angle.
    """
    lowest = math.asin(0.8)
    floor = PointStop(
        name="stop",
        body="bob",
        point=(1, 0),
        normal=(0, 1),
        offset=-0.8,
        closed=closed,
        restitution=restitution,
    )
    angle = Stop(
        name="stop", body="bob", sense=-1, limit=-lowest, closed=closed, restitution=restitution
    )
    return Mechanism(
        name="pendulum",
        bodies=(Body(name="bob", angle="a", mass=2, centre=(1, 0), inertia=0),),
        joints=(
            PinJoint(
                name="pin", parent=GROUND, child="bob", parent_point=(0, 0), child_point=(0, 0)
            ),
        ),
        stops=(floor if on == "floor" else angle,),
        markers=(Marker(name="tip", body="bob", point=(1, 0)),),
        gravity=9.81,
        start=(lowest if closed else 0.1,),
        start_speeds=(speed,),
    )


def chain(restitution: float) -> Mechanism:
    """A rod before a stop on its angle, and a bob on it over a floor.

    The stops are met in turn, and at once.
    """
    return Mechanism(
        name="chain",
        bodies=(
            Body(name="rod", angle="a", mass=2, centre=(0.5, 0), inertia=0.2),
            Body(name="bob", angle="b", mass=1, centre=(0.6, 0), inertia=0),
        ),
        joints=(
            PinJoint(
                name="pin", parent=GROUND, child="rod", parent_point=(0, 0), child_point=(0, 0)
            ),
            PinJoint(
                name="elbow", parent="rod", child="bob", parent_point=(1, 0), child_point=(0, 0)
            ),
        ),
        stops=(
            Stop(
                name="wall", body="rod", sense=-1, limit=-1.4, closed=False, restitution=restitution
            ),
            PointStop(
                name="floor",
                body="bob",
                point=(0.6, 0),
                normal=(0, 1),
                offset=-1.5,
                closed=False,
                restitution=restitution,
            ),
        ),
        markers=(Marker(name="tip", body="bob", point=(0.6, 0)),),
        gravity=9.81,
        start=(0.1, 1.2),
    )


CASES: dict[str, tuple[Mechanism, float]] = {
    "onto the floor, e = 0": (pendulum(0.0), 1.5),
    "onto the floor, e = 0.5, to rest": (pendulum(0.5), 3.0),
    "onto an angle, e = 0.5, to rest": (pendulum(0.5, on="angle"), 3.0),
    "driven into the floor at the start": (pendulum(0.5, closed=True, speed=2.0), 2.0),
    "chain, e = 0": (chain(0.0), 0.7),
    "chain, e = 0.5": (chain(0.5), 1.0),
    "fixed": (fixed(), 3.1),
    "rolling": (rolling(), 2.8),
}
cases = pytest.mark.parametrize("name", CASES)


@functools.cache
def reference(name: str) -> Solution:
    mechanism, duration = CASES[name]
    return solve(Problem(mechanism, duration, stop_law=StopLaw.UNILATERAL))


@functools.cache
def run(name: str, timestep: float) -> Trajectory:
    return PymunkEngine(timestep=timestep).simulate(reference(name).problem)


@cases
def test_of_second_order_through_impacts(name: str) -> None:
    errors = [misplaced(run(name, step), reference(name)) for step in STEPS]
    # A quarter of the step: 16 times less; impacts fall elsewhere in a step, hence the margin.
    assert 10 < errors[0] / errors[2] < 25


@cases
def test_impacts_in_time_and_impulse(name: str) -> None:
    found, exact = run(name, 1e-3), reference(name)
    h, rests = found.t[1], 0.05  # [s] rebounds shorter than this may come to rest earlier here
    lasting = [
        (time, impulses) for time, impulses in exact.impacts if time < _last_flight(exact, rests)
    ]
    assert len(found.impacts) >= len(lasting) > 0
    for (mine, push), (time, impulses) in zip(found.impacts, lasting, strict=False):
        assert mine == pytest.approx(
            time, abs=50 * h**2
        )  # measured up to 10 h^2, at the rolling machine
        assert set(push) == set(impulses)
        for stop, impulse in impulses.items():
            # Speeds are off by a part of h^2 times the third derivative of the motion.
            assert push[stop] == pytest.approx(impulse, rel=1e-3)


def _last_flight(exact: Solution, shortest: float) -> float:
    """When flights between impacts become shorter than a time [s]."""
    times = [time for time, _ in exact.impacts]
    late = (end for begin, end in itertools.pairwise(times) if end - begin < shortest)
    return next(late, math.inf)


@cases
def test_no_stop_is_penetrated(name: str) -> None:
    found = run(name, 1e-3)
    assert np.all(np.diff(found.t) > 0)
    assert found.t[-1] == CASES[name][1]
    for stop in found.mechanism.stops:
        # A closed stop holds as a joint does: to h^4 of what goes on across it.
        assert found.stop_gap(stop.name).min() > -1e-9
        assert np.all(found.stop_torque(stop.name) >= 0)


def test_what_comes_to_rest_presses_with_its_weight() -> None:
    found = run("onto the floor, e = 0.5, to rest", 1e-3)
    later = found.t > 2.5
    # A massless rod and a floor: its force across the rod's line balances gravity's, and that is
    # all of it.
    assert found.stop_torque("stop")[later] == pytest.approx(2 * 9.81, rel=1e-6)
    assert np.abs(found.u[later]).max() < 1e-9


def test_energy_falls_by_the_square_of_the_restitution() -> None:
    found = run("onto the floor, e = 0.5, to rest", 1e-3)
    times = [time for time, _ in found.impacts[:3]]
    floor = 2 * 9.81 * -0.8
    before, between, after = (
        float(found.total_energy[(found.t > low) & (found.t < high)].mean()) - floor
        for low, high in ((0.0, times[0]), (times[0], times[1]), (times[1], times[2]))
    )
    # Counted from the floor it is the square of the speed there.
    assert between / before == pytest.approx(0.25, rel=1e-4)
    assert after / between == pytest.approx(0.25, rel=1e-4)


def test_bounces_for_ever_without_loss() -> None:
    problem = Problem(pendulum(1.0), 6.0, stop_law=StopLaw.UNILATERAL)
    exact, found = solve(problem), PymunkEngine().simulate(problem)
    assert len(found.impacts) == len(exact.impacts) >= 7
    assert (
        np.abs(found.total_energy - found.total_energy[0]).max() < 1e-4 * found.kinetic_energy.max()
    )


@pytest.mark.parametrize("name", ["fixed", "rolling"])
def test_the_arm_stop_is_met(name: str) -> None:
    """The paper's third constraint: it holds the arm as soon as it is there, and pushes."""
    found, exact = run(name, 1e-3), reference(name)
    assert len(found.impacts) == len(exact.impacts) == 1
    assert found.impacts[0][1][ARM_STOP] > 0
    later = found.t > found.impacts[0][0]
    there = exact.trajectory(found.t).stop_torque(ARM_STOP)
    assert there[later].max() > 0
    assert np.abs(found.stop_torque(ARM_STOP) - there)[later].max() < 1e-2 * there.max()


def test_nothing_is_met_before_the_launch() -> None:
    """Under either law the same motion, to the last bit."""
    laws = [PymunkEngine().simulate(Problem(fixed(), 2.7, stop_law=law)) for law in StopLaw]
    assert np.array_equal(laws[0].q, laws[1].q)
    assert laws[0].release_times == laws[1].release_times


def test_a_stop_at_the_middle_of_a_massless_rod_is_met() -> None:
    """Of second order: the point mass gets an inertia by mass at its pin, which does not move."""
    base = pendulum(0.0)
    middle = PointStop(
        name="middle",
        body="bob",
        point=(0.5, 0),
        normal=(0, 1),
        offset=-0.4,
        closed=False,
        restitution=0.5,
    )
    problem = Problem(
        Mechanism(**(dict(base) | {"stops": (middle,)})), 1.0, stop_law=StopLaw.UNILATERAL
    )
    exact = solve(problem)
    runs = [PymunkEngine(timestep=h).simulate(problem) for h in (2e-3, 1e-3)]
    coarse, fine = (np.abs(run.q - exact.motion(run.t).q).max() for run in runs)
    assert coarse / fine == pytest.approx(4.0, rel=0.2)
    assert fine < 1e-5  # 2 (h/T)^2 of a swing of a second
    assert runs[1].impacts[0][1]["middle"] == pytest.approx(exact.impacts[0][1]["middle"], rel=1e-5)


def test_a_stop_given_twice_acts_as_once() -> None:
    """Both touch at the same instant: they take part in each impact and come to rest together."""
    once = pendulum(0.5, closed=True, speed=2.0)
    (stop,) = once.stops
    twice = once.model_copy(update={"stops": (stop, stop.model_copy(update={"name": "twin"}))})
    single, double = (
        PymunkEngine(timestep=2e-3).simulate(Problem(mechanism, 1.5, stop_law=StopLaw.UNILATERAL))
        for mechanism in (once, twice)
    )
    assert all(set(impulses) == {"stop", "twin"} for _, impulses in double.impacts)
    assert double.q[-1] == pytest.approx(single.q[-1], abs=1e-6)


@pytest.mark.parametrize("steps", [0.5, 1.4, 3.7, 63.5, 64.5, 65.2])
def test_an_impact_is_located_in_whichever_step_it_is(steps: float) -> None:
    """A rod that turns evenly meets its stop at limit / speed; 64 steps are looked at at once."""
    step, speed = 2e-3, 1.5
    rod = rod_pendulum(angle_stop(speed * steps * step, body="rod")).model_copy(
        update={"gravity": 0.0, "start_speeds": (speed,)}
    )
    run = PymunkEngine(timestep=step).simulate(Problem(rod, 70 * step, stop_law=StopLaw.UNILATERAL))
    assert [time for time, _ in run.impacts] == pytest.approx([steps * step], abs=1e-6 * step)
