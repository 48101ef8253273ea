"""Every metric on a motion given by formulas, where the right answer is known.

No engine, no integration.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from formulas import ARM, END, LAUNCH, RELEASE, SLOT, TURN, Formula, pinned, times, trolley
from mechanisms import pin
from trebucheck.comparisons.runs.metrics import against, measure
from trebucheck.comparisons.runs.quantities import Kind, Quantity, metric_label, parse_label
from trebucheck.comparisons.runs.results import Metric
from trebucheck.models.elements import GROUND, PointStop
from trebucheck.models.launch import Launch
from trebucheck.models.trajectory import PointMotion

REFERENCE = Formula()
T = times()
SCALE = math.sqrt(3 / 9)
"""Characteristic time [s]."""


def _measured(
    trajectory: tb.Trajectory, reference: Formula = REFERENCE, end: float = END, **more: Any
) -> dict:
    return {metric.label: metric for metric in measure(trajectory, reference, end, **more)}  # type: ignore[arg-type]


def _changed(
    trajectory: tb.Trajectory, reference: Formula = REFERENCE, end: float = END, **more: Any
) -> dict[str, float | None]:
    """Values that are others than those of the reference itself at the same times."""
    usual = _measured(reference.trajectory(trajectory.t), reference, end, **more)
    found = _measured(trajectory, reference, end, **more)
    assert all(
        label in found for label in usual if label.split()[0] not in ("joint_reaction_relative",)
    )
    return {
        label: metric.value
        for label, metric in found.items()
        if label not in usual
        or metric.value != pytest.approx(usual[label].value, rel=1e-12, abs=1e-15)
    }


def _own(**changes: Any) -> tb.Trajectory:
    return replace(REFERENCE.trajectory(T), **changes)


def _column(i: int, values: Any) -> Any:
    return np.eye(3)[i] * np.asarray(values)[..., None]


OWN = REFERENCE.trajectory(T)
AT_TIP = OWN.marker("projectile")


def test_the_reference_is_no_distance_from_itself() -> None:
    found = _measured(OWN)
    held = {"stop_gap_held (rest)": 0.0, "launch_time": pytest.approx(0.0, abs=1e-12)}
    held |= {"launch_speed": pytest.approx(0.0, abs=1e-12)}
    assert {label: metric.value for label, metric in found.items()} == {
        label: held.get(label, 0.0) for label in found
    }
    assert set(found) == {
        "missing_time",
        "position_max (projectile)",
        "position_rms (projectile)",
        "velocity_max (projectile)",
        "position_max (hook)",
        "position_rms (hook)",
        "velocity_max (hook)",
        "angle_max (tilt)",
        "angular_speed_max (tilt)",
        "angle_max (beta)",
        "angular_speed_max (beta)",
        "slide_max (s)",
        "slide_speed_max (s)",
        "launch_time",
        "launch_speed",
        "release_time (rest)",
        "stop_torque_max (rest)",
        "stop_torque_settled (rest)",
        "stop_impulse (rest)",
        "stop_torque_max (buffer)",
        "stop_torque_settled (buffer)",
        "stop_impulse (buffer)",
        "stop_torque_max (wall)",
        "stop_torque_settled (wall)",
        "stop_impulse (wall)",
        "joint_reaction_max (slot)",
        "joint_reaction_relative (slot)",
        "joint_reaction_max (pivot)",
        "joint_reaction_relative (pivot)",
        "kinetic_energy_max",
        "potential_energy_max",
        "energy_balance",
        "energy_drift",
        "energy_drift_kinetic",
        "horizontal_momentum",
        "stop_gap_held (rest)",
    }


UNITS = {
    "missing_time": "s",
    "position_max (hook)": "m",
    "position_rms (hook)": "m",
    "velocity_max (hook)": "m/s",
    "angle_max (beta)": "rad",
    "angular_speed_max (beta)": "rad/s",
    "slide_max (s)": "m",
    "slide_speed_max (s)": "m/s",
    "launch_time": "s",
    "launch_speed": "m/s",
    "release_time (rest)": "s",
    "stop_torque_max (rest)": "N m",
    "stop_torque_settled (wall)": "N",
    "stop_impulse (rest)": "N m s",
    "stop_impulse (wall)": "N s",
    "joint_reaction_max (slot)": "N",
    "joint_reaction_relative (slot)": "1",
    "kinetic_energy_max": "J",
    "potential_energy_max": "J",
    "energy_balance": "J",
    "energy_drift": "1",
    "energy_drift_kinetic": "1",
    "horizontal_momentum": "kg m/s",
    "stop_gap_held (rest)": "rad",
}


def test_every_metric_has_its_unit() -> None:
    found = _measured(OWN)
    assert {label: found[label].unit for label in UNITS} == UNITS


def _ramp(slope: float) -> Any:
    return slope * T


def _hook(position: Any = 0.0, velocity: Any = 0.0) -> tb.Trajectory:
    """With the hook elsewhere [m] and at another speed [m/s]."""
    motion = OWN.marker("hook")
    return _own(
        markers={
            **OWN.markers,
            "hook": PointMotion(motion.position + position, motion.velocity + velocity),
        }
    )


def _torque(stop: str, more: Any) -> tb.Trajectory:
    return _own(stop_torques={**OWN.stop_torques, stop: OWN.stop_torques[stop] + more})


def _reaction(joint: str, force: Any) -> tb.Trajectory:
    return _own(joint_reactions={**OWN.joint_reactions, joint: force})


READINGS: dict[str, tuple[tb.Trajectory, dict[str, float]]] = {
    "position off by 3 mm and 4 mm": (
        _hook(np.array([3e-3, -4e-3])),
        {"position_max (hook)": 5e-3, "position_rms (hook)": 5e-3},
    ),
    "position drifts": (
        _hook(np.outer(_ramp(2.0), [1, 0])),
        {"position_max (hook)": 3.0, "position_rms (hook)": math.sqrt(np.mean((2 * T[:151]) ** 2))},
    ),
    "velocity of the hook drifts": (
        _hook(velocity=np.outer(_ramp(-2.0), [0, 1])),
        {"velocity_max (hook)": 3.0},
    ),
    "sign of a speed": (_own(u=-OWN.u), {"angular_speed_max (beta)": 2 * TURN}),
    "angle off by a turn": (
        _own(q=OWN.q + _column(1, 0 * T - 2 * math.pi)),
        {"angle_max (beta)": 2 * math.pi, "stop_gap_held (rest)": 2 * math.pi},
    ),
    "slide drifts": (_own(q=OWN.q + _column(2, _ramp(-0.1))), {"slide_max (s)": 0.15}),
    "slide's speed": (
        _own(u=OWN.u + _column(2, 0 * T - 0.2)),
        {"slide_speed_max (s)": 0.2, "horizontal_momentum": 5 * 0.2},
    ),
    "torque off by 7 N m": (
        _torque("rest", -7.0),
        {
            "stop_torque_max (rest)": 7.0,
            "stop_torque_settled (rest)": 7.0,
            "stop_impulse (rest)": -7.0 * END,
        },
    ),
    "sign of a torque": (
        _torque("rest", -2 * OWN.stop_torques["rest"]),
        {
            "stop_torque_max (rest)": 40.0,
            "stop_torque_settled (rest)": 40.0,
            "stop_impulse (rest)": -10.0,
        },
    ),
    "force at a stop on a point": (
        _torque("wall", _ramp(1.0)),
        {
            "stop_torque_max (wall)": END,
            "stop_torque_settled (wall)": END,
            "stop_impulse (wall)": END**2 / 2,
        },
    ),
    "torque wrong at its release only": (
        _torque("rest", 5.0 * (np.abs(T - RELEASE) < 0.0149)),
        {"stop_torque_max (rest)": 5.0, "stop_impulse (rest)": 0.15},
    ),
    "torque wrong two steps from its release": (
        _torque("rest", 5.0 * (np.abs(T - RELEASE - 0.02) < 1e-6)),
        {
            "stop_torque_max (rest)": 5.0,
            "stop_torque_settled (rest)": 5.0,
            "stop_impulse (rest)": 0.05,
        },
    ),
    "torque wrong two steps before its release": (
        _torque("rest", 5.0 * (np.abs(T - RELEASE + 0.02) < 1e-6)),
        {
            "stop_torque_max (rest)": 5.0,
            "stop_torque_settled (rest)": 5.0,
            "stop_impulse (rest)": 0.05,
        },
    ),
    "sign of a reaction": (
        _reaction("slot", -OWN.joint_reactions["slot"]),
        {"joint_reaction_max (slot)": 90.0, "joint_reaction_relative (slot)": 2.0},
    ),
    "reaction off across": (
        _reaction("pivot", OWN.joint_reactions["pivot"] + np.array([0.3, -0.4])),
        {
            "joint_reaction_max (pivot)": 0.5,
            "joint_reaction_relative (pivot)": 0.5 / math.hypot(4.5, 6.0),
        },
    ),
    "half the kinetic energy": (
        _own(kinetic_energy=0.5 * OWN.kinetic_energy),
        {
            "kinetic_energy_max": 37.5,
            "energy_balance": 37.5,
            "energy_drift": 37.5 / 20,
            "energy_drift_kinetic": 0.5,
        },
    ),
    "another zero of the potential energy": (
        _own(potential_energy=OWN.potential_energy - 8.0),
        {
            "potential_energy_max": 8.0,
            "energy_balance": 8.0,
            "energy_drift": 0.4,
            "energy_drift_kinetic": 8 / 75,
        },
    ),
    "energies that balance": (
        _own(kinetic_energy=OWN.kinetic_energy - 2.0, potential_energy=OWN.potential_energy + 2.0),
        {"kinetic_energy_max": 2.0, "potential_energy_max": 2.0},
    ),
    "released late": (_own(release_times={"rest": RELEASE + 1e-3}), {"release_time (rest)": 1e-3}),
    "released early": (_own(release_times={"rest": RELEASE - 0.1}), {"release_time (rest)": -0.1}),
    "released after the end": (
        _own(release_times={"rest": 1.9}),
        {"release_time (rest)": 1.4, "launch_time": None, "launch_speed": None},
    ),
    "drift of a joint": (
        _own(joint_gaps={"pivot": -_ramp(1e-3)}),
        {"joint_gap_max (pivot)": 1.5e-3},
    ),
}


@pytest.mark.parametrize("name", READINGS)
def test_a_reading_that_is_wrong_in_one_place_shows_there_and_by_how_much(name: str) -> None:
    trajectory, expected = READINGS[name]
    assert _changed(trajectory) == {
        label: value if value is None else pytest.approx(value, rel=1e-9)
        for label, value in expected.items()
    }


def test_nothing_after_the_end_counts() -> None:
    late = T > END + 1e-9
    more = late[:, None]
    other = _own(
        q=OWN.q + late[:, None],
        u=OWN.u + late[:, None],
        kinetic_energy=OWN.kinetic_energy + late,
        potential_energy=OWN.potential_energy + late,
        stop_torques={name: torque + late for name, torque in OWN.stop_torques.items()},
        joint_reactions={name: force + more for name, force in OWN.joint_reactions.items()},
        markers={
            n: PointMotion(m.position + more, m.velocity + more) for n, m in OWN.markers.items()
        },
    )
    assert _changed(other) == {}
    at_end = T >= END - 1e-9
    other = replace(other, q=OWN.q + _column(0, at_end), u=OWN.u + _column(0, at_end))
    assert _changed(other) == {"angle_max (tilt)": 1.0, "angular_speed_max (tilt)": 1.0}


# invariants beyond the horizon


def test_invariants_are_compared_longer_than_the_rest() -> None:
    late = T > 1.0 + 1e-9
    other = _own(
        q=OWN.q + _column(0, late),
        u=OWN.u + _column(2, 0.1 * late),
        kinetic_energy=OWN.kinetic_energy + 1.0 * late,
        joint_gaps={"pivot": 1e-3 * late},
    )
    assert _changed(other, end=1.0, invariants_to=1.5) == {
        "energy_balance": pytest.approx(1.0),
        "energy_drift": pytest.approx(1 / 20),
        "energy_drift_kinetic": pytest.approx(1 / 75),
        "horizontal_momentum": pytest.approx(0.5),
        "joint_gap_max (pivot)": 1e-3,
    }


@pytest.mark.parametrize("whose", ["own", "reference"])
@pytest.mark.parametrize(("at", "counts"), [(1.0, True), (1.2, False), (1.5, False), (1.6, True)])
def test_invariants_end_where_an_impact_follows(whose: str, at: float, counts: bool) -> None:
    impacts = ((at, {"buffer": 1.0}),)
    reference = replace(REFERENCE, impacts=impacts) if whose == "reference" else REFERENCE
    late = (T > 1.3) & (T < 1.45)
    other = _own(
        kinetic_energy=OWN.kinetic_energy + late, impacts=impacts if whose == "own" else ()
    )
    found = _measured(other, reference, 1.0, invariants_to=1.5)
    assert found["energy_balance"].value == pytest.approx(1.0 if counts else 0.0)


# launches


def _launching(offset: float = 0.0, factor: float = 1.0) -> tb.Trajectory:
    """The tip, as much later [s] and faster."""
    moved = replace(REFERENCE, release_times={"rest": RELEASE + offset}).trajectory(T)
    angle = math.pi + TURN * np.maximum(T - RELEASE - offset, 0.0)
    speed = factor * ARM * TURN * np.stack([-np.sin(angle), -np.cos(angle)], axis=1)
    place = factor * ARM * np.stack([np.cos(angle), -np.sin(angle)], axis=1)
    return replace(moved, markers={**moved.markers, "projectile": PointMotion(place, speed)})


def test_a_launch_is_compared_by_time_and_speed_with_sign() -> None:
    found = _measured(_launching(0.01, 1.1))
    assert found["launch_time"].value == pytest.approx(0.01, abs=1e-9)
    assert found["launch_speed"].value == pytest.approx(0.1 * ARM * TURN, rel=1e-6)
    assert found["launch_speed"].note is None
    assert _measured(_launching(-0.01))["launch_time"].value == pytest.approx(-0.01, abs=1e-9)


def test_a_launch_that_one_of_the_two_has_by_the_end_is_missing_and_one_after_the_end_is_none() -> (
    None
):
    none = replace(REFERENCE, launches={})
    found = _measured(OWN, none)
    assert found["launch_time"].value is None and found["launch_speed"].value is None
    assert found["launch_time"].note == (
        "projectile comes to the launch angle at 1.28539816 s by the engine, at no time before "
        "the end by the reference"
    )
    assert found["launch_speed"].note == "only one of the two launches"
    resting = _own(release_times={"rest": None})
    assert _measured(resting)["launch_time"].value is None
    assert "launch_time" not in _measured(OWN, end=LAUNCH * (1 - 1e-8))
    assert "launch_time" in _measured(OWN, end=LAUNCH * (1 - 1e-10))
    assert "launch_time" in _measured(OWN, end=LAUNCH)
    # One of the two by the end, the other a little later: compared.
    assert _measured(_launching(0.01), end=LAUNCH)["launch_time"].value == pytest.approx(
        0.01, abs=1e-9
    )
    assert _measured(_launching(-0.01), end=LAUNCH - 0.005)["launch_time"].value == pytest.approx(
        -0.01, abs=1e-9
    )


def test_the_launch_of_another_marker_bears_its_name() -> None:
    tip = trolley().markers[0].model_copy(update={"name": "tip"})
    mechanism = trolley(markers=(tip, *trolley().markers[1:]))
    reference = replace(
        REFERENCE, mechanism=mechanism, launches={"tip": REFERENCE.launches["projectile"]}
    )
    found = _measured(reference.trajectory(T), reference, thrown="tip")
    assert found["launch_time (tip)"].value == pytest.approx(0.0, abs=1e-9)
    assert found["launch_speed (tip)"].value == pytest.approx(0.0, abs=1e-9)
    assert not [
        label
        for label in _measured(reference.trajectory(T), reference)
        if label.startswith("launch")
    ]
    no_launch = replace(reference, launches={"tip": Launch(1.9, 1.0, (0.7, 0.7))})
    found = _measured(
        replace(reference.trajectory(T), release_times={"rest": None}), no_launch, thrown="tip"
    )
    assert "launch_time (tip)" not in found


# releases


@pytest.mark.parametrize(
    ("own", "reference", "value"), [(0.5, None, None), (None, 0.5, None), (0.4, 0.5, -0.1)]
)
def test_releases_that_one_of_the_two_has(
    own: float | None, reference: float | None, value: float | None
) -> None:
    found = _measured(
        _own(release_times={"rest": own}), replace(REFERENCE, release_times={"rest": reference})
    )
    metric = found["release_time (rest)"]
    assert metric.value == (None if value is None else pytest.approx(value))
    assert (metric.note is None) == (value is not None)
    if own is None:
        assert (
            metric.note
            == "released at no time before the end by the engine, at 0.5 s by the reference"
        )


@pytest.mark.parametrize(
    ("turn", "judged"), [(0.9, set()), (1.1, {"rest"}), (1.4, {"rest"}), (1.6, {"rest", "wall"})]
)
def test_a_release_without_load_is_judged_where_the_gap_opens_by_a_part_of_its_scale(
    turn: float, judged: set[str]
) -> None:
    """A thousandth of a radian, or of 3 m; the tip is 2 m off, and nothing presses on the stops."""
    wall = next(stop for stop in trolley().stops if stop.name == "wall")
    held = wall.model_copy(update={"offset": 0.0, "closed": True})
    mechanism = trolley(stops=(*trolley().stops[:2], held))
    released = {"rest": RELEASE, "wall": RELEASE}
    idle = {stop.name: lambda t: 0 * t for stop in mechanism.stops}
    motion = replace(
        REFERENCE, mechanism=mechanism, release_times=released, torques=idle,
        q=lambda t: [0 * t, math.pi + turn * 1e-3 * (t > RELEASE), 0 * t],
    )  # fmt: skip
    found = _measured(motion.trajectory(T), motion)
    names = {"rest", "wall"}
    assert {name for name in names if found[f"release_time ({name})"].observed} == judged


def test_releases_of_both_after_the_end_are_none() -> None:
    def found(own: float | None, reference: float | None) -> dict[str, Metric]:
        return _measured(
            _own(release_times={"rest": own}), replace(REFERENCE, release_times={"rest": reference})
        )

    assert "release_time (rest)" not in found(1.6, 1.7)
    assert "release_time (rest)" not in found(1.6, None)
    assert "release_time (rest)" not in found(None, END * (1 + 1.1e-9))
    assert found(None, END * (1 + 0.9e-9))["release_time (rest)"].value is None
    assert found(END, 1.6)["release_time (rest)"].value == pytest.approx(-0.1)


def test_a_stop_that_is_open_at_the_start_is_never_released_under_the_law_without_impacts() -> None:
    own = _own(release_times={"rest": RELEASE, "buffer": 1.0, "wall": None})
    found = _measured(own)
    assert [label for label in found if label.startswith("release")] == [
        "release_time (rest)",
        "release_time (buffer)",
    ]
    released = found["release_time (buffer)"]
    assert released.value is None and released.observed
    unilateral = replace(REFERENCE, law=tb.StopLaw.UNILATERAL)
    assert "release_time (buffer)" not in _measured(own, unilateral)


# impacts


def _struck(
    *times: float, stop: str = "buffer", impulse: float = 1.0
) -> tuple[tuple[float, dict[str, float]], ...]:
    return tuple((time, {stop: impulse}) for time in times)


def _impact(
    own: tuple[Any, ...], reference: tuple[Any, ...], stop: str = "buffer", end: float = END
) -> Metric | None:
    found = _measured(_own(impacts=own), replace(REFERENCE, impacts=reference), end)
    return found.get(f"impact_time ({stop})")


def test_impacts_are_paired_in_their_order_and_the_worst_counts() -> None:
    metric = _impact(_struck(0.61, 0.87, 1.2), _struck(0.6, 0.9, 1.2))
    assert (
        metric is not None
        and metric.value == pytest.approx(-0.03)
        and metric.unit == "s"
        and metric.observed
    )
    assert _impact(_struck(1.6), _struck(1.7)) is None
    late = _impact(_struck(1.6), _struck(1.4))
    assert late is not None and late.value == pytest.approx(0.2)
    early = _impact(_struck(1.4), _struck(1.6))
    assert early is not None and early.value == pytest.approx(-0.2)


def test_an_impact_that_one_of_the_two_has_is_missing() -> None:
    for own, reference in (
        (_struck(0.6, 0.7), _struck(0.6)),
        (_struck(0.6), _struck(0.6, 0.9)),
        (_struck(0.6), ()),
    ):
        metric = _impact(own, reference)
        assert metric is not None and metric.value is None and metric.observed and metric.note
    further = _impact(_struck(0.6, 1.6), _struck(0.6))
    assert further is not None and further.value == 0.0  # the second one is after the end


def test_an_engine_that_resolves_no_impacts_says_so_and_one_that_misses_some_does_not() -> None:
    metric = _impact((), _struck(0.6))
    assert metric is not None and metric.value is None and not metric.observed
    assert metric.note == "the engine resolves no impacts; its motion is judged"
    metric = _impact(_struck(0.6, stop="wall"), _struck(0.6))
    assert metric is not None and metric.value is None and metric.observed


def test_stops_that_do_not_push_in_an_impact_have_none() -> None:
    assert _impact(_struck(0.6, impulse=0.0), _struck(0.7, impulse=0.0)) is None
    metric = _impact(_struck(0.6, impulse=-1.0), _struck(0.6))
    assert metric is not None and metric.value is None


def test_ten_impacts_of_a_stop_count() -> None:
    early = np.linspace(0.1, 1.0, 10)
    metric = _impact(_struck(*early, 1.2), _struck(*early, 1.25))
    assert metric is not None and metric.value == 0.0
    metric = _impact(_struck(*early[:-1], 1.2), _struck(*early))
    assert metric is not None and metric.value == pytest.approx(0.2)


def _jump(at: float, low: float, high: float) -> dict[str, float | None]:
    """What changes where speeds and forces are off between two times, beside impacts at `at` and 1
    s.
    """
    reference = replace(REFERENCE, impacts=_struck(1.0))
    off = ((low < T) & (high > T)).astype(float)
    own = replace(
        reference.trajectory(T),
        impacts=_struck(at),
        u=OWN.u + _column(0, off),
        kinetic_energy=OWN.kinetic_energy + off,
        stop_torques={**OWN.stop_torques, "wall": off},
        joint_reactions={
            **OWN.joint_reactions,
            "slot": OWN.joint_reactions["slot"] + off[:, None] * [0, 1],
        },
        markers={
            **OWN.markers,
            "hook": replace(OWN.marker("hook"), velocity=off[:, None] * [0.0, 1.0]),
        },
    )
    changed = _changed(own, reference)
    return {
        label: value
        for label, value in changed.items()
        if "energy_drift" not in label and "impulse" not in label
    }


SPEEDS_AND_FORCES = {
    "angular_speed_max (tilt)",
    "velocity_max (hook)",
    "kinetic_energy_max",
    "energy_balance",
    "stop_torque_max (wall)",
    "joint_reaction_max (slot)",
    "joint_reaction_relative (slot)",
}


def test_speeds_and_forces_are_not_compared_beside_an_impact() -> None:
    """Within one and a half steps of the two instants, and between them, but no further."""
    assert _jump(1.0, 0.9855, 1.0145) == {}
    assert _jump(1.05, 0.9855, 1.0645) == {"impact_time (buffer)": pytest.approx(0.05)}
    assert _jump(0.95, 0.9355, 1.0145) == {"impact_time (buffer)": pytest.approx(-0.05)}
    for low, high in ((0.975, 0.985), (1.015, 1.025)):
        assert set(_jump(1.0, low, high)) == SPEEDS_AND_FORCES | {"stop_torque_settled (wall)"}
    assert _jump(1.0, 0.975, 0.985)["velocity_max (hook)"] == pytest.approx(1.0)


def test_beside_an_impact_is_what_its_time_may_be_off_by_and_one_and_a_half_steps() -> None:
    t = np.linspace(0.99, 1.01, 201)
    reference = replace(REFERENCE, impacts=_struck(1.0))
    c = against(reference.trajectory(t), reference, END)  # type: ignore[arg-type]
    assert c.guard == pytest.approx(1e-3 * c.scales.time + 1.5e-4)
    assert np.array_equal(c.smooth, np.abs(t - 1.0) > c.guard)
    assert 0.1 < c.scales.time < 1.0  # some of these samples are compared, and some are not


def _pushed(*spells: tuple[float, float], expected: tuple[float, ...] = (1.0,)) -> set[str]:
    """What changes where an engine that resolves no impacts pushes in these spells [s]."""
    reference = replace(REFERENCE, impacts=_struck(*expected))
    off = np.zeros(len(T))
    for first, last in spells:
        off[(first < T) & (last > T)] = 100.0
    own = replace(
        reference.trajectory(T), impacts=(), stop_torques={**OWN.stop_torques, "buffer": off}
    )
    bare = replace(own, stop_torques={**OWN.stop_torques, "buffer": np.zeros(len(T))})
    before, after = _measured(bare, reference), _measured(own, reference)
    return {label for label in after if after[label].value != before[label].value}


def test_the_force_of_an_impact_that_is_spread_over_few_steps_is_not_compared() -> None:
    compared = {"stop_torque_max (buffer)", "stop_torque_settled (buffer)"}
    summed = {"stop_impulse (buffer)"}
    assert _pushed((1.045, 1.065)) == summed  # later than the reference's
    assert _pushed((1.045, 1.085)) == compared | summed  # longer than beside an impact
    # Each impact of the reference's accounts for one beginning.
    assert _pushed((1.045, 1.065), (1.205, 1.225)) == compared | summed
    assert _pushed((1.045, 1.065), (1.205, 1.225), expected=(1.0, 1.2)) == summed
    assert _pushed((1.045, 1.065), expected=()) == compared | summed


def test_the_speeds_of_an_impact_that_is_spread_over_some_steps_are_compared() -> None:
    reference = replace(REFERENCE, impacts=_struck(1.0))
    late = ((T > 0.995) & (T < 1.045)).astype(float)  # the speed jumps 45 ms later
    push = ((T > 1.045) & (T < 1.055)).astype(float)
    own = replace(
        reference.trajectory(T),
        impacts=(),
        u=OWN.u + _column(0, late),
        stop_torques={**OWN.stop_torques, "buffer": push},
    )
    found = _measured(own, reference)
    assert found["angular_speed_max (tilt)"].value == pytest.approx(1.0)
    assert found["stop_torque_max (buffer)"].value == pytest.approx(0.0, abs=1e-9)


def test_what_is_not_compared_at_an_impact_is_said() -> None:
    reference = replace(REFERENCE, impacts=_struck(1.0))
    own = replace(reference.trajectory(T), impacts=_struck(1.0))
    found = _measured(own, reference)
    for label in SPEEDS_AND_FORCES - {"joint_reaction_relative (slot)"}:
        assert found[label].left_out == pytest.approx(0.04)  # from 0.98 s to 1.02 s
    assert found["angle_max (tilt)"].left_out is None
    assert _measured(OWN)["angular_speed_max (tilt)"].left_out is None


def test_an_impact_of_one_of_the_two_only_has_a_window_of_its_own() -> None:
    off = (np.abs(T - 0.8) < 0.0149).astype(float)
    own = _own(impacts=_struck(0.6, 0.8), u=OWN.u + _column(0, off))
    changed = _changed(own, replace(REFERENCE, impacts=_struck(0.6)))
    assert changed == {"impact_time (buffer)": None}


def test_positions_and_potential_energy_are_compared_at_an_impact_as_well() -> None:
    reference = replace(REFERENCE, impacts=_struck(1.0))
    off = np.abs(T - 1.0) < 1e-6
    own = replace(
        reference.trajectory(T),
        q=OWN.q + _column(0, off),
        potential_energy=OWN.potential_energy + off,
    )
    assert {"angle_max (tilt)", "potential_energy_max"} < set(_changed(own, reference))


def test_where_every_sample_is_at_an_impact_speeds_are_not_judged() -> None:
    coarse = np.array([0.0, 0.75, 1.5])
    reference = replace(REFERENCE, impacts=_struck(0.7))
    found = _measured(reference.trajectory(coarse), reference)
    unseen = {label for label, metric in found.items() if not metric.observed}
    assert {
        "velocity_max (hook)",
        "kinetic_energy_max",
        "joint_reaction_max (slot)",
        "stop_torque_max (rest)",
    } < unseen
    assert found["velocity_max (hook)"].note == "every sample is at an impact"
    assert (
        found["velocity_max (hook)"].value is None and "joint_reaction_relative (slot)" not in found
    )


# forces that are not there


def test_what_an_engine_does_not_tell_is_said_for_each_stop_and_joint() -> None:
    found = _measured(_own(stop_torques={"rest": OWN.stop_torques["rest"]}, joint_reactions={}))
    blind = {label: metric for label, metric in found.items() if not metric.observed}
    assert set(blind) == {
        "stop_torque_max (buffer)",
        "stop_torque_max (wall)",
        "joint_reaction_max (slot)",
        "joint_reaction_max (pivot)",
    }
    assert all(m.value is None and m.note == "the engine does not tell it" for m in blind.values())
    assert {blind["stop_torque_max (wall)"].unit, blind["stop_torque_max (buffer)"].unit} == {
        "N",
        "N m",
    }
    assert found["stop_torque_max (rest)"].value == 0.0


def test_forces_that_are_not_unique_are_not_compared() -> None:
    reference = replace(REFERENCE, undetermined_joints=("slot",), undetermined_stops=("rest",))
    found = _measured(OWN, reference)
    blind = [label for label, metric in found.items() if not metric.observed]
    assert blind == ["release_time (rest)", "stop_torque_max (rest)", "joint_reaction_max (slot)"]
    assert all("not unique" in found[label].note for label in blind)


def test_a_joint_without_load_has_no_relative_error() -> None:
    reference = replace(
        REFERENCE, reactions={**REFERENCE.reactions, "slot": lambda t: np.zeros((len(t), 2))}
    )
    found = _measured(OWN, reference)
    assert found["joint_reaction_max (slot)"].value == 45.0
    assert "joint_reaction_relative (slot)" not in found


# invariants


def test_energies_without_a_zero_have_no_relative_error() -> None:
    reference = replace(REFERENCE, kinetic=lambda t: 0 * t, potential=lambda t: 0 * t)
    found = _measured(OWN, reference)
    assert found["energy_balance"].value == pytest.approx(20.0)
    assert not [label for label in found if label.startswith("energy_drift")]


@pytest.mark.parametrize(
    ("changes", "invariant"),
    [
        ({}, True),
        ({"joints": (SLOT.model_copy(update={"axis": (-1.0, 0.0)}), trolley().joints[1])}, True),
        ({"joints": (SLOT.model_copy(update={"axis": (0.6, 0.8)}), trolley().joints[1])}, False),
        ({"joints": (SLOT.model_copy(update={"axis": (0.0, 1.0)}), trolley().joints[1])}, False),
        (
            {
                "joints": (pin("slot", GROUND, "trolley"), trolley().joints[1]),
                "start": (0.0, math.pi),
            },
            False,
        ),
        (
            {
                "stops": (
                    PointStop(
                        name="wall",
                        body="arm",
                        point=(1, 0),
                        normal=(1, 0),
                        offset=-9,
                        closed=False,
                    ),
                )
            },
            False,
        ),
        (pinned(), False),
    ],
    ids=[
        "level slot",
        "the other way",
        "tilted",
        "upright",
        "pinned",
        "pushed by a wall",
        "a pin on the ground beside",
    ],
)
def test_momentum_is_an_invariant_where_nothing_pushes_along_x(
    changes: dict[str, Any], invariant: bool
) -> None:
    mechanism = trolley(**changes)
    zeros = len(mechanism.coordinates) - 3
    reference = replace(
        REFERENCE, mechanism=mechanism, release_times={"rest": None},
        q=lambda t: [0 * t] * (3 + zeros), u=lambda t: [0 * t] * (3 + zeros),
        reactions={joint.name: lambda t: np.zeros((len(t), 2)) for joint in mechanism.joints},
    )  # fmt: skip
    found = measure(reference.trajectory(T), reference, END, thrown="none")  # type: ignore[arg-type]
    assert ("horizontal_momentum" in {metric.name for metric in found}) == invariant


def test_momentum_is_measured_from_that_at_the_start() -> None:
    """0.3 m/s of 5 kg from the start on: it is the change that counts, along x only."""
    moving = replace(REFERENCE, u=lambda t: [0 * t, TURN * (t > RELEASE), 0.3 + 0 * t])
    assert _measured(moving.trajectory(T), moving)["horizontal_momentum"].value == pytest.approx(
        0.0, abs=1e-14
    )
    slower = replace(moving.trajectory(T), u=moving.trajectory(T).u - _column(2, 0.1 * (T > 1.0)))
    assert _changed(slower, moving)["horizontal_momentum"] == pytest.approx(0.5)


# constraints


def test_a_stop_is_held_up_to_the_earlier_release() -> None:
    lifted = _own(q=OWN.q + _column(1, 0.01 * (T > 0.3)))
    assert _measured(lifted)["stop_gap_held (rest)"].value == pytest.approx(0.01)
    at_release = _own(q=OWN.q + _column(1, 0.02 * (np.abs(T - RELEASE) < 1e-9)))
    assert _measured(at_release)["stop_gap_held (rest)"].value == pytest.approx(0.02)
    early = replace(lifted, release_times={"rest": 0.3})
    assert _measured(early)["stop_gap_held (rest)"].value == 0.0
    pressed = _own(q=OWN.q - _column(1, 0.01 * (T < 0.2)))
    assert _measured(pressed)["stop_gap_held (rest)"].value == pytest.approx(0.01)
    never = replace(lifted, release_times={"rest": None})
    assert _measured(never, replace(REFERENCE, release_times={"rest": None}), 0.4)[
        "stop_gap_held (rest)"
    ].value == pytest.approx(0.01)
    at_once = _own(t=np.concatenate([[1e-10], T[1:]]), release_times={"rest": 0.0})
    assert (
        _measured(at_once, replace(REFERENCE, release_times={"rest": 0.0}))[
            "stop_gap_held (rest)"
        ].value
        == 0.0
    )


def test_penetration_is_judged_under_the_unilateral_law_only_and_without_torques_too() -> None:
    into = _own(q=OWN.q + _column(1, 0.02 * (T < 0.2) * -1.0))
    assert not [
        label
        for label in _measured(into)
        if label.startswith(("stop_penetration", "complementarity"))
    ]
    law = replace(REFERENCE, law=tb.StopLaw.UNILATERAL)
    found = _measured(into, law)
    assert found["stop_penetration (rest)"].value == pytest.approx(0.02)
    assert (
        found["stop_penetration (rest)"].unit == "rad"
        and found["stop_penetration (wall)"].unit == "m"
    )
    assert found["stop_penetration (buffer)"].value == 0.0
    # 20 N m at most where it gapes: the largest product, of the largest torque.
    assert found["complementarity (rest)"].value == pytest.approx(0.02)
    assert "complementarity (buffer)" not in found
    assert _measured(replace(into, stop_torques={}), law)[
        "stop_penetration (rest)"
    ].value == pytest.approx(0.02)


def test_a_stop_that_pushes_at_a_distance_is_seen() -> None:
    """2 N m at a gap of 8.3 rad, of a largest torque of 4 N m."""
    torque = 2.0 * (np.abs(T - 1.0) < 1e-6) + 4.0 * (np.abs(T - 1.8) < 1e-6) + 1.0 * (T < 0.001)
    own = _own(stop_torques={**OWN.stop_torques, "buffer": torque})
    found = _measured(own, replace(REFERENCE, law=tb.StopLaw.UNILATERAL))
    gap = 10.0 - (math.pi + TURN * (1.0 - RELEASE))
    assert found["complementarity (buffer)"].value == pytest.approx(gap)
    assert found["complementarity (buffer)"].unit == "rad"


# the compared time


@pytest.mark.parametrize(
    ("t", "missing", "unseen"),
    [
        (T, 0.0, 0.0),
        (T[T <= 1.5], 0.0, 0.0),
        (T[T <= 1.2 + 1e-9], 0.3, 0.0),
        (times(0.25), 0.0, 0.0),
        (np.arange(0.0, 2.2, 0.3), 0.0, 1.5),  # longer than half of sqrt(1/3) s
        (np.arange(0.0, 1.3, 0.3), 0.3, 1.2),
        (np.array([0.0, 2.0]), 0.0, 1.5),
        (np.concatenate([T[T < 0.41], T[T > 0.99]]), 0.0, 0.6),
        (np.concatenate([T[T < 1.005], [1.9]]), 0.0, 0.5),
        (np.concatenate([T[T < 1.405], [1.9]]), 0.0, 0.0),
        (np.concatenate([[0.0], T[T > 1.0]]), 0.0, 1.01),
        (np.repeat(T, 2), 0.0, 0.0),
        (T[T > 0.995], 1.0, 0.0),
    ],
    ids=[
        "whole",
        "to the end",
        "truncated",
        "coarse",
        "too coarse",
        "too coarse and truncated",
        "two",
        "gap",
        "late",
        "last step",
        "jump",
        "twice",
        "late start",
    ],
)
def test_what_is_missing_lies_before_or_behind_the_samples_and_the_unseen_between_them(
    t: Any, missing: float, unseen: float
) -> None:
    found = _measured(REFERENCE.trajectory(t))
    assert found["missing_time"].value == pytest.approx(missing, abs=1e-12)
    assert ("unseen_time" in found) is bool(unseen)
    if unseen:
        assert found["unseen_time"].value == pytest.approx(unseen, abs=1e-12)


def test_a_short_end_needs_samples_of_its_own() -> None:
    """Half the end counts where that is less than half the characteristic time."""
    found = _measured(REFERENCE.trajectory(np.array([0.0, 0.11, 0.2])), end=0.1)
    assert found["unseen_time"].value == pytest.approx(0.1)
    assert "unseen_time" not in _measured(REFERENCE.trajectory(times(0.05)), end=0.1)


def test_the_compared_time_lasts_as_long_as_invariants_are() -> None:
    short = REFERENCE.trajectory(T[T <= 1.2 + 1e-9])
    assert _measured(short, end=1.0)["missing_time"].value == 0.0
    assert _measured(short, end=1.0, invariants_to=1.5)["missing_time"].value == pytest.approx(0.3)


def test_repeated_times_change_nothing() -> None:
    twice = np.sort(np.concatenate([T, [RELEASE, LAUNCH, LAUNCH]]))
    found = _measured(REFERENCE.trajectory(twice))
    assert max(abs(metric.value or 0.0) for metric in found.values()) < 1e-9


# a comparison


def test_a_comparison_is_cut_at_its_end_and_knows_its_step_and_scales() -> None:
    c = against(OWN, REFERENCE, END)  # type: ignore[arg-type]
    assert c.t[-1] == END and len(c.t) == 151
    assert c.step == pytest.approx(0.01) and c.scales.length == 3.0 and c.smooth.all()
    assert c.lasting is c
    assert c.distance(np.arange(201.0), np.zeros(201)).max() == 150.0
    uneven = against(REFERENCE.trajectory(np.array([0.0, 0.1, 0.2, 0.3, 1.6])), REFERENCE, END)  # type: ignore[arg-type]
    assert uneven.step == pytest.approx(0.1)


def test_given_scales_and_reference_are_taken() -> None:
    scales = against(OWN, REFERENCE, END).scales.model_copy(update={"time": 1e-3})  # type: ignore[arg-type]
    assert _measured(OWN, scales=scales)["unseen_time"].value == pytest.approx(END)
    moved = _own(q=OWN.q + _column(0, np.ones(len(T))))
    assert _measured(OWN, reference=REFERENCE) == _measured(OWN)
    found = {m.label: m.value for m in measure(OWN, REFERENCE, END, moved)}  # type: ignore[arg-type]
    assert found["angle_max (tilt)"] == 1.0


# names


@pytest.mark.parametrize(
    "quantity",
    [
        Quantity(Kind.COORDINATES),
        Quantity(Kind.SPEEDS),
        Quantity(Kind.POSITION, "tip of the arm"),
        Quantity(Kind.KINETIC_ENERGY),
    ],
)
def test_a_quantity_is_read_from_its_text(quantity: Quantity) -> None:
    assert Quantity.parse(quantity.text) == quantity


def test_an_unknown_kind_of_quantity_is_refused() -> None:
    with pytest.raises(ValueError, match="mood"):
        Quantity.parse("mood of the projectile")


@pytest.mark.parametrize("subject", [None, "rest", "rest (left)", "x)"])
def test_a_label_is_read_as_it_was_written(subject: str | None) -> None:
    assert parse_label(metric_label("release_time", subject)) == ("release_time", subject)
