"""Couplers in the engines that build them: order of the error, forces of joints, built models."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from mechanisms import errors_at, geared, misplaced
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
    ("pymunk", two_rods()),
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
    if (name, preset) == ("pymunk", "settings"):
        pytest.skip("Chipmunk's own steps are of first order: the test below has them")
    exact, errors = solve(problem), list[float]()
    for step in (4e-3, 2e-3):
        trajectory = tb.engine(name, preset, timestep=step).simulate(problem)
        errors.append(misplaced(trajectory, exact))
    # Both are of second order at least; softness and Newton's tolerance leave some of it.
    assert errors[1] < 1e-3
    assert errors[0] / errors[1] > 2.0 or errors[1] < 1e-8


@pytest.mark.parametrize("preset", ["default", "settings"])
def test_pymunk_s_own_gear_is_followed_to_first_order(preset: str) -> None:
    problem, names = tb.Problem(two_rods(), END), dict[str, Any]()
    engine = tb.engine("pymunk", preset, timestep=1e-3)
    assert check_model(engine, two_rods()).holds
    exec(engine.script(problem), names)
    assert np.array_equal(names["q"], engine.simulate(problem).q)
    exact = solve(problem)
    coarse, fine = (
        misplaced(tb.engine("pymunk", preset, timestep=h).simulate(problem), exact)
        for h in (2e-3, 1e-3)
    )
    assert coarse / fine == pytest.approx(2, rel=0.15)


@pytest.mark.parametrize("ratio", [-1.7, 0.0, None])
def test_pymunk_s_gear_turns_a_point_mass_as_well(ratio: float | None) -> None:
    """An angle that is held to another one, to none of it, or to the ground's."""
    gear = two_rods().couplers[0]
    terms = () if ratio is None else (tb.CouplerTerm(coordinate="alpha", ratio=ratio),)
    first, second = two_rods().bodies
    point = second.model_copy(update={"inertia": 0.0})
    changes = {"bodies": (first, point), "couplers": (gear.model_copy(update={"terms": terms}),)}
    start = {"start": (0.3, gear.offset + 0.3 * (ratio or 0.0))}
    mechanism = two_rods().model_copy(update=changes | start)
    for preset in ("settings", "assisted"):
        assert check_model(tb.engine("pymunk", preset), mechanism).holds
    problem = tb.Problem(mechanism, 0.5)
    coarse, fine = errors_at((2e-3, 1e-3), "pymunk", "assisted", problem)
    for name, error in coarse.items():  # the leapfrog's order
        assert error / fine[name] == pytest.approx(4, rel=0.1), name


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
        for preset in ("settings", "assisted"):
            with pytest.raises(tb.UnsupportedProblemError, match=r"'rack' holds 's' to 'alpha', "):
                use(tb.engine("pymunk", preset))
