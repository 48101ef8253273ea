"""Couplers in the engines that build them: order of the error, forces of joints, built models."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from mechanisms import geared, misplaced
from trebucheck.comparisons.diagnosis.equivalence import check_model
from trebucheck.reference.solver import solve

END = 1.0


def two_rods() -> tb.Mechanism:
    """A double pendulum whose second rod is geared to the first: two angles, in every engine."""
    mechanism = geared()
    return tb.Mechanism(
        name="geared rods",
        bodies=mechanism.bodies[:2],
        joints=mechanism.joints[:2],
        couplers=mechanism.couplers[:1],
        markers=(tb.Marker(name="tip", body="second", point=(0.2, -0.5)),),
        gravity=mechanism.gravity,
        start=mechanism.start[:2],
    )


RACK = geared("ground").model_copy(update={"name": "rack"})
CASES = [
    ("mujoco", geared()),
    ("mujoco", two_rods()),
    ("exudyn", two_rods()),
    ("exudyn", RACK),
]
by_case = pytest.mark.parametrize(
    ("name", "mechanism"), CASES, ids=lambda case: case if isinstance(case, str) else case.name
)


@by_case
@pytest.mark.parametrize("preset", ["assisted", "settings"])
def test_the_error_falls_with_the_square_of_the_step(
    name: str, mechanism: tb.Mechanism, preset: str
) -> None:
    problem = tb.Problem(mechanism, END)
    exact, errors = solve(problem), list[float]()
    for step in (4e-3, 2e-3):
        trajectory = tb.engine(name, preset, timestep=step).simulate(problem)
        errors.append(misplaced(trajectory, exact))
    # Both are of second order at least; softness and Newton's tolerance leave some of it.
    assert errors[1] < 1e-3
    assert errors[0] / errors[1] > 2.0 or errors[1] < 1e-8


@by_case
def test_forces_of_joints_are_those_of_the_reference(name: str, mechanism: tb.Mechanism) -> None:
    problem = tb.Problem(mechanism, END)
    trajectory = tb.engine(name, timestep=1e-3).simulate(problem)
    exact = solve(problem).trajectory(trajectory.t)
    for joint in mechanism.joints:
        largest = np.abs(exact.joint_reactions[joint.name]).max()
        found = trajectory.joint_reactions[joint.name]
        assert np.abs(found - exact.joint_reactions[joint.name]).max() < 1e-3 * largest


@by_case
def test_the_built_model_is_the_mechanism(name: str, mechanism: tb.Mechanism) -> None:
    equality = check_model(tb.engine(name), mechanism)
    assert equality.exposed
    assert equality.holds, equality.broken


@by_case
def test_a_wrong_ratio_is_found(name: str, mechanism: tb.Mechanism) -> None:
    """A mechanism whose gear is off by a thousandth is another one, by its model and its motion."""
    engine = tb.engine(name)

    class Wrong(type(engine)):  # type: ignore[misc]
        def inspect(self, mechanism: tb.Mechanism, states: Any) -> Any:
            return super().inspect(wrong(mechanism), states)

    def wrong(mechanism: tb.Mechanism) -> tb.Mechanism:
        (gear, *others) = mechanism.couplers
        (term,) = gear.terms
        changed = term.model_copy(update={"ratio": term.ratio * 1.001})
        gear = gear.model_copy(update={"terms": (changed,)})
        return mechanism.model_copy(update={"couplers": (gear, *others)})

    assert not check_model(Wrong(), mechanism).holds


def test_what_an_engine_does_not_build_is_refused_by_name() -> None:
    with pytest.raises(tb.UnsupportedProblemError, match=r"gear|rack"):
        tb.engine("exudyn").simulate(tb.Problem(geared(), END))
    for use in (
        lambda engine: engine.simulate(tb.Problem(geared(), END)),
        lambda engine: check_model(engine, geared()),
    ):
        with pytest.raises(tb.UnsupportedProblemError, match=r"couplers of coordinates \('gear'"):
            use(tb.engine("pymunk"))
