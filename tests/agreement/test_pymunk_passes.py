"""Passes of pymunk's impulse solver.

What they leave of an error, and modes that grow because they leave too much.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
import trebucheck as tb

pytest.importorskip("pymunk")

from mechanisms import four_bar, parallel_cranks, pin
from trebucheck.comparisons.campaigns.random_mechanisms import random_mechanism
from trebucheck.comparisons.diagnosis.equivalence import check_model
from trebucheck.engines.pymunk.build import build
from trebucheck.engines.pymunk.leapfrog import _step_to  # pyright: ignore[reportPrivateUsage]
from trebucheck.engines.pymunk.passes import TRACKED, convergence, growth
from trebucheck.models.elements import GROUND, FreeJoint, PrismaticJoint, SlotJoint
from trebucheck.models.errors import SimulationError
from trebucheck.models.mechanism import Body, Mechanism
from trebucheck.models.problem import Problem
from trebucheck.models.spec import Vector

RADIUS, SPEED = 0.5, 3.0  # [m], [rad/s]


def sledge(slight: float) -> Mechanism:
    """One body in two guides of the ground that are so far from parallel [rad]."""
    body = Body(name="sledge", angle=None, mass=2.0, centre=(0.0, 0.0), inertia=0.1)
    joints = guides(GROUND, (0.0, 0.0), 0.0, slight)
    return Mechanism(name="sledge", bodies=(body,), joints=joints, gravity=0.0, start=(0.0,))


def turntable(slight: float) -> Mechanism:
    """A table that turns steadily, with a sledge in two guides so far from parallel [rad].

    Nothing moves it there.
    """
    bodies = (
        Body(name="table", angle="turn", mass=1.0, centre=(0.0, 0.0), inertia=0.2),
        Body(name="sledge", angle=None, mass=2.0, centre=(0.0, 0.0), inertia=0.1),
    )
    joints = (pin("axle", GROUND, "table"), *guides("table", (RADIUS, 0.0), math.pi / 2, slight))
    start = {"start": (0.0, 0.0), "start_speeds": (SPEED, 0.0)}
    return Mechanism(name="turntable", bodies=bodies, joints=joints, gravity=0.0, **start)


def guides(
    base: str, at: Vector, direction: float, slight: float
) -> tuple[PrismaticJoint, SlotJoint]:
    points = {"parent": base, "child": "sledge", "parent_point": at, "child_point": (0.0, 0.0)}
    axes = ((math.cos(angle), math.sin(angle)) for angle in (direction, direction + slight))
    return (
        PrismaticJoint(name="rail", **points, axis=next(axes), coordinate="x"),
        SlotJoint(name="guide", **points, axis=next(axes)),
    )


def test_passes_leave_what_the_matrices_say() -> None:
    """Chipmunk's own, from no impulses.

    Two guides leave cos^2 of their angle of an error in a pass.
    """
    slight = 0.1
    assembly = build(sledge(slight), (), 0.0, 1.0)
    found = convergence(assembly)
    assert found.one_pass.shape == (2, 2)
    for passes in (1, 10, 100):
        space = build(sledge(slight), (), 0.0, 1.0)
        push = np.array([[1.0, 0.0, 0.0]])
        _step_to(space, [(body.position, body.angle) for body in space.bodies], push, 1e-9, passes)
        left = float(np.linalg.norm(space.rates[0, :2]))
        assert left == pytest.approx(math.cos(slight) ** (2 * passes - 1), rel=1e-6)
        assert found.left_after(passes) == pytest.approx(left, rel=1e-6)


@pytest.mark.parametrize(
    "mechanism", [four_bar(), parallel_cranks(2)], ids=lambda mechanism: mechanism.name
)
def test_passes_change_each_speed_as_the_matrices_say(mechanism: Mechanism) -> None:
    """What no joint holds stays; of the rest, weighted by roots of masses, Q^n is left."""
    assembly = build(mechanism, (), 0.0, 1.0)
    found = convergence(assembly)
    weights = np.sqrt([[body.mass, body.mass, body.moment] for body in assembly.bodies]).ravel()
    places = [(body.position, body.angle) for body in assembly.bodies]
    push = np.random.default_rng(7).normal(size=(len(assembly.bodies), 3))
    before = push.ravel() * weights
    held = found.basis.T @ before
    for passes in (1, 4):
        again = build(mechanism.model_copy(update={"gravity": 0.0}), (), 0.0, 1.0)
        _step_to(again, places, push, 1e-7, passes)
        left = np.linalg.matrix_power(found.one_pass, passes) @ held
        expected = before + found.basis @ (left - held)
        assert again.rates.ravel() * weights == pytest.approx(expected, abs=1e-5)


def test_where_nothing_is_constrained_one_pass_leaves_nothing() -> None:
    body = Body(name="stone", angle="a", mass=2.0, centre=(0.0, 0.0), inertia=0.1)
    free = FreeJoint(
        name="none", parent=GROUND, child="stone", parent_point=(0, 0), child_point=(0, 0),
        coordinates=("x", "y"),
    )  # fmt: skip
    stone = Mechanism(name="stone", bodies=(body,), joints=(free,), gravity=9.81, start=(0, 0, 0))
    found = convergence(build(stone, (), 0.0, 1.0))
    assert found.left_after(1) == 0.0 and found.passes_to(1e-12) == 1


@pytest.mark.parametrize("share", [0.5, TRACKED, 1e-12])
def test_so_many_passes_leave_a_share(share: float) -> None:
    found = convergence(build(sledge(0.05), (), 0.0, 1.0))
    needed = found.passes_to(share)
    assert found.left_after(needed) <= share * (1 + 1e-9) < found.left_after(needed - 2)


def test_a_mode_grows_if_passes_leave_more_than_a_half_of_it() -> None:
    assert growth(0.0) == pytest.approx(0.0, abs=1e-4)  # a triple zero
    assert growth(0.49) < 1.0 < growth(0.51)
    g = 1e-6
    assert math.log(growth(1.0 - g)) == pytest.approx(g ** (1 / 3) / 2, rel=0.01)


@pytest.mark.parametrize("left", [1e-3, 0.2, 0.5, 0.9, 1.0 - 1e-6, 1.0, 1.0 + 1e-15])
def test_a_mode_grows_as_the_recurrence_of_position_speed_and_impulse_does(left: float) -> None:
    """The impulses of a step change by the share 1 - left of what they should."""
    step = np.zeros((3, 3))
    for k, (x, y, z) in enumerate(np.eye(3)):
        gap = x + y
        push = left * z - (1.0 - left) * (gap + y)
        step[:, k] = gap, y + push, push
    roots = np.abs(np.linalg.eigvals(step))
    assert growth(left) == pytest.approx(roots.max(), abs=1e-4)  # of a triple root at 1


def test_a_slow_mode_that_nothing_excites_does_not_grow() -> None:
    """200 passes leave 0.98 of it.

    Its rounding errors grew by 13 % in a step, to forces of 6700 N instead of 9 N.
    """
    problem = Problem(turntable(0.01), 0.5)
    found = convergence(build(problem.mechanism, (), 0.0, 1e4))
    assert growth(found.left_after(200)) ** 500 > 1e20
    run = tb.engine("pymunk", timestep=1e-3).simulate(problem)
    assert np.abs(run.q[:, 1]).max() < 1e-9
    centripetal = 2.0 * RADIUS * SPEED**2
    # Three digits of the largest force, as of its change in a step.
    for name, force in (("rail", centripetal), ("guide", 0.0)):
        assert np.linalg.norm(run.joint_reactions[name], axis=1) == pytest.approx(
            force, abs=TRACKED * centripetal
        )


def test_a_mode_that_grows_all_the_same_is_refused() -> None:
    """Of the guides' angle: 20 000 passes leave 0.95 of it.

    The sentence says so, and between which bodies.
    """
    sentence = (
        "on 'table' and 'sledge' are nearly parallel there, so that 20000 passes leave "
        "0.95 "
        "of "
        "an "
        "error"
    )
    with pytest.raises(SimulationError, match=sentence):
        tb.engine("pymunk", timestep=1e-3).simulate(Problem(turntable(0.001), 0.5))


def test_the_slowest_bodies_are_those_that_what_is_left_moves_most() -> None:
    """A swing beside the turntable is none of them, however heavy it is."""
    table = turntable(0.01)
    swing = Body(name="swing", angle="swing", mass=50.0, centre=(0.3, 0.1), inertia=9.0)
    both = table.model_copy(
        update={
            "bodies": (*table.bodies[:1], swing, *table.bodies[1:]),
            "joints": (table.joints[0], pin("hinge", GROUND, "swing"), *table.joints[1:]),
            "start": (0.0, 0.0, 0.0),
            "start_speeds": (SPEED, 0.0, 0.0),
        }
    )
    found = convergence(build(both, (), 0.0, 1e4))
    assert found.slowest(200) == ("table", "sledge")


def test_impulses_that_have_converged_are_settled() -> None:
    """In more passes than these need, roundings of what no constraint holds add up.

    1.2e-11 were refused.
    """
    assert check_model(tb.engine("pymunk"), random_mechanism(93)).holds
