"""Springs along slides, and rotors of bodies: what programs of rigid bodies give any engine.

An engine has an environment of its own: where it is not installed, its cases are skipped.
"""

from __future__ import annotations

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.comparisons.diagnosis.equivalence import check_model
from trebucheck.reference.solver import solve

WITH_SLIDES = ("planck", "rapier", "jolt", "havok", "physx", "p2", "pyb2d3", "ovphysx")
WITHOUT = ("cannon", "matter")
TREES = ("drake", "dart", "pybullet")
"""In joint coordinates, where a rotor of a body is no part of its moment: without rotors."""
COMPILED = ("mjx", "mujoco_warp")
"""On MuJoCo's model, whose joints have rotors. Each run is compiled for some ten seconds."""
STEP = 1e-3  # [s] and half of it


def cart() -> tb.Mechanism:
    """A cart with spring, damper and motor on a slope, and a rod with a rotor that hangs on it."""
    return tb.Mechanism(
        name="cart",
        bodies=(
            tb.Body(name="cart", mass=2.5, centre=(0.1, 0.0), inertia=0.1),
            tb.Body(name="rod", angle="b", mass=1.0, centre=(0.1, -0.5), inertia=0.08),
        ),
        joints=(
            tb.PrismaticJoint(
                name="rail", child="cart", parent_point=(0.1, 0.2), child_point=(0.0, 0.0),
                axis=(0.8, 0.6), coordinate="s",
            ),
            pin("cart", "rod"),
        ),
        force_elements=(
            tb.SlideSpringDamper(
                name="spring", body="cart", relative_to="ground", coordinate="s", stiffness=40.0,
                damping=3.0, rest_position=0.3, force=7.0,
            ),
            rotor("rod", "cart"),
        ),
        markers=(tb.Marker(name="tip", body="rod", point=(0.0, -1.0)),),
        gravity=9.81,
        start=(0.4, 0.1),
    )  # fmt: skip


def bead() -> tb.Mechanism:
    """A block that a spring holds on a rod that swings."""
    return tb.Mechanism(
        name="bead",
        bodies=(
            tb.Body(name="rod", angle="b", mass=1.0, centre=(0.5, 0.1), inertia=0.08),
            tb.Body(name="block", mass=2.5, centre=(0.1, 0.0), inertia=0.1),
        ),
        joints=(
            pin("ground", "rod"),
            tb.PrismaticJoint(
                name="rail", parent="rod", child="block", parent_point=(0.1, 0.2),
                child_point=(0.0, 0.0), axis=(0.8, 0.6), coordinate="s",
            ),
        ),
        force_elements=(
            tb.SlideSpringDamper(
                name="spring", body="block", relative_to="rod", coordinate="s", stiffness=90.0,
                damping=3.0, rest_position=0.3, force=7.0,
            ),
        ),
        markers=(tb.Marker(name="tip", body="block", point=(0.3, 0.0)),),
        gravity=9.81,
        start=(0.4, 0.3),
    )  # fmt: skip


def pendulum(*rotors: tb.RotorInertia) -> tb.Mechanism:
    """Two rods, with rotors."""
    return tb.Mechanism(
        name="rods",
        bodies=(
            tb.Body(name="rod", angle="a", mass=1.0, centre=(0.5, 0.1), inertia=0.08),
            tb.Body(name="other", angle="b", mass=0.5, centre=(0.3, 0.0), inertia=0.05),
        ),
        joints=(pin("ground", "rod"), pin("rod", "other", at=(0.9, 0.0))),
        force_elements=rotors,
        markers=(tb.Marker(name="tip", body="other", point=(0.6, 0.0)),),
        gravity=9.81,
        start=(0.4, 0.9),
    )


def sprung() -> tb.Mechanism:
    """The cart without its rotor."""
    spring, _ = cart().force_elements
    return cart().model_copy(update={"name": "sprung cart", "force_elements": (spring,)})


def pin(parent: str, child: str, at: tuple[float, float] = (0.0, 0.0)) -> tb.PinJoint:
    """A pin at the child's origin."""
    points = {"parent_point": at, "child_point": (0.0, 0.0)}
    return tb.PinJoint(name=f"pin of {child}", parent=parent, child=child, **points)


def rotor(body: str, relative_to: str = "ground") -> tb.RotorInertia:
    """A rotor of the inertia of the rods."""
    return tb.RotorInertia(
        name=f"rotor of {body}", body=body, relative_to=relative_to, inertia=0.15
    )


TURNING = pendulum(rotor("rod"), rotor("other"))
GEARED = pendulum(rotor("rod"), rotor("other", "rod"))
CASES = [(name, made) for name in WITH_SLIDES for made in (cart(), bead(), TURNING)]
CASES += [(name, TURNING) for name in WITHOUT]
CASES += [(name, made) for name in TREES for made in (sprung(), bead())]
CASES += [(name, made) for name in COMPILED for made in (cart(), GEARED)]


def installed(name: str) -> str:
    """The name, if the plug-in is here."""
    if name not in tb.engines():
        pytest.skip(f"{name} is not installed here")
    return name


@pytest.mark.parametrize(
    ("name", "mechanism"), CASES, ids=lambda case: case if isinstance(case, str) else case.name
)
def test_they_are_built_and_followed(name: str, mechanism: tb.Mechanism) -> None:
    checked = check_model(tb.engine(installed(name)), mechanism)
    assert checked.exposed and checked.holds, checked
    # Assisted, the steps of trees are trebucheck's own.
    preset = "settings" if name in (*TREES, *COMPILED) else "assisted"
    problem = tb.Problem(mechanism, duration=0.4)
    truth, errors = solve(problem), list[float]()
    for step in (STEP, STEP / 2):
        found = tb.engine(name, preset, timestep=step).simulate(problem)
        errors.append(float(np.abs(found.q - truth.trajectory(found.t).q).max()))
    # Of first order, down to what single precision, or Havok's masses of eight bits, leave.
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.2) or errors[1] < 1e-3, errors
    without = problem.model_copy(
        update={"mechanism": mechanism.model_copy(update={"force_elements": ()})}
    )
    end, other = (each.motion(np.array([problem.duration])).q for each in (truth, solve(without)))
    assert errors[1] < 0.05 * np.abs(end - other).max()


@pytest.mark.parametrize("name", [*WITH_SLIDES, *WITHOUT])
def test_a_rotor_between_two_bodies_that_turn_is_refused(name: str) -> None:
    with pytest.raises(tb.UnsupportedProblemError, match="'rotor of other' turns with the angle"):
        tb.engine(installed(name)).simulate(tb.Problem(GEARED, duration=0.1))


@pytest.mark.parametrize("name", [*WITH_SLIDES, *TREES])
@pytest.mark.parametrize("preset", ["default", "settings"])
def test_a_program_has_the_same_motion(name: str, preset: str) -> None:
    engine, problem = tb.engine(installed(name), preset), tb.Problem(bead(), duration=0.2)
    program = engine.script(problem)  # type: ignore[attr-defined]
    npm, printed = getattr(type(engine), "npm", None), dict[str, object]()
    if npm is not None:
        printed = npm.run(program)
    else:
        exec(program, printed)
    assert np.array_equal(np.array(printed["q"]), engine.simulate(problem).q)
