"""The gate and the diagnosis, on the reference and on engines of a third party.

No engine library needed.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np
import plugin_engines
import pytest
import trebucheck as tb
from conftest import machine_parameters, machines
from faulty import Faulty, body, parameters
from hypothesis import given
from hypothesis import strategies as st
from trebucheck.comparisons.diagnosis.case import Case, factor_of, fit, share_of
from trebucheck.comparisons.diagnosis.diagnose import active_contacts_at, check_and_diagnose, growth
from trebucheck.comparisons.diagnosis.equivalence import EXACT, check_model, random_states
from trebucheck.comparisons.diagnosis.faults import combined, hypotheses, machine_suspects
from trebucheck.comparisons.diagnosis.rerun import Rerun, _other_settings
from trebucheck.comparisons.report.pages.tables import diagnosis
from trebucheck.comparisons.runs.results import Diagnosis, Outcome, RankedCause, Run
from trebucheck.engines.inspection import Dynamics, Inspection, State
from trebucheck.engines.mujoco.engine import MujocoEngine
from trebucheck.engines.registry import causes_of
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
        preset="tuned",
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
    results = tb.compare(["fixed"], ["reference"], ["tuned"], isolate=False).results
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


def test_half_the_step_is_run_only_where_it_can_change_what_the_step_explains() -> None:
    """An error of first and second order: an eighth and a sixteenth of the step tell it."""
    solution = solve(tb.Problem(tb.catapult(), 0.5))
    t = np.linspace(0.0, 0.5, 101)
    steps: list[float | None] = []

    def simulate(engine: tb.Engine, _: tb.Problem) -> tb.Trajectory:
        steps.append(engine.timestep)
        exact, h = solution.trajectory(t), (engine.timestep or 0.0) / 1e-3
        error = 1e-3 * (h * np.sin(4 * np.pi * t) + h**2 * np.cos(4 * np.pi * t))
        return dataclasses.replace(exact, q=exact.q + error[:, None])

    engine = MujocoEngine(timestep=1e-3)
    causes = Rerun(engine, simulate).causes(Case(simulate(engine, solution.problem), solution, 0.5))
    explained = {cause.name: cause.explained for cause in causes}
    assert explained["time step"] == pytest.approx(1 - 1 / 128 / math.sqrt(2), abs=2e-3)
    assert {1e-3 / 8, 1e-3 / 16} < set(steps) and 5e-4 not in steps


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
