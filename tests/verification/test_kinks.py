"""Motions with derivatives to one side only, and starts that loops hold.

Each against differences of the motions.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
import trebucheck as tb
from directions import derivatives, random_direction, stepped
from mechanisms import G, bouncing
from trebucheck.comparisons.campaigns.random_mechanisms import random_mechanism
from trebucheck.models.elements import ConstantForce
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.reference.sensitivity.release import whipper_sensitivities
from trebucheck.reference.sensitivity.tangent import Kink, one_sided, sides
from trebucheck.reference.sensitivity.variational import consistent_direction
from trebucheck.reference.solver import solve

Direction = dict[str, float]
LAW = StopLaw.UNILATERAL
STEP = 1e-5
SOLVER = 1e-12  # of the largest number of a state: what the solver may err by


def end(mechanism: Mechanism, direction: Direction, step: float, t: float) -> np.ndarray:
    """The state at t [s] of a mechanism moved along a direction."""
    active = solve(Problem(mechanism, duration=1e-6, stop_law=LAW)).segments[0].closed
    solution = solve(Problem(stepped(mechanism, direction, step, active), duration=t, stop_law=LAW))
    return np.asarray(solution.segments[-1].interpolant(t), dtype=np.float64)


def slope(
    mechanism: Mechanism, direction: Direction, side: float, t: float
) -> tuple[np.ndarray, float]:
    """One-sided, extrapolated twice, and how far the differences can be trusted."""
    start = end(mechanism, direction, 0.0, t)
    first, second, third = (
        (end(mechanism, direction, side * k * STEP, t) - start) / (side * k * STEP)
        for k in (1, 2, 4)
    )
    fine, coarse = 2 * first - second, 2 * second - third
    size = np.abs(start).max() + np.abs(first).max()
    return (4 * fine - coarse) / 3, float(np.abs(coarse - fine).max() + SOLVER * size / STEP)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "number"), [(12, "start_speeds.2"), (23, "start_speeds.0")])
def test_a_stop_that_opens_at_the_start_is_struck_by_steps_to_one_side(
    seed: int, number: str
) -> None:
    mechanism, t = random_mechanism(seed), 0.2
    everything, speed = (
        random_direction(mechanism, 0.1),
        consistent_direction(mechanism, {number: 1.0}),
    )
    mass = {f"bodies.{mechanism.bodies[0].name}.mass": 1.0}
    found = derivatives(mechanism, [everything, speed, mass], t, LAW)
    held = sides(found.kinks, 3)
    assert abs(held[0]) == abs(held[1]) == 1
    assert held[2] == 0
    (sentence,) = one_sided(found.kinks, ["everything", number, "mass"])
    assert number in sentence
    assert "strikes stop 0, which touches at the start" in sentence
    for j, direction in enumerate((everything, speed)):
        exact = np.concatenate([found.dq[j], found.du[j]])
        smooth, own = slope(mechanism, direction, held[j], t)
        struck, _ = slope(mechanism, direction, -held[j], t)
        assert np.abs(exact - smooth).max() <= own
        assert np.abs(exact - struck).max() > 100 * own


@pytest.mark.slow
def test_bouncing_to_rest_against_differences() -> None:
    """Random mechanism 43 meets its stop 21 times and stays on it."""
    mechanism, t, step = random_mechanism(43), 0.43, 1e-4
    direction = random_direction(mechanism, 0.1)
    found = derivatives(mechanism, [direction], t, LAW)
    assert len(found.d_impact_times) == 21
    assert found.closed == ("stop 0",)
    near, far = (
        (end(mechanism, direction, k * step, t) - end(mechanism, direction, -k * step, t))
        / (2 * k * step)
        for k in (1, 2)
    )
    expected = (4 * near - far) / 3
    # What remains of the truncation is smaller than what the extrapolation took away.
    own = np.abs(expected - near).max() + SOLVER * np.abs(expected).max() / step
    assert own < 1e-4 * np.abs(expected).max()
    assert np.abs(np.concatenate([found.dq[0], found.du[0]]) - expected).max() <= own


@pytest.mark.slow
def test_a_stop_whose_gap_loops_hold_has_no_part_in_the_motion() -> None:
    """Random mechanism 45: loop 0 holds the angle of stop 0, which a change of the loop's angle
    opens or jams.
    """
    mechanism, t = random_mechanism(45), 0.3
    alone = consistent_direction(mechanism, {"joints.loop 0.angle": 1.0})
    along = alone | {"stops.stop 0.limit": 1.0}
    found = derivatives(mechanism, [alone, along], t, LAW)
    assert sides(found.kinks, 2).tolist() == [1, 0]
    (sentence,) = one_sided(found.kinks, ["angle of loop 0", "both"])
    assert sentence.startswith(
        "derivatives hold one way only for an increase of angle of loop 0: the other way strikes"
    )
    smooth, own = slope(mechanism, along, 1.0, t)
    for j in (0, 1):
        assert np.abs(np.concatenate([found.dq[j], found.du[j]]) - smooth).max() <= own


def beside_a_floor(restitution: float, gravity: float) -> Mechanism:
    ball = bouncing(1.0, restitution)
    (floor,) = ball.stops
    force = ConstantForce(name="push", body="ball", point=(0, 0), force=(0, 0))
    closed = floor.model_copy(update={"closed": True})
    return ball.model_copy(
        update={"start": (0.0,), "stops": (closed,), "gravity": gravity, "force_elements": (force,)}
    )


def test_a_stop_without_a_force_holds_against_pushes_one_way() -> None:
    """Without gravity y = F t^2 / 2 m for an upward force and 0 for a downward one.

    Along the floor nothing changes.
    """
    pushes = [
        {"force_elements.push.force.1": 1.0},
        {"force_elements.push.force.1": -2.0},
        {"force_elements.push.force.0": 1.0},
    ]
    found = derivatives(beside_a_floor(0.5, 0.0), pushes, 0.5, LAW)
    assert sides(found.kinks, 3).tolist() == [-1, 1, 0]
    assert found.dq[:, 0] == pytest.approx(0, abs=1e-15)
    (sentence,) = one_sided(found.kinks, ["lift", "press", "shove"])
    assert sentence == (
        "derivatives hold one way only for an increase of press and a decrease of lift: the other "
        "way opens floor, "
        "which carries no force from t = 0 s on"
    )
    assert derivatives(beside_a_floor(0.5, G), pushes, 0.5, LAW).kinks == ()


def test_a_kick_on_a_stop_that_throws_all_back_has_no_derivative() -> None:
    kick, heavier = {"start_speeds.0": 1.0}, {"bodies.ball.mass": 1.0}
    found = derivatives(beside_a_floor(1.0, G), [kick, heavier], 0.5, LAW)
    held = sides(found.kinks, 2)
    assert math.isnan(held[0])
    assert held[1] == 0
    assert one_sided(found.kinks, ["kick", "mass"]) == [
        (
            "there is no derivative by kick: either way bounces on floor for ever, because its "
            "restitution is 1"
        )
    ]
    assert derivatives(beside_a_floor(0.9, G), [kick, heavier], 0.5, LAW).kinks == ()


def test_two_stops_that_hold_for_opposite_steps_leave_none() -> None:
    up, down = (
        Kink(name, 0.0, np.array([side, side, 0.0]), f"strikes {name}")
        for name, side in (("a", 1.0), ("b", -1.0))
    )
    held = sides([up, down], 3)
    assert np.isnan(held[:2]).all()
    assert held[2] == 0
    assert one_sided([up, down], ["p", "q", "r"]) == [
        "there is no derivative by p and q: either way strikes a and strikes b"
    ]
    assert sides([], 2).tolist() == [0, 0]


def test_a_throw_says_which_start_speeds_hold_one_way() -> None:
    """Beyond l1 = 12.73 m the fixed machine's hanger rest is gone at t = 0; kicks may strike it."""
    p, step = tb.TrebuchetParameters.with_beam(13.3), 1e-5
    found = whipper_sensitivities(tb.fixed, p)
    (sentence,) = found.one_sided
    assert "strikes hanger rest, which touches at the start" in sentence
    increase, decrease = sentence.split(" and a decrease of ")
    assert "u_theta" in increase
    assert "u_alpha" in decrease
    machine, i = tb.fixed(p), found.names.index("u_alpha")

    def time(kick: float) -> float:
        kicked = machine.model_copy(update={"start_speeds": (0.0, 0.0, kick)})
        launch = solve(Problem(kicked, duration=found.launch_time + 0.1)).launch
        return math.inf if launch is None else launch.time

    assert (found.launch_time - time(-step)) / step == pytest.approx(
        found.d_launch_time[i], rel=1e-3
    )
    assert (
        not abs(time(step) - found.launch_time) < 10 * step
    )  # the other rest is struck open, and the throw another
