"""The cubic torsion spring in Exudyn and pymunk: of second order, and right in single states."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest
import trebucheck as tb
from numpy.testing import assert_allclose
from trebucheck.engines.exudyn.engine import ExudynEngine
from trebucheck.engines.inspection import State
from trebucheck.engines.pymunk.engine import PymunkEngine
from trebucheck.engines.reference.engine import ReferenceEngine
from trebucheck.models.elements import CubicTorsionSpring, PinJoint
from trebucheck.models.mechanism import Body, Mechanism
from trebucheck.models.problem import Problem

ENGINES = {"exudyn": ExudynEngine, "pymunk": PymunkEngine}


def duffing(inertia: float) -> Mechanism:
    """A pendulum at a spring on the ground, and a second one at a spring on the first."""
    return Mechanism(
        name="duffing",
        bodies=(
            Body(name="upper", angle="a", mass=1.0, centre=(0.5, 0.0), inertia=0.1),
            Body(name="lower", angle="b", mass=0.5, centre=(0.4, 0.0), inertia=inertia),
        ),
        joints=(
            PinJoint(name="pivot", parent="ground", child="upper", parent_point=(0.0, 0.0),
                     child_point=(0.0, 0.0)),
            PinJoint(name="elbow", parent="upper", child="lower", parent_point=(1.0, 0.0),
                     child_point=(0.0, 0.0)),
        ),
        force_elements=(
            CubicTorsionSpring(name="shoulder", body="upper", stiffness=2.0, cubic_stiffness=9.0,
                               rest_angle=1.2),
            CubicTorsionSpring(name="tendon", body="lower", relative_to="upper", stiffness=0.5,
                               cubic_stiffness=6.0, rest_angle=0.1),
        ),
        start=(0.3, 1.4),
        gravity=9.81,
    )  # fmt: skip


@pytest.fixture(params=sorted(ENGINES))
def engine(request: pytest.FixtureRequest) -> str:
    """An engine that has a builder for the spring."""
    if importlib.util.find_spec(request.param) is None:
        pytest.skip(f"{request.param} is not installed")
    return request.param


@pytest.mark.parametrize("inertia", [0.02, 0.0])
def test_of_second_order(engine: str, inertia: float) -> None:
    problem = Problem(duffing(inertia), duration=1.0)
    exact = ReferenceEngine().simulate(problem)
    runs = [ENGINES[engine](timestep=step).simulate(problem) for step in (2e-3, 1e-3)]
    errors = [np.abs(run.q[-1] - exact.q[-1]).max() for run in runs]
    assert errors[1] < 5e-4
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)
    drift = [np.abs(run.total_energy - exact.total_energy[0]).max() for run in runs]
    assert drift[0] / drift[1] == pytest.approx(4.0, rel=0.15)


@pytest.mark.parametrize("inertia", [0.02, 0.0])
def test_right_in_single_states(engine: str, inertia: float) -> None:
    mechanism = duffing(inertia)
    states = [
        State(q=np.array([0.3, 1.4]), u=np.zeros(2)),
        State(np.array([-1.0, 2.2]), np.ones(2)),
    ]
    inspected = ENGINES[engine]().inspect(mechanism, states)
    exact = ReferenceEngine().inspect(mechanism, states)
    for found, right in zip(inspected.dynamics, exact.dynamics, strict=True):
        assert_allclose(found.accelerations, right.accelerations, rtol=1e-8)


def test_the_spring_matters() -> None:
    without = duffing(0.02).model_copy(update={"force_elements": ()})
    with_springs, free = (
        tb.engine("reference").simulate(Problem(m, duration=1.0)) for m in (duffing(0.02), without)
    )
    assert np.abs(with_springs.q[-1] - free.q[-1]).max() > 0.1
