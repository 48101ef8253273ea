"""Genesis: its own defaults, limits, loops and armature, and what is refused."""

from __future__ import annotations

import inspect
from types import SimpleNamespace
from typing import Any

import genesis as gs
import numpy as np
import pytest
import trebucheck as tb
from genesis.options.morphs import MJCF
from genesis.options.solvers import RigidOptions, SimOptions
from trebucheck.comparisons.diagnosis.equivalence import check_model
from trebucheck.engines.inspection import State
from trebucheck.engines.presets import DEFAULT, SETTINGS
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.library.registry import benchmark
from trebucheck_genesis.engine import GenesisEngine


def _engine(preset: str, **options: Any) -> GenesisEngine:
    return GenesisEngine.presets()[preset](**options)


def test_the_defaults_are_genesiss_own() -> None:
    default = _engine(DEFAULT)
    assert default.timestep == SimOptions.model_fields["dt"].default
    assert SimOptions.model_fields["substeps"].default == 1
    assert default.precision == inspect.signature(gs.init).parameters["precision"].default
    assert default.default_armature == MJCF.model_fields["default_armature"].default
    own = RigidOptions.model_fields
    assert getattr(gs.integrator, default.integrator) == own["integrator"].default
    assert default.constraint_timeconst == own["constraint_timeconst"].default
    text = default.script(tb.Problem(tb.fixed(), duration=0.1))
    assert "RigidOptions()" in text and "MJCF(file=MODEL)" in text and "precision" not in text
    assert "solimp" not in text


def _rod(*, sense: int) -> tb.Mechanism:
    """A level rod on a pin, on a stop that holds it against its weight from this side."""
    pendulum = benchmark("pendulum").problem().mechanism
    body = pendulum.bodies[0]
    stop = tb.Stop(
        name="rest", body=body.name, relative_to="ground", limit=0.0, sense=-1, closed=True
    )
    centre = (abs(body.centre[0]), 0.0)
    if sense < 0:  # clockwise is down for a rod to the right, up for one to the left
        centre, stop = (-centre[0], 0.0), stop.model_copy(update={"sense": 1})
    moved = body.model_copy(update={"centre": centre})
    return pendulum.model_copy(
        update={"bodies": (moved,), "stops": (stop,), "start": (0.0,), "start_speeds": (0.0,)}
    )


@pytest.mark.parametrize("sense", [1, -1])
def test_a_limit_carries_a_level_rod(sense: int) -> None:
    """Its torque is the weight's moment, and it is positive on either side."""
    mechanism = _rod(sense=sense)
    problem = tb.Problem(mechanism, duration=0.2, stop_law=tb.StopLaw.UNILATERAL)
    row = _engine(SETTINGS).simulate(problem)
    body = mechanism.bodies[0]
    moment = body.mass * abs(mechanism.gravity_vector[1]) * abs(body.centre[0])
    # Critically damped with a time constant of 2 ms, a hundredth of the duration: what is left is
    # how far the rod sags, and the cosine of that.
    assert row.stop_torques["rest"][-1] == pytest.approx(moment, rel=1e-6)
    assert row.stop_torques["rest"][0] == 0.0  # a limit acts from beyond its end only
    assert row.release_times["rest"] is None


def test_loops_by_pins_and_by_slots_hold_better_at_shorter_steps() -> None:
    for name in ("n-four-bar", "slider-crank"):
        problem = benchmark(name).problem()
        problem = problem.model_copy(update={"duration": problem.duration / 10})
        gaps: list[float] = []
        for steps in (100, 200):
            row = _engine(SETTINGS, timestep=problem.duration / steps).simulate(problem)
            residual = Kinematics(problem.mechanism).loop_residual
            gaps.append(max(float(np.abs(residual(q)).max()) for q in row.q))
        # Time constants of two steps: the gap falls by the square of the step, or by the step where
        # velocities are of first order.
        assert gaps[1] < 0.6 * gaps[0], name


def test_a_force_acts_where_it_is_given_on_a_body_that_a_carrier_has_mass_of() -> None:
    """Weights as forces at the centres of mass move a slider-crank as gravity does."""
    problem = benchmark("slider-crank").problem()
    heavy, duration = problem.mechanism, problem.duration / 10
    weights = [
        tb.ConstantForce(
            name=f"weight of {body.name}",
            body=body.name,
            point=body.centre,
            force=(0.0, -body.mass * heavy.gravity),
        )
        for body in heavy.bodies
    ]
    pushed = heavy.model_copy(update={"gravity": 0.0, "force_elements": tuple(weights)})
    apart: list[float] = []
    for steps in (100, 200):
        engine = _engine(SETTINGS, timestep=duration / steps)
        by_gravity, by_forces = (
            engine.simulate(tb.Problem(mechanism, duration=duration)).q
            for mechanism in (heavy, pushed)
        )
        apart.append(float(np.abs(by_gravity - by_forces).max()))
    # The forces differ by one in the direction that the loop holds, whose softness falls with the
    # square of the step.
    assert apart[1] < 0.6 * apart[0]


def test_the_built_model_is_shown_and_a_fault_in_it_is_found() -> None:
    engine, mechanism = _engine(SETTINGS), tb.fixed()
    first = mechanism.bodies[0]
    assert check_model(engine, mechanism).holds
    bodies = (first.model_copy(update={"mass": 1.001 * first.mass}), *mechanism.bodies[1:])
    heavy = mechanism.model_copy(update={"bodies": bodies})
    wrong = SimpleNamespace(
        name="genesis",
        capabilities=engine.capabilities,
        inspect=lambda _, states: engine.inspect(heavy, states),
    )
    assert not check_model(wrong, mechanism).holds  # type: ignore[arg-type]


def test_the_default_adds_a_rotor_inertia_to_each_joint() -> None:
    """A pendulum of inertia I about its pin falls as one of I + 0.1 kg m^2."""
    problem = benchmark("pendulum").problem()
    mechanism = problem.mechanism
    state = State(q=np.zeros(1), u=np.zeros(1))
    own, bare = (
        _engine(DEFAULT, **options).inspect(mechanism, [state]).dynamics[0].mass_matrix
        for options in ({}, {"default_armature": None})
    )
    assert own is not None and bare is not None
    assert (own - bare)[0, 0] == pytest.approx(0.1, rel=1e-6 * float(bare[0, 0]) / 0.1)


def test_it_tells_no_joint_forces_and_refuses_what_it_does_not_build() -> None:
    assert not GenesisEngine.capabilities.joint_reactions
    with pytest.raises(tb.UnsupportedProblemError, match=r"genesis"):
        _engine(SETTINGS).simulate(benchmark("bouncing").problem())


def test_an_absent_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(GenesisEngine, "is_installed", classmethod(lambda _: False))
    with pytest.raises(tb.EngineNotInstalledError, match="genesis"):
        _engine(SETTINGS).simulate(benchmark("pendulum").problem())
