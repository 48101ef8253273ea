"""When a cause is named, which sizes make sense, and the first-order effect of faults."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache, partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.comparisons.diagnosis.case import Case
from trebucheck.comparisons.diagnosis.diagnose import (
    _law_causes,
    _motion_agrees,
    _outright_causes,
    diagnose_motion,
)
from trebucheck.comparisons.diagnosis.faults import (
    Component,
    combined,
    hypotheses,
    machine_suspects,
)
from trebucheck.comparisons.diagnosis.fit import first_order
from trebucheck.comparisons.diagnosis.rank import Estimate, measured, ranked, ranked_with_parts
from trebucheck.comparisons.diagnosis.rerun import Rerun
from trebucheck.comparisons.runs.quantities import Kind, Quantity
from trebucheck.comparisons.runs.results import Diagnosis, Metric, RankedCause
from trebucheck.models.trajectory import PointMotion
from trebucheck.reference.equations import Equations
from trebucheck.reference.perturbed import (
    solve_scheduled,
    with_damping,
    with_joint_element,
    with_tilted_gravity,
)
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


@pytest.mark.parametrize(
    ("confirmed", "named"),
    [
        ((0.49,), []),  # not most of it
        ((0.7, 0.2), ["run 0"]),
        ((0.3, 0.9), ["run 1"]),
        ((0.8, 0.7), ["run 0", "run 1"]),  # each leaves less than twice what the other does
        ((0.9, 0.7), ["run 0"]),
    ],
)
def test_a_part_is_named_where_a_run_without_it_shows_it(
    confirmed: tuple[float, ...], named: list[str]
) -> None:
    """Before a suspect that explains more without such evidence, if that is not named itself."""
    runs = [
        RankedCause(name=f"run {k}", kind="settings", explained=share, confirmed=True)
        for k, share in enumerate(confirmed)
    ]
    suspect = RankedCause(name="suspect", kind="law", explained=0.93)
    listed, count = ranked_with_parts([*runs, suspect])
    assert [cause.name for cause in listed[:count]] == named
    assert len(listed) == len(runs) + 1
    sure = suspect.model_copy(update={"explained": 0.999})
    listed, count = ranked_with_parts([*runs, sure])
    assert count == 1 and listed[0] is sure


def test_what_a_run_shows_to_be_the_cause_goes_before_a_suspect_of_the_same_shape() -> None:
    suspect = RankedCause(name="rate of time", kind="reading", explained=0.9995)
    for share, first in ((0.96, "time step"), (0.94, "rate of time")):
        step = RankedCause(name="time step", kind="settings", explained=share, confirmed=True)
        listed, count = ranked_with_parts([suspect, step])
        assert count == 1 and listed[0].name == first and len(listed) == 2


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


@pytest.mark.parametrize(("share", "is_measured"), [(0.048, False), (0.0495, True), (0.3, True)])
def test_while_the_list_has_room_all_that_tell_something_are_measured(
    share: float, is_measured: bool
) -> None:
    """Whose rough share may be a twentieth; it is known to a thousandth."""
    rough = [("best", 0.9999, 0.9999), *((f"{k}", 0.5, 0.5) for k in range(4))]
    estimates, asked = _estimates(*rough, ("last", share, 0.06))
    listed = ranked(measured(estimates[:-2] + estimates[-1:]))[0]
    assert ("last" in asked) == is_measured == ("last" in [cause.name for cause in listed])
    assert len(asked) == 4 + is_measured


def test_what_decides_how_many_are_named_is_measured() -> None:
    """Eight suspects of the same effect.

    The list has room for six, and the named ones depend on all.
    """
    estimates, asked = _estimates(*((f"cause {k}", 0.97, 0.97) for k in range(8)))
    assert ranked(measured(estimates))[1] == 0 and len(asked) == 8


# what a trajectory shows by itself

Q, U, P, V = map(Quantity, (Kind.COORDINATES, Kind.SPEEDS, Kind.POSITION, Kind.VELOCITY))
FORCE = Quantity(Kind.FORCE, "pin")


def _outright(whole: tb.Trajectory, end: float = 1.0) -> dict[str, float]:
    solution = solve(tb.Problem(_sprung(), duration=1.2))
    return {c.name: c.explained for c in _outright_causes(Case(whole, solution, end))}


def _swung(samples: int = 101, end: float = 1.0) -> tb.Trajectory:
    solution = solve(tb.Problem(_sprung(), duration=1.2))
    return solution.trajectory(np.linspace(0.0, end, samples))


def test_an_early_end_explains_what_is_missing_beside_what_deviates() -> None:
    """Half of the time is missing; an angle is off by a quarter of its size, which is 1 rad."""
    half = _swung(51, 0.5)
    assert _outright(half) == {"run ends early": pytest.approx(1.0, abs=1e-9)}
    assert _outright(replace(half, q=half.q + 0.25)) == {
        "run ends early": pytest.approx(0.5 / (0.5 + 0.25))
    }
    # Up to two steps may be missing.
    assert not _outright(_swung(100, 0.99)) and not _outright(_swung(99, 0.9801))
    assert set(_outright(_swung(98, 0.97))) == {"run ends early"}


def test_a_first_sample_of_its_own_explains_what_stands_out_from_the_others() -> None:
    right = _swung()
    first = np.zeros_like(right.q)
    first[0] = 0.05
    assert _outright(replace(right, q=right.q + first + 1e-4)) == {
        "first sample: coordinates": pytest.approx(1 - 1e-4 / 0.0501)
    }
    assert not _outright(replace(right, q=right.q + first + 1e-3))


def test_values_that_are_no_numbers_and_markers_that_are_missing_are_told() -> None:
    right = _swung()
    u = right.u.copy()
    u[60:] = np.nan
    assert _outright(replace(right, u=u)) == {f"{U.text}: not a finite number": 1.0}
    assert _outright(replace(right, markers={})) == {"no marker tip": 1.0}


@pytest.mark.parametrize(
    ("shares", "broken", "agrees"),
    [
        ({Q: 0.0, U: 0.0, FORCE: 1.0}, set(), True),
        ({Q: 0.0099, U: 0.0, FORCE: 1.0}, set(), True),
        ({Q: 0.0101, U: 0.0, FORCE: 1.0}, set(), False),
        ({Q: 0.0, U: 0.5, FORCE: 0.5}, set(), False),
        ({Q: 0.0, FORCE: 1.0}, set(), False),  # the speeds are not told
        ({Q: 0.0, U: 0.0, FORCE: 1.0}, {"angle_max"}, False),
        ({Q: 0.0, U: 0.0, FORCE: 1.0}, {"velocity_max"}, True),
        ({Q: 0.5, P: 0.0, V: 0.0}, set(), True),  # markers alone are right
        ({Q: 0.5, P: 0.0}, set(), True),
        ({Q: 0.5, P: 0.0, V: 0.2}, set(), False),
        ({Q: 0.5, P: 0.0, V: 0.0}, {"position_max"}, False),
        ({Q: 0.5, U: 0.5}, set(), False),  # no markers are told
        ({Q: 0.0, U: 0.0, P: 0.0}, set(), False),  # nothing deviates
    ],
)
def test_a_motion_agrees_where_its_state_or_its_markers_are_right(
    shares: dict[Quantity, float], broken: set[str], agrees: bool
) -> None:
    case: Any = SimpleNamespace(shares=shares, broken=broken)
    assert _motion_agrees(case) is agrees


# releases


class _WithImpacts(Case):
    """Whose motion is taken for one with impacts."""

    has_impacts = True  # type: ignore[assignment]


@cache
def _fixed() -> Solution:
    """Its hanger is released at 1.19 s, its sling at 1.80 s; the third stop is open."""
    return solve(tb.Problem(tb.fixed(), duration=2.2))


def _released(kind: type[Case], hanger: float, sling: float, moves: bool = True) -> dict[str, Any]:
    """Causes of stops that open later by so much, or are only said to; with accurate shares."""
    solution, t = _fixed(), np.linspace(0.0, 2.1, 200)
    right = dict(solution.release_times)
    told = right | {
        f"{name} rest": (right[f"{name} rest"] or math.nan) + late
        for name, late in (("hanger", hanger), ("sling", sling))
    }
    schedule = told if moves else right
    moved = solve_scheduled(tb.Problem(tb.fixed(), duration=2.2), schedule).trajectory(t)
    case = kind(replace(moved, release_times=told), solution, 2.1)
    found = [c.measured() if isinstance(c, Estimate) else c for c in _law_causes(case)]
    return {cause.name: cause for cause in found}


HANGER, SLING = "release of the hanger rest", "release of the sling rest"


def test_a_late_release_explains_its_motion() -> None:
    found = _released(Case, 0.05, 0.0)
    assert found[HANGER].kind == "law" and found[HANGER].explained > 0.9999
    assert f"reading of the {HANGER}" not in found and SLING not in found
    start, due = (float(w) for w in found[HANGER].amount.split() if w[0].isdigit())
    assert start - due == pytest.approx(0.05, abs=2e-5)  # six digits are told
    assert abs(found["reading of the hanger rest's release"].explained) < 1e-4
    assert found["hanger rest never opens"].explained < 0.95


def test_a_release_that_is_only_told_late_is_a_mistake_of_reading() -> None:
    found = _released(Case, 0.05, 0.0, moves=False)
    assert found["reading of the hanger rest's release"].explained > 0.9999
    assert "reading of the sling rest's release" not in found
    assert found[HANGER].explained < 0.0


def test_the_first_of_two_late_releases_explains_both() -> None:
    found = _released(Case, 0.05, 0.02)
    assert found[HANGER].explained > 0.9999 > found[SLING].explained
    found = _released(Case, 0.86, -0.05)  # the hanger is due first, and opens last
    assert found[HANGER].explained > 0.9999 > found[SLING].explained
    found = _released(Case, 0.05, -0.9)  # the sling opens before the hanger
    assert found[SLING].explained > 0.9999 > found[HANGER].explained


def test_where_there_are_impacts_a_schedule_moves_nothing_and_only_readings_are_suspected() -> None:
    found = _released(_WithImpacts, 0.05, 0.0)
    assert set(found) == {"reading of the hanger rest's release"}
