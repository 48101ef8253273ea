"""Mistakes in reading a motion are read back: what a mistake makes of it is one of the readings."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from itertools import chain, product

import numpy as np
import pytest
import trebucheck as tb
from mechanisms import everything, hanging_bob, rods_on_a_slot, scaled
from trebucheck.comparisons.diagnosis.readings import (
    Reading,
    _conventions,
    _forces,
    _kinetic_mistakes,
    _known_points,
    _markers,
    _orders,
    all_readings,
    partly_late_readings,
    scale_text,
)
from trebucheck.comparisons.runs.quantities import Kind
from trebucheck.models.elements import GROUND
from trebucheck.models.trajectory import PointMotion, Trajectory
from trebucheck.reference.solution import Solution
from trebucheck.reference.solver import solve

END, STEP = 0.3, 1e-3
DEGREES = 180 / math.pi
Mistake = Callable[[Trajectory], Trajectory]


@cache
def _moved() -> tuple[Solution, Trajectory]:
    """One of each element, with a marker on each of two bodies, and where they are."""
    fields = everything().model_dump() | {
        "markers": [
            {"name": "tip", "body": "bob", "point": (0.35, 0.15)},
            {"name": "hand", "body": "arm", "point": (-0.2, 0.3)},
        ]
    }
    solution = solve(tb.Problem(tb.Mechanism(**fields), duration=2 * END))
    return solution, solution.trajectory(np.linspace(0.0, END, 25))


@cache
def _readings() -> tuple[Reading, ...]:
    solution, right = _moved()
    return tuple(all_readings(solution, right, right, STEP))


def _read_back(recorded: Trajectory) -> list[Reading]:
    """The readings that give what was recorded, of those that depend on it."""
    several = (_forces, _markers, _orders, _conventions)
    found = chain.from_iterable(readings(_moved()[1], recorded) for readings in several)
    return [reading for reading in found if _same(reading.wrong[0], recorded)]


def _named(name: str) -> Reading:
    (found,) = (reading for reading in _readings() if reading.name == name)
    return found


def _arrays(r: Trajectory) -> list[np.ndarray]:
    points = [array for m in r.markers.values() for array in (m.position, m.velocity)]
    forces = [*r.joint_reactions.values(), *r.stop_torques.values()]
    return [r.q, r.u, *points, *forces, r.kinetic_energy, r.potential_energy]


def _same(one: Trajectory, other: Trajectory) -> bool:
    pairs = zip(_arrays(one), _arrays(other), strict=True)
    return all(a is b or np.abs(a - b).max() <= 1e-9 * np.abs(b).max() for a, b in pairs)


# conventions of coordinates


def _angles(r: Trajectory) -> np.ndarray:
    return np.arange(r.q.shape[1]) < len(r.mechanism.angles)


def _relative(r: Trajectory) -> np.ndarray:
    """The arm's angle from the hull's, the bob's from the arm's; the hull floats."""
    names = list(r.mechanism.coordinates)
    matrix = np.eye(len(names))
    matrix[names.index("arm angle"), names.index("hull angle")] = -1.0
    matrix[names.index("bob angle"), names.index("arm angle")] = -1.0
    return matrix


def _convention(frame: bool, sign: int, unit: float, zero: str, of: str) -> Mistake:
    def mistaken(r: Trajectory) -> Trajectory:
        matrix = _relative(r) if frame else np.eye(r.q.shape[1])
        matrix = np.where(_angles(r), sign * unit, 1.0)[:, None] * matrix
        q, u = r.q @ matrix.T, r.u @ matrix.T
        if zero == "start":
            q = q - q[0]
        if zero == "another":
            q = q + np.arange(1.0, 1.0 + q.shape[1])
        return replace(r, q=q if "q" in of else r.q, u=u if "u" in of else r.u)

    return mistaken


WORDS = (
    "relative to the parent", "anticlockwise", "degrees", "relative to the start",
    "from another zero",
)  # fmt: skip


def _mistakes() -> Iterator[object]:
    for frame, sign, unit in product((False, True), (1, -1), (1.0, DEGREES)):
        for zero, of in (("", "qu"), ("start", "qu"), ("another", "qu"), ("", "q"), ("", "u")):
            if frame or (sign, unit) != (1, 1.0) or zero:
                said = (frame, sign < 0, unit > 1, zero == "start", zero == "another")
                how = [word for word, is_so in zip(WORDS, said, strict=True) if is_so]
                yield pytest.param(_convention(frame, sign, unit, zero, of), how, of)


@pytest.mark.parametrize(("mistake", "how", "of"), list(_mistakes()))
def test_a_convention_of_coordinates_is_read_back(
    mistake: Mistake, how: list[str], of: str
) -> None:
    recorded = mistake(_moved()[1])
    found = _read_back(recorded)
    assert how in [[word for word in WORDS if word in reading.name] for reading in found]
    if of != "qu":
        only = "not their speeds" if of == "q" else "speeds of the angles"
        assert any(only in reading.name for reading in found)


def test_the_zero_of_each_coordinate_is_told() -> None:
    """In the unit of the convention, and of those only that are off."""
    right = _moved()[1]
    offsets = np.zeros(right.q.shape[1])
    offsets[[1, 5]] = 0.25, -0.125
    recorded = replace(right, q=right.q + offsets)
    names = [reading.name for reading in _read_back(recorded)]
    assert names == ["coordinates from another zero (arm angle +0.25 rad, s -0.125 m)"]
    turned = np.where(_angles(right), DEGREES, 1.0)
    recorded = replace(right, q=right.q * turned + offsets, u=right.u * turned)
    names = [reading.name for reading in _read_back(recorded)]
    assert len(names) == 1 and "(arm angle +0.25 deg, s -0.125 m)" in names[0]


@pytest.mark.parametrize("order", [(1, 0, 2, 3, 4, 5, 6), (2, 0, 1, 3, 4, 5, 6)])
def test_another_order_of_coordinates_is_read_back(order: tuple[int, ...]) -> None:
    right = _moved()[1]
    recorded = replace(right, q=right.q[:, order], u=right.u[:, order])
    assert _read_back(recorded)


# forces and markers


def _in_frame(r: Trajectory, body: str, v: np.ndarray) -> np.ndarray:
    angle = np.zeros(len(r.t)) if body == GROUND else r.kinematics.angle(body).value(r.q)
    # A body's x axis is (cos a, -sin a): angles are clockwise.
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * v[:, 0] - s * v[:, 1], s * v[:, 0] + c * v[:, 1]], axis=1)


FORCES: dict[str, Callable[[Trajectory, str, np.ndarray], np.ndarray]] = {
    "mirrored, x": lambda _, __, v: v * [-1, 1],
    "mirrored, y": lambda _, __, v: v * [1, -1],
    "x and y exchanged": lambda _, __, v: v[:, ::-1],
    "in the frame of the body": lambda r, j, v: _in_frame(r, _joint(r, j).child, v),
    "in the frame of the parent": lambda r, j, v: _in_frame(r, _joint(r, j).parent, v),
    "in the frame of the body, wrong sign": lambda r, j, v: -_in_frame(r, _joint(r, j).child, v),
    "in the frame of the parent, wrong sign": lambda r, j, v: -_in_frame(r, _joint(r, j).parent, v),
    "without the weight of the body": lambda r, j, v: (
        v + r.mechanism.body(_joint(r, j).child).mass * 9.81 * np.array([0.6, -0.8])
    ),
}


def _joint(r: Trajectory, name: str) -> tb.AnyJoint:
    return next(joint for joint in r.mechanism.joints if joint.name == name)


@pytest.mark.parametrize("how", FORCES)
@pytest.mark.parametrize("only", [None, "rail", "pin"])
def test_a_mistake_in_joint_forces_is_read_back(how: str, only: str | None) -> None:
    right = _moved()[1]
    held = {name: v for name, v in right.joint_reactions.items() if only in (None, name)}
    wrong = {name: FORCES[how](right, name, v) for name, v in held.items()}
    recorded = replace(right, joint_reactions={**right.joint_reactions, **wrong})
    found = _read_back(recorded)
    whose = f" of the {only}" if only else ""
    assert f"joint forces{whose} {how}" in [reading.name for reading in found]


def test_joint_forces_under_other_names_are_read_back() -> None:
    right = _moved()[1]
    pairs = (("slot", "rail"), ("rail", "weld"), ("weld", "slot"))
    taken = {one: right.joint_reactions[other] for one, other in pairs}
    recorded = replace(right, joint_reactions={**right.joint_reactions, **taken})
    found = _read_back(recorded)
    assert [reading.name for reading in found] == [
        "joint forces of the slot, rail, weld are those of rail, weld, slot"
    ]


def _point(r: Trajectory, body: str, point: tuple[float, float]) -> PointMotion:
    row = r.kinematics.point(body, point)
    return PointMotion(r.kinematics.position(row, r.q), r.kinematics.velocity(row, r.q, r.u))


POINTS = {
    "the hull's centre of mass": ("hull", (0.1, -0.05)),
    "the bob's centre of mass": ("bob", (0.3, 0.0)),
    "the slot": ("hull", (0.2, 0.3)),
    "the rail": ("arm", (0.3, 0.1)),
    "the weld": ("slider", (0.1, 0.1)),
    "the pin": ("bracket", (0.4, 0.0)),
    "the slider's origin": ("slider", (0.0, 0.0)),
    "the arm's origin": ("arm", (0.0, 0.0)),
}
"""Some points that a marker is taken for."""


def test_the_known_points_are_those_of_bodies_and_joints() -> None:
    known = _known_points(_moved()[0].problem.mechanism)
    assert all(known[at] == what for what, at in POINTS.items())
    child_points = [((j.child, j.child_point), j.name) for j in everything().joints]
    assert all(at in known for at, _ in child_points)
    assert known["arm", (0.05, 0.0)] == "the slot" and known["hull", (0.0, 0.0)] == "the sea"
    assert (GROUND, (0.0, 0.0)) not in known


@pytest.mark.parametrize("what", POINTS)
@pytest.mark.parametrize("of", ["both", "position", "velocity"])
def test_a_marker_taken_for_another_point_is_read_back(what: str, of: str) -> None:
    right = _moved()[1]
    tip, other = right.marker("tip"), _point(right, *POINTS[what])
    wrong = PointMotion(
        tip.position if of == "velocity" else other.position,
        tip.velocity if of == "position" else other.velocity,
    )
    recorded = replace(right, markers={**right.markers, "tip": wrong})
    found = _read_back(recorded)
    text = f"tip taken for {what}" if of == "both" else f"{of} of the tip taken for that of {what}"
    assert [reading.name for reading in found] == [text]


def test_markers_that_are_exchanged_or_turned_are_read_back() -> None:
    right = _moved()[1]
    tip, hand = right.marker("tip"), right.marker("hand")
    recorded = replace(right, markers={"tip": hand, "hand": tip})
    found = [reading.name for reading in _read_back(recorded)]
    assert found == ["tip and hand exchanged"]
    local = PointMotion(tip.position, _in_frame(right, "bob", tip.velocity))
    recorded = replace(right, markers={"tip": local, "hand": hand})
    found = [reading.name for reading in _read_back(recorded)]
    assert found == ["velocities of the tip in the frame of the body"]


def test_a_right_motion_is_read_in_no_other_names_frames_or_zeros() -> None:
    """Readings that depend on what was recorded are those that are nearer to it."""
    usual = [reading.name for reading in _readings()]
    words = ("taken for", "tip and hand", "are those of", "frame of", "relative to", "from another")
    assert not [name for name in usual if any(word in name for word in words)]
    assert not [name for name in usual if name.startswith(("joint forces", "coordinates from"))]


# sizes


def _fitted(name: str, factors: tuple[float, ...]) -> Trajectory:
    """The right motion with so many times a mistake of size one, which is linear."""
    right = _moved()[1]
    reading = _named(name)

    def sum_of(base: np.ndarray, wrong: list[np.ndarray]) -> np.ndarray:
        return base + sum(f * (w - base) for f, w in zip(factors, wrong, strict=True))

    return replace(
        right,
        q=sum_of(right.q, [w.q for w in reading.wrong]),
        kinetic_energy=sum_of(right.kinetic_energy, [w.kinetic_energy for w in reading.wrong]),
        potential_energy=sum_of(
            right.potential_energy, [w.potential_energy for w in reading.wrong]
        ),
        markers={
            n: PointMotion(
                sum_of(m.position, [w.marker(n).position for w in reading.wrong]),
                sum_of(m.velocity, [w.marker(n).velocity for w in reading.wrong]),
            )
            for n, m in right.markers.items()
        },
    )


def _numbers(text: str) -> list[float]:
    return [float(word) for word in text.replace(",", " ").split() if word[0] in "+-0123456789"]


def test_the_size_of_another_origin_is_told_in_metres() -> None:
    right = _moved()[1]
    factors = (0.25, -0.5)
    for name, changed in (("origin of the positions", {"tip", "hand"}),
                          ("origin of the hand's position", {"hand"})):  # fmt: skip
        wrong, text = _fitted(name, factors), _named(name).text
        assert text is not None
        away = np.array(_numbers(text(factors)))
        assert np.all(away != 0)
        for marker in right.markers:
            moved = wrong.marker(marker).position - right.marker(marker).position
            expected = np.broadcast_to(away * (marker in changed), moved.shape)
            assert moved == pytest.approx(expected, rel=5e-3)  # three digits are told
            assert np.array_equal(wrong.marker(marker).velocity, right.marker(marker).velocity)


def test_the_size_of_another_point_is_told_in_metres_on_the_body() -> None:
    right = _moved()[1]
    factors = (0.25, -0.5)
    wrong, text = (
        _fitted("point of the hand on the arm", factors),
        _named("point of the hand on the arm").text,
    )
    assert text is not None
    x, y = _numbers(text(factors))
    there = _point(right, "arm", (-0.2 + x, 0.3 + y))
    assert x > 0 > y
    off, own = wrong.marker("hand"), right.marker("hand")
    # Three digits of x and y are told.
    digits = 5e-3 * math.hypot(x, y)
    assert off.position == pytest.approx(there.position, abs=digits)
    assert off.velocity == pytest.approx(there.velocity, abs=digits * np.abs(right.u).max())
    assert np.abs(off.velocity - own.velocity).max() > 10 * digits * np.abs(right.u).max()


def test_the_sizes_of_energies_are_told() -> None:
    right = _moved()[1]
    raised = _fitted("zero of the potential energy", (0.5,))
    text = _named("zero of the potential energy").text
    assert text is not None
    (zero,) = _numbers(text((0.5,)))
    assert raised.potential_energy - right.potential_energy == pytest.approx(
        np.full(len(right.t), zero), rel=1e-3
    )
    moved = _fitted("kinetic energy counted as potential", (-0.3,))
    text = _named("kinetic energy counted as potential").text
    assert text is not None and _numbers(text((-0.3,))) == [30.0]
    assert moved.kinetic_energy == pytest.approx(0.7 * right.kinetic_energy)
    assert moved.total_energy == pytest.approx(right.total_energy)


@pytest.mark.parametrize(
    ("factor", "text"),
    [
        (-2.0, "wrong sign"),
        (-1.0, "always zero"),
        (DEGREES - 1, "degrees for radians"),
        (1 / DEGREES - 1, "radians for degrees"),
        (0.5, "times 1.5"),
        (-0.5, "times 0.5"),
        (STEP - 1, "times 0.001, the step"),
        (1 / STEP - 1, "times 1000, one over the step"),
        (-2.0 - 1e-4, "wrong sign"),
        (-2.0 - 2e-3, "times -1.002"),
    ],
)
def test_a_factor_is_told_as_the_mistake_that_it_is(factor: float, text: str) -> None:
    assert scale_text(factor, STEP) == text


def test_only_a_force_is_told_in_steps() -> None:
    for reading in _readings():
        if reading.name.startswith("scale of"):
            assert reading.text is not None
            in_steps = "the step" in reading.text((STEP - 1,))
            forces = ("force", "torque")
            assert in_steps == any(word in reading.name for word in forces) or (
                "masses" in reading.name
            )


def test_masses_are_scaled_to_no_less_than_nearly_nothing() -> None:
    """Other quantities may have the wrong sign; there is no negative mass."""
    least = {r.name: r.least for r in _readings() if r.least > -math.inf}
    (smallest,) = least.values()
    assert "masses" in next(iter(least)) and 0.0 < 1.0 + smallest < 1e-3


# other times


def test_a_shift_and_a_rate_are_those_of_the_solution() -> None:
    solution, right = _moved()
    shifted, rate = _named("motion shifted in time, and no force"), _named("rate of time")
    assert shifted.at is not None and rate.at is not None
    assert shifted.text is not None and rate.text is not None
    factor = 3e4
    later, faster = shifted.at(factor), rate.at(factor)
    assert later is not None and faster is not None
    late, steps = _numbers(shifted.text((factor,)))
    assert late == pytest.approx(0.03 * END) and steps == pytest.approx(late / STEP)
    there = solution.trajectory(right.t + late)
    assert later.q == pytest.approx(there.q) and later.u == pytest.approx(there.u)
    assert later.marker("tip").position == pytest.approx(there.marker("tip").position)
    assert np.array_equal(later.t, right.t)
    for joint, force in right.joint_reactions.items():
        assert np.array_equal(later.joint_reactions[joint], force)
    (told,) = _numbers(rate.text((factor,)))
    there = solution.trajectory(right.t * 1.03)
    assert told == pytest.approx(1 / 1.03, rel=1e-5)
    assert faster.q == pytest.approx(there.q)
    assert faster.joint_reactions["pin"] == pytest.approx(there.joint_reactions["pin"])
    for reading in (shifted, rate):
        assert reading.at is not None
        assert reading.at(0.19e6) is not None and reading.at(-0.19e6) is not None
        assert reading.at(0.21e6) is None and reading.at(-0.21e6) is None


def test_kinds_that_are_late_together_are_read_together() -> None:
    solution, right = _moved()
    kinds = {Kind.SPEEDS, Kind.KINETIC_ENERGY}
    together, mixed = partly_late_readings(solution, right, STEP, kinds)
    later = solution.trajectory(right.t + 1e-6 * END)
    for reading in (together, mixed):
        wrong = reading.wrong[0]
        assert np.array_equal(wrong.q, right.q) and wrong.u == pytest.approx(later.u, abs=1e-12)
        assert not np.array_equal(wrong.u, right.u)
        assert not np.array_equal(wrong.kinetic_energy, right.kinetic_energy)
        assert np.array_equal(wrong.potential_energy, right.potential_energy)
    assert together.wrong[0].kinetic_energy == pytest.approx(later.kinetic_energy, abs=1e-12)
    assert np.array_equal(together.wrong[0].marker("tip").velocity, right.marker("tip").velocity)
    assert not np.array_equal(mixed.wrong[0].marker("tip").velocity, right.marker("tip").velocity)
    assert not list(partly_late_readings(solution, right, STEP, {Kind.SPEEDS}))
    assert not list(partly_late_readings(solution, right, STEP, {Kind.SPEEDS, Kind.VELOCITY}))
    (only,) = partly_late_readings(solution, right, STEP, {*kinds, Kind.COORDINATES})
    assert only.wrong[0].q == pytest.approx(later.q, abs=1e-12)
    assert not np.array_equal(only.wrong[0].q, right.q)


# energies in part


def test_kinetic_energies_of_bodies_add_up() -> None:
    right = _moved()[1]
    wrong, bodies = _kinetic_mistakes(right), right.mechanism.bodies
    alone = [wrong[f"of the {body.name} alone"] for body in bodies]
    assert sum(alone) == pytest.approx(right.kinetic_energy)
    spins = {body.name: right.u[:, k] for body, k in zip(bodies, (0, 1, 1, 1, 2), strict=True)}
    turning = {body.name: 0.5 * body.inertia * spins[body.name] ** 2 for body in bodies}
    for body, part in zip(bodies, alone, strict=True):
        rest = wrong[f"without the {body.name}"]
        assert rest + part == pytest.approx(right.kinetic_energy)
        centre = _point(right, body.name, body.centre).velocity
        assert part - turning[body.name] == pytest.approx(0.5 * body.mass * (centre**2).sum(axis=1))
        left = right.kinetic_energy - wrong[f"without the rotation of the {body.name}"]
        assert left == pytest.approx(turning[body.name])
    every = right.kinetic_energy - wrong["without the rotation of the bodies"]
    assert every == pytest.approx(sum(turning.values()))
    about = {b.name: b.mass * math.dist(b.centre, _joint_of(right, b.name)) ** 2 for b in bodies}
    assert wrong["with inertias about the joints"] - right.kinetic_energy == pytest.approx(
        sum(0.5 * about[name] * spin**2 for name, spin in spins.items())
    )


def _joint_of(r: Trajectory, body: str) -> tuple[float, float]:
    return next(joint.child_point for joint in r.mechanism.joints if joint.child == body)


@pytest.mark.parametrize(
    ("mechanism", "parts"),
    [
        (hanging_bob(), set()),
        (
            rods_on_a_slot(inertia=0.0, tip=(0.5, 0.2)),
            {"without the upper", "of the upper alone", "without the lower", "of the lower alone"}
            | {"without the rotation of the upper"},
        ),
    ],
)
def test_parts_of_the_kinetic_energy_are_of_several_bodies_and_of_those_that_turn(
    mechanism: tb.Mechanism, parts: set[str]
) -> None:
    moved = solve(tb.Problem(mechanism, duration=0.1)).trajectory(np.linspace(0.0, 0.1, 5))
    assert set(_kinetic_mistakes(moved)) == parts | {"with inertias about the joints"}


def test_readings_of_a_model_are_those_of_the_machine() -> None:
    """A tenth of the size: the same mistakes, in the same order."""
    names = []
    for factor in (1.0, 0.1):
        machine = scaled(rods_on_a_slot(inertia=0.01, tip=(0.5, 0.2)), factor)
        end = 0.2 * math.sqrt(factor)
        solution = solve(tb.Problem(machine, duration=2 * end))
        right = solution.trajectory(np.linspace(0.0, end, 10))
        names.append([r.name for r in all_readings(solution, right, right, STEP)])
    assert names[0] == names[1]
