"""Exudyn through positions in which a loop's constraints depend on each other.

Speeds, drift and reactions.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from mechanisms import pin, slider_crank
from trebucheck.engines.exudyn.engine import ExudynEngine
from trebucheck.models.elements import GROUND, SlotJoint, Stop
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem
from trebucheck.reference.solver import solve

pytest.importorskip("exudyn")

from trebucheck.engines.exudyn.solver import Conditioning, LoopConstraints

SPEED = 8.0  # [rad/s] of the crank at the start: it turns over and over


def turning(slot_height: float) -> Mechanism:
    """A slider-crank whose crank and rod stand above each other as its slider passes.

    There the loop is singular.
    """
    length = 1.0 + slot_height
    rod = -math.asin(slot_height / length)
    slot = SlotJoint(
        name="slot",
        child="rod",
        parent_point=(0, slot_height),
        child_point=(length, 0),
        axis=(1, 0),
    )
    return slider_crank(
        length,
        joints=(pin("pivot", GROUND, "crank"), pin("elbow", "crank", "rod", (1, 0)), slot),
        start=(0.0, rod),
        start_speeds=(SPEED, -SPEED / (length * math.cos(rod))),
    )


@pytest.mark.parametrize("slot_height", [0.0, 0.2])
def test_errors_behind_a_singular_position_are_of_second_order(slot_height: float) -> None:
    exact = solve(Problem(turning(slot_height), 0.48))
    (passage,) = exact.singular_passages
    errors: list[tuple[float, float]] = []
    for step in (2e-4, 1e-4):
        run = ExudynEngine(timestep=step).simulate(exact.problem)
        there, behind = exact.trajectory(run.t), run.t > passage.time + 0.03
        forces = [
            np.linalg.norm(run.joint_reaction(j) - there.joint_reaction(j), axis=1)
            for j in ("pivot", "slot")
        ]
        errors.append(
            (
                float(np.abs(run.q - there.q).max()),
                max(float(force[behind].max()) for force in forces),
            )
        )
    (position, force), (shorter_position, shorter_force) = errors
    assert position / shorter_position > 3
    assert force / shorter_force > 3


class _Passing(LoopConstraints):
    """Two constraints with a singular position at x = 0, or one that is passed at a distance.

    Their singular values are hypot(x, distance).
    """

    def __init__(self, distance: float) -> None:
        self.distance = distance

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        return np.array([[q[0], self.distance], [-self.distance, q[0]]])


def looks(values: list[float], distance: float = 0.0) -> dict[int, tuple[bool, bool]]:
    """Steps after which constraints were looked at: whether to begin anew, and for what is ahead.

    Values are those of x at the start and after each step.
    """
    conditioning, found = Conditioning(_Passing(distance)), dict[int, tuple[bool, bool]]()
    conditioning.begin(np.array(values[:1]))
    for k in range(1, len(values)):

        def position(k: int = k) -> np.ndarray:
            found[k] = False, False
            return np.array([values[k]])

        due = conditioning.look(position)
        if k in found:
            assert due == conditioning.is_due
            found[k] = due, conditioning.has_neared
        if due:
            conditioning.begin(np.array([values[k]]))
    return found


def test_constraints_are_looked_at_more_often_the_nearer_a_singular_position_is() -> None:
    """After a quarter of the steps to it, 32 at most, and after the step that begins anew.

    That is when it is nearer than 256 steps, and then than half of what was left, but four.
    """
    steps, expected, k, neared = 600, dict[int, tuple[bool, bool]](), 1, math.inf
    while k < steps:
        ahead = steps + 0.5 - k
        due = 4 < ahead < min(256, neared / 2)
        neared = ahead if due else neared
        expected[k] = due, due
        k += 1 if due else int(np.clip(ahead / 4, 1, 32))
    assert looks([steps + 0.5 - k for k in range(steps)]) == expected


def test_a_run_begins_anew_when_the_least_singular_value_has_doubled() -> None:
    values = [abs(200.0 - k) + 60.5 for k in range(600)]
    found = looks(values)
    least, behind = math.inf, 0
    for k, (due, neared) in found.items():
        least = min(least, values[k])
        if k > 200:
            assert due == (values[k] > 2 * least) and not neared
            behind += due
        if due:
            least = values[k]
    assert behind == 2  # near 130 and 280, not yet 560


def test_a_second_singular_position_is_seen_as_the_first_one_is() -> None:
    found = looks([abs(200.5 - k % 400) for k in range(600)])
    assert any(neared for k, (_, neared) in found.items() if 400 < k < 600)


@pytest.mark.parametrize("distance", [3.0, 30.0])
def test_a_position_is_singular_if_a_tenth_of_the_least_value_is_left_there(
    distance: float,
) -> None:
    """By the rates, wherever the value itself would vanish: it falls ever slower."""
    found = looks([200.5 - k for k in range(200)], distance)
    assert any(neared for _, neared in found.values()) == (distance < 20.0)


def test_what_hardly_changes_is_looked_at_every_32_steps() -> None:
    assert list(looks([1.0] * 100)) == [1, 33, 65, 97]


@pytest.mark.parametrize(
    ("values", "ahead"),
    [
        ([9.0, 12.0, 10.0], 5.0),
        ([10.0, 10.0], math.inf),
        ([9.0, 10.0], math.inf),
        ([9.0], math.inf),
    ],
)
def test_steps_to_a_singular_position_follow_from_the_last_two(
    values: list[float], ahead: float
) -> None:
    conditioning = Conditioning(_Passing(0.0))
    conditioning.begin(np.array([20.0]))
    assert conditioning.steps_ahead(np.array(values)[:, None]) == pytest.approx(ahead)


def test_without_drift_a_state_is_the_nearest_on_its_loops_and_stops() -> None:
    """Speeds that these hold are gone, all others are as before."""
    stop = Stop(name="stop", body="crank", sense=1, limit=0.0, closed=True)
    mechanism = slider_crank(tilt=0.2)
    stop = stop.model_copy(update={"limit": mechanism.start[0]})
    for stops in ((), (stop,)):
        kinematics = Kinematics(mechanism.model_copy(update={"stops": stops}))
        constraints = LoopConstraints(kinematics, tuple(stop.name for stop in stops))
        drift, speeds = np.array([1e-4, -2e-4]), np.array([0.7, -1.9])
        q, u = constraints.projected(np.array(mechanism.start) + drift, speeds)
        gaps = [kinematics.gap(stop.name, q) for stop in stops]
        assert [*kinematics.loop_residual(q), *gaps] == pytest.approx(
            np.zeros(1 + len(stops)), abs=1e-13
        )
        rows = constraints.jacobian(q)
        free = np.eye(2) - np.linalg.pinv(rows) @ rows
        assert rows @ u == pytest.approx(np.zeros(len(rows)), abs=1e-13)
        assert free @ u == pytest.approx(free @ speeds, abs=1e-13)
        assert free @ (q - mechanism.start) == pytest.approx(free @ drift, abs=1e-6)
