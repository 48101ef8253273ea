"""A stop whose gap nothing can change has no part in the motion.

In the reference, in engines, in the model check.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.comparisons.diagnosis.equivalence import check_model
from trebucheck.models.elements import PinJoint, PointStop, PrismaticJoint, Stop, WeldJoint
from trebucheck.models.kinematics import Kinematics, immovable_stops
from trebucheck.models.mechanism import Body, Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.reference.solver import solve

ANGLE, RAIL = -1.07, 0.4
# Two bodies welded askew, and one on a rail of the second.
BODIES = (
    Body(name="arm", angle="a", mass=1.3, centre=(0.3, -0.1), inertia=0.2),
    Body(name="head", angle=None, mass=0.7, centre=(0.1, 0.2), inertia=0.1),
    Body(name="cart", angle=None, mass=0.4, centre=(0.0, 0.1), inertia=0.05),
)
JOINTS = (
    PinJoint(
        name="pin", parent="ground", child="arm", parent_point=(0.1, 0.9), child_point=(-0.13, 0.37)
    ),
    WeldJoint(
        name="weld",
        parent="arm",
        child="head",
        parent_point=(0.4, 0.2),
        child_point=(0.3, -0.1),
        angle=ANGLE,
    ),
    PrismaticJoint(
        name="rail",
        parent="head",
        child="cart",
        parent_point=(0.1, 0.1),
        child_point=(0.2, 0.1),
        axis=(math.cos(RAIL), math.sin(RAIL)),
        coordinate="s",
    ),
)
FLOOR = PointStop(
    name="floor",
    body="arm",
    point=(0.5, 0.4),
    normal=(0, 1),
    offset=0.65,
    closed=False,
    restitution=0.5,
)
IDLE = (
    PointStop(
        name="welded", body="arm", point=(-0.24, -0.26), relative_to="head", closed=True, offset=0,
        normal=(math.cos(0.7), math.sin(0.7)),
    ),
    Stop(name="turned", body="head", relative_to="arm", sense=1, limit=ANGLE, closed=True),
    PointStop(
        name="across", body="cart", point=(0.3, 0.2), relative_to="head", closed=True, offset=0,
        normal=(-math.sin(RAIL), math.cos(RAIL)),
    ),
)  # fmt: skip


def _mechanism(*idle: Stop | PointStop) -> Mechanism:
    """With the walls of point stops put where their points are."""
    start = (0.3, 0.1)
    fields = {"name": "askew", "bodies": BODIES, "joints": JOINTS, "start": start, "gravity": 9.81}
    gaps = Kinematics(Mechanism(**fields).model_copy(update={"stops": idle})).gap
    placed = tuple(
        stop.model_copy(update={"offset": float(gaps(stop.name, np.array(start)))})
        if isinstance(stop, PointStop)
        else stop
        for stop in idle
    )
    return Mechanism(**fields, stops=(FLOOR, *placed))


FREE, HELD = _mechanism(), _mechanism(*IDLE)
NAMES = tuple(stop.name for stop in IDLE)


def _problem(mechanism: Mechanism, law: StopLaw) -> Problem:
    return Problem(mechanism, duration=0.6, stop_law=law)


def test_they_are_found() -> None:
    assert immovable_stops(HELD) == NAMES


@pytest.mark.parametrize("law", StopLaw)
@pytest.mark.parametrize("idle", [*((stop,) for stop in IDLE), IDLE], ids=[*NAMES, "all"])
def test_the_reference_moves_as_without_them(
    idle: tuple[Stop | PointStop, ...], law: StopLaw
) -> None:
    free, held = solve(_problem(FREE, law)), solve(_problem(_mechanism(*idle), law))
    assert bool(free.impacts) == (law is StopLaw.UNILATERAL)
    assert [t for t, _ in held.impacts] == pytest.approx([t for t, _ in free.impacts], abs=1e-9)
    t = np.linspace(0.0, 0.6, 50)
    assert held.motion(t).q == pytest.approx(free.motion(t).q, abs=1e-9)
    assert all(held.release_times[stop.name] is None for stop in idle)


@pytest.mark.parametrize("engine", ["mujoco", "pymunk", "exudyn"])
def test_engines_move_as_without_them(engine: str) -> None:
    with_options = tb.engine(engine, timestep=1e-3)
    free, held = (
        with_options.simulate(_problem(each, StopLaw.UNILATERAL)) for each in (FREE, HELD)
    )
    assert len(free.impacts) > 0
    assert np.array_equal(held.q, free.q)
    assert all(
        held.release_times[name] is None and not held.stop_torques[name].any() for name in NAMES
    )
    assert check_model(with_options, HELD).holds
