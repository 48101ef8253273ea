"""When a cause is named, which sizes make sense, and the first-order effect of faults."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.comparisons.diagnosis.diagnose import diagnose_motion
from trebucheck.comparisons.diagnosis.faults import (
    Component,
    combined,
    hypotheses,
    machine_suspects,
)
from trebucheck.comparisons.diagnosis.fit import first_order
from trebucheck.comparisons.diagnosis.rank import Estimate, measured, ranked
from trebucheck.comparisons.diagnosis.rerun import Rerun
from trebucheck.comparisons.runs.results import Diagnosis, Metric, RankedCause
from trebucheck.models.trajectory import PointMotion
from trebucheck.reference.equations import Equations
from trebucheck.reference.perturbed import with_damping, with_joint_element, with_tilted_gravity
from trebucheck.reference.solution import Solution
from trebucheck.reference.solver import solve


def _likeliest(*shares: float) -> int:
    return ranked(
        RankedCause(name=f"cause {k}", kind="law", explained=share)
        for k, share in enumerate(shares)
    )[1]


@pytest.mark.parametrize(
    ("shares", "named"),
    [
        ((), 0),
        ((0.09,), 0),
        ((0.93, 0.2), 0),  # too much is left
        ((0.96, 0.2), 1),
        ((0.96, 0.94), 0),  # not clearly more than the next
        ((0.9999, 0.96), 1),
        ((0.9999, 0.99995, 0.5), 2),  # the deviation cannot tell them apart
        ((1.0, 1.0, 1.0, 1.0, 1.0), 3),
    ],
)
def test_a_cause_is_named_by_what_it_leaves(shares: tuple[float, ...], named: int) -> None:
    assert _likeliest(*shares) == named


def test_suspects_of_the_same_effect_keep_their_order_and_names_come_once() -> None:
    shares = (("a", 0.9995), ("b", 0.99999), ("a", 0.3), ("c", 0.01))
    causes = [RankedCause(name=name, kind="law", explained=share) for name, share in shares]
    listed, named = ranked(causes)
    assert [cause.name for cause in listed] == ["a", "b"] and named == 2


@pytest.mark.parametrize(
    ("component", "size", "sensible"),
    [
        (Component("", 1.0, ""), -1.1, False),  # an inertia of -10 %
        (Component("", 1.0, ""), 0.5, True),
        (Component("", 1.0, "rad"), math.radians(5.7e11), False),
        (Component("", 1.0, "m", length=10.0), 11.0, False),
        (Component("", 1.0, "N m/rad", positive=True), -1.0, False),
        (Component("", 1.0, "N m"), -1e9, True),
        (Component("", 1.0, "N m"), math.inf, False),
    ],
)
def test_sizes_that_make_no_sense_are_refused(
    component: Component, size: float, sensible: bool
) -> None:
    assert component.is_sensible(size) is sensible


@pytest.mark.parametrize("build", [tb.fixed, tb.rolling])
def test_first_order_effects_are_those_of_the_solved_motion(build: object) -> None:
    """Of every hypothesis: what is left is of second order in a size of 1e-6, grown along the
    motion.
    """
    mechanism = build()  # type: ignore[operator]
    solution = solve(tb.Problem(mechanism, duration=2.4))
    t = np.linspace(0.0, 2.4, 101)[1:]
    chosen = [h for h in hypotheses(mechanism) if len(h.components) == 1][::4]
    equations = [e for e in (h.make([1.0]) for h in chosen) if e is not None]
    right = solution.motion(t)
    assert len(equations) > 0
    for wrong, change in zip(equations, first_order(solution, equations, t), strict=True):
        moved = solve(tb.Problem(wrong.mechanism, duration=2.4), 1e-13, 1e-13, wrong).motion(t)
        exact = np.concatenate([moved.q - right.q, moved.u - right.u], axis=1)
        assert np.linalg.norm(exact - change) <= 1e-3 * np.linalg.norm(exact) + 1e-10


def test_elements_do_the_work_that_they_store_or_take() -> None:
    """A spring keeps energy with its own, turned gravity keeps it along its direction, and damping
    takes it.
    """
    mechanism = tb.fixed()
    t = np.linspace(0.0, 1.0, 50)

    def energy(equations: Equations) -> np.ndarray:
        found = solve(tb.Problem(mechanism, duration=1.0), equations=equations).trajectory(t)
        return found.kinetic_energy + found.potential_energy

    for equations in (
        with_joint_element(mechanism, "sling pin", stiffness=1e3),
        with_tilted_gravity(mechanism, 0.3),
    ):
        kept = energy(equations)
        assert np.abs(kept - kept[0]).max() < 1e-8 * np.abs(kept).max()
    assert np.all(np.diff(energy(with_damping(mechanism, 0.1))) < 0)


def test_turned_gravity_is_the_turned_mechanism() -> None:
    """Gravity turned by an angle moves a mechanism as upright gravity moves it turned the other
    way.
    """
    angle, mechanism = 0.2, tb.fixed()
    free = mechanism.model_copy(update={"stops": ()})
    turned = free.model_copy(update={"start": tuple(q + angle for q in free.start)})
    t = np.linspace(0.0, 1.0, 20)
    tilted = solve(
        tb.Problem(free, duration=1.0), equations=with_tilted_gravity(free, angle)
    ).motion(t)
    upright = solve(tb.Problem(turned, duration=1.0)).motion(t)
    assert tilted.q + angle == pytest.approx(upright.q, abs=1e-9)


def _solution() -> Solution:
    return solve(tb.Problem(tb.fixed(), duration=2.4))


def _said(trajectory: tb.Trajectory, solution: Solution, end: float = 2.3) -> Diagnosis:
    metric = Metric(name="seeded", value=1.0, unit="1", tolerance=0.5)
    return diagnose_motion(
        (metric,), trajectory, solution, end, Rerun(tb.engine("reference"), lambda *_: trajectory)
    )


def test_a_quantity_that_is_read_strangely_is_named_as_a_reading() -> None:
    """In a way that is no suspect.

    The motion is right, so the cause is in how that one quantity is read.
    """
    solution = _solution()
    right = solution.trajectory(np.linspace(0.0, 2.4, 400))
    strange = {
        n: PointMotion(m.position, m.velocity + 0.1 * m.velocity**2)
        for n, m in right.markers.items()
    }
    found = _said(replace(right, markers=strange), solution)
    assert found.motion_agrees and found.named[0].name.startswith("reading of the velocity")
    assert found.named[0].kind == "reading"


def test_a_run_without_samples_or_markers_has_a_diagnosis() -> None:
    solution = _solution()
    right = solution.trajectory(np.linspace(0.0, 2.4, 400))
    short = solution.trajectory(np.linspace(0.0, 0.1, 2))
    assert _said(short, solution).named == ()
    bare = replace(right, markers={}, u=2 * right.u)
    found = _said(bare, solution)
    assert {"no marker projectile", "scale of the coordinates' speeds"} <= {
        cause.name for cause in found.causes
    }
    turned = _said(replace(right, q=right.q.T), solution)
    assert turned.named[0].name == "shape of the coordinates"


def _pendulum(gravity: float = 9.81) -> tb.Mechanism:
    """That falls against a stop below its pin, from which it bounces."""
    rod = {"name": "rod", "angle": "a", "mass": 2.0, "centre": (1.0, 0.0), "inertia": 0.1}
    pin = {
        "kind": "pin",
        "name": "pin",
        "parent": "ground",
        "child": "rod",
        "parent_point": (0, 0),
        "child_point": (0, 0),
    }
    stop = {
        "name": "wall",
        "body": "rod",
        "sense": -1,
        "limit": -1.5,
        "closed": False,
        "restitution": 0.5,
    }
    return tb.Mechanism(
        name="pendulum", bodies=[rod], joints=[pin], stops=[stop], gravity=gravity, start=(0.0,),
        markers=[{"name": "tip", "body": "rod", "point": (1.5, 0.0)}],
    )  # fmt: skip


def test_impacts_are_solved_instead_of_linearised() -> None:
    """Under the unilateral law a stop closes.

    The effect of a fault is then that of the solved motion.
    """
    t, right = np.linspace(0.0, 1.4, 400), _pendulum()
    solution = solve(tb.Problem(right, duration=1.4, stop_law="unilateral"))
    assert solution.impacts and solution.impacts[0][0] < 1.0
    wrong = solve(tb.Problem(_pendulum(1.001 * 9.81), duration=1.4, stop_law="unilateral"))
    found = _said(replace(wrong.trajectory(t), mechanism=right), solution, 1.3)
    assert found.causes[0].name == "gravity" and found.causes[0].amount == "+0.1 %", found


def test_a_start_speed_has_the_size_asked_for_where_the_mechanism_starts_at_rest() -> None:
    """Left-out start speeds are zeros.

    The fault was the suspect's own small one whatever its size.
    """
    mechanism = tb.catapult()
    (speed,) = [
        suspect for suspect in machine_suspects(mechanism) if suspect.name == "start speed of theta"
    ]
    wrong = combined(mechanism, [speed], [1e4])
    assert mechanism.start_speeds == ()
    assert wrong is not None and wrong.start_speeds == pytest.approx((1e4 * speed.scale,))


def _sprung(**changes: object) -> tb.Mechanism:
    """The pendulum with a motor and a torsion spring with a cubic term."""
    elements = [
        {"kind": "cubic-torsion-spring", "name": "spring", "body": "rod", "stiffness": 4.0,
         "cubic_stiffness": 3.0, "rest_angle": 0.2},
        {"kind": "constant-torque", "name": "motor", "body": "rod", "torque": 5.0},
    ]  # fmt: skip
    fields = {"stops": (), "force_elements": elements, **changes}
    return tb.Mechanism(**{**_pendulum().model_dump(), **fields})


def _named(right: tb.Mechanism, wrong: tb.Mechanism) -> Diagnosis:
    """Diagnosis of an engine that moves a wrong mechanism."""
    t = np.linspace(0.0, 1.2, 300)
    solution = solve(tb.Problem(right, duration=1.2))
    moved = solve(tb.Problem(wrong, duration=1.2)).trajectory(t)
    return _said(replace(moved, mechanism=right), solution, 1.1)


def test_a_builder_that_leaves_out_all_force_elements_is_named() -> None:
    found = _named(_sprung(), _sprung(force_elements=()))
    assert [cause.name for cause in found.named] == ["all force elements missing"], found


@pytest.mark.parametrize(
    ("field", "factor", "cause", "amount"),
    [
        ("cubic_stiffness", 1.001, "cubic stiffness of the spring", "+0.1 %"),
        ("stiffness", 1.001, "stiffness of the spring", "+0.1 %"),
        ("rest_angle", 1.001, "rest angle of the spring", "+0.1 %"),
    ],
)
def test_each_number_of_a_cubic_spring_is_a_suspect(
    field: str, factor: float, cause: str, amount: str
) -> None:
    elements = [element.model_dump() for element in _sprung().force_elements]
    elements[0][field] *= factor
    found = _named(_sprung(), _sprung(force_elements=elements))
    first = found.causes[0]
    assert (first.name, first.amount) == (cause, amount) and found.likeliest, found


def test_a_marker_taken_for_the_centre_of_mass_is_named() -> None:
    right = _sprung()
    solution = solve(tb.Problem(right, duration=1.2))
    t = np.linspace(0.0, 1.2, 300)
    trajectory = solution.trajectory(t)
    row = trajectory.kinematics.point("rod", (1.0, 0.0))
    centre = PointMotion(
        trajectory.kinematics.position(row, trajectory.q),
        trajectory.kinematics.velocity(row, trajectory.q, trajectory.u),
    )
    found = _said(replace(trajectory, markers={"tip": centre}), solution, 1.1)
    assert "tip taken for the rod's centre of mass" in {cause.name for cause in found.named}, found
    assert found.motion_agrees


@pytest.mark.parametrize(("axis", "signs"), [("x", (-1.0, 1.0)), ("y", (1.0, -1.0))])
def test_mirrored_markers_are_named(axis: str, signs: tuple[float, float]) -> None:
    solution = solve(tb.Problem(_sprung(), duration=1.2))
    right = solution.trajectory(np.linspace(0.0, 1.2, 300))
    mirrored = {
        name: PointMotion(motion.position * signs, motion.velocity * signs)
        for name, motion in right.markers.items()
    }
    found = _said(replace(right, markers=mirrored), solution, 1.1)
    assert [cause.name for cause in found.named] == [f"markers mirrored, {axis}"], found


def _estimates(*shares: tuple[str, float, float]) -> tuple[list[RankedCause | Estimate], list[str]]:
    """Estimates of name, rough and accurate share; and the names of those that get measured."""
    asked: list[str] = []

    def cause(name: str, share: float) -> RankedCause:
        return RankedCause(name=name, kind="law", explained=share)

    def measure(name: str, share: float) -> RankedCause:
        asked.append(name)
        return cause(name, share)

    return [
        Estimate(cause(name, rough), 1e-3, partial(measure, name, share))
        for name, rough, share in shares
    ], asked


def test_only_what_may_be_listed_is_measured() -> None:
    rough = [(f"cause {k}", 0.9 - 0.1 * k, 0.9 - 0.1 * k) for k in range(8)]
    estimates, asked = _estimates(*rough, ("close", 0.3995, 0.4004), ("none", 0.01, 0.01))
    listed, named = ranked(measured(estimates))
    assert [cause.name for cause in listed][-1] == "close" and len(listed) == 6 and named == 0
    assert asked == [f"cause {k}" for k in range(6)] + ["close"]


def test_what_decides_how_many_are_named_is_measured() -> None:
    """Eight suspects of the same effect.

    The list has room for six, and the named ones depend on all.
    """
    estimates, asked = _estimates(*((f"cause {k}", 0.97, 0.97) for k in range(8)))
    assert ranked(measured(estimates))[1] == 0 and len(asked) == 8
