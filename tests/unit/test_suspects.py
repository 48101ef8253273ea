"""Tables of suspected faults: their sizes follow the mechanism's units, and their forces are what
their text says.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from mechanisms import (
    G,
    chain,
    chain_on_a_slot,
    everything,
    hanging_bob,
    parallel_cranks,
    rods_on_a_slot,
    scaled,
    slider_crank,
)
from trebucheck.comparisons.diagnosis.faults import (
    Fault,
    armatures,
    gross_faults,
    hypotheses,
    machine_suspects,
    mechanism_length,
    missing_faults,
    systematic_faults,
    with_closed_loops,
)
from trebucheck.reference.equations import Equations
from trebucheck.reference.solver import solve

POWERS = {
    "": 0.0, "rad": 0.0, "m": 1.0, "1/s": -0.5, "rad/s": -0.5, "m/s": 0.5, "N m s/rad": 4.5,
    "N s/m": 2.5, "N m/rad": 4.0, "N m": 4.0, "kg m^2": 5.0,
}  # fmt: skip
"""Of the size in each unit, of models of the same density under the same gravity."""
MACHINES: dict[str, Callable[[], tb.Mechanism]] = {
    "everything": everything,
    "slider crank": slider_crank,
    "rods": lambda: rods_on_a_slot(inertia=0.0, tip=(0.5, 0.2)),
}


def _laws(mechanism: tb.Mechanism) -> list[Fault]:
    return [*(f for f in hypotheses(mechanism) if f.kind == "law"), *armatures(mechanism)]


@pytest.mark.parametrize("name", MACHINES)
def test_sizes_of_laws_and_start_speeds_are_those_of_the_units(name: str) -> None:
    full, model = MACHINES[name](), scaled(MACHINES[name](), 0.25)
    assert mechanism_length(model) == pytest.approx(0.25 * mechanism_length(full))
    pairs = list(zip(_laws(full), _laws(model), strict=True))
    assert len(pairs) > 8
    for large, small in pairs:
        assert large.name == small.name
        for one, other in zip(large.components, small.components, strict=True):
            assert other.scale == pytest.approx(0.25 ** POWERS[one.unit] * one.scale), large.name
            assert other.length == pytest.approx(0.25 * one.length)
    units = ("rad/s", "m/s")
    one, other = (
        {s.name: s for s in machine_suspects(machine) if s.unit in units}
        for machine in (full, model)
    )
    assert one.keys() == other.keys() and len(one) > 1
    for key, suspect in one.items():
        assert other[key].scale == pytest.approx(0.25 ** POWERS[suspect.unit] * suspect.scale)


def test_points_are_moved_by_parts_of_the_mechanisms_length() -> None:
    for factor in (1.0, 0.25):
        machine = scaled(everything(), factor)
        moved = {s.name: s for s in machine_suspects(machine)}
        across = moved["place of the pin on the bracket, across"]
        joint = next(j for j in across.wrong.joints if j.name == "pin")
        own = next(j for j in machine.joints if j.name == "pin")
        assert math.dist(joint.parent_point, own.parent_point) == pytest.approx(across.scale)
        assert np.dot(joint.parent_point, own.parent_point) == pytest.approx(
            math.hypot(*own.parent_point) ** 2
        )
        assert across.scale == pytest.approx(1e-6 * mechanism_length(machine))
        longer = moved["place of the pin on the bracket"]
        joint = next(j for j in longer.wrong.joints if j.name == "pin")
        assert joint.parent_point == pytest.approx(np.array(own.parent_point) * (1 + 1e-6))
        at_origin = moved["place of the pin on the bob, y"]
        joint = next(j for j in at_origin.wrong.joints if j.name == "pin")
        assert joint.child_point == pytest.approx((0.0, at_origin.scale))


def test_a_slot_is_not_moved_along_itself() -> None:
    """Level, only up or down; upright, only aside; tilted, along x and y."""
    name = "place of the slot on the ground"
    for tilt, places in ((0.0, {", y"}), (math.pi / 2, {", x"}), (0.3, {", x", ", y"})):
        suspects = [s.name for s in machine_suspects(slider_crank(tilt=tilt))]
        assert {s.removeprefix(name) for s in suspects if s.startswith(name)} == places


def test_loops_are_closed_where_one_of_them_is_open() -> None:
    """The third crank of a beam, of which the other two fit, is turned to where it belongs."""
    right = parallel_cranks(3)
    assert with_closed_loops(right) is right
    start = (*right.start[:3], right.start[3] + 1e-3)
    closed = with_closed_loops(right.model_copy(update={"start": start}))
    assert closed is not None and closed.start != start
    assert max(closed.loop_closure_residual.values()) < 1e-9


# the power of an added force


@cache
def _states(name: str) -> tuple[tb.Mechanism, np.ndarray, np.ndarray]:
    mechanism = MACHINES[name]()
    motion = solve(tb.Problem(mechanism, duration=0.4)).motion(np.linspace(0.1, 0.4, 4))
    return mechanism, motion.q, motion.u


def _turns(mechanism: tb.Mechanism, values: np.ndarray) -> dict[str, np.ndarray]:
    """Angles, or their rates, of the joints that turn: of the child less that of the parent."""
    column = dict.fromkeys((b.name for b in mechanism.bodies), np.zeros(len(values)))
    for k, name in enumerate(mechanism.angles):
        body = next(b.name for b in mechanism.bodies if b.angle == name)
        column[body] = values[:, k]
    column["ground"] = np.zeros(len(values))
    for held, by in (("slider", "arm"), ("bracket", "arm")):
        if held in column:
            column[held] = column[by]
    turning = [j for j in mechanism.joints if j.kind in ("pin", "pin-in-slot")]
    return {j.name: column[j.child] - column[j.parent] for j in turning}


def _expected(name: str) -> Iterator[tuple[str, np.ndarray]]:
    """Power of each law at size one of its unit, by the name of the fault."""
    mechanism, q, u = _states(name)
    rates, angles = _turns(mechanism, u), _turns(mechanism, q)
    start = _turns(mechanism, np.array([mechanism.start]))
    kinetic = 0.5 * np.einsum("ni,nij,nj->n", u, Equations(mechanism).mass_matrix(q), u)
    yield "damping of all bodies", -2 * kinetic
    for joint, rate in rates.items():
        yield f"friction or damping of the {joint}", -(rate**2)
        yield f"torque on the {joint}", rate
        yield f"spring on the {joint}", -(angles[joint] - start[joint]) * rate
    pins = [j.name for j in mechanism.joints if j.kind == "pin"]
    if len(rates) > 1:
        yield "friction or damping of all turning joints", -sum(r**2 for r in rates.values())
    if len(rates) > len(pins) > 1:
        yield "friction or damping of all pins", -sum(rates[pin] ** 2 for pin in pins)
    n = len(mechanism.angles)
    slides = {c: u[:, n + k] for k, c in enumerate(mechanism.coordinates[n:])}
    for slide, rate in slides.items():
        yield f"friction or damping of slide {slide}", -(rate**2)
    if len(slides) > 1:
        yield "friction or damping of all slides", -sum(r**2 for r in slides.values())


def _told(text: str) -> float:
    """The number in the text of one component."""
    return next(float(word) for word in text.split() if word[0] in "+-")


@pytest.mark.parametrize("name", MACHINES)
def test_an_added_force_has_the_power_of_the_size_that_is_told(name: str) -> None:
    mechanism, q, u = _states(name)
    usual = Equations(mechanism).forces(q, u)
    expected = dict(_expected(name))
    laws = [
        f for f in hypotheses(mechanism) if f.kind == "law" and f.name != "direction of gravity"
    ]
    laws = [law for law in laws if not law.name.endswith("missing")]
    assert {law.name for law in laws} == set(expected)
    for law in laws:
        factors = [2e5] + [0.0] * (len(law.components) - 1)
        wrong = law.make(factors)
        assert wrong is not None
        power = np.sum((wrong.forces(q, u) - usual) * u, axis=1)
        size = _told(law.text(factors))
        assert power == pytest.approx(size * expected[law.name], rel=1e-2, abs=1e-9), law.name
        if len(law.components) > 1:  # a spring with a torque at the start
            both = law.make([2e5, -3e5])
            assert both is not None
            added = np.sum((both.forces(q, u) - wrong.forces(q, u)) * u, axis=1)
            torque = law.components[1].scale * -3e5
            joint = law.name.removeprefix("spring on the ")
            assert added == pytest.approx(torque * _turns(mechanism, u)[joint])


@pytest.mark.parametrize("name", MACHINES)
def test_what_only_takes_or_stores_energy_has_no_negative_size(name: str) -> None:
    """Damping, friction, stiffness and a rotor's inertia; a torque and a tilt have either sign."""
    laws = [law for law in _laws(MACHINES[name]()) if len(law.components) == 1]
    for law in laws:
        either = law.name.startswith("torque") or law.name == "direction of gravity"
        assert (law.equations([-1.0]) is not None) == either, law.name
        assert law.equations([1.0]) is not None


@pytest.mark.parametrize("name", MACHINES)
def test_an_armature_is_inertia_of_the_rate_of_its_joint(name: str) -> None:
    mechanism, q, u = _states(name)
    usual, rates = Equations(mechanism).mass_matrix(q), _turns(mechanism, u)
    found = list(armatures(mechanism))
    assert [fault.name for fault in found] == [f"armature of the {joint}" for joint in rates]
    for fault, rate in zip(found, rates.values(), strict=True):
        wrong = fault.make([1e6])
        assert wrong is not None
        energy = np.einsum("ni,nij,nj->n", u, wrong.mass_matrix(q) - usual, u)
        assert energy == pytest.approx(1e6 * fault.components[0].scale * rate**2)


def test_gravity_is_turned_by_the_angle_that_is_told() -> None:
    mechanism = everything()
    (tilt,) = [f for f in hypotheses(mechanism) if f.name == "direction of gravity"]
    assert tilt.text([1e5]) == "+0.1 rad"
    wrong = tilt.make([1e5])
    assert wrong is not None
    x, y = wrong.mechanism.gravity_direction
    assert math.atan2(y, x) - math.atan2(-0.8, 0.6) == pytest.approx(0.1)
    still = hypotheses(hanging_bob(gravity=0.0))
    assert "direction of gravity" not in [fault.name for fault in still]


def test_gravity_is_reversed_turned_and_left_out() -> None:
    """In words of the world where it points down, else by its own direction."""
    for mechanism, where in (
        (everything(), ("turned by +90 deg", "turned by -90 deg")),
        (slider_crank(), ("along +x", "along -x")),
    ):
        found = {fault.name: fault.make(()) for fault in gross_faults(mechanism)}
        x, y = mechanism.gravity_direction
        for name, direction in zip(("reversed", *where), ((-x, -y), (-y, x), (y, -x)), strict=True):
            turned = found[f"gravity {name}"]
            assert turned is not None
            assert turned.mechanism.gravity_direction == pytest.approx(direction)
        none = found["no gravity"]
        assert none is not None and none.mechanism.gravity == 0.0
    assert {f.name for f in gross_faults(hanging_bob(gravity=0.0))} == {
        "velocity-dependent forces dropped"
    }


# mistakes in all parts


def _changed(right: Any, wrong: Any, at: str = "") -> dict[str, Any]:
    """Values of another mechanism that are others, by where they are; of parts their number."""
    found: dict[str, Any] = {}
    if isinstance(right, dict):
        for key, value in right.items():
            found |= _changed(value, wrong.get(key, ()), f"{right.get('name', '')} {key}")
        return found
    if isinstance(right, tuple | list) and right and isinstance(right[0], dict):
        if len(right) != len(wrong):
            return {at: len(wrong)}
        for one, other in zip(right, wrong, strict=True):
            found |= _changed(one, other, at)
        return found
    return {} if right == wrong else {at: wrong}


def _with_all() -> tb.Mechanism:
    """One of each element, a closed and two open stops that bounce, moving at the start."""
    fields = everything().model_dump()
    stop = {"name": "rest", "body": "hull", "sense": 1, "limit": 0.3, "closed": True}
    bounce = {"name": "bounce", "body": "arm", "sense": 1, "limit": -2.0, "restitution": 0.5}
    speeds = (0.0, *fields["start_speeds"][1:])
    stops = [stop, bounce | {"closed": False}, *fields["stops"]]
    return tb.Mechanism(**{**fields, "stops": stops, "start_speeds": speeds})


SPEEDS = (0.0, 1.0, -0.7, 0.2, -0.3, 0.4, 0.6)
IN_ALL: dict[str, dict[str, Any]] = {
    "inertias of all bodies missing": {
        f"{body} inertia": 0.0 for body in ("hull", "arm", "slider", "bracket", "bob")
    },
    "centres of mass at the bodies' origins": {
        f"{body} centre": (0.0, 0.0) for body in ("hull", "arm", "slider", "bracket", "bob")
    },
    "all force elements missing": {"everything force_elements": 0},
    "damping of all elements missing": {"tie damping": 0.0, "twist damping": 0.0},
    "damping of all elements doubled": {"tie damping": 3.0, "twist damping": 0.4},
    "stiffness of all elements missing": {"tie stiffness": 0.0, "twist stiffness": 0.0},
    "rest lengths ignored": {"tie rest_length": 0.0},
    "rest angles ignored": {"twist rest_angle": 0.0},
    "rest angles with the wrong sign": {"twist rest_angle": -0.3},
    "torques of motors missing": {"motor torque": 0.0},
    "torques of motors with the wrong sign": {"motor torque": -0.9},
    "constant forces missing": {"pull force": (0.0, 0.0)},
    "torques on one body only, without their reaction": {"motor relative_to": "ground"},
    "rotational springs and dampers against the ground": {"twist relative_to": "ground"},
    "start speeds ignored": {"everything start_speeds": (0.0,) * 7},
    "start speeds reversed": {"everything start_speeds": tuple(-u for u in SPEEDS)},
    "gravity along -y": {"everything gravity_direction": ()},
    "all stops missing": {"everything stops": 0},
    "stops that are open at the start missing": {"everything stops": 1},
    "bounce missing": {"everything stops": 2},
    "deck missing": {"everything stops": 2},
    "restitution 0 of all stops": {"bounce restitution": 0.0},
    "restitution 1 of all stops": {"rest restitution": 1.0, "bounce restitution": 1.0}
    | {"deck restitution": 1.0},
}


def test_a_mistake_in_all_parts_changes_these_and_nothing_else() -> None:
    mechanism = _with_all()
    found = {fault.name: fault.make(()) for fault in systematic_faults(mechanism)}
    assert set(IN_ALL) <= set(found)
    for name, expected in IN_ALL.items():
        wrong = found[name]
        assert wrong is not None
        changed = _changed(mechanism.model_dump(), wrong.mechanism.model_dump())
        assert changed == expected, name
    left = found["bounce missing"]
    assert left is not None and [s.name for s in left.mechanism.stops] == ["rest", "deck"]
    left = found["stops that are open at the start missing"]
    assert left is not None and [s.name for s in left.mechanism.stops] == ["rest"]


def test_a_mistake_that_changes_nothing_is_no_suspect() -> None:
    """A bob without inertia, springs, stops or speeds, under gravity along -y."""
    found = {fault.name for fault in systematic_faults(hanging_bob(start_speeds=(0.0,)))}
    assert found == {
        "inertias about the joints in place of those about the centres of mass",
        "centres of mass at the bodies' origins",
    }


def test_what_may_be_missing_or_rounded() -> None:
    mechanism = _with_all()
    missing = {fault.name: fault.make(()) for fault in missing_faults(mechanism)}
    names = {"tie", "twist", "pull", "motor", "rest"}
    assert {f"{name} missing" for name in names} == {n for n in missing if "missing" in n}
    for name, equations in missing.items():
        assert equations is not None
        left = equations.mechanism
        parts = (*left.force_elements, *left.stops)
        assert name.removesuffix(" missing") not in [part.name for part in parts]
    digits = chain(gravity=G + 1e-8)
    rounded = {f.name: f.make(()) for f in missing_faults(digits) if f.name.startswith("data")}
    assert set(rounded) == {
        "data in six digits, as text formats write them",
        "data in single precision",
    }
    single = rounded["data in single precision"]
    assert single is not None and single.mechanism.gravity == float(np.float32(G + 1e-8))


def test_a_fault_of_several_numbers_is_suspected_with_each_alone_and_with_all() -> None:
    faults = hypotheses(chain_on_a_slot())
    groups: dict[str, list[int]] = {}
    for fault in faults:
        groups.setdefault(fault.group, []).append(len(fault.components))
    assert groups["centre of mass of the lower"] == [1, 1, 2]
    assert groups["gravity"] == [1]
    (both,) = [
        f for f in faults if f.group == "centre of mass of the lower" and len(f.components) == 2
    ]
    along, across = both.components
    centre = np.array((0.4, -0.5))
    wrong = both.make([3e5, 2e5])
    assert wrong is not None
    moved = np.array(wrong.mechanism.body("lower").centre) - centre
    out = centre / np.linalg.norm(centre)
    assert moved @ out == pytest.approx(0.3 * np.linalg.norm(centre))
    assert moved @ [-out[1], out[0]] == pytest.approx(2e5 * across.scale)
    assert along.unit == "" and across.unit == "m"
    assert both.text([3e5, 0.0]).startswith("along +30 %, across")
