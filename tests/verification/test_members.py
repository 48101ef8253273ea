"""Forces in rods and at the ground.

Closed forms of a pendulum, and the checked figures of both machines.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.reference.solution import Solution
from trebucheck.reference.solver import solve
from trebucheck.reference.throw.members import (
    axial_force,
    member_forces,
    members,
    negative_intervals,
    support_forces,
    supports,
    upward_force,
)

G, MASS, LENGTH = 9.81, 3.0, 2.0


def pendulum(start: float, axis: tuple[float, float] | None = None) -> tb.Mechanism:
    """A point mass on a massless rod; angle -pi/2 is straight up."""
    common = {
        "name": "pivot",
        "parent": "ground",
        "child": "bob",
        "parent_point": (0, 0),
        "child_point": (0, 0),
    }
    slot = None if axis is None else tb.SlotJoint(**common, axis=axis, coordinate="x")
    return tb.Mechanism(
        name="pendulum",
        # A point mass under a massless slider would have no inertia against sliding both ways at
        # once.
        bodies=(
            tb.Body(
                name="bob",
                angle="beta",
                mass=MASS,
                centre=(LENGTH, 0),
                inertia=0.5 if axis else 0.0,
            ),
        ),
        joints=(slot or tb.PinJoint(**common),),
        gravity=G,
        start=(start,) if axis is None else (start, 0.0),
    )


def test_a_pendulum_from_the_top_pushes_until_two_thirds() -> None:
    """T = m g (2 cos(top) - 3 cos(a)), a from the upright.

    In compression while cos(a) > 2/3 cos(top).
    """
    top = 0.3
    solution = solve(tb.Problem(pendulum(-math.pi / 2 + top), duration=2.0))
    (force,) = member_forces(solution, 2.0)
    turning = next(end for start, end in force.compressed if start == 0.0)
    a = solution.motion(np.array([turning])).q[0, 0] + math.pi / 2
    assert math.cos(a) == pytest.approx(
        2 / 3 * math.cos(top), abs=1e-11
    )  # a root on a solution good to 1e-12
    assert force.two_force
    assert force.peak_compression == pytest.approx(-MASS * G * math.cos(top), rel=1e-12)
    assert force.peak_compression_time == 0.0
    # Its largest, at the lowest point: a parabola's top, found in value to rounding.
    assert force.peak_tension == pytest.approx(MASS * G * (3 + 2 * math.cos(top)), rel=1e-11)


def test_the_ground_pulls_a_pendulum_s_pin_down_where_the_formula_says() -> None:
    """Upward force of the pin.

    -T cos(a) above, so negative just where T > 0 and the bob is above the pin.
    """
    solution = solve(tb.Problem(pendulum(-math.pi / 2 + 0.3), duration=1.6))
    (force,) = support_forces(solution, 1.6)
    assert not force.rolls
    ((start, end),) = force.pulls_down
    first, last = np.cos(solution.motion(np.array([start, end])).q[:, 0] + math.pi / 2)
    assert first == pytest.approx(2 / 3 * math.cos(0.3), abs=1e-11)
    assert last == pytest.approx(0.0, abs=1e-11)
    assert force.peak_direction == pytest.approx(
        math.pi / 2, abs=1e-4
    )  # flat top: found to the root of rounding


@pytest.mark.parametrize("axis", [(1.0, 0.0), (-1.0, 0.0)])
def test_up_does_not_depend_on_how_a_slot_is_written(axis: tuple[float, float]) -> None:
    """A mass hanging at rest under its slot weighs m g."""
    solution = solve(tb.Problem(pendulum(math.pi / 2, axis), duration=0.5))
    (support,) = supports(solution.problem.mechanism)
    assert upward_force(solution, support, np.array([0.0, 0.5])) == pytest.approx(
        MASS * G, rel=1e-12
    )
    (force,) = support_forces(solution, 0.5)
    assert force.rolls and not force.pulls_down
    assert member_forces(solution, 0.5) == ()  # a body with inertia on the ground is no rod


@pytest.fixture(scope="module", params=["fixed", "rolling"])
def solution(request: pytest.FixtureRequest) -> Solution:
    return solve(
        tb.Problem({"fixed": tb.fixed, "rolling": tb.rolling}[request.param](), duration=2.8)
    )


def test_the_sling_is_compressed_as_checked(solution: Solution) -> None:
    fixed = solution.problem.mechanism.name == "fixed"
    assert solution.launch is not None
    sling, hanger = member_forces(solution, solution.launch.time)
    assert (sling.name, hanger.name) == ("sling", "hanger")
    ((start, end),) = sling.compressed
    assert start == 0.0
    assert end == pytest.approx(2.05 if fixed else 2.01, abs=5.1e-3)  # printed digits
    assert sling.peak_compression == pytest.approx(
        -1150 if fixed else -2340, abs=5.1
    )  # printed digits
    assert sling.peak_tension > 5e4


def test_ends_of_the_intervals_are_roots(solution: Solution) -> None:
    assert solution.launch is not None
    until = solution.launch.time
    for member, force in zip(
        members(solution.problem.mechanism), member_forces(solution, until), strict=True
    ):
        ends = [t for interval in force.compressed for t in interval if 0 < t < until]
        assert ends
        # Located to 1e-14 s where forces change by up to 1e7 N/s.
        assert axial_force(solution, member, np.array(ends)) == pytest.approx(0.0, abs=1e-6)
        for start, end in force.compressed:
            inside = np.linspace(start, end, 99)[1:-1]
            assert axial_force(solution, member, inside).max() < 0


def test_only_the_rolling_machine_would_lift_off(solution: Solution) -> None:
    assert solution.launch is not None
    (force,) = support_forces(solution, solution.launch.time)
    assert force.rolls == (solution.problem.mechanism.name == "rolling")
    assert bool(force.pulls_down) == force.rolls
    assert (force.least < 0) == force.rolls
    if force.rolls:
        assert force.peak_direction == pytest.approx(
            math.pi / 2, abs=1e-12
        )  # a slot has no other force


def test_the_ground_carries_weight_and_rate_of_momentum(solution: Solution) -> None:
    """Newton for the whole machine, its momentum differenced."""
    (support,) = supports(solution.problem.mechanism)
    t, h = np.linspace(0.1, 2.4, 24), 1e-4
    after, before = (solution.trajectory(t + d).momentum[:, 1] for d in (h, -h))
    weight = G * sum(body.mass for body in solution.problem.mechanism.bodies)
    # The difference errs by h^2/6 of the force's second derivative, itself below 1e8 N/s^2, and by
    # 1e-7/h.
    expected = weight + (after - before) / (2 * h)
    assert upward_force(solution, support, t) == pytest.approx(expected, abs=1.0)


def test_a_rod_with_something_hung_on_its_middle_is_no_two_force_member() -> None:
    machine = tb.fixed()
    bob = tb.Body(name="bob", angle="beta", mass=1.0, centre=(1.0, 0), inertia=0.0)
    hung = tb.PinJoint(
        name="hung", parent="hanger", child="bob", parent_point=(5.0, 0), child_point=(0, 0)
    )
    more = {
        "bodies": (*machine.bodies, bob),
        "joints": (*machine.joints, hung),
        "start": (*machine.start, 1.5),
    }
    flags = {m.body.name: m.two_force for m in members(tb.Mechanism(**{**dict(machine), **more}))}
    assert flags == {"sling": True, "hanger": False, "bob": True}


@pytest.mark.parametrize("pulled", ["sling", "hanger", "arm"])
def test_a_rod_that_a_force_acts_on_is_no_two_force_member(pulled: str) -> None:
    force = tb.ConstantForce(name="pull", body=pulled, point=(1.0, 0.0), force=(1.0, 0.0))
    machine = tb.fixed().model_copy(update={"force_elements": (force,)})
    flags = {m.body.name: m.two_force for m in members(machine)}
    assert flags == {"sling": pulled != "sling", "hanger": pulled != "hanger"}


def test_intervals_of_simple_functions() -> None:
    times = np.linspace(0.0, 3 * math.pi, 200)
    found = negative_intervals(np.sin, times)
    assert [t for interval in found for t in interval] == pytest.approx(
        [math.pi, 2 * math.pi], abs=1e-13
    )
    found = negative_intervals(np.cos, times)
    expected = [0.5, 1.5, 2.5, 3.0]
    assert [t / math.pi for interval in found for t in interval] == pytest.approx(
        expected, abs=1e-13
    )
    assert negative_intervals(np.zeros_like, times) == ()
    assert negative_intervals(lambda t: 1e5 - 1e-6 * np.cos(t), times) == ()
    assert negative_intervals(lambda t: -np.ones_like(t), times) == ((0.0, 3 * math.pi),)


def test_times_beyond_the_motion(solution: Solution) -> None:
    with pytest.raises(tb.InputError, match=r"until = 9\.0 s must lie within"):
        member_forces(solution, 9.0)
