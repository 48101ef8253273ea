"""DART by itself: its own defaults, what its elements do, and what is refused."""

from __future__ import annotations

from typing import Any

import dartpy
import numpy as np
import pytest
import trebucheck as tb
from trebucheck.engines.presets import DEFAULT, SETTINGS
from trebucheck.models.elements import GROUND
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.library.registry import benchmark
from trebucheck_dart.alone import DARTS_STEP, Alone
from trebucheck_dart.engine import DartEngine


def _engine(preset: str, **options: Any) -> DartEngine:
    return DartEngine.presets()[preset](**options)


def _numbers(thing: Any) -> dict[str, Any]:
    """Numbers and classes that an object of DART's tells, by the names of its functions."""
    found: dict[str, Any] = {}
    for name in dir(thing):
        if name.startswith(("get", "is", "are", "has")):
            try:
                value = getattr(thing, name)()
            except (TypeError, RuntimeError):
                continue
            if isinstance(value, bool | int | float):
                found[name] = value
    return found


@pytest.mark.parametrize("preset", [DEFAULT, SETTINGS])
def test_the_defaults_are_darts_own(preset: str) -> None:
    bare, engine = dartpy.simulation.World(), _engine(preset)
    assert engine.timestep == bare.getTimeStep() == DARTS_STEP
    for mechanism in (tb.fixed(), benchmark("three-cranks").problem().mechanism):
        world = Alone(mechanism, engine).world
        mine, own = _numbers(world), _numbers(bare)
        of_the_model = {"getNumSkeletons", "getIndex"}
        assert {key: mine[key] for key in own if key not in of_the_model} == {
            key: value for key, value in own.items() if key not in of_the_model
        }
        solver, plain = world.getConstraintSolver(), bare.getConstraintSolver()
        assert type(solver) is type(plain)
        assert type(solver.getBoxedLcpSolver()) is type(plain.getBoxedLcpSolver())
        assert solver.isSplitImpulseEnabled() == plain.isSplitImpulseEnabled()
    assert "setTimeStep" not in engine.script(tb.Problem(tb.fixed(), duration=0.1))


def test_limits_are_enforced_as_dart_does_not_by_itself() -> None:
    """A stop is built as a limit that is enforced; joints without stops are as DART makes them."""
    made = dartpy.dynamics.Skeleton("one").createRevoluteJointAndBodyNodePair()[0]
    assert not made.areLimitsEnforced()
    alone = Alone(tb.fixed(), _engine(DEFAULT))
    for index, joint in enumerate(alone.moving):
        assert joint.areLimitsEnforced() == (index in alone.ranges)
        kept = ("getSpringStiffness", "getDampingCoefficient", "getCoulombFriction")
        assert [getattr(joint, name)(0) for name in kept] == [
            getattr(made, name)(0) for name in kept
        ]


def test_a_spring_on_a_joint_is_darts_own() -> None:
    mechanism = benchmark("torsion-pendulum").problem().mechanism
    alone = Alone(mechanism, _engine(DEFAULT))
    assert len(alone.springs) == 1 and not alone.pushed.force_elements
    (spring,) = mechanism.force_elements
    assert isinstance(spring, tb.RotationalSpringDamper)
    assert alone.moving[0].getSpringStiffness(0) == spring.stiffness
    assert alone.moving[0].getDampingCoefficient(0) == spring.damping


@pytest.mark.parametrize("name", ["torsion-pendulum", "motor", "damped-oscillator"])
def test_springs_are_of_first_order(name: str) -> None:
    problem = benchmark(name).problem().model_copy(update={"duration": 1.0})
    truth = np.asarray(tb.solve(problem).q(np.array([1.0])))[0]
    coarse, fine = (
        np.abs(_engine(DEFAULT, timestep=step).simulate(problem).q[-1] - truth).max()
        for step in (2e-3, 1e-3)
    )
    assert np.log2(coarse / fine) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("name", ["n-four-bar", "squeezer", "three-cranks"])
def test_forces_of_pins_are_those_whose_torque_dart_tells(name: str) -> None:
    """DART tells the joint forces of its constraints: J^T f.

    Of the first tree of a skeleton alone: those of others are written into the same places. They
    are told after the step, whose turn changes the arm of all but the tree's last joint.
    """
    problem = benchmark(name).problem()
    step, mechanism = problem.duration / 2000, problem.mechanism
    made = _engine(DEFAULT, timestep=step)
    found = made.simulate(problem.model_copy(update={"duration": 20 * step}))
    alone, kinematics = Alone(mechanism, made), Kinematics(mechanism)
    last = next(k for k, (_, joint) in enumerate(alone.to.links) if joint.parent != GROUND)
    for k, q in enumerate(found.q):
        alone.step()
        told = float(alone.skeleton.getConstraintForces()[last])
        pins = [found.joint_reactions[joint.name][k] for joint in alone.pins]
        torques = alone.to.forces(kinematics.loop_jacobian(q).T @ np.concatenate(pins))
        assert told != 0.0 and torques[last] == pytest.approx(told, rel=1e-6)


@pytest.mark.parametrize("problem", ["bouncing", "stopped-pendulum"])
def test_what_is_not_built_is_said_of_the_adapter(problem: str) -> None:
    with pytest.raises(tb.UnsupportedProblemError, match="adapter"):
        _engine(DEFAULT).simulate(benchmark(problem).problem())
