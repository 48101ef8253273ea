"""What engines show of the models they have built, against the reference's equations, before
anything moves.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from conftest import machine_parameters
from hypothesis import given
from mechanisms import OBLIQUE_SLOT, chain
from trebucheck.comparisons.diagnosis.equivalence import random_states
from trebucheck.engines.inspection import Inspectable, Inspection, State
from trebucheck.models.elements import GROUND, PinJoint, Stop
from trebucheck.models.errors import SimulationError
from trebucheck.models.library.trebuchet import HANGER_REST, SLING_REST
from trebucheck.models.mechanism import Body, Mechanism
from trebucheck.models.mjcf.writer import mjcf
from trebucheck.reference.equations import Equations

EXACT = 1e-10  # relative; the bar where an engine exposes a quantity
P = tb.TrebuchetParameters
TABLE_ONE = P()
PRESETS = ("assisted", "default")


def _inspectable(name: str, preset: str = "assisted", **options: object) -> Inspectable:
    engine = tb.engine(name, preset, **options)
    if not isinstance(engine, Inspectable):
        pytest.skip(f"{name} does not show its built model")
    return engine


@dataclass(frozen=True)
class Apart:
    """Largest differences over the states, relative to the largest value among them, or None if not
    exposed.
    """

    mass: float | None
    forces: float | None
    accelerations: float
    torques: float
    centres: float | None
    gaps: float
    """[rad]"""
    start: float
    """[rad or m]"""
    total_mass: float | None

    @property
    def exact(self) -> list[float]:
        """What the engine exposes by itself."""
        found = (self.mass, self.forces, self.centres, self.gaps, self.start, self.total_mass)
        return [value for value in found if value is not None]

    def holds(self) -> bool:
        """Whether the built model is the machine."""
        return max(self.exact) <= EXACT and max(self.accelerations, self.torques) <= EXACT


def apart(found: Inspection, mechanism: Mechanism, states: Sequence[State]) -> Apart:
    """An inspection in some states beside the equations of a mechanism."""
    equations, kinematics = Equations(mechanism), Equations(mechanism).kinematics
    rows = {body.name: kinematics.point(body.name, body.centre) for body in mechanism.bodies}
    pairs: dict[str, list[tuple[object, object]]] = {
        key: [] for key in ("mass", "forces", "centres", "a", "torques")
    }
    for state, dynamics in zip(states, found.dynamics, strict=True):
        a, lam = equations.solve(state.q, state.u, state.closed)
        pairs["a"].append((dynamics.accelerations, a))
        assert tuple(dynamics.stop_torques) == state.closed
        pairs["torques"] += zip(
            dynamics.stop_torques.values(), lam[equations.n_loops :], strict=True
        )
        if dynamics.mass_matrix is not None:
            pairs["mass"].append((dynamics.mass_matrix, equations.mass_matrix(state.q)))
        if dynamics.forces is not None:
            forces = equations.gravity_forces(state.q) - equations.bias(state.q, state.u)
            pairs["forces"].append((dynamics.forces, forces))
        pairs["centres"] += [
            (place, kinematics.position(rows[n], state.q)) for n, place in dynamics.centres.items()
        ]
    gaps = [
        abs(gap - float(kinematics.gap(name, state.q)))
        for state, dynamics in zip(states, found.dynamics, strict=True)
        for name, gap in dynamics.stop_gaps.items()
    ]
    total = sum(body.mass for body in mechanism.bodies)
    return Apart(
        mass=_worst(pairs["mass"]),
        forces=_worst(pairs["forces"]),
        accelerations=_worst(pairs["a"]) or 0.0,
        torques=_worst(pairs["torques"]) or 0.0,
        centres=_worst(pairs["centres"]),
        gaps=max(gaps, default=0.0),
        start=float(np.abs(found.start - mechanism.start).max()),
        total_mass=None if found.total_mass is None else abs(found.total_mass - total) / total,
    )


def _worst(pairs: Sequence[tuple[object, object]]) -> float | None:
    if not pairs:
        return None
    mine, theirs = (np.array([pair[side] for pair in pairs]) for side in (0, 1))
    # State by state, and component by component, each of the size it reaches in some state.
    size = np.abs(theirs).max(axis=0)
    return float((np.abs(mine - theirs) / np.where(size > 0, size, 1.0)).max())


# --- The same machine
# -------------------------------------------------------------------------------------------


@given(parameters=machine_parameters())
def test_random_machines_in_random_states(
    parameters: P, build: Callable[..., Mechanism], engine_name: str
) -> None:
    mechanism = build(parameters)
    states = random_states(mechanism, n=9)
    for preset in PRESETS:  # numerical options are no part of the model
        found = _inspectable(engine_name, preset).inspect(mechanism, states)
        difference = apart(found, mechanism, states)
        assert difference.holds(), (preset, difference)


def test_states_reach_every_active_set(build: Callable[..., Mechanism]) -> None:
    """What the tests above stand on: both rests, each alone, and neither.

    And that something moves.
    """
    states = random_states(build(), n=9)
    assert {state.closed for state in states} == {
        (HANGER_REST, SLING_REST),
        (HANGER_REST,),
        (SLING_REST,),
        (),
    }
    assert max(float(np.abs(state.u).max()) for state in states) > 0.5


UNUSUAL = {
    "mujoco": (
        {"solver": "PGS", "iterations": 1},
        {"solimp": (1e-4, 1e-4, 0.1, 0.5, 2.0), "solref": (0.5, 0.1), "margin": 0.0},
        {"timestep": 0.2, "integrator": "Euler", "margin": 1e-2},
    ),
    "pymunk": (
        {"iterations": 1, "start_iterations": 1, "error_bias": 1.0},
        {"pivot_mass": 1e8, "hold_lengths": False},
        {"timestep": 0.2, "leapfrog": False},
    ),
}


def test_unusual_options_show_the_same_model(
    build: Callable[..., Mechanism], engine_name: str
) -> None:
    mechanism = build()
    states = random_states(mechanism)
    for options in UNUSUAL.get(engine_name, ({"timestep": 0.2},)):
        difference = apart(
            _inspectable(engine_name, **options).inspect(mechanism, states), mechanism, states
        )
        assert difference.holds(), (options, difference)


def test_states_do_not_depend_on_each_other(
    build: Callable[..., Mechanism], engine_name: str
) -> None:
    """Nothing of a state is left in the model for the next one."""
    engine, mechanism = _inspectable(engine_name), build()
    states = random_states(mechanism, n=9)
    forth = engine.inspect(mechanism, states).dynamics
    back = engine.inspect(mechanism, states[::-1]).dynamics[::-1]
    assert len(forth) > 0
    for one, other in zip(forth, back, strict=True):
        assert other.accelerations == pytest.approx(one.accelerations, rel=EXACT, abs=EXACT)
        assert other.stop_torques == pytest.approx(one.stop_torques, rel=EXACT)


# --- Machines of other kinds
# ------------------------------------------------------------------------------------


def two_bodies(*stops: Stop, **changes: Any) -> Mechanism:
    """The chain with other inertias, on a weaker planet."""
    return chain(*stops, inertias=(0.1, 0.3), hook=(0, 0), **({"gravity": 3.7} | changes))


THIRD = Body(name="third", angle="c", mass=1, centre=(0.2, 0), inertia=0.02)
LAST = PinJoint(
    name="last", parent="lower", child="third", parent_point=(0.9, -0.1), child_point=(0, 0)
)
BOB = Body(name="bob", angle="a", mass=2, centre=(0.3, 0.4), inertia=0)
STRING = PinJoint(
    name="string", parent=GROUND, child="bob", parent_point=(0.3, 2), child_point=(0, 0)
)
BETWEEN = Stop(
    name="between", body="upper", relative_to="lower", sense=-1, limit=0.2 - 0.3, closed=True
)
LEVEL = Stop(name="level", body="lower", sense=1, limit=0.2, closed=True)

OTHERS = {
    "two bodies": two_bodies(),
    "an oblique slot": two_bodies(
        joints=(OBLIQUE_SLOT, two_bodies().joints[1]),
        start=(0.3, 0.2, 0.4),
        start_speeds=(1.0, -2.0, 0.7),
    ),
    "three bodies": two_bodies(
        bodies=(*two_bodies().bodies, THIRD),
        joints=(*two_bodies().joints, LAST),
        start=(0.3, 0.2, 0.5),
        start_speeds=(1.0, -2.0, 0.3),
    ),
    "a stop named from the inner body": two_bodies(BETWEEN, start_speeds=()),
    "a stop on the ground, two bodies away": two_bodies(LEVEL, start_speeds=()),
    "a bob resting on the ground": two_bodies(
        bodies=(BOB,),
        joints=(STRING,),
        markers=(),
        stops=(Stop(name="rest", body="bob", sense=-1, limit=-2.0, closed=True),),
        start=(2.0,),
        start_speeds=(),
    ),
}


@pytest.mark.parametrize("name", OTHERS)
def test_other_machines(name: str, engine_name: str) -> None:
    mechanism = OTHERS[name]
    states = random_states(mechanism, n=9)
    found = _inspectable(engine_name).inspect(mechanism, states)
    difference = apart(found, mechanism, states)
    assert difference.holds(), difference
    assert found.start_speeds == pytest.approx(
        mechanism.start_speeds or [0.0] * len(mechanism.start), abs=EXACT
    )
    if mechanism.stops:
        assert any(state.closed for state in states)


# --- Another machine shows
# --------------------------------------------------------------------------------------


def _heavier(mechanism: Mechanism, factor: float) -> Mechanism:
    """The arm's inertia about its centre, multiplied."""
    bodies = [
        body.model_copy(update={"inertia": body.inertia * factor}) if body.name == "arm" else body
        for body in mechanism.bodies
    ]
    return mechanism.model_copy(update={"bodies": tuple(bodies)})


WRONG: dict[str, Callable[[Callable[..., Mechanism]], Mechanism]] = {
    **{
        name: lambda build, name=name: build(P(**{name: getattr(TABLE_ONE, name) * 1.001}))
        for name in ("l1", "l2", "r", "h", "m_b", "m_cw", "m_a", "g")
    },
    "arm's inertia": lambda build: _heavier(build(), 1.001),
}


@pytest.mark.parametrize("fault", WRONG)
def test_a_thousandth_shows(fault: str, build: Callable[..., Mechanism], engine_name: str) -> None:
    states = random_states(build())
    difference = apart(
        _inspectable(engine_name).inspect(WRONG[fault](build), states), build(), states
    )
    # In accelerations by themselves, by well more than their tolerance (an inertia of 1/60 of the
    # whole shows least).
    assert difference.accelerations > 1e-6 > EXACT
    assert not difference.holds()


@pytest.mark.parametrize(("angle", "stop"), [("alpha0", HANGER_REST), ("phi0", SLING_REST)])
def test_a_stop_a_thousandth_off_shows_by_how_much(
    angle: str, stop: str, build: Callable[..., Mechanism], engine_name: str
) -> None:
    """Each rest stands where the machine starts, so a stop's angle and the start's go together."""
    wrong = build(P(**{angle: getattr(TABLE_ONE, angle) * 1.001}))
    states = [state for state in random_states(build()) if stop in state.closed]
    found = _inspectable(engine_name).inspect(wrong, states)
    off = Equations(wrong).kinematics
    for state, dynamics in zip(states, found.dynamics, strict=True):
        expected = float(off.gap(stop, state.q))
        assert abs(expected) > 7e-4
        if dynamics.stop_gaps:
            assert dynamics.stop_gaps[stop] == pytest.approx(expected, abs=EXACT)
    difference = apart(found, build(), states)
    assert not difference.holds()
    assert difference.start == pytest.approx(abs(getattr(TABLE_ONE, angle)) * 1e-3, rel=1e-6)


# --- A wrong build of the right machine shows
# --------------------------------------------------------------------

MJCF_FAULTS: dict[str, Callable[[str], str]] = {
    "a mass": lambda text: text.replace('mass="60"', 'mass="60.06"'),
    "gravity": lambda text: text.replace("-9.81", "-9.80665"),
    "an inertia": lambda text: text.replace("16333.333333333334", "16349.7"),
    "a length": lambda text: text.replace('pos="10 0 0"', 'pos="10.01 0 0"'),
    "the sign of the angles": lambda text: text.replace('axis="0 1 0"', 'axis="0 -1 0"'),
    "where a limit is": lambda text: text.replace('range="0 ', 'range="0.001 '),
    "six digits": lambda text: re.sub(r"\d+\.\d{6,}", lambda found: f"{float(found[0]):.6g}", text),
    "spheres with their own inertia": lambda text: text.replace(
        'diaginertia="2e-15 2e-15 2e-15"', 'diaginertia="1 1 1"'
    ),
}


@pytest.mark.parametrize("fault", MJCF_FAULTS)
def test_a_fault_in_the_mjcf_shows(
    fault: str, build: Callable[..., Mechanism], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("mujoco")
    from trebucheck.engines.mujoco import build as module

    right = mjcf(build())
    assert MJCF_FAULTS[fault](right) != right
    monkeypatch.setattr(
        module, "mjcf", lambda mechanism, timestep: MJCF_FAULTS[fault](mjcf(mechanism, timestep))
    )
    states = random_states(build())
    assert not apart(_inspectable("mujoco").inspect(build(), states), build(), states).holds()


def _times(part: str, name: str, factor: float) -> Callable[[Any], None]:
    def change(machine: Any) -> None:
        body = machine.parts[part].body
        setattr(body, name, getattr(body, name) * factor)

    return change


def _longer_rod(machine: Any) -> None:
    """The bodies stand where they should, but a rod is made a thousandth too long."""
    rod = next(rod for rod in machine.rods if rod.joint.b is machine.parts["sling"].body)
    rod.length *= 1.001


def _shifted_end(machine: Any) -> None:
    """The sling hangs a centimetre beside its pin."""
    rod = next(rod for rod in machine.rods if rod.joint.b is machine.parts["sling"].body)
    rod.joint.anchor_a = (rod.joint.anchor_a[0], rod.joint.anchor_a[1] + 0.01)


SPACE_FAULTS: dict[str, Callable[[Any], None]] = {
    "a mass": _times("sling", "mass", 1.001),
    "an inertia": _times("arm", "moment", 1.001),
    "gravity": lambda machine: setattr(machine.space, "gravity", (0, -9.80665)),
    "a rod's length": _longer_rod,
    "a rod's end": _shifted_end,
    "where a body is": lambda machine: setattr(
        machine.parts["hanger"].body, "position", (3.08, 7.08)
    ),
}


@pytest.mark.parametrize("fault", SPACE_FAULTS)
def test_a_fault_in_the_space_shows(
    fault: str, build: Callable[..., Mechanism], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pymunk")
    from trebucheck.engines.pymunk import inspect as module

    rightly = module.build

    def wrongly(*arguments: Any) -> Any:
        machine = rightly(*arguments)
        SPACE_FAULTS[fault](machine)
        return machine

    monkeypatch.setattr(module, "build", wrongly)
    states = random_states(build())
    assert not apart(_inspectable("pymunk").inspect(build(), states), build(), states).holds()


# --- As built
# --------------------------------------------------------------------------------------------------


def test_start_comes_from_the_bodies_with_the_turns_of_the_mechanism(engine_name: str) -> None:
    parameters = P(theta0=TABLE_ONE.theta0 - 2 * math.pi, phi0=TABLE_ONE.phi0 - 2 * math.pi)
    mechanism = tb.rolling(parameters).model_copy(
        update={"start": (*tb.rolling(parameters).start[:3], 3.5)}
    )
    states = random_states(mechanism, n=3)
    difference = apart(_inspectable(engine_name).inspect(mechanism, states), mechanism, states)
    assert difference.holds(), difference


def test_total_mass_is_told_where_no_mass_is_added() -> None:
    pytest.importorskip("pymunk")
    at_start = random_states(tb.fixed(), n=1)
    total = TABLE_ONE.m_a + TABLE_ONE.m_b + TABLE_ONE.m_cw
    for options, mechanism, told in (
        ({"pivot_mass": 1.0}, tb.fixed(), total),
        ({"pivot_mass": 1e4}, tb.fixed(), None),  # the arm's mass, multiplied on its pin
        ({"pivot_mass": 1e4}, tb.rolling(), total),
    ):
        assert _inspectable("pymunk", **options).inspect(mechanism, at_start[:0]).total_mass == told


def test_impulses_are_followed_until_they_settle() -> None:
    """An arm of 1 kg between 3000 kg takes Chipmunk's solver far more passes than Table I."""
    pytest.importorskip("pymunk")
    mechanism = tb.rolling(P(m_a=1.0))
    states = random_states(mechanism, n=5)
    difference = apart(_inspectable("pymunk").inspect(mechanism, states), mechanism, states)
    assert difference.holds(), difference


def test_impulses_that_do_not_settle_are_not_taken_for_the_machine() -> None:
    pytest.importorskip("pymunk")
    mechanism = tb.fixed(P(m_a=0.1))
    with pytest.raises(SimulationError, match="not settled"):
        _inspectable("pymunk", pivot_mass=1.0).inspect(mechanism, random_states(mechanism, n=1))
