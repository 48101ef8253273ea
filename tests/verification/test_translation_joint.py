"""Bodies that move without turning: closed forms, and all formulations together."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from mechanisms import errors_at, pin
from trebucheck.comparisons.diagnosis.equivalence import check_model
from trebucheck.models.mjcf.writer import mjcf
from trebucheck.reference.certification.redundant import RedundantSystem
from trebucheck.reference.equations import Equations
from trebucheck.reference.solver import solve
from trebucheck.reference.taylor.solve import solve_taylor

MASS, ROD = 2.0, 0.7


def plate(*elements: Any, **changes: Any) -> tb.Mechanism:
    """A plate that is turned by 0.3 rad, and a rod that hangs on it beside its centre."""
    fields: dict[str, Any] = {
        "name": "plate",
        "bodies": (
            tb.Body(name="plate", mass=MASS, centre=(0.1, -0.2), inertia=0.3),
            tb.Body(name="rod", angle="b", mass=ROD, centre=(0.4, 0.0), inertia=0.02),
        ),
        "joints": (
            tb.TranslationJoint(
                name="table", child="plate", child_point=(0.3, 0.1), coordinates=("x", "y"),
                angle=0.3,
            ),
            pin("pin", "plate", "rod", (0.5, 0.2), (0, 0)),
        ),
        "force_elements": elements,
        "markers": (tb.Marker(name="tip", body="rod", point=(0.8, 0.0)),),
        "gravity": 9.81,
        "start": (0.4, 0.2, 1.0),
        "start_speeds": (-2.0, 1.5, 3.0),
    }  # fmt: skip
    return tb.Mechanism(**(fields | changes))


def springs() -> tuple[Any, ...]:
    """A spring along x, and one with a damper along y."""
    along: dict[str, Any] = {"body": "plate", "relative_to": "ground"}
    return (
        tb.SlideSpringDamper(name="sx", coordinate="x", stiffness=30.0, **along),
        tb.SlideSpringDamper(name="sy", coordinate="y", stiffness=50.0, damping=2.0, **along),
    )


def test_alone_it_falls_as_a_point_and_does_not_turn() -> None:
    bodies, joints = plate().bodies[:1], plate().joints[:1]
    alone = plate(
        bodies=bodies, joints=joints, markers=(), start=(0.2, 1.0), start_speeds=(1.5, 3.0)
    )
    motion = solve(tb.Problem(alone, duration=1.0)).motion(np.array([0.0, 0.7]))
    assert motion.q[1] == pytest.approx(
        [0.2 + 1.5 * 0.7, 1.0 + 3.0 * 0.7 - 9.81 * 0.49 / 2], abs=1e-12
    )
    equations = Equations(alone)
    assert equations.mass_matrix(motion.q[0]) == pytest.approx(MASS * np.eye(2))
    assert alone.attitudes["plate"] == (None, 0.3)


def test_on_springs_it_oscillates_along_both() -> None:
    alone = plate(
        *springs(), bodies=plate().bodies[:1], joints=plate().joints[:1], markers=(), gravity=0.0,
        start=(0.2, 0.4), start_speeds=(0.0, 0.0),
    )  # fmt: skip
    t = np.linspace(0.0, 1.5, 16)
    motion = solve(tb.Problem(alone, duration=1.5)).motion(t)
    assert motion.q[:, 0] == pytest.approx(0.2 * np.cos(math.sqrt(30.0 / MASS) * t), abs=1e-10)
    decay = 2.0 / (2 * MASS)
    rate = math.sqrt(50.0 / MASS - decay**2)
    wave = np.cos(rate * t) + decay / rate * np.sin(rate * t)
    assert motion.q[:, 1] == pytest.approx(0.4 * np.exp(-decay * t) * wave, abs=1e-10)


def test_formulations_agree_and_a_proof_holds() -> None:
    problem = tb.Problem(plate(*springs()), duration=1.0)
    solution, t = solve(problem), np.linspace(0.0, 1.0, 11)
    trajectory = solution.trajectory(t)
    assert solve_taylor(problem).trajectory(t).q == pytest.approx(trajectory.q, abs=1e-10)
    redundant, equations = RedundantSystem(problem.mechanism), Equations(problem.mechanism)
    a, _ = equations.solve(trajectory.q[0], trajectory.u[0], ())
    spins = redundant.rates(redundant.start, ())[redundant.n :][2::3]
    assert spins == pytest.approx([0.0, a[0]], abs=1e-9)
    proof = tb.prove(problem, digits=12, until=0.5)
    values = [float(each.value) for each in proof.q(0.5).values()]
    assert solution.motion(np.array([0.5])).q[0] == pytest.approx(values, abs=1e-11)


@pytest.mark.parametrize(
    ("engine", "step", "error"),
    # RK4 at 0.2 ms; a method of second order at 0.1 ms, with third derivatives below 1e4
    [("mujoco", 2e-4, 1e-8), ("exudyn", 1e-4, 1e-5)],
)
def test_engines_move_it(engine: str, step: float, error: float) -> None:
    mechanism = plate(*springs())
    assert check_model(tb.engine(engine), mechanism).holds
    found = tb.engine(engine, "settings", timestep=step).simulate(
        tb.Problem(mechanism, duration=0.3)
    )
    exact = solve(tb.Problem(mechanism, duration=0.4)).trajectory(found.t)
    assert found.q == pytest.approx(exact.q, abs=error)
    pin_force = exact.joint_reactions["pin"]
    assert found.joint_reactions["pin"][5:] == pytest.approx(pin_force[5:], abs=0.05)


def test_it_is_two_slides_in_mjcf_that_are_read_again() -> None:
    text = mjcf(plate(), 1e-3)
    assert text.count('type="slide"') == 2
    read = tb.from_mjcf(text)
    assert [type(joint) for joint in read.joints] == [tb.TranslationJoint, tb.PinJoint]


def test_pymunk_moves_it_without_turning_it() -> None:
    mechanism = plate(*springs())
    assert check_model(tb.engine("pymunk"), mechanism).holds
    problem = tb.Problem(mechanism, duration=0.3)
    coarse, fine = errors_at((2e-3, 1e-3), "pymunk", "assisted", problem)
    for name, error in coarse.items():  # the leapfrog's order
        assert error / fine[name] == pytest.approx(4, rel=0.1), name


@pytest.mark.parametrize("preset", ["default", "settings"])
def test_pymunk_by_itself_holds_its_angle_by_a_gear(preset: str) -> None:
    mechanism, engine = plate(), tb.engine("pymunk", preset, timestep=1e-3)
    assert check_model(engine, mechanism).holds
    problem, names = tb.Problem(mechanism, duration=0.3), dict[str, Any]()
    exec(engine.script(problem), names)
    assert np.array_equal(names["q"], engine.simulate(problem).q)
    coarse, fine = errors_at((1e-3, 5e-4), "pymunk", preset, problem)
    assert coarse["q"] / fine["q"] == pytest.approx(2, rel=0.15)


def test_its_body_has_no_angle_of_its_own() -> None:
    body = tb.Body(name="plate", angle="a", mass=1.0, centre=(0, 0), inertia=0.1)
    with pytest.raises(tb.InputError, match="plate"):
        plate(bodies=(body, plate().bodies[1]))
