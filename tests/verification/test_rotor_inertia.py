"""Rotor inertias: in closed form, and all formulations against each other."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from mechanisms import chain, errors_at, rod_pendulum
from trebucheck.comparisons.diagnosis.equivalence import check_model
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.mjcf.writer import mjcf
from trebucheck.reference.certification.redundant import RedundantSystem
from trebucheck.reference.equations import Equations
from trebucheck.reference.solver import solve
from trebucheck.reference.taylor.solve import solve_taylor

ROTOR, TIMES = 0.37, np.linspace(0.0, 1.5, 31)


def rotor(body: str, relative_to: str = "ground", inertia: float = ROTOR) -> tb.RotorInertia:
    """A rotor between two bodies."""
    return tb.RotorInertia(
        name=f"rotor of {body}", body=body, relative_to=relative_to, inertia=inertia
    )


def geared(*elements: Any, **changes: Any) -> tb.Mechanism:
    """Two rods, with rotors between upper and ground and between lower and upper."""
    rotors = (rotor("upper"), rotor("lower", "upper", 0.21))
    return chain(force_elements=(*rotors, *elements), start_speeds=(0.5, -2.0), **changes)


def test_a_rotor_on_the_ground_is_inertia_of_its_body() -> None:
    """Seen from the ground, the relative angle is the body's own."""
    heavier = chain(inertias=(0.1 + ROTOR, 0.2), start_speeds=(0.5, -2.0))
    with_rotor = chain(
        inertias=(0.1, 0.2), start_speeds=(0.5, -2.0), force_elements=(rotor("upper"),)
    )
    one, other = (solve(tb.Problem(each, duration=1.5)) for each in (heavier, with_rotor))
    assert other.motion(TIMES).q == pytest.approx(one.motion(TIMES).q, abs=1e-10)
    first, second = (each.trajectory(TIMES) for each in (one, other))
    assert second.kinetic_energy == pytest.approx(first.kinetic_energy, rel=1e-9)


def test_between_two_bodies_it_couples_their_angles() -> None:
    q, u = np.array([0.3, -1.1]), np.array([2.0, -3.0])
    plain, with_rotor = chain(), chain(force_elements=(rotor("lower", "upper"),))
    added = ROTOR * np.array([[1.0, -1.0], [-1.0, 1.0]])
    masses = [Equations(each).mass_matrix(q) for each in (plain, with_rotor)]
    assert masses[1] - masses[0] == pytest.approx(added, abs=1e-14)
    energies = [Kinematics(each).kinetic_energy(q, u) for each in (plain, with_rotor)]
    assert energies[1] - energies[0] == pytest.approx(ROTOR * 5.0**2 / 2, rel=1e-13)
    states = np.stack([q, q + 1.0])
    assert Kinematics(with_rotor).kinetic_energy(states, np.stack([u, u])).shape == (2,)


def test_a_rotor_of_great_inertia_holds_the_angle() -> None:
    """As its inertia grows the two bodies turn as one: the angle between them falls as 1/J."""
    turned: list[float] = []
    for inertia in (1e3, 1e4):
        rotors = (rotor("lower", "upper", inertia),)
        mechanism = chain(force_elements=rotors, start_speeds=(1.0, 1.0))
        motion = solve(tb.Problem(mechanism, duration=0.5)).motion(np.array([0.0, 0.5]))
        turned.append(float(np.diff(motion.q @ [-1.0, 1.0])[0]))
    assert abs(turned[0]) < 1e-2
    assert turned[0] / turned[1] == pytest.approx(10.0, rel=0.02)


def test_formulations_agree_and_energy_is_kept() -> None:
    spring = tb.RotationalSpringDamper(
        name="spring", body="lower", relative_to="upper", stiffness=2.0
    )
    problem = tb.Problem(geared(spring), duration=1.5)
    solution = solve(problem)
    trajectory = solution.trajectory(TIMES)
    total = trajectory.kinetic_energy + trajectory.potential_energy
    assert total == pytest.approx(total[0], rel=1e-11)
    taylor = solve_taylor(problem).trajectory(TIMES)
    assert taylor.q == pytest.approx(trajectory.q, abs=1e-10)
    redundant = RedundantSystem(problem.mechanism)
    equations, q, u = Equations(problem.mechanism), trajectory.q[7], trajectory.u[7]
    a, _ = equations.solve(q, u, ())
    angles = redundant.rates(redundant.start, ())[redundant.n :][2::3]
    start = Equations(problem.mechanism).solve(trajectory.q[0], trajectory.u[0], ())[0]
    assert angles == pytest.approx(start, rel=1e-9)
    assert np.isfinite(a).all()
    assert redundant.energy(redundant.start) == pytest.approx(total[0], rel=1e-12)


def test_its_motion_is_proved() -> None:
    problem = tb.Problem(geared(), duration=0.5)
    proof = tb.prove(problem, digits=15, until=0.5)
    motion = solve(problem).motion(np.array([0.5]))
    values = [float(each.value) for each in proof.q(0.5).values()]
    assert motion.q[0] == pytest.approx(values, abs=1e-11)
    kinetic, _ = proof.energy(0.5)
    trajectory = solve(problem).trajectory(np.array([0.5]))
    assert trajectory.kinetic_energy[0] == pytest.approx(float(kinetic.value), rel=1e-10)


def test_sensitivity_to_its_inertia_is_a_difference_quotient() -> None:
    step, number = 1e-4, "inertia of rotor of lower"

    def machine(inertia: float) -> tb.Mechanism:
        return chain(force_elements=(rotor("lower", "upper", inertia),))

    def end(inertia: float) -> Any:
        solution = solve(tb.Problem(machine(inertia), duration=0.5))
        return solution.motion(np.array([0.5])).q[0]

    table = tb.sensitivities(machine(ROTOR), duration=0.5, numbers=[number])
    found = [table.derivative("coordinate", name, number) for name in ("a", "b")]
    quotient = (end(ROTOR + step) - end(ROTOR - step)) / (2 * step)
    # The quotient's own error: h^2 of its third derivative, and 1e-12 of the motion over h.
    assert found == pytest.approx(quotient, rel=1e-5, abs=1e-7)
    assert np.abs(quotient).min() > 1e-2


def test_mujoco_has_it_as_a_hinges_armature() -> None:
    assert 'armature="0.21"' in mjcf(geared(), 1e-3)
    assert check_model(tb.engine("mujoco"), geared()).holds


def test_a_rotor_over_several_hinges_is_refused_by_name() -> None:
    over_two = chain(force_elements=(rotor("lower"),))
    with pytest.raises(tb.UnsupportedProblemError, match="rotor of lower"):
        mjcf(over_two, 1e-3)


@pytest.mark.parametrize("preset", ["default", "settings", "assisted"])
@pytest.mark.parametrize(
    "mechanism",
    [geared(), chain(force_elements=(rotor("lower"),), start_speeds=(0.5, -2.0))],
    ids=["geared", "over two hinges"],
)
def test_exudyn_adds_it_to_the_equations_of_its_nodes(mechanism: tb.Mechanism, preset: str) -> None:
    problem = tb.Problem(mechanism, duration=1.0)

    def errors(step: float) -> list[float]:
        engine = tb.engine("exudyn", preset, timestep=step)
        assert check_model(engine, mechanism).holds
        run = engine.simulate(problem)
        exact = solve(problem).trajectory(run.t)
        forces = (
            np.abs(run.joint_reactions[joint] - force).max()
            for joint, force in exact.joint_reactions.items()
        )
        energy = np.abs(run.kinetic_energy - exact.kinetic_energy).max()
        return [float(np.abs(run.q - exact.q).max()), float(energy), max(map(float, forces))]

    # All rules are of second order; by itself Exudyn keeps an alternating error in its forces.
    compared = 3 if preset == "assisted" else 2
    for coarse, fine in zip(*(errors(step)[:compared] for step in (2e-3, 1e-3)), strict=True):
        assert coarse / fine == pytest.approx(4, rel=0.2)


def test_exudyn_s_program_has_it() -> None:
    engine, problem = tb.engine("exudyn", "settings"), tb.Problem(geared(), duration=0.1)
    names: dict[str, Any] = {}
    exec(engine.script(problem), names)
    assert np.abs(names["q"] - engine.simulate(problem).q).max() < 1e-13


@pytest.mark.parametrize("preset", ["default", "settings", "assisted"])
@pytest.mark.parametrize("inertias", [(0.1, 0.2), (0.0, 0.0)], ids=["bodies", "point masses"])
def test_pymunk_has_it_as_moment_of_a_body(preset: str, inertias: tuple[float, float]) -> None:
    rotors = rotor("upper"), rotor("lower", inertia=0.21)
    mechanism = chain(inertias=inertias, force_elements=rotors, start_speeds=(0.5, -2.0))
    assert check_model(tb.engine("pymunk", preset), mechanism).holds
    order = 2 if preset == "assisted" else 1
    problem = tb.Problem(mechanism, duration=0.5)
    coarse, fine = errors_at((1e-3, 5e-4), "pymunk", preset, problem)
    compared = coarse if preset == "assisted" else ("q", "kinetic energy")
    for name in compared:
        assert coarse[name] / fine[name] == pytest.approx(2**order, rel=0.15), name


def test_pymunk_s_stops_feel_it() -> None:
    """A rotor on the ground is inertia of its body: in impacts, torques and releases, too."""
    stop = tb.Stop(name="stop", body="rod", sense=-1, limit=-1.2, closed=False, restitution=0.5)
    light = rod_pendulum(stop)
    (rod,) = light.bodies
    heavy = rod.model_copy(update={"inertia": rod.inertia + ROTOR})
    with_rotor = light.model_copy(update={"force_elements": (rotor("rod"),)})
    law: dict[str, Any] = {"duration": 2.5, "stop_law": tb.StopLaw.UNILATERAL}
    found, expected = (
        tb.engine("pymunk").simulate(tb.Problem(each, **law))
        for each in (with_rotor, light.model_copy(update={"bodies": (heavy,)}))
    )
    assert len(expected.impacts) > 2
    assert found.q == pytest.approx(expected.q, abs=1e-12)
    assert found.stop_torques["stop"] == pytest.approx(expected.stop_torques["stop"], abs=1e-9)
    for (time, impulses), (there, others) in zip(found.impacts, expected.impacts, strict=True):
        assert time == pytest.approx(there, abs=1e-12)
        assert impulses["stop"] == pytest.approx(others["stop"], rel=1e-9)


@pytest.mark.parametrize("preset", ["settings", "assisted"])
def test_pymunk_refuses_it_between_two_bodies_that_turn(preset: str) -> None:
    with pytest.raises(tb.UnsupportedProblemError, match="'rotor of lower' turns with the angle"):
        tb.engine("pymunk", preset).simulate(tb.Problem(geared(), duration=0.1))


def test_a_negative_inertia_is_refused() -> None:
    with pytest.raises(tb.InputError, match="inertia = -1"):
        rotor("upper", inertia=-1.0)
