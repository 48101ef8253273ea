"""Exudyn through positions in which a loop's constraints depend on each other.

Speeds, drift and reactions.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from mechanisms import pin, slider_crank
from trebucheck.engines.exudyn.engine import ExudynEngine
from trebucheck.models.elements import GROUND, SlotJoint
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem
from trebucheck.reference.solver import solve

pytest.importorskip("exudyn")

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
