"""Mechanisms on which little acts, or which hardly move.

A rotor on its axle, a slide on a wall nearly beside it.
"""

from __future__ import annotations

import cmath

import numpy as np
import pytest
import trebucheck as tb
from mechanisms import G, angle_stop, pin
from trebucheck.comparisons.diagnosis.equivalence import EXACT, check_model
from trebucheck.models.elements import GROUND, PointStop, PrismaticJoint, Stop
from trebucheck.models.mechanism import Body, Mechanism
from trebucheck.models.problem import Problem

ENGINES = ("reference", "mujoco", "pymunk", "exudyn")


def _on_a_pin(body: Body, gravity: float, *stops: Stop, speed: float = 0.0) -> Mechanism:
    return Mechanism(
        name="one",
        bodies=(body,),
        joints=(pin("pin", GROUND, "bob"),),
        stops=stops,
        gravity=gravity,
        start=(0.3,),
        start_speeds=(speed,),
    )


ROTOR = Body(name="bob", angle="a", mass=2.0, centre=(0, 0), inertia=0.5)
BOB = Body(name="bob", angle="a", mass=2.0, centre=(0.5, 0), inertia=0.0)
ROD = Body(name="bob", angle="a", mass=2.0, centre=(0.5, 0), inertia=0.1)
HELD = angle_stop(-0.3).model_copy(update={"sense": 1, "limit": 0.3, "closed": True})
IDLE = {
    "rotor": _on_a_pin(ROTOR, G, speed=2.0),
    "rotor on its stop": _on_a_pin(ROTOR, G, HELD),
    "bob without gravity": _on_a_pin(BOB, 0.0, speed=1.0),
    "rod without gravity": _on_a_pin(ROD, 0.0),
    "rod on its stop without gravity": _on_a_pin(ROD, 0.0, HELD),
}


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("name", IDLE)
def test_the_model_is_the_same_where_no_force_acts(name: str, engine: str) -> None:
    checks = check_model(tb.engine(engine), IDLE[name]).checks
    assert checks
    assert [c.name for c in checks if c.value is None or c.value > EXACT] == []


def test_a_fault_is_seen_where_no_force_acts() -> None:
    """Gravity where there should be none, and a rotor whose centre is not on its axle."""
    pulled = _on_a_pin(ROD, 1e-3)
    off_axle = _on_a_pin(ROTOR.model_copy(update={"centre": (1e-6, 0.0)}), G)
    for wrong, right in ((pulled, _on_a_pin(ROD, 0.0)), (off_axle, _on_a_pin(ROTOR, G))):

        class Wrong(type(tb.engine("mujoco"))):  # type: ignore[misc]
            def inspect(
                self, mechanism: Mechanism, states: object, built: Mechanism = wrong
            ) -> object:
                return super().inspect(built, states)

        broken = [
            check.name
            for check in check_model(Wrong(), right).checks
            if (check.value or 0.0) > EXACT
        ]
        assert {"force", "acceleration"} <= set(broken)


@pytest.mark.parametrize("preset", ["assisted", "default"])
@pytest.mark.parametrize("engine", ENGINES[1:])
def test_a_balanced_rotor_turns_at_its_speed(engine: str, preset: str) -> None:
    trajectory = tb.engine(engine, preset, timestep=1e-3).simulate(Problem(IDLE["rotor"], 1.0))
    assert (
        np.abs(trajectory.q[:, 0] - (0.3 + 2.0 * trajectory.t)).max() < 1e-11
    )  # a thousand roundings of a radian


def held_beside_its_rail(by: float, turned: float = 0.0) -> Mechanism:
    """A block on a steep rail, held by a wall whose normal is so much [rad] off the perpendicular
    of the rail.
    """
    along, normal = cmath.rect(1.0, -2.1), cmath.rect(1.0, -2.1 - cmath.pi / 2 - by)
    touching, turned_normal = 0.3 * along, normal * cmath.rect(1.0, turned)
    wall = PointStop(
        name="wall", body="bob", point=(0, 0), normal=(turned_normal.real, turned_normal.imag),
        offset=(touching * turned_normal.conjugate()).real, closed=True,
    )  # fmt: skip
    rail = PrismaticJoint(
        name="rail",
        parent=GROUND,
        child="bob",
        parent_point=(0, 0),
        child_point=(0, 0),
        coordinate="s",
        axis=(along.real, along.imag),
    )
    block = ROD.model_copy(update={"angle": None})
    return Mechanism(
        name="held", bodies=(block,), joints=(rail,), stops=(wall,), gravity=0.1, start=(0.3,)
    )


@pytest.mark.parametrize("engine", ["mujoco", "exudyn"])
@pytest.mark.parametrize("by", [1e-2, 1e-3, 1e-4, 1e-5])
def test_a_wall_nearly_along_the_motion_is_checked_to_its_condition(by: float, engine: str) -> None:
    """Without a refined solution, and preloads that settle, 1e-9 to 1 of the force was lost."""
    right = held_beside_its_rail(by)
    found = check_model(tb.engine(engine), right)
    assert found.holds
    assert [c.tolerance for c in found.checks if c.name == "stop torque"] == pytest.approx(
        [max(EXACT, 1e-14 / by)]
    )


def test_a_fault_shows_where_a_wall_is_nearly_along_the_motion() -> None:
    """A hundredth of a microradian in its normal, at a milliradian from the rail."""
    wrong = held_beside_its_rail(1e-3, turned=1e-8)

    class Wrong(type(tb.engine("exudyn"))):  # type: ignore[misc]
        def inspect(self, mechanism: Mechanism, states: object) -> object:
            return super().inspect(wrong, states)

    assert not check_model(Wrong(), held_beside_its_rail(1e-3)).holds


@pytest.mark.parametrize("engine", ["mujoco", "exudyn"])
def test_what_a_wall_nearly_along_its_motion_holds_is_not_found_to_move(engine: str) -> None:
    compared = tb.compare(
        [held_beside_its_rail(1e-3)],
        engines=[engine],
        presets=["assisted"],
        timestep=4e-4,
        duration=0.2,
        isolate=False,
    )
    assert [str(run.outcome) for run in compared.results.runs] == ["agrees"]
