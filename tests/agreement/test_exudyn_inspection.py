"""The built Exudyn system shown by its own matrices.

Right to rounding, and a fault in any of its items shows.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from mechanisms import TABLE_ONE, rod_pendulum
from trebucheck.comparisons.diagnosis.equivalence import random_states
from trebucheck.engines.exudyn.engine import ExudynEngine
from trebucheck.engines.inspection import Inspection, State
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import PointStop, SlotJoint, Stop
from trebucheck.models.errors import InputError
from trebucheck.models.library.trebuchet import HANGER_REST, SLING_REST, fixed
from trebucheck.models.mechanism import Body, Mechanism
from trebucheck.reference.equations import Equations

pytest.importorskip("exudyn")

EXACT = 1e-10  # relative; the bar where an engine exposes a quantity


def closed_loop() -> Mechanism:
    """A bar between two slots that are square to each other: the second one closes a loop."""
    return Mechanism(
        name="trammel",
        bodies=(Body(name="bar", angle="a", mass=2, centre=(0.4, 0.1), inertia=0.3),),
        joints=(
            SlotJoint(
                name="x",
                child="bar",
                parent_point=(0, 0),
                child_point=(0, 0),
                axis=(1, 0),
                coordinate="s",
            ),
            SlotJoint(name="y", child="bar", parent_point=(0, 0), child_point=(1, 0), axis=(0, 1)),
        ),
        stops=(Stop(name="rest", body="bar", sense=-1, limit=-0.5, closed=True),),
        gravity=9.81,
        start=(0.5, -float(np.cos(0.5))),
    )


def off(found: Inspection, mechanism: Mechanism, states: tuple[State, ...]) -> dict[str, float]:
    """Largest difference from the equations by quantity, relative to the quantity's largest
    value."""
    equations = Equations(mechanism)
    pairs: dict[str, list[tuple[object, object]]] = {
        "mass": [],
        "forces": [],
        "accelerations": [],
        "torques": [],
    }
    for state, mine in zip(states, found.dynamics, strict=True):
        accelerations, multipliers = equations.solve(state.q, state.u, state.closed)
        forces = equations.gravity_forces(state.q) - equations.bias(state.q, state.u)
        pairs["mass"].append((mine.mass_matrix, equations.mass_matrix(state.q)))
        pairs["forces"].append((mine.forces, forces))
        pairs["accelerations"].append((mine.accelerations, accelerations))
        pairs["torques"] += zip(
            mine.stop_torques.values(), multipliers[equations.n_loops :], strict=True
        )
    return {
        name: _relative(*map(np.array, zip(*rows, strict=True)))
        for name, rows in pairs.items()
        if rows
    }


def _relative(mine: FloatArray, theirs: FloatArray) -> float:
    return float(np.abs(mine - theirs).max() / np.abs(theirs).max())


@pytest.mark.parametrize("stiffness", [None, 1e9])
@pytest.mark.parametrize(
    "mechanism", [*TABLE_ONE.values(), closed_loop()], ids=lambda mechanism: mechanism.name
)
def test_springs_and_constraints_are_the_same_machine(
    mechanism: Mechanism, stiffness: float | None
) -> None:
    states = random_states(mechanism)
    found = ExudynEngine(stop_stiffness=stiffness).inspect(mechanism, states)
    assert max(off(found, mechanism, states).values()) <= EXACT
    assert (
        max(abs(gap) for dynamics in found.dynamics for gap in dynamics.stop_gaps.values()) <= EXACT
    )
    assert any(state.closed for state in states)


@pytest.mark.parametrize("stiffness", [None, 1e9])
def test_the_gap_of_a_closed_stop_that_is_open_or_penetrates_is_shown(
    stiffness: float | None,
) -> None:
    """As the connector measures it: a floor that leans supports a point beside the rod."""
    lean, point = (0.6, 0.8), (1.3, 0.2)
    stops = (
        Stop(name="angle", body="rod", sense=-1, limit=0.0, closed=True),
        PointStop(
            name="floor", body="rod", point=point, normal=lean, offset=float(np.dot(lean, point)),
            closed=True,
        ),
    )  # fmt: skip
    mechanism = rod_pendulum().model_copy(update={"stops": stops})
    for angle in (0.2, -0.1):
        state, gap = State(np.array([angle]), np.zeros(1), ("angle", "floor")), -angle
        (shown,) = ExudynEngine(stop_stiffness=stiffness).inspect(mechanism, (state,)).dynamics
        place = complex(*point) * np.exp(-1j * angle)
        above = (place * complex(*lean).conjugate()).real - np.dot(lean, point)
        assert shown.stop_gaps == pytest.approx({"angle": gap, "floor": above}, abs=1e-12)


def test_accelerations_are_right_at_any_speed() -> None:
    """The joints' second derivatives come from Jacobians along the motion, whatever the rate of
    that.
    """
    mechanism = TABLE_ONE["rolling"]
    for speed in (0.0, 1e-6, 30.0, 1e4):
        states = (State(np.array([0.4, 4.0, 0.2, -0.3]), speed * np.array([1.0, -0.7, 0.4, 2.0])),)
        assert (
            off(ExudynEngine().inspect(mechanism, states), mechanism, states)["accelerations"]
            <= EXACT
        )


def test_a_state_may_close_only_what_is_closed_at_the_start() -> None:
    state = State(np.array(fixed().start), np.zeros(3), ("arm stop",))
    with pytest.raises(
        InputError,
        match="'arm stop' is no stop that is closed at the start; those are: hanger rest, ",
    ):
        ExudynEngine().inspect(fixed(), (state,))


def test_redundant_joints_give_the_same_machine() -> None:
    joints = fixed().joints
    twice = fixed().model_copy(
        update={"joints": (*joints, joints[1].model_copy(update={"name": "again"}))}
    )
    states = random_states(fixed())
    assert max(off(ExudynEngine().inspect(twice, states), fixed(), states).values()) <= EXACT


def _set(kind: str, name: str, **values: object) -> Callable[[Any], None]:
    def change(system: Any) -> None:
        for parameter, value in values.items():
            system.main.SetObjectParameter(getattr(system, kind)[name], parameter, value)

    return change


def _shifted_pin(system: Any) -> None:
    """The sling's end of its pin stands a centimetre along the sling."""
    pin = system.main.GetSensor(system.sensors["joint", "sling pin", "Force"])["objectNumber"]
    marker, _ = system.main.GetObject(pin)["markerNumbers"]
    system.main.SetMarkerParameter(marker, "localPosition", [-5.99, 0.0, 0.0])


FAULTS: dict[str, Callable[[Any], None]] = {
    "a mass": _set("bodies", "sling", physicsMass=60.06),
    "an inertia": _set("bodies", "arm", physicsInertia=16349.7),
    "gravity": lambda system: system.main.SetLoadParameter(0, "loadVector", [0.0, -9.80665, 0.0]),
    "a joint's point": _shifted_pin,
    "where a stop is": _set("stops", HANGER_REST, offset=1e-3),
    "a stop's lever": _set("stops", SLING_REST, factor1=1.001),
}


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("name", TABLE_ONE)
def test_a_fault_in_the_system_shows(
    name: str, fault: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from trebucheck.engines.exudyn import inspect as module

    rightly = module.build

    def wrongly(*arguments: object) -> object:
        system = rightly(*arguments)
        FAULTS[fault](system)
        return system

    states = random_states(TABLE_ONE[name])
    monkeypatch.setattr(module, "build", wrongly)
    found = ExudynEngine().inspect(TABLE_ONE[name], states)
    gaps = max(abs(gap) for dynamics in found.dynamics for gap in dynamics.stop_gaps.values())
    # A thousandth of an inertia that is a sixtieth of the whole shows least.
    assert max(gaps, *off(found, TABLE_ONE[name], states).values()) > 1e-6
