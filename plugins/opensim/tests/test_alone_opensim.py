"""OpenSim by itself: its own defaults, and the elements that it is built of."""

from typing import Any

import numpy as np
import opensim as osim
import pytest
import trebucheck as tb
from trebucheck.engines.presets import DEFAULT, SETTINGS
from trebucheck.models.library.registry import library_problem
from trebucheck_opensim.alone import Alone
from trebucheck_opensim.engine import OpenSimEngine


def _engine(preset: str, **options: Any) -> OpenSimEngine:
    return OpenSimEngine.presets()[preset](**options)


def _problem(name: str, duration: float = 0.5) -> tb.Problem:
    known = library_problem(name, None)
    assert known is not None
    return known.model_copy(update={"duration": min(duration, known.duration)})


def test_the_defaults_are_opensims_own() -> None:
    default, limit = _engine(DEFAULT), osim.CoordinateLimitForce()
    assert default.limit_stiffness == limit.get_upper_stiffness() == limit.get_lower_stiffness()
    assert default.limit_damping == limit.get_damping()
    assert default.limit_transition == limit.get_transition()
    # A Manager tells none of its settings: one of which nothing is set takes the same steps.
    problem = _problem("double-pendulum")
    alone = Alone(problem.mechanism, default)
    manager = osim.Manager(alone.built.model)
    alone.built.state.setTime(0.0)
    manager.initialize(alone.built.state)
    manager.integrate(problem.duration)
    table, row = manager.getStatesTable(), default.simulate(problem)
    assert np.array_equal(table.getIndependentColumn(), row.t) and len(row.t) > 3
    paths = (f"{each.getAbsolutePathString()}/speed" for each in alone.built.moving)
    own = np.array([table.getDependentColumn(path).to_numpy() for path in paths]).T
    assert np.array_equal(alone.to.mechanism_speeds(own), row.u)


@pytest.mark.parametrize(
    "name",
    [
        "slider-crank",
        "squeezer",
        "quick-return",
        "damped-oscillator",
        "torsion-pendulum",
        "thrown-plate",
        "welded-rods",
        "spring-pendulum",
    ],
)
def test_elements_and_readings_are_those_of_the_mechanism(name: str) -> None:
    """Of a hundredth of the motion, to the accuracy with the condition of the mechanism."""
    whole = library_problem(name, None)
    assert whole is not None
    problem = _problem(name, whole.duration / 100)
    run = _engine(SETTINGS, timestep=problem.duration / 10).simulate(problem)
    truth = tb.solve(problem).trajectory(np.minimum(run.t, problem.duration))
    assert run.q == pytest.approx(truth.q, rel=1e-7, abs=1e-9)
    assert run.kinetic_energy == pytest.approx(truth.kinetic_energy, rel=1e-6, abs=1e-9)
    assert run.potential_energy == pytest.approx(truth.potential_energy, rel=1e-7, abs=1e-9)
    peak = max((np.abs(f).max() for f in truth.joint_reactions.values()), default=0.0)
    for joint, force in truth.joint_reactions.items():
        assert np.abs(run.joint_reactions[joint] - force).max() <= 1e-7 * peak, joint


def test_a_limit_holds_by_its_stiffness() -> None:
    """A level rod on its limit gives way as far as its spring needs for the weight."""
    stop = tb.Stop(name="rest", body="rod", sense=-1, limit=0.0, closed=True)
    mechanism = tb.Mechanism(
        name="held",
        bodies=(tb.Body(name="rod", angle="q", mass=2.0, centre=(0.5, 0), inertia=1.0),),
        joints=(
            tb.PinJoint(
                name="pin", parent="ground", child="rod", parent_point=(0, 0), child_point=(0, 0)
            ),
        ),
        stops=(stop,),
        gravity=9.81,
        start=(0.0,),
    )
    stiffness = 100.0  # [N m/degree]
    soft = {"limit_stiffness": stiffness, "limit_damping": 20.0, "limit_transition": 1e-4}
    row = _engine(SETTINGS, **soft).simulate(tb.Problem(mechanism, duration=1.0))
    assert row.stop_torques["rest"][-1] == pytest.approx(9.81, rel=1e-3)
    # And half of the transition, from which the stiffness rises.
    assert np.degrees(row.q[-1, 0]) == pytest.approx(9.81 / stiffness, rel=1e-2)


@pytest.mark.parametrize("name", ["motor", "bouncing", "stopped-pendulum"])
def test_what_the_adapter_does_not_build_it_says_itself(name: str) -> None:
    with pytest.raises(tb.UnsupportedProblemError, match="adapter"):
        _engine(DEFAULT).simulate(_problem(name))


def test_own_steps_are_refused_beside_locks() -> None:
    with pytest.raises(tb.InputError, match="own steps"):
        OpenSimEngine(samples="own steps")
