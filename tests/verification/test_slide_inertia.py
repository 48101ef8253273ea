"""Inertias along slides: in closed form, and all formulations against each other."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from mechanisms import pin
from trebucheck.comparisons.diagnosis.equivalence import check_model
from trebucheck.models.mjcf.writer import mjcf
from trebucheck.reference.certification.redundant import RedundantSystem
from trebucheck.reference.equations import Equations
from trebucheck.reference.solver import solve
from trebucheck.reference.taylor.solve import solve_taylor

MASS, DRIVE = 2.5, 1.7  # kg
TIMES = np.linspace(0.0, 1.0, 21)


def drive(
    coordinate: str = "s", body: str = "cart", relative_to: str = "ground", inertia: float = DRIVE
) -> tb.SlideInertia:
    """A drive along a slide."""
    return tb.SlideInertia(
        name=f"drive of {coordinate}", body=body, relative_to=relative_to,
        coordinate=coordinate, inertia=inertia,
    )  # fmt: skip


def cart(**changes: Any) -> tb.Mechanism:
    """A cart on a slide that goes downhill, at rest."""
    fields: dict[str, Any] = {
        "name": "cart",
        "bodies": (tb.Body(name="cart", mass=MASS, centre=(0.1, 0.2), inertia=0.1),),
        "joints": (
            tb.PrismaticJoint(
                name="rail", child="cart", parent_point=(0.2, 0.5), child_point=(0, 0),
                axis=(0.8, -0.6), coordinate="s",
            ),
        ),
        "force_elements": (drive(),),
        "gravity": 9.81,
        "start": (0.1,),
    }  # fmt: skip
    return tb.Mechanism(**(fields | changes))


def bead_on_an_arm(*elements: Any, **changes: Any) -> tb.Mechanism:
    """An arm that swings, a bead with a drive that slides on it obliquely, and a rod on the bead.

    The rod slides, too, with a drive: its line turns with the bead.
    """
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
            tb.SlotJoint(
                name="slot", parent="bead", child="rod", parent_point=(0.1, 0),
                child_point=(0.02, 0.03), axis=(0.6, -0.8), coordinate="r",
            ),
        ),
        "force_elements": (
            drive("s", "bead", "arm"),
            drive("r", "rod", "bead", 0.4),
            tb.SlideSpringDamper(
                name="spring", body="rod", relative_to="bead", coordinate="r", stiffness=50.0
            ),
            *elements,
        ),
        "markers": (tb.Marker(name="tip", body="rod", point=(0.6, 0.0)),),
        "gravity": 9.81,
        "start": (0.4, 1.0, 0.15, 0.05),
        "start_speeds": (1.0, -2.0, 0.5, -0.3),
    }  # fmt: skip
    return tb.Mechanism(**(fields | changes))


def test_it_slows_a_cart_and_weighs_nothing() -> None:
    trajectory = solve(tb.Problem(cart(), duration=1.0)).trajectory(TIMES)
    downhill = MASS * 9.81 * 0.6 / (MASS + DRIVE)
    assert trajectory.q[:, 0] == pytest.approx(0.1 + downhill * TIMES**2 / 2, abs=1e-12)
    # Across the slide the joint carries the weight's part, and along it nothing.
    across = MASS * 9.81 * 0.8 * np.array([0.6, 0.8])
    expected = np.tile(across, (len(TIMES), 1))
    assert trajectory.joint_reactions["rail"] == pytest.approx(expected, abs=1e-11)


def test_a_drive_of_great_inertia_holds_the_slide() -> None:
    """As its inertia grows what slides keeps its speed: the change falls as 1/J."""
    changes: list[float] = []
    for inertia in (1e3, 1e4):
        heavy = cart(force_elements=(drive(inertia=inertia),), start_speeds=(0.5,))
        motion = solve(tb.Problem(heavy, duration=1.0)).motion(np.array([1.0]))
        changes.append(float(motion.u[0, 0]) - 0.5)
    assert changes[0] / changes[1] == pytest.approx(10.0, rel=0.02)


def test_formulations_agree_and_energy_is_kept() -> None:
    problem = tb.Problem(bead_on_an_arm(), duration=1.0)
    trajectory = solve(problem).trajectory(TIMES)
    total = trajectory.kinetic_energy + trajectory.potential_energy
    assert total == pytest.approx(total[0], rel=1e-11)
    assert solve_taylor(problem).trajectory(TIMES).q == pytest.approx(trajectory.q, abs=1e-10)
    redundant, equations = RedundantSystem(problem.mechanism), Equations(problem.mechanism)
    a, _ = equations.solve(trajectory.q[0], trajectory.u[0], ())
    spins = redundant.rates(redundant.start, ())[redundant.n :][2::3]
    assert spins == pytest.approx([a[0], a[0], a[1]], rel=1e-9)
    assert redundant.energy(redundant.start) == pytest.approx(total[0], rel=1e-12)
    for joint, force in redundant.reactions(redundant.start, ()).items():
        assert trajectory.joint_reactions[joint][0] == pytest.approx(force, rel=1e-9), joint


def test_its_motion_and_forces_are_proved() -> None:
    problem = tb.Problem(bead_on_an_arm(), duration=0.5)
    proof, solution = tb.prove(problem, digits=12, until=0.25), solve(problem)
    trajectory = solution.trajectory(np.array([0.25]))
    values = [float(each.value) for each in proof.q(0.25).values()]
    assert trajectory.q[0] == pytest.approx(values, abs=1e-11)
    for joint, force in trajectory.joint_reactions.items():
        found = [float(part.value) for part in proof.joint_reaction(joint, 0.25)]
        assert found == pytest.approx(force[0].tolist(), abs=1e-8)
    kinetic, _ = proof.energy(0.25)
    assert trajectory.kinetic_energy[0] == pytest.approx(float(kinetic.value), rel=1e-9)


def test_sensitivity_to_its_inertia_is_a_difference_quotient() -> None:
    step, number = 1e-4, "inertia of drive of s"

    def machine(inertia: float) -> tb.Mechanism:
        return bead_on_an_arm(force_elements=(drive("s", "bead", "arm", inertia),))

    def end(inertia: float) -> Any:
        solution = solve(tb.Problem(machine(inertia), duration=0.5))
        return solution.motion(np.array([0.5])).q[0]

    table = tb.sensitivities(machine(DRIVE), duration=0.5, numbers=[number])
    found = [table.derivative("coordinate", name, number) for name in ("a", "b", "s", "r")]
    quotient = (end(DRIVE + step) - end(DRIVE - step)) / (2 * step)
    # The quotient's own error: h^2 of its third derivative, and 1e-12 of the motion over h.
    assert found == pytest.approx(quotient, rel=1e-5, abs=1e-7)
    assert np.abs(quotient).max() > 1e-2


@pytest.mark.parametrize("mechanism", [cart(), bead_on_an_arm()], ids=lambda m: m.name)
def test_mujoco_has_it_as_a_slides_armature(mechanism: tb.Mechanism) -> None:
    assert 'armature="1.7' in mjcf(mechanism, 1e-3)
    assert check_model(tb.engine("mujoco"), mechanism).holds
    problem = tb.Problem(mechanism, duration=0.5)
    found = tb.engine("mujoco", "settings", timestep=2e-4).simulate(problem)
    exact = solve(problem).trajectory(found.t)
    # RK4 at 0.2 ms: h^4 of accelerations below 1e3.
    assert found.q == pytest.approx(exact.q, abs=1e-7)
    for joint, force in exact.joint_reactions.items():
        assert found.joint_reactions[joint] == pytest.approx(force, abs=1e-5), joint


@pytest.mark.parametrize("engine", ["pymunk", "exudyn"])
def test_engines_without_it_refuse_it_by_name(engine: str) -> None:
    with pytest.raises(tb.UnsupportedProblemError, match="drive of s"):
        tb.engine(engine).simulate(tb.Problem(cart(), duration=0.1))


def test_what_is_no_inertia_or_no_slide_is_refused() -> None:
    with pytest.raises(tb.InputError, match="inertia = -1"):
        drive(inertia=-1.0)
    with pytest.raises(tb.InputError, match="inertia = nan"):
        drive(inertia=math.nan)
    with pytest.raises(tb.InputError, match="'s' on 'ground'"):
        cart(force_elements=(drive("t"),))
