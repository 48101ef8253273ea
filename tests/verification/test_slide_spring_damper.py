"""Springs, dampers and forces along slides: closed forms, and all formulations together."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from mechanisms import errors_at, pin
from trebucheck.comparisons.diagnosis.equivalence import check_model
from trebucheck.models.applied_forces import AppliedForces
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.mjcf.writer import mjcf
from trebucheck.reference.certification.redundant import RedundantSystem
from trebucheck.reference.equations import Equations
from trebucheck.reference.solver import solve
from trebucheck.reference.taylor.solve import solve_taylor

MASS, STIFFNESS, DAMPING, FORCE, REST = 2.5, 40.0, 3.0, 7.0, 0.3
TIMES = np.linspace(0.0, 1.5, 31)


def spring(coordinate: str = "s", body: str = "cart", relative_to: str = "ground") -> Any:
    """A spring, damper and force on a slide."""
    return tb.SlideSpringDamper(
        name=f"spring of {coordinate}",
        body=body,
        relative_to=relative_to,
        coordinate=coordinate,
        stiffness=STIFFNESS,
        damping=DAMPING,
        rest_position=REST,
        force=FORCE,
    )


def cart(**changes: Any) -> tb.Mechanism:
    """A cart on a level slide, at rest at 0.1 m."""
    fields: dict[str, Any] = {
        "name": "cart",
        "bodies": (tb.Body(name="cart", mass=MASS, centre=(0, 0), inertia=0.1),),
        "joints": (
            tb.PrismaticJoint(
                name="rail", child="cart", parent_point=(0.2, 0.5), child_point=(0, 0),
                axis=(1, 0), coordinate="s",
            ),
        ),
        "force_elements": (spring(),),
        "gravity": 9.81,
        "start": (0.1,),
    }  # fmt: skip
    return tb.Mechanism(**(fields | changes))


def bead_on_an_arm(**changes: Any) -> tb.Mechanism:
    """An arm that swings, and a bead that slides on it obliquely and carries a rod."""
    fields: dict[str, Any] = {
        "name": "bead on an arm",
        "bodies": (
            tb.Body(name="arm", angle="a", mass=3.0, centre=(0.5, 0.1), inertia=0.4),
            tb.Body(name="bead", mass=1.2, centre=(0.05, 0.02), inertia=0.03),
            tb.Body(name="rod", angle="b", mass=0.7, centre=(0.3, 0.0), inertia=0.02),
        ),
        "joints": (
            pin("hook", "ground", "arm", (0, 1), (0, 0)),
            tb.PrismaticJoint(
                name="rail", parent="arm", child="bead", parent_point=(0.3, 0.05),
                child_point=(0, 0), axis=(0.8, 0.6), coordinate="s", angle=0.2,
            ),
            pin("pin", "bead", "rod", (0.1, 0), (0, 0)),
        ),
        "force_elements": (spring("s", "bead", "arm"),),
        "markers": (tb.Marker(name="tip", body="rod", point=(0.6, 0.0)),),
        "gravity": 9.81,
        "start": (0.4, 1.0, 0.15),
        "start_speeds": (1.0, -2.0, 0.5),
    }  # fmt: skip
    return tb.Mechanism(**(fields | changes))


def test_a_cart_is_a_damped_oscillator() -> None:
    solution = solve(tb.Problem(cart(), duration=1.5))
    at_rest = REST + FORCE / STIFFNESS
    decay = DAMPING / (2 * MASS)
    rate = math.sqrt(STIFFNESS / MASS - decay**2)
    off = 0.1 - at_rest
    wave = np.cos(rate * TIMES) + decay / rate * np.sin(rate * TIMES)
    expected = at_rest + off * np.exp(-decay * TIMES) * wave
    assert solution.motion(TIMES).q[:, 0] == pytest.approx(expected, abs=1e-11)


def test_energy_changes_by_its_power_and_the_joint_carries_the_weight_alone() -> None:
    solution = solve(tb.Problem(cart(), duration=1.5))
    t = np.linspace(0.0, 1.5, 3001)
    trajectory = solution.trajectory(t)
    applied = AppliedForces(Kinematics(cart()))
    power = applied.power(trajectory.q, trajectory.u)
    work = np.concatenate([[0.0], np.cumsum((power[1:] + power[:-1]) / 2 * np.diff(t))])
    total = trajectory.kinetic_energy + trajectory.potential_energy
    # The trapezoidal rule at 0.5 ms: h^2 / 12 of the power's slope, which is below 1e3 W/s.
    assert total - total[0] == pytest.approx(work, abs=1e3 * 0.0005**2)
    weight = np.tile([0.0, MASS * 9.81], (len(t), 1))
    assert trajectory.joint_reactions["rail"] == pytest.approx(weight, abs=1e-9)


def test_formulations_agree() -> None:
    problem = tb.Problem(bead_on_an_arm(), duration=1.0)
    solution = solve(problem)
    t = np.linspace(0.0, 1.0, 21)
    trajectory = solution.trajectory(t)
    assert solve_taylor(problem).trajectory(t).q == pytest.approx(trajectory.q, abs=1e-10)
    redundant, equations = RedundantSystem(problem.mechanism), Equations(problem.mechanism)
    a, _ = equations.solve(trajectory.q[0], trajectory.u[0], ())
    spins = redundant.rates(redundant.start, ())[redundant.n :][2::3]
    assert spins == pytest.approx([a[0], a[0], a[1]], rel=1e-9)
    total = trajectory.kinetic_energy[0] + trajectory.potential_energy[0]
    assert redundant.energy(redundant.start) == pytest.approx(total, rel=1e-12)


def test_its_motion_and_forces_are_proved() -> None:
    problem = tb.Problem(bead_on_an_arm(), duration=0.5)
    proof, solution = tb.prove(problem, digits=12, until=0.25), solve(problem)
    trajectory = solution.trajectory(np.array([0.25]))
    values = [float(each.value) for each in proof.q(0.25).values()]
    assert trajectory.q[0] == pytest.approx(values, abs=1e-11)
    for joint, force in trajectory.joint_reactions.items():
        found = [float(part.value) for part in proof.joint_reaction(joint, 0.25)]
        assert found == pytest.approx(force[0].tolist(), abs=1e-8)
    _, potential = proof.energy(0.25)
    assert trajectory.potential_energy[0] == pytest.approx(float(potential.value), rel=1e-9)


@pytest.mark.parametrize("mechanism", [cart(), bead_on_an_arm()], ids=lambda m: m.name)
def test_mujoco_has_it_as_the_slides_own(mechanism: tb.Mechanism) -> None:
    text = mjcf(mechanism, 1e-3)
    assert 'stiffness="40' in text
    assert 'damping="3' in text
    assert check_model(tb.engine("mujoco"), mechanism).holds
    problem = tb.Problem(mechanism, duration=0.5)
    found = tb.engine("mujoco", "settings", timestep=2e-4).simulate(problem)
    exact = solve(problem).trajectory(found.t)
    # RK4 at 0.2 ms: h^4 of accelerations below 1e3.
    assert found.q == pytest.approx(exact.q, abs=1e-7)
    for joint, force in exact.joint_reactions.items():
        assert found.joint_reactions[joint] == pytest.approx(force, abs=1e-5), joint


@pytest.mark.parametrize("mechanism", [cart(), bead_on_an_arm()], ids=lambda m: m.name)
def test_exudyn_has_it_between_two_frames(mechanism: tb.Mechanism) -> None:
    assert check_model(tb.engine("exudyn"), mechanism).holds
    problem = tb.Problem(mechanism, duration=0.3)
    found = tb.engine("exudyn", "settings", timestep=1e-4).simulate(problem)
    exact = solve(problem).trajectory(found.t)
    # A method of second order at 0.1 ms, with third derivatives below 1e4
    assert found.q == pytest.approx(exact.q, abs=1e-5)
    assert found.potential_energy == pytest.approx(exact.potential_energy, abs=1e-3)
    for joint, force in exact.joint_reactions.items():
        assert found.joint_reactions[joint][5:] == pytest.approx(force[5:], abs=0.05), joint


@pytest.mark.parametrize("mechanism", [cart(), bead_on_an_arm()], ids=lambda m: m.name)
def test_pymunk_has_it_as_a_force_of_each_step(mechanism: tb.Mechanism) -> None:
    assert check_model(tb.engine("pymunk"), mechanism).holds
    problem = tb.Problem(mechanism, duration=0.3)
    coarse, fine = errors_at((2e-3, 1e-3), "pymunk", "assisted", problem)
    # The leapfrog's order; the cart's rail carries its weight at any step.
    for name, error in coarse.items():
        assert fine[name] < 1e-9 or error / fine[name] == pytest.approx(4, rel=0.1), name


@pytest.mark.parametrize("preset", ["default", "settings"])
def test_pymunk_by_itself_has_it_as_a_spring_to_a_point_far_away(preset: str) -> None:
    for mechanism in (cart(), bead_on_an_arm()):
        assert check_model(tb.engine("pymunk", preset), mechanism).holds
        problem, names = tb.Problem(mechanism, duration=0.3), dict[str, Any]()
        engine = tb.engine("pymunk", preset, timestep=1e-3)
        exec(engine.script(problem), names)
        assert np.array_equal(names["q"], engine.simulate(problem).q)
    coarse, fine = errors_at((2e-3, 1e-3), "pymunk", preset, tb.Problem(cart(), 0.3))
    assert coarse["q"] / fine["q"] == pytest.approx(2, rel=0.1)


@pytest.mark.parametrize("preset", ["settings", "assisted"])
@pytest.mark.parametrize("field", ["stiffness", "damping", "force", "rest_position"])
def test_a_wrong_law_is_seen_in_what_pymunk_has_built(preset: str, field: str) -> None:
    class Wrong(type(tb.engine("pymunk", preset))):  # type: ignore[misc]
        def inspect(self, mechanism: tb.Mechanism, states: Any) -> Any:
            (law,) = mechanism.force_elements
            law = law.model_copy(update={field: getattr(law, field) + 1e-3})
            changed = mechanism.model_copy(update={"force_elements": (law,)})
            return super().inspect(changed, states)

    engine = Wrong(**dict(tb.engine("pymunk", preset)))
    assert not check_model(engine, bead_on_an_arm()).holds


def test_pymunk_by_itself_refuses_it_where_the_body_moves_across_the_slide() -> None:
    table = tb.TranslationJoint(name="table", child="cart", coordinates=("s", "r"))
    free = cart(joints=(table,), start=(0.1, 0.2))
    with pytest.raises(tb.UnsupportedProblemError, match="'spring of s' acts on 'cart'"):
        tb.engine("pymunk", "settings").simulate(tb.Problem(free, duration=0.1))


def test_several_on_a_slide_add_up() -> None:
    """Two springs of half the stiffness, damping and force are one."""
    half = {n: getattr(spring(), n) / 2 for n in ("stiffness", "damping", "force")}
    one = spring().model_copy(update=half)
    other = one.model_copy(update={"name": "other"})
    both, single = (
        tb.engine("mujoco", "settings").simulate(tb.Problem(each, duration=0.3))
        for each in (cart(force_elements=(one, other)), cart())
    )
    assert both.q == pytest.approx(single.q, abs=1e-13)


@pytest.mark.parametrize(
    ("of", "message"),
    [
        (("t",), "'s' on 'ground'"),
        (("s", "cart", "cart"), "itself"),
        (("s", "cart", "truck"), "truck"),
    ],
)
def test_a_slide_that_is_not_there_is_refused(of: tuple[str, ...], message: str) -> None:
    with pytest.raises(tb.InputError, match=message):
        cart(force_elements=(spring(*of),))
