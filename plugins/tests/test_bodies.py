"""Rigid bodies in single precision: every element is built, forces are right until a stop is let
go, and a slow body sleeps where nothing is set alone.

An engine has an environment of its own: where it is not installed, its cases are skipped.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.models.library.registry import benchmark
from trebucheck.reference.solver import solve

_TREES = ("oscillator", "motor", "thrown-plate", "spring-pendulum", "welded-rods")
BUILT: Mapping[str, tuple[str, ...]] = {
    "jolt": ("slider-crank", *_TREES),
    "physx": ("slider-crank", *_TREES),
    "ovphysx": ("bead", *_TREES),
}
HELD = (("jolt", "assisted"), ("physx", "settings"), ("physx", "assisted"))
SLEEPING = ("jolt", "physx")


def _engine(name: str, preset: str = "assisted", **options: Any) -> Any:
    if name not in tb.engines():
        pytest.skip(f"{name} is not installed here")
    return tb.engine(name, preset, **options)


def _error(found: tb.Trajectory, problem: tb.Problem) -> float:
    """Greatest distance of a marker from where it should be [m]."""
    right = solve(problem).trajectory(found.t).markers
    return float(
        max(np.abs(m.position - right[key].position).max() for key, m in found.markers.items())
    )


@pytest.mark.parametrize(("name", "problem"), [(n, each) for n in BUILT for each in BUILT[n]])
def test_every_element_is_built(name: str, problem: str) -> None:
    """First order from a coarse step, where single precision plays no part yet."""
    given = benchmark(problem).problem()
    given = given.model_copy(update={"duration": min(0.5, given.duration)})
    coarse, fine = (_error(_engine(name, timestep=h).simulate(given), given) for h in (4e-3, 2e-3))
    assert np.log2(coarse / fine) == pytest.approx(1.0, abs=0.3)


@pytest.mark.parametrize(("name", "preset"), HELD)
@pytest.mark.parametrize("model", ["fixed", "rolling"])
def test_forces_are_within_rounding_where_nothing_is_let_go(
    name: str, preset: str, model: str
) -> None:
    """Joint forces on the child, in the world, and stop torques, from the first sample on.

    Bodies of 3000 kg and of 60 kg: an iteration's rounding, 6e-8 of the greater one's momentum,
    is 3e-6 of the lesser's, and a step of 1 ms of its weight is 2e-4 of its greatest.
    """
    problem = tb.Problem(tb.model(model), duration=0.75)
    found = _engine(name, preset, timestep=1e-3, least_inertia=1e-3).simulate(problem)
    truth = solve(problem).trajectory(found.t)
    for mine, right in (
        (found.joint_reactions, truth.joint_reactions),
        (found.stop_torques, truth.stop_torques),
    ):
        greatest = max(float(np.abs(values).max()) for values in right.values())
        for joint, values in mine.items():
            assert np.abs(values - right[joint]).max() < 1e-2 * greatest, joint


@pytest.mark.parametrize("preset", ["default", "settings", "assisted"])
@pytest.mark.parametrize("name", SLEEPING)
def test_a_body_at_rest_falls_asleep_by_default_alone(name: str, preset: str) -> None:
    """Jolt stops what moves by less than 0.03 m/s for half a second, PhysX what has less than 5 mJ
    a kilogram for 0.4 s."""
    made = tb.Mechanism(
        name="slow puck",
        bodies=(tb.Body(name="puck", angle="q", mass=1.0, centre=(0.0, 0.0), inertia=0.1),),
        joints=(tb.FreeJoint(name="air", child="puck", coordinates=("x", "y")),),
        stops=(),
        gravity=0.0,
        start=(0.0, 0.0, 0.0),
        start_speeds=(0.0, 0.005, 0.0),
    )
    end = _engine(name, preset).simulate(tb.Problem(made, duration=1.0)).u[-1, 1]
    assert end == (0.0 if preset == "default" else pytest.approx(0.005, rel=1e-6))
