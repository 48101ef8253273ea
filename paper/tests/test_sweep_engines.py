"""Engines on the fulcrum's sweep and on the coinciding design.

Within what their bars allow of just those figures.
"""

from __future__ import annotations

from functools import cache

import pytest
import trebucheck as tb
from trebucheck.reference.solver import solve, solve_to_launch
from trebucheck.reference.throw.flight import Projectile
from trebucheck_paper.design.first_forward_swing import FirstForwardSwing, first_forward_swing_of
from trebucheck_paper.design.study import QUANTITIES, confirmed
from trebucheck_paper.evidence.claims import EngineValue
from trebucheck_paper.evidence.engine_runs import allowed, launches
from trebucheck_paper.sweep.study import Beam

BEAM = Beam(tb.TrebuchetParameters(), 14.0, 8.5, 13.0)
COINCIDING = tb.TrebuchetParameters.with_beam(11.4167054, r=3.8435824, h=11.6150873)
"""As found by the search to seven digits: its two instants are a microsecond apart at most."""


def _agrees(found: EngineValue, expected: float) -> bool:
    return (
        found.value is not None
        and found.tolerance is not None
        and abs(found.value - expected) <= found.tolerance
    )


@pytest.mark.parametrize("l1", [9.0, pytest.param(12.73, marks=pytest.mark.again)])
def test_launch_speed_and_no_fall_backward(engine_name: str, l1: float) -> None:
    """At 12.73 m the hanger's rest would have to pull.

    Engines' limits can only push, and follow release-once.
    """
    if engine_name == "reference":
        pytest.skip("it is what the others are measured against")
    solution = solve_to_launch(BEAM.rigid(l1).mechanism)
    assert solution.launch is not None
    (speed,), (back,) = launches([engine_name], Projectile(solution), solution.launch.time, None)
    if allowed(tb.engine(engine_name), solution.problem.mechanism).position is None:
        pytest.skip("no bar is stated for this engine")
    assert _agrees(speed, solution.launch.speed), (speed, solution.launch.speed)
    assert back.value is not None and back.tolerance is not None and back.value >= -back.tolerance
    bilateral = BEAM.position(l1).bilateral_speed
    if l1 > 12.7255:
        assert bilateral is not None and speed.tolerance is not None
        assert not _agrees(speed, bilateral)


@cache
def _coinciding() -> FirstForwardSwing:
    found = first_forward_swing_of(tb.rolling(COINCIDING), solve)
    assert found is not None
    return found


def test_the_design_is_confirmed(engine_name: str) -> None:
    if (
        engine_name == "reference"
        or allowed(tb.engine(engine_name), tb.rolling(COINCIDING)).position is None
    ):
        pytest.skip("no bar is stated for this engine")
    found = _coinciding()
    ours = {
        "largest_ratio_time": found.fastest,
        "best_release_time": found.best.time,
        "best_release_angle": found.best.angle,
        "best_release_speed": found.best.speed,
        "best_range": found.range,
    }
    values = confirmed([engine_name], found, None)
    assert set(values) == set(QUANTITIES)
    for figure, (value,) in values.items():
        assert _agrees(value, ours[figure]), (figure, value, ours[figure])


def test_an_engine_that_is_not_there_becomes_a_note() -> None:
    solution = solve_to_launch(tb.fixed())
    assert solution.launch is not None
    (speed,), (back,) = launches(["nobody"], Projectile(solution), solution.launch.time, None)
    assert speed.value is None and speed.note and "nobody" in speed.note
    assert back.value is None and back.note == speed.note


def test_tolerances_are_tight_enough_to_catch_a_wrong_machine() -> None:
    """One thousandth of the sling's length is beyond every engine's allowance but pymunk's, which
    has millimetres.
    """
    solution = solve_to_launch(tb.fixed(tb.TrebuchetParameters.with_beam(9.5)))
    other = solve_to_launch(tb.fixed(tb.TrebuchetParameters.with_beam(9.5, r=6.006)))
    assert solution.launch is not None and other.launch is not None
    delay = abs(other.launch.speed - solution.launch.speed)
    for name in ("mujoco", "exudyn"):
        if tb.engines()[name].installed:
            (speed,), _ = launches([name], Projectile(solution), solution.launch.time, None)
            assert speed.tolerance is not None and speed.tolerance < delay
