"""The gate and the diagnosis, on the reference and on engines of a third party.

No engine library needed.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import plugin_engines
import pytest
import trebucheck as tb
from conftest import machine_parameters, machines
from faulty import Faulty, body, parameters
from formulas import END, LAUNCH, RELEASE, Formula, times
from hypothesis import given
from hypothesis import strategies as st
from mechanisms import hanging_bob
from trebucheck.comparisons.diagnosis import diagnose as diagnosing
from trebucheck.comparisons.diagnosis import rerun as rerunning
from trebucheck.comparisons.diagnosis.case import FINE, ROUGH, Case, factor_of, fit, share_of
from trebucheck.comparisons.diagnosis.diagnose import (
    _BuiltModel,
    _fitted_size,
    _mistaken,
    active_contacts_at,
    check_and_diagnose,
    find_onset,
    growth,
)
from trebucheck.comparisons.diagnosis.equivalence import (
    EXACT,
    SPEED,
    check_model,
    expected,
    random_states,
)
from trebucheck.comparisons.diagnosis.faults import (
    Component,
    Fault,
    combined,
    hypotheses,
    machine_suspects,
)
from trebucheck.comparisons.diagnosis.rank import Estimate
from trebucheck.comparisons.diagnosis.readings import NO_MOTION, Reading
from trebucheck.comparisons.diagnosis.rerun import Rerun, SearchTime, _other_settings
from trebucheck.comparisons.report.pages.tables import diagnosis
from trebucheck.comparisons.runs.metrics import against
from trebucheck.comparisons.runs.quantities import Kind, Quantity
from trebucheck.comparisons.runs.results import Diagnosis, Metric, Outcome, RankedCause, Run
from trebucheck.engines.inspection import Dynamics, Inspection, State
from trebucheck.engines.mujoco.engine import MujocoEngine
from trebucheck.engines.registry import causes_of
from trebucheck.engines.units import units_of
from trebucheck.models.library.trebuchet import parameters_of
from trebucheck.reference.contact import active_contacts
from trebucheck.reference.equations import Equations
from trebucheck.reference.solver import solve

Build = Callable[..., tb.Mechanism]


def test_a_signature_of_the_same_shape_is_found_with_its_size() -> None:
    signature = np.array([1.0, -2.0, 3.0])
    assert factor_of(7.0 * signature, signature) == pytest.approx(7.0)
    assert share_of(7.0 * signature, 7.0 * signature) == pytest.approx(1.0)
    assert share_of(7.0 * signature, signature) == pytest.approx(1 / 7)


def test_what_stands_across_explains_nothing() -> None:
    across, along = np.array([0.0, 1.0]), np.array([1.0, 0.0])
    assert factor_of(along, across) == 0.0 == fit(along, across[None])[1]
    assert share_of(along, across) < 0.0
    assert factor_of(np.ones(2), np.zeros(2)) == 0.0
    assert share_of(np.zeros(2), np.ones(2)) == 0.0 == share_of(np.ones(2), np.zeros(2))
    assert share_of(np.ones(2), np.array([1.0, np.inf])) == 0.0


def test_states_are_where_they_should_be(build: Build) -> None:
    mechanism, equations = build(), Equations(build())
    states = random_states(mechanism)
    assert {state.closed for state in states} >= {
        (),
        ("hanger rest",),
        ("sling rest",),
        ("hanger rest", "sling rest"),
    }
    for state in states:
        for stop in mechanism.stops:
            gap = float(equations.kinematics.gap(stop.name, state.q))
            speed = float(equations.kinematics.gap_jacobian(stop.name, state.q) @ state.u)
            if stop.name in state.closed:
                assert abs(gap) < 1e-13 and abs(speed) < 1e-13  # rounding of angles up to ten
            else:
                assert gap > 0
        assert active_contacts(equations, state.q, state.u, state.closed) == state.closed


@machines(10)
@given(chosen=machine_parameters(), rolls=st.booleans())
def test_parameters_are_read_off_a_machine(chosen: tb.TrebuchetParameters, rolls: bool) -> None:
    machine = (tb.rolling if rolls else tb.fixed)(chosen)
    assert parameters_of(machine) == chosen
    assert parameters_of(body("arm", mass=machine.body("arm").mass * 1.001)(machine)) is None


def test_minimal_and_redundant_coordinates_pass_each_others_gate(build: Build) -> None:
    found = check_model(tb.engine("reference"), build())
    assert found.exposed and found.holds
    assert {check.name for check in found.checks} >= {
        "acceleration",
        "stop torque",
        "centre of mass",
        "start",
    }
    assert all(check.tolerance == EXACT for check in found.checks)


def test_an_engine_that_shows_nothing_says_so() -> None:
    found = check_model(plugin_engines.Echo(), tb.fixed())
    assert not found.exposed and found.holds
    assert found.note and "only its motion can tell" in found.note


def test_an_engine_that_cannot_be_looked_into_fails(build: Build) -> None:
    def broken(_: tb.Mechanism) -> tb.Mechanism:
        raise ZeroDivisionError("careless")

    found, why = check_and_diagnose(Faulty(tb.engine("reference"), machine=broken), build())
    assert not found.holds and why is not None
    assert found.note and "ZeroDivisionError: careless" in found.note


def test_a_suspect_can_be_made_larger(build: Build) -> None:
    suspect = next(s for s in machine_suspects(build()) if s.name.startswith("m_cw"))
    larger = combined(build(), (suspect,), (1000.0,))
    assert larger is not None
    assert larger.body("hanger").mass == pytest.approx(3000.0 * 1.001, rel=1e-12)
    fault = next(fault for fault in hypotheses(build()) if fault.name == suspect.name)
    assert fault.text([1000.0]) == "+0.1 %"


@pytest.mark.slow
def test_a_machine_of_no_builder_has_suspects_too(build: Build) -> None:
    other = body("arm", mass=900.0)(build())
    names = {suspect.name for suspect in machine_suspects(other)}
    assert {
        "mass of the arm",
        "gravity",
        "place of the sling pin on the arm",
        "start of phi",
    } <= names
    wrong = Faulty(tb.engine("reference"), machine=body("hanger", mass=3003.0))
    _, why = check_and_diagnose(wrong, other)
    assert why is not None and why.causes[0].name == "mass of the hanger"
    assert why.causes[0].amount == "+0.1 %"


def test_an_error_grows_towards_the_launch(build: Build) -> None:
    solution = solve(tb.Problem(build(), duration=2.5))
    grown = growth(solution, np.linspace(0.0, 2.5, 100))
    assert np.all(np.diff(grown) >= 0) and grown[-1] == pytest.approx(1.0) and grown[0] < 0.01
    assert active_contacts_at(solution, 0.1) == ("hanger rest", "sling rest")
    assert active_contacts_at(solution, 2.4) == ()


def test_a_diagnosis_reads_as_a_sentence() -> None:
    cause = RankedCause(name="g (gravity)", kind="machine", amount="+0.1 %", explained=0.9999)
    found = Diagnosis(
        leads="launch_speed", parts_at=1.25, holding=("sling rest",), causes=(cause,), likeliest=1
    )
    run = Run(
        model="m",
        engine="e",
        preset="assisted",
        outcome=Outcome.DISAGREES,
        engine_version="1",
        diagnosis=found,
    )
    (sentence,) = diagnosis(run)
    assert "t = 1.25 s, while sling rest held" in sentence
    assert "Likeliest: g (gravity) (+0.1 %): 100.0 % of it" in sentence
    unknown = run.model_copy(update={"diagnosis": found.model_copy(update={"likeliest": 0})})
    (sentence,) = diagnosis(unknown)
    assert "Cause unknown" in sentence and "Likeliest" not in sentence and "g (gravity)" in sentence


@pytest.mark.slow
def test_a_gate_that_fails_ends_the_run_and_not_the_report(monkeypatch: pytest.MonkeyPatch) -> None:
    from trebucheck.engines import registry

    make = registry.engine
    monkeypatch.setattr(
        registry, "engine", lambda *a, **o: Faulty(make(*a, **o), machine=parameters(g=9.8))
    )
    results = tb.compare(["fixed"], ["reference"], ["assisted"], isolate=False).results
    (run,) = results.runs
    assert run.outcome is Outcome.NOT_EQUIVALENT and not results.passed
    assert not run.metrics and run.message and "before any motion" in run.message
    assert run.diagnosis and run.diagnosis.causes[0].name.startswith("g (gravity)")


def test_what_follows_the_step_does_so_in_a_diagnosis() -> None:
    """An error of the step and of limits as soft as it is long is nobody's, if each is taken out
    alone.
    """
    follows = MujocoEngine(timestep=1e-3)
    finer = next(
        setting for setting in _other_settings(follows, tb.fixed()) if setting.name == "time step"
    )
    assert finer.options == {"timestep": 1e-3 / 8}
    budget = next(cause for cause in causes_of(follows, tb.fixed()) if cause.name == "time step")
    assert budget.removal is not None and budget.removal.options.keys() == {"timestep", "solref"}


def test_a_diagnosis_leaves_options_alone_that_do_nothing_to_the_mechanism() -> None:
    """No run without stops is made with other assistance of stops, and none is a cause."""
    made = tb.engine("exudyn", "settings")
    of_stops = {
        each.option
        for each in made.assistance
        if each.acts_on(tb.fixed()) and not each.acts_on(tb.model("pendulum"))
    }
    changed = {
        mechanism.name: {
            option for setting in _other_settings(made, mechanism) for option in setting.options
        }
        for mechanism in (tb.fixed(), tb.model("pendulum"))
    }
    assert of_stops & changed[tb.fixed().name]
    assert not of_stops & changed["pendulum"]


def test_two_settings_that_make_a_deviation_together_are_named_together() -> None:
    """Neither explains enough alone: the rule of a step, and where its solver stops."""
    solution = solve(tb.Problem(tb.catapult(), 0.5))
    t = np.linspace(0.0, 0.5, 101)

    def simulate(engine: tb.Engine, _: tb.Problem) -> tb.Trajectory:
        exact = solution.trajectory(t)
        rule = 2e-3 * (engine.settings["integrator"] != "RK4") * np.sin(4 * np.pi * t)
        solver = 1e-3 * (engine.settings["solver"] != "Newton") * np.sin(8 * np.pi * t)
        return dataclasses.replace(exact, q=exact.q + (rule + solver)[:, None])

    engine = MujocoEngine(integrator="Euler", solver="CG")
    causes = Rerun(engine, simulate).causes(Case(simulate(engine, solution.problem), solution, 0.5))
    explained = {cause.name: cause.explained for cause in causes}
    assert explained.keys() == {"integrator", "solver tolerance", "integrator, solver tolerance"}
    # What sin^2 leaves of the sum of 2 and 1: alone 1 and 2 of their root of 5.
    assert explained["integrator"] == pytest.approx(1 - 1 / math.sqrt(5), abs=0.02)
    assert explained["integrator, solver tolerance"] == pytest.approx(1.0)


def test_of_a_run_of_many_steps_the_step_is_asked_for_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """And nothing else where it makes half of the deviation; where it does not, all else is."""
    solution = solve(tb.Problem(tb.catapult(), 0.5))
    t, engine = np.linspace(0.0, 0.5, 101), MujocoEngine.presets()["default"]()
    monkeypatch.setattr(rerunning, "_MANY_STEPS", 100)
    asked: list[set[str]] = []

    def simulate(order: int, made: tb.Engine, _: tb.Problem) -> tb.Trajectory:
        assert made.timestep is not None
        asked.append({name for name, value in made.settings.items() if value != own[name]})
        error = 1e-3 * (made.timestep / 2e-3) ** order * np.sin(4 * np.pi * t)
        exact = solution.trajectory(t)
        return dataclasses.replace(exact, q=exact.q + error[:, None])

    own = engine.settings
    case = Case(simulate(0, engine, solution.problem), solution, 0.5)
    for order in (1, 0):
        asked.clear()
        rerun = Rerun(engine, partial(simulate, order))
        found = [cause for cause in rerun.causes(case) if cause.explained > 0.5]
        assert asked[0] == {"timestep"}
        assert bool(found) == (asked == [{"timestep"}]) == (order == 1)


def test_the_engine_is_run_again_to_the_first_violation() -> None:
    """Or for a characteristic time; to the end where that is nearly all of it."""
    solution = solve(tb.Problem(tb.model("pendulum"), 10.0))
    exact = solution.trajectory(np.linspace(0.0, 10.0, 2001))
    drift = dataclasses.replace(exact, q=exact.q + 1e-3 * exact.t[:, None])
    time = against(drift, solution, 10.0).scales.time
    for tolerance, end, to in (
        (3e-3, 10.0, 3.0),
        (1e-4, 10.0, time),
        (9e-3, 10.0, 10.0),
    ):
        angle = exact.mechanism.coordinates[0]
        broken = Metric(name="angle_max", subject=angle, value=1.0, unit="rad", tolerance=tolerance)
        aligned = against(drift, solution, end)
        assert diagnosing._end_of_reruns(aligned, [broken]) == pytest.approx(to, abs=0.02)


def test_the_engine_is_run_again_to_the_last_violation_of_forces_where_nothing_else_is() -> None:
    solution = solve(tb.Problem(tb.model("pendulum"), 10.0))
    exact = solution.trajectory(np.linspace(0.0, 10.0, 2001))
    (joint, reaction), *_ = exact.joint_reactions.items()
    of_force = Metric(name="joint_reaction_max", subject=joint, value=1.0, unit="N", tolerance=0.1)
    of_energy = Metric(name="energy_balance", value=1.0, unit="J", tolerance=0.1)
    for until, broken, to in (
        (4.0, [of_force], 4.0),
        (0.0, [of_force], against(exact, solution, 10.0).scales.time),
        (9.0, [of_force], 10.0),
        (4.0, [of_force, of_energy], 10.0),
    ):
        wrong = reaction + np.where(exact.t <= until, 1.0, 0.0)[:, None]
        read = dataclasses.replace(exact, joint_reactions={joint: wrong})
        aligned = against(read, solution, 10.0)
        assert diagnosing._end_of_reruns(aligned, broken) == pytest.approx(to, abs=0.02)


def test_runs_that_would_take_too_long_are_left_out_and_counted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By a clock on which a step takes a second."""
    solution = solve(tb.Problem(tb.catapult(), 0.5))
    t, clock = np.linspace(0.0, 0.5, 101), [0.0]
    monkeypatch.setattr(rerunning, "perf_counter", lambda: clock[0])

    def simulate(engine: tb.Engine, problem: tb.Problem) -> tb.Trajectory:
        assert engine.timestep is not None
        clock[0] += problem.duration / engine.timestep
        exact = solution.trajectory(t)
        return dataclasses.replace(exact, q=exact.q + 1e-3 * np.sin(4 * np.pi * t)[:, None])

    engine = MujocoEngine.presets()["default"]()
    case = Case(simulate(engine, solution.problem), solution, 0.5)
    for allowed in (math.inf, 2000.0, 0.0):
        clock[0], rerun = 0.0, Rerun(engine, simulate, time=SearchTime(allowed))
        assert not [cause for cause in rerun.causes(case) if cause.explained > 0.5]
        assert clock[0] <= max(allowed, 250.0)  # the first run is made, whatever it takes
        assert bool(rerun.time.left_out) == (allowed < math.inf)


@pytest.mark.parametrize("least", [1.0, 1 / 8])
def test_options_that_harm_alone_are_set_together_as_the_next_preset_has_them(least: float) -> None:
    """Stiff limits, felt early, by RK4: each of them alone makes it worse; and perhaps the step."""
    solution = solve(tb.Problem(tb.catapult(), 0.5))
    t = np.linspace(0.0, 0.5, 101)
    default = MujocoEngine.presets()["default"]()
    needed = ("integrator", "solref", "solimp", "margin")

    def simulate(engine: tb.Engine, _: tb.Problem) -> tb.Trajectory:
        exact, changed = solution.trajectory(t), MujocoEngine.presets()["settings"]().settings
        count = sum(engine.settings[name] == changed[name] for name in needed)
        right = count == len(needed) and (engine.timestep or 0.0) <= least * default.timestep
        error = 0.0 if right else 1e-3 * (1 + count)
        return dataclasses.replace(exact, q=exact.q + error * np.sin(4 * np.pi * t)[:, None])

    case = Case(simulate(default, solution.problem), solution, 0.5)
    causes = [cause for cause in Rerun(default, simulate).causes(case) if cause.explained > 0.5]
    assert len(causes) == 1 and causes[0].explained == pytest.approx(1.0)
    assert all(name in causes[0].amount for name in needed)
    assert "tolerance" not in causes[0].amount
    assert ("timestep" in causes[0].amount) == (least < 1)


def _errors_of_the_step(
    size: Callable[[float], tuple[float, float]], finest: float | None = None
) -> tuple[RankedCause, list[float]]:
    """The step's cause, and the steps [s] run, of 1 ms with errors of two shapes by the step."""
    solution = solve(tb.Problem(tb.catapult(), 0.5))
    t = np.linspace(0.0, 0.5, 101)
    steps: list[float] = []

    def simulate(engine: tb.Engine, _: tb.Problem) -> tb.Trajectory:
        step = engine.timestep or 0.0
        steps.append(step)
        exact, (one, other) = solution.trajectory(t), size(step / 1e-3)
        error = 1e-3 * (one * np.sin(4 * np.pi * t) + other * np.cos(4 * np.pi * t))
        return dataclasses.replace(exact, q=exact.q + error[:, None])

    engine = MujocoEngine(timestep=1e-3)
    case = Case(simulate(engine, solution.problem), solution, 0.5)
    rerun = Rerun(engine, simulate, finest)
    found = {cause.name: cause for cause in rerun.causes(case)}
    none = RankedCause(name="time step", kind="settings", explained=0.0)
    return found.get("time step", none), sorted({step for step in steps if step < 1e-3})


@pytest.mark.parametrize("order", [1, 2, 4])
def test_half_the_step_tells_an_error_of_one_order(order: int) -> None:
    cause, steps = _errors_of_the_step(lambda h: (h**order, 0.0))
    assert cause.explained == pytest.approx(1.0, abs=1e-3) and cause.confirmed
    assert f"order {order}" in cause.amount and steps == [5e-4]


def test_steps_ever_shorter_tell_an_error_of_two_orders() -> None:
    """Of h sin + h^2 cos, 2 d(h / 2) - d(h) leaves -h^2 / 2, and each further half a quarter."""
    cause, steps = _errors_of_the_step(lambda h: (h, h**2))
    assert steps == [1.25e-4, 2.5e-4, 5e-4]
    assert cause.explained == pytest.approx(1 - 1 / 32 / math.sqrt(2), abs=2e-3)


def test_what_stays_with_every_step_is_no_error_of_it() -> None:
    cause, steps = _errors_of_the_step(lambda h: (1.0, 0.05 * h))
    assert cause.explained < 0.1 and steps == [2.5e-4, 5e-4]  # an eighth is not worth its time
    cause, _ = _errors_of_the_step(lambda h: (h, 1.0))
    assert cause.explained == pytest.approx(1 - 1 / math.sqrt(2), abs=0.02)


def test_an_error_that_only_a_far_shorter_step_takes_out_is_of_the_step() -> None:
    """A step of the next preset is tried where halves are too long for any order."""

    def error(h: float) -> tuple[float, float]:
        return (1.0 if h > 0.1 else 0.0, 0.0)

    assert _errors_of_the_step(error)[0].explained < 0.1
    cause, steps = _errors_of_the_step(error, finest=5e-5)
    assert cause.explained == pytest.approx(1.0) and steps[0] == 5e-5
    assert _errors_of_the_step(error, finest=5e-4)[0].explained < 0.1


@dataclasses.dataclass(frozen=True)
class _Shown(Faulty):
    """An engine that shows something else of its built model."""

    change: Callable[[Dynamics], Dynamics] = lambda dynamics: dynamics

    def inspect(self, mechanism: tb.Mechanism, states: Sequence[State]) -> Inspection:
        inspection = super().inspect(mechanism, states)
        return dataclasses.replace(
            inspection, dynamics=tuple(self.change(dynamics) for dynamics in inspection.dynamics)
        )


@pytest.mark.parametrize("error", [0.01, -0.01, math.nan])
def test_a_stop_off_on_either_side_does_not_pass_the_model_check(error: float) -> None:
    mechanism = tb.fixed()
    right = Equations(mechanism).kinematics

    def off(dynamics: Dynamics, q: np.ndarray) -> Dynamics:
        gaps = {stop.name: float(right.gap(stop.name, q)) for stop in mechanism.stops}
        return dataclasses.replace(
            dynamics, stop_gaps=gaps | {"sling rest": gaps["sling rest"] + error}
        )

    @dataclasses.dataclass(frozen=True)
    class OffStop(Faulty):
        def inspect(self, mechanism: tb.Mechanism, states: Sequence[State]) -> Inspection:
            inspection = super().inspect(mechanism, states)
            pairs = zip(inspection.dynamics, states, strict=True)
            return dataclasses.replace(
                inspection, dynamics=tuple(off(dynamics, state.q) for dynamics, state in pairs)
            )

    found = check_model(OffStop(tb.engine("reference")), mechanism)
    assert [check.label for check in found.broken] == ["stop position (sling rest)"]
    (check,) = found.broken
    assert check.value is None if math.isnan(error) else check.value == pytest.approx(0.01)


def test_a_torque_that_is_no_number_does_not_pass_the_model_check() -> None:
    asked = iter(range(1000))

    def one_nan(dynamics: Dynamics) -> Dynamics:
        if next(asked) != 3:
            return dynamics
        torques = dict.fromkeys(dynamics.stop_torques, math.nan)
        return dataclasses.replace(dynamics, stop_torques=torques)

    found = check_model(_Shown(tb.engine("reference"), change=one_nan), tb.fixed())
    assert "stop torque" in {check.name for check in found.broken}, found


def test_the_model_check_sees_each_number_of_a_force_element() -> None:
    spring = {"kind": "cubic-torsion-spring", "name": "spring", "body": "arm", "stiffness": 1e4,
              "cubic_stiffness": 1e4, "rest_angle": 0.1}  # fmt: skip
    right = tb.Mechanism(**{**tb.fixed().model_dump(), "force_elements": [spring]})
    for field in ("stiffness", "cubic_stiffness", "rest_angle"):
        elements = [spring | {field: 1.001 * spring[field]}]
        wrong = tb.Mechanism(**{**right.model_dump(), "force_elements": elements})
        found = check_model(Faulty(tb.engine("reference"), machine=lambda _, m=wrong: m), right)
        assert "acceleration" in {check.name for check in found.broken}, field


# what a built model shows by itself


def _shown(
    monkeypatch: pytest.MonkeyPatch,
    start: dict[int, float] | None = None,
    gaps: dict[str, float] | None = None,
    torques: Sequence[dict[str, float]] = (),
) -> list[tuple[str, str, float]]:
    """Name, amount and share of what a model shows: other starts, gaps, or torques of its stops."""
    mechanism = tb.fixed()
    begin = np.array(mechanism.start)
    for i, value in (start or {}).items():
        begin[i] = value
    closed = ("hanger rest", "sling rest")
    states = [State(begin, 0 * begin, closed[:n]) for n in (0, 1, 2)]
    dynamics = [
        SimpleNamespace(stop_torques=each)
        for each in (torques or [{}, dict.fromkeys(closed, 1.0), dict.fromkeys(closed, 1.0)])
    ]
    model: Any = object.__new__(_BuiltModel)
    model.mechanism, model.states, model.right = mechanism, states, None
    model.inspection = SimpleNamespace(start=begin, dynamics=dynamics)
    monkeypatch.setattr(diagnosing, "gap_errors", lambda *_: gaps or {})
    return [(c.name, c.amount, c.explained) for c in model.single_quantities()]


ALPHA = -math.pi / 4


@pytest.mark.parametrize(
    ("value", "amount", "share"),
    [
        (-ALPHA, "sign", 1.0),
        (math.degrees(ALPHA), "degrees for radians", 1.0),
        (math.radians(ALPHA), "radians for degrees", 1.0),
        (ALPHA + 0.01, "+0.01 rad", 0.992),
        (ALPHA - 3.0, "-3 rad", 0.992),
        (ALPHA + 7.0, "", 0.992),  # more than a turn says nothing
        (ALPHA - 7.0, "", 0.992),
        (ALPHA + 6.2, "+6.2 rad", 0.992),
    ],
)
def test_a_start_elsewhere_is_read_off(
    value: float, amount: str, share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert _shown(monkeypatch, {2: value}) == [("start of alpha", amount, share)]


def test_a_start_is_right_up_to_roundings_of_its_size(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of pi for the sling, of one radian for a smaller angle."""
    assert not _shown(monkeypatch, {1: math.pi * (1 + 0.9 * EXACT), 2: ALPHA + 0.9 * EXACT})
    found = _shown(monkeypatch, {1: math.pi * (1 + 1.1 * EXACT), 2: ALPHA + 1.1 * EXACT})
    assert [name for name, *_ in found] == ["start of phi", "start of alpha"]


def test_the_place_of_a_stop_is_read_off_in_degrees(monkeypatch: pytest.MonkeyPatch) -> None:
    for sign, shown in ((-1, "-"), (1, "+")):
        gaps = {"hanger rest": sign * 0.01, "sling rest": 0.9 * EXACT, "arm stop": sign * 4.0}
        assert _shown(monkeypatch, gaps=gaps) == [
            ("place of the hanger rest", f"{shown}0.573 deg", 0.992),
            ("place of the arm stop", "", 0.992),  # more than half a turn says nothing
        ]


@pytest.mark.parametrize("torque", [{}, {"sling rest": 0.0}, {"sling rest": None}])
def test_a_stop_that_never_holds_where_it_is_closed_is_missing(
    torque: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    rest = {"hanger rest": 2.0}
    assert _shown(monkeypatch, torques=({}, rest, rest | torque)) == [
        ("sling rest missing", "", 0.97)
    ]
    assert not _shown(monkeypatch, torques=({}, rest, rest | {"sling rest": -1e-9}))


def test_a_mistaken_angle_is_told_to_a_millionth_of_its_size() -> None:
    assert _mistaken(-3.0 * (1 + 0.9e-6), 3.0) == "sign" and not _mistaken(-3.0 * (1 + 1.1e-6), 3.0)
    assert _mistaken(-0.3 + 0.9e-6, 0.3) == "sign" and not _mistaken(-0.3 + 1.1e-6, 0.3)


# sizes of what is built


def _size(
    deviation: np.ndarray, ways: Callable[[np.ndarray], list[np.ndarray]], n: int = 1,
    largest: float = math.inf,
) -> tuple[Any, list[list[float]]]:  # fmt: skip
    """The size of a fault that fits, and all that were asked for, up to a largest one."""
    asked: list[list[float]] = []
    components = (Component("", 1.0, "m", length=largest),) * n
    fault = Fault("fault", "machine", components, "fault", np.array)  # type: ignore[arg-type]

    def signatures(factors: Any) -> list[np.ndarray]:
        asked.append(factors.tolist())
        return ways(factors)

    return _fitted_size(fault, deviation, signatures), asked


FORM, CURVE = np.array([3.0, 1.0, -2.0]), np.array([1.0, -1.0, 1.0])


def test_a_linear_size_is_fitted_by_the_way_that_shows_it() -> None:
    found, _ = _size(4.0 * FORM, lambda f: [f[0] * CURVE, f[0] * FORM, 0.0 * FORM])
    assert found.factors == pytest.approx([4.0]) and found.explained == pytest.approx(1.0)
    found, _ = _size(4.0 * FORM - 2.0 * CURVE, lambda f: [f[0] * FORM + f[1] * CURVE], n=2)
    assert found.factors == pytest.approx([4.0, -2.0])


def test_a_size_that_bends_its_effect_is_corrected() -> None:
    """f + f^2 / 10: Newton's method, with differences for derivatives."""
    right = 2.0
    found, _ = _size((right + 0.1 * right**2) * FORM, lambda f: [(f[0] + 0.1 * f[0] ** 2) * FORM])
    assert found.factors == pytest.approx([right], rel=1e-3)
    assert found.explained > 0.999


def test_a_correction_that_makes_no_sense_is_made_in_part() -> None:
    """Up to 2.5 m: a half of 4 is the first that makes sense, then a tenth of the next 2."""
    found, asked = _size(4.0 * FORM, lambda f: [f[0] * FORM], largest=2.5)
    assert asked[2] == pytest.approx([2.0]) and len(found.factors) == 1
    assert found.factors.tolist() == pytest.approx([2.5]) and found.explained == pytest.approx(
        0.625
    )


def test_what_explains_nothing_has_no_size() -> None:
    across = np.cross(FORM, CURVE)
    assert _size(across, lambda f: [f[0] * FORM])[0] is None
    assert _size(FORM, lambda _: [])[0] is None
    lost = Fault("lost", "machine", (Component("", 1.0, "m"),), "lost", lambda _: None)
    assert _fitted_size(lost, FORM, lambda _: [FORM]) is None


# rough shares


def _estimated(
    rough_error: float | None, shares: dict[float, float | None]
) -> tuple[Any, list[float]]:
    """What is estimated of a cause with these shares by tolerance, and which were asked for."""
    asked: list[float] = []

    def share(tolerance: float) -> float | None:
        asked.append(tolerance)
        return shares[tolerance]

    case: Any = SimpleNamespace(rough_error=rough_error)
    cause = RankedCause(name="cause", kind="law", explained=0.0)
    return Case.estimated(case, cause, share), asked


def test_a_rough_share_is_taken_where_it_is_of_use() -> None:
    found, asked = _estimated(0.003, {ROUGH: 0.4, FINE: 0.5})
    assert isinstance(found, Estimate) and asked == [ROUGH]
    assert found.cause.explained == 0.4 and found.error == 0.003
    assert found.measured().explained == 0.5 and asked == [ROUGH, FINE]


@pytest.mark.parametrize(
    ("rough_error", "shares", "explained"),
    [
        (None, {FINE: 0.5}, 0.5),
        (0.003, {ROUGH: None, FINE: 0.5}, 0.5),
        (None, {FINE: None}, 0.0),  # it has no motion
    ],
)
def test_else_the_share_is_computed_accurately(
    rough_error: float | None, shares: dict[float, float | None], explained: float
) -> None:
    found, asked = _estimated(rough_error, shares)
    assert isinstance(found, RankedCause) and found.explained == explained
    assert asked == list(shares)


@pytest.mark.parametrize(
    ("deviation", "rough", "error"),
    [
        (5.0, 0.005, 0.01),  # ten times a thousandth
        (5.0, 0.0051, None),
        (5.0, 0.001, 0.002),
        (0.0, 0.001, None),
        (5.0, None, None),  # the reference cannot be solved so
    ],
)
def test_a_rough_share_is_known_to_ten_times_what_the_reference_loses(
    deviation: float, rough: float | None, error: float | None
) -> None:
    moved = None if rough is None else SimpleNamespace(trajectory=lambda _: rough)

    def solved(equations: str, tolerance: float) -> Any:
        assert (equations, tolerance) == ("own", ROUGH)
        return moved

    case: Any = SimpleNamespace(
        deviation=deviation * np.array([0.6, 0.8]), t=None,
        solution=SimpleNamespace(equations="own"),
        solved=solved,
        signature=lambda size: size * np.array([-0.8, 0.6]),
    )  # fmt: skip
    found = vars(Case)["rough_error"].func(case)
    assert found == (None if error is None else pytest.approx(error))


# sizes of mistakes in reading


def _read(deviation: np.ndarray, *wrong: np.ndarray, **reading: Any) -> list[tuple[float, str]]:
    """Share and size of the reading whose signatures these are; its name is 'read'."""
    case: Any = SimpleNamespace(deviation=deviation, signature=np.asarray)
    one: Any = Reading("read", wrong, **reading)  # type: ignore[arg-type]
    found = list(diagnosing._fitted(case, [one]))
    assert all((cause.name, cause.kind) == ("read", "reading") for cause in found)
    return [(cause.explained, cause.amount) for cause in found]


def _told(factors: Sequence[float]) -> str:
    return " ".join(f"{factor:.4g}" for factor in factors)


def test_a_mistake_without_a_size_is_not_fitted() -> None:
    assert _read(4.0 * FORM, FORM) == [(pytest.approx(0.25), "")]
    assert _read(FORM, 3.0 * FORM) == [(pytest.approx(-1.0), "")]


def test_mistakes_of_one_or_several_numbers_are_fitted() -> None:
    assert _read(4.0 * FORM, FORM, text=_told) == [(pytest.approx(1.0), "4")]
    both = 4.0 * FORM - 2.0 * CURVE
    assert _read(both, FORM, CURVE, text=_told) == [(pytest.approx(1.0), "4 -2")]


@pytest.mark.parametrize(("least", "listed"), [(-3.0, True), (-2.0, True), (-1.9, False)])
def test_a_size_that_makes_no_sense_is_no_mistake(least: float, listed: bool) -> None:
    assert bool(_read(-2.0 * FORM, FORM, text=_told, least=least)) == listed


def test_what_does_not_explain_the_deviation_is_no_mistake() -> None:
    assert not _read(np.cross(FORM, CURVE), 0.0 * FORM, text=_told, least=-1.0)


def test_a_size_without_a_linear_effect_is_corrected_by_what_it_explains() -> None:
    """An effect of f^(3/2): four sizes, each by the secant through zero; the best is kept."""
    sizes: list[float] = []

    def at(factor: float) -> np.ndarray:
        sizes.append(factor)
        return factor * abs(factor) ** 0.5 * FORM

    ((share, told),) = _read(8.0 * FORM, FORM, text=_told, at=at)
    expected = [8.0]
    while len(expected) < 4:
        expected.append(8.0 / expected[-1] ** 0.5)
    assert sizes == pytest.approx(expected)
    assert share == pytest.approx(1 - abs(1 - expected[-1] ** 1.5 / 8.0))
    assert told == f"{expected[-1]:.4g}"


def test_a_size_is_corrected_as_far_as_it_makes_sense() -> None:
    """The first leads to none: it is kept with its share. Where there is none, it is no mistake."""
    ((share, told),) = _read(
        4.0 * FORM, FORM, text=_told, at=lambda f: 3.0 * FORM if f < 4.5 else None
    )
    assert (share, told) == (pytest.approx(0.75), "4")
    assert not _read(4.0 * FORM, FORM, text=_told, at=lambda _: None)


# faults without a size


def _sizeless_share(*signatures: np.ndarray, fault: Any = None, solves: bool = True) -> RankedCause:
    """A cause with the signatures of its motion as an engine with the fault and others read it."""
    solved: list[Any] = []

    def solve_it(wrong: Any, tolerance: float) -> Any:
        solved.append(wrong)
        assert tolerance == FINE
        return SimpleNamespace(motion=lambda t: f"at {t}") if solves else None

    case: Any = SimpleNamespace(
        deviation=4.0 * FORM, t="t", rough_error=None, solved=solve_it,
        seen=lambda _, motion: signatures if motion == "at t" else (),
    )  # fmt: skip
    case.estimated = lambda cause, share: Case.estimated(case, cause, share)
    wrong: Any = fault or Fault("fault", "machine", (), "fault", lambda _: "equations")  # type: ignore[arg-type,return-value]
    found = diagnosing._sizeless(case, wrong)
    assert isinstance(found, RankedCause) and solved == [fault or "equations"]
    return found


def test_a_fault_without_a_size_explains_what_its_best_reading_does() -> None:
    for signatures in ((3.0 * FORM, FORM), (FORM, 3.0 * FORM)):
        found = _sizeless_share(*signatures)
        assert (found.name, found.kind) == ("fault", "machine")
        assert found.explained == pytest.approx(0.75)
    law = _sizeless_share(FORM, FORM, fault=tb.StopLaw.UNILATERAL)
    assert law.kind == "law" and tb.StopLaw.UNILATERAL.value in law.name
    assert law.explained == pytest.approx(0.25)
    assert _sizeless_share(solves=False).explained == 0.0


# which suspects are asked for, in the order of their cost


def _asked(
    monkeypatch: pytest.MonkeyPatch,
    rerun: bool = True,
    told: frozenset[str] | None = None,
    agrees: bool = False,
    **shares: float,
) -> tuple[list[str], dict[str, float], int]:
    """Kinds of suspects that were asked for, the listed ones, and how many of these are named.

    Two quantities deviate by 0.3 % and 0.4 % of the whole, and a force by nearly all of it.

    Each kind has one suspect, which explains so much; one that is not given explains nothing.
    """
    asked: list[str] = []

    def suspect(kind: str) -> list[RankedCause]:
        asked.append(kind)
        if kind == "reading" and "still" in shares:
            return [RankedCause(name=NO_MOTION, kind="reading", explained=shares["still"])]
        share, shown = shares.get(kind, 0.0), kind == "again"
        return [RankedCause(name=kind, kind="law", explained=share, confirmed=shown)]

    missing: Any = SimpleNamespace(kind="missing")
    for function, kind in (
        ("_reading_causes", "reading"), ("fitting_faults", "fitted"), ("_law_causes", "law"),
        ("integrator_causes", "integrator"), ("_gross_causes", "gross"),
        ("faults_at_the_same_motion", "same motion"),
        ("_mismatch_causes", "mismatch"),
    ):  # fmt: skip
        monkeypatch.setattr(diagnosing, function, lambda _, kind=kind: suspect(kind))
    monkeypatch.setattr(diagnosing, "_outright_causes", lambda _: [])
    monkeypatch.setattr(diagnosing, "missing_faults", lambda _: [missing])
    monkeypatch.setattr(diagnosing, "_sizeless", lambda _, fault: suspect(fault.kind)[0])
    monkeypatch.setattr(diagnosing, "_motion_agrees", lambda _: agrees)
    monkeypatch.setattr(diagnosing, "_forces_deviate", lambda _: False)
    kinds = {Kind.COORDINATES: 0.003, Kind.SPEEDS: 0.004, Kind.FORCE: 0.9999}
    deviate = {Quantity(kind): share for kind, share in kinds.items()}
    broken = frozenset[str]() if agrees else frozenset({"angle_max"})
    case: Any = SimpleNamespace(told=told, mechanism=None, shares=deviate, broken=broken)
    listed, named = diagnosing._ranked_causes(case, partial(suspect, "again") if rerun else None)
    return asked, {cause.name: cause.explained for cause in listed}, named


FAULTS = ["reading", "fitted", "missing", "law"]


def test_a_reading_that_explains_all_of_it_ends_the_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """Unless little is told, or the motion is right: then a load may explain it as well.

    Where the motion deviates, the engine is run again: its step may have the shape of a suspect.
    """
    again = ["reading", "again"]
    assert _asked(monkeypatch, reading=0.9999) == (again, {"reading": 0.9999}, 1)
    assert _asked(monkeypatch, rerun=False, reading=0.9999)[0] == ["reading"]
    assert _asked(monkeypatch, reading=0.9998)[0] == [*again, *FAULTS[1:]]
    of_a_file = _asked(monkeypatch, rerun=False, reading=0.9999, told=frozenset())[0]
    assert of_a_file == ["reading", "integrator", *FAULTS[1:]]
    assert _asked(monkeypatch, reading=0.9999, agrees=True)[0] == ["reading", "same motion"]


@pytest.mark.parametrize(
    ("shares", "kinds", "named"),
    [
        ({"fitted": 0.99}, FAULTS, 1),
        ({"fitted": 0.98}, [*FAULTS, "gross"], 1),  # it may be something worse
        ({"gross": 0.96}, [*FAULTS, "gross"], 1),
        ({"gross": 0.9}, [*FAULTS, "gross", "mismatch"], 0),
        ({"mismatch": 0.96}, [*FAULTS, "gross", "mismatch"], 1),
        ({"again": 0.9}, [*FAULTS, "gross", "mismatch"], 1),  # a part that a run shows
    ],
)
def test_the_next_kind_of_suspects_is_asked_for_where_the_last_explains_too_little(
    shares: dict[str, float], kinds: list[str], named: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The engine is run again before suspects are looked for, as its motion deviates."""
    reading, *others = kinds
    asked, _, how_many = _asked(monkeypatch, **shares)
    assert asked == [reading, "again", *others] and how_many == named
    assert _asked(monkeypatch, rerun=False, **shares)[0] == kinds


def test_what_a_run_takes_out_ends_the_search(monkeypatch: pytest.MonkeyPatch) -> None:
    asked, _, named = _asked(monkeypatch, gross=0.9, again=0.95)
    assert asked == ["reading", "again"] and named == 1


def test_of_a_right_motion_suspects_come_before_other_settings(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its little deviation changes with the settings, and what is read wrongly does not."""
    asked, _, named = _asked(monkeypatch, agrees=True, law=0.96, again=0.99)
    assert asked == [*FAULTS, "gross"] and named == 1
    assert _asked(monkeypatch, agrees=True, again=0.99)[0] == [*FAULTS, "gross", "again"]


def test_where_nothing_moves_what_is_missing_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    assert _asked(monkeypatch, still=0.95)[0] == [*FAULTS, "missing", "gross"]
    assert _asked(monkeypatch, still=0.9999)[0] == ["reading", "missing", "gross"]
    assert _asked(monkeypatch, still=0.94)[0] == [
        "reading",
        "again",
        *FAULTS[1:],
        "gross",
        "mismatch",
    ]


def test_what_no_suspect_explains_at_the_right_motion_is_a_reading(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    _, listed, named = _asked(monkeypatch, agrees=True, reading=0.5)
    name = f"reading of the {Quantity(Kind.FORCE).text}"
    assert named == 1 and listed == {name: pytest.approx(1 - 0.005), "reading": 0.5}
    _, listed, named = _asked(monkeypatch, agrees=False, reading=0.5)
    assert named == 0 and listed == {"reading": 0.5}


# settings that are taken out of an engine, one at a time and two together


def _removed(monkeypatch: pytest.MonkeyPatch, **left: float | None) -> dict[str, float]:
    """What each setting explains, and two of them as 'ab', by what is left of a deviation of 10.

    None: the engine cannot be run so.
    """
    options = {"a": {"a": 1}, "b": {"b": 1}, "c": {"a": 2}}
    singles = [name for name in left if len(name) == 1]
    settings = [rerunning._Setting(name, name, options[name]) for name in singles]
    keys = {repr(sorted(options[name].items())): name for name in options}

    def remaining(_: Any, __: Any, chosen: dict[str, Any]) -> Any:
        names = [keys[repr([item])] for item in chosen.items()]
        size = left["".join(sorted(names))]
        return None if size is None else np.array([0.6, 0.8]) * size

    monkeypatch.setattr(rerunning, "_other_settings", lambda *_: settings)
    monkeypatch.setattr(Rerun, "_left", remaining)
    case: Any = SimpleNamespace(deviation=np.array([6.0, 8.0]), mechanism=None, end=1.0)
    causes = Rerun(tb.engine("reference"), lambda *_: None).causes(case)  # type: ignore[arg-type]
    found = [("".join(sorted(cause.name.split(", "))), cause.explained) for cause in causes]
    assert len(dict(found)) == len(found)
    return dict(found)


def test_a_setting_explains_what_vanishes_without_it(monkeypatch: pytest.MonkeyPatch) -> None:
    assert _removed(monkeypatch, a=8.5, b=9.0) == pytest.approx({"a": 0.15, "b": 0.1})
    assert _removed(monkeypatch, a=0.5, b=12.0) == pytest.approx({"a": 0.95})
    assert not _removed(monkeypatch, a=10.0, b=None)


@pytest.mark.parametrize(
    ("both", "explained"), [(1.9, 0.81), (2.1, None), (0.3, 0.97), (None, None)]
)
def test_two_settings_explain_it_together_if_they_leave_less_than_half_of_what_one_does(
    both: float | None, explained: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = _removed(monkeypatch, a=4.0, b=7.0, ab=both)
    pair = {} if explained is None else {"ab": explained}
    assert found == pytest.approx({"a": 0.6, "b": 0.3} | pair)


def test_two_settings_are_taken_out_where_one_explains_a_part_and_not_all(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """More than a fifth, less than enough; and not two of one option."""
    assert "ab" not in _removed(monkeypatch, a=8.1, b=8.5, ab=0.0)
    assert "ab" in _removed(monkeypatch, a=7.9, b=8.5, ab=0.0)
    assert "ab" in _removed(monkeypatch, a=0.51, b=5.0, ab=0.0)
    assert "ab" not in _removed(monkeypatch, a=0.49, b=5.0, ab=0.0)
    assert set(_removed(monkeypatch, a=4.0, c=5.0)) == {"a", "c"}
    assert "bc" in _removed(monkeypatch, a=5.0, c=4.0, b=6.0, bc=0.0)


def test_two_settings_are_taken_out_only_where_both_change_the_motion(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert "ab" not in _removed(monkeypatch, a=4.0, b=10.0, ab=0.0)


# when a motion parts, and sizes of what a model shows


def _onset(
    *metrics: Metric, reference: Formula | None = None, own: Any = None
) -> tuple[str, float] | None:
    """What is violated first, and when, of a motion by formulas."""
    reference = reference or Formula()
    motion: Any = reference
    compared = against((own or reference).trajectory(times()), motion, END)
    found = find_onset(compared, metrics)
    return None if found is None else (found.first_violated, found.time)


def test_events_violate_their_tolerance_at_the_earlier_of_their_times() -> None:
    launch = Metric(name="launch_speed", value=9.0, unit="m/s", tolerance=1.0)
    release = Metric(name="release_time", subject="rest", value=-0.1, unit="s", tolerance=0.01)
    assert _onset(launch) == ("launch_speed", pytest.approx(LAUNCH))
    assert _onset(launch.model_copy(update={"name": "launch_time"})) is not None
    assert _onset(launch, reference=Formula(launches={})) is None
    for early, late in ((0.4, RELEASE), (RELEASE, 0.7), (None, RELEASE)):
        for own, right in ((early, late), (late, early)):
            found = _onset(
                launch, release, own=Formula(release_times={"rest": own}),
                reference=Formula(release_times={"rest": right}),
            )  # fmt: skip
            assert found == ("release_time (rest)", early or late)
    bare = Metric(name="position_max", subject="hook", value=1.0, unit="m")
    assert _onset(bare) is None  # it has no tolerance


def test_a_force_violates_its_tolerance_where_it_is_compared() -> None:
    """Not where an engine without impacts pushes in one instead, over a few samples."""
    reference: Any = Formula(impacts=((1.0, {"buffer": 1.0}),))
    t = times()
    metric = Metric(
        name="stop_torque_max", subject="buffer", value=100.0, unit="N m", tolerance=1.0
    )

    def onset(*pushed: tuple[float, float]) -> tuple[str, float] | None:
        force = sum((100.0 * ((t > first) & (t < last)) for first, last in pushed), 0.0 * t)
        exact = reference.trajectory(t)
        torques = {**exact.stop_torques, "buffer": force}
        own = dataclasses.replace(exact, impacts=(), stop_torques=torques)
        found = find_onset(against(own, reference, END), (metric,))
        return None if found is None else (found.first_violated, found.time)

    assert onset((1.045, 1.055)) is None
    late = onset((1.045, 1.055), (1.295, 1.4))
    assert late == ("stop_torque_max (buffer)", pytest.approx(1.3))


@pytest.mark.parametrize("speed", [1e3, 1e-9])
def test_forces_of_inertia_are_those_of_the_largest_speed_or_of_one_in_its_units(
    speed: float,
) -> None:
    """3 kg at 2 m: 12 kg m^2."""
    bob = hanging_bob()
    states = [State(np.array([0.3]), np.array([u]), ()) for u in (0.0, -speed, 0.5 * speed)]
    least = SPEED / units_of(bob).time
    found = expected(bob, states).inertial
    assert found == pytest.approx([12.0 * max(speed, least) ** 2])


def test_a_diagnosis_that_fails_is_of_what_breaks_its_tolerance_most() -> None:
    broken = [
        Metric(name="position_max", subject=name, value=value, unit="m", tolerance=tolerance)
        for name, value, tolerance in (("a", 3.0, 1.0), ("b", 4.0, 0.5), ("c", 9.0, 3.0))
    ]
    found = diagnosing.failed_diagnosis(broken, ZeroDivisionError("careless"))
    assert found.leads == "position_max (b)" and "careless" in (found.note or "")
