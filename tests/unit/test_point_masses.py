"""Mass moved along pins leaves all motions as they are, and gives every body an inertia."""

from __future__ import annotations

import numpy as np
import pytest
from mechanisms import hanging_bob
from trebucheck.comparisons.campaigns.random_mechanisms import random_mechanism
from trebucheck.engines.point_masses import NoPointMasses, spread_masses, spreads_masses
from trebucheck.models.elements import GROUND, FreeJoint, PinJoint
from trebucheck.models.errors import UnsupportedProblemError
from trebucheck.models.kinematics import Kinematics, initial_state
from trebucheck.models.library.trebuchet import fixed, rolling
from trebucheck.models.mechanism import Body, Marker, Mechanism
from trebucheck.models.problem import Problem
from trebucheck.reference.equations import Equations
from trebucheck.reference.solver import solve

LEAST = 1e-2


def _pin(parent: str, child: str, at: tuple[float, float]) -> PinJoint:
    return PinJoint(
        name=f"{parent} {child}",
        parent=parent,
        child=child,
        parent_point=at,
        child_point=(0.0, 0.0),
    )


def _pendulums(first: float, second: float) -> Mechanism:
    """Two point masses on rods, hanging from a point that is not the origin."""
    bodies = (
        Body(name="upper", angle="a", mass=first, centre=(1.0, 0.0), inertia=0.0),
        Body(name="lower", angle="b", mass=second, centre=(0.7, 0.1), inertia=0.0),
    )
    joints = (_pin(GROUND, "upper", (0.4, 0.3)), _pin("upper", "lower", (0.8, 0.0)))
    marker = Marker(name="tip", body="lower", point=(0.7, 0.0))
    return Mechanism(
        name="pendulums",
        bodies=bodies,
        joints=joints,
        markers=(marker,),
        gravity=9.81,
        start=(0.3, 0.9),
    )


def _some(seed: int) -> Mechanism:
    """A random mechanism; every other body that hangs on a pin is a point mass."""
    drawn = random_mechanism(seed, stops=False)
    pinned = {joint.child for joint in drawn.joints if isinstance(joint, PinJoint)}
    light = [body.name for body in drawn.bodies if body.name in pinned][::2]
    bodies = [
        b.model_copy(update={"inertia": 0.0 if b.name in light else b.inertia})
        for b in drawn.bodies
    ]
    return drawn.model_copy(update={"bodies": tuple(bodies)})


MECHANISMS = [
    fixed(),
    rolling(),
    _pendulums(2.0, 1.0),
    _pendulums(1.0, 500.0),
    *map(_some, range(16)),
]


@pytest.mark.parametrize("mechanism", MECHANISMS)
def test_accelerations_are_the_same(mechanism: Mechanism) -> None:
    """On closed loops, at the start."""
    spread, (q, u) = NoPointMasses(mechanism, LEAST), initial_state(mechanism)
    closed = [stop.name for stop in mechanism.stops if stop.closed]
    own, other = (Equations(each).solve(q, u, closed)[0] for each in (mechanism, spread.mechanism))
    assert np.abs(other - own).max() < 1e-10 * np.abs(own).max()
    assert all(body.inertia > 0.0 for body in spread.mechanism.bodies)


@pytest.mark.parametrize("mechanism", MECHANISMS)
def test_the_equations_of_motion_are_the_same(mechanism: Mechanism) -> None:
    spread = NoPointMasses(mechanism, LEAST)
    if not spread.moved.keys() <= {joint.name for joint in mechanism.tree_joints}:
        pytest.skip("mass was moved along a pin that closes a loop: the same on closed loops alone")
    own, other, n = Equations(mechanism), Equations(spread.mechanism), len(mechanism.coordinates)
    for q, u in np.random.default_rng(5).normal(size=(3, 2, n)):
        mass, forces = own.mass_matrix(q), own.forces(q, u)
        assert np.abs(other.mass_matrix(q) - mass).max() < 1e-13 * np.abs(mass).max()
        assert np.abs(other.forces(q, u) - forces).max() < 1e-12 * (
            np.abs(forces).max() + np.abs(mass).max()
        )
        more = other.potential_energy(q) - own.potential_energy(q)
        assert more == pytest.approx(spread.extra_potential_energy, abs=1e-11 * np.abs(mass).max())


def test_inertias_are_made_up_for() -> None:
    bodies = {body.name: body for body in NoPointMasses(fixed(), LEAST).mechanism.bodies}
    for name in ("sling", "hanger"):
        arm = np.hypot(*bodies[name].centre)  # their pins are at the origins of their frames
        old = fixed().body(name)
        assert bodies[name].inertia == pytest.approx(
            LEAST * old.mass * np.hypot(*old.centre) ** 2, rel=1e-12
        )
        assert bodies[name].mass > old.mass and arm < np.hypot(*old.centre)


def test_a_light_parent_keeps_half_of_what_it_has() -> None:
    mechanism = _pendulums(1.0, 500.0)
    upper, lower = NoPointMasses(mechanism, LEAST).mechanism.bodies
    assert upper.mass > 0.5 and 0.0 < lower.inertia < LEAST * 500.0 * 0.5
    assert upper.inertia == pytest.approx(0.5 * LEAST, rel=1e-2)


def test_a_body_without_a_pin_is_given_the_least_inertia() -> None:
    held = _pendulums(1.0, 1.0).model_copy(
        update={"joints": (_pin(GROUND, "upper", (0, 0)), _pin("upper", "lower", (0.8, 0)))}
    )
    centred = held.bodies[1].model_copy(
        update={"centre": (0.0, 0.0)}
    )  # on its pin: no mass there brings inertia
    spread = NoPointMasses(held.model_copy(update={"bodies": (held.bodies[0], centred)}), LEAST)
    assert spread.mechanism.bodies[1].inertia == 1e-5 and set(spread.moved) == {"ground upper"}


def test_a_pin_whose_parent_has_nothing_to_lend_is_passed_over() -> None:
    """The upper mass is on its pin, so that it has no inertia but what it is given in the end."""
    drawn = _pendulums(1.0, 1.0)
    upper = drawn.bodies[0].model_copy(update={"centre": (0.0, 0.0)})
    lower = drawn.bodies[1]
    tip = PinJoint(
        name="tip", parent=GROUND, child="lower", parent_point=(1.2, 0.0), child_point=(0.1, 0.0)
    )
    held = drawn.model_copy(update={"bodies": (upper, lower), "joints": (*drawn.joints, tip)})
    spread = NoPointMasses(held, LEAST)
    assert set(spread.moved) == {"tip"}
    found, arm2 = spread.mechanism.bodies[1], 0.6**2 + 0.1**2
    lent = found.mass - 1.0
    assert found.inertia == pytest.approx(1.0 * lent / (1.0 + lent) * arm2)
    assert found.inertia == pytest.approx(LEAST * 1.0 * arm2, rel=0.03)


def test_reactions_are_found_again() -> None:
    mechanism = _pendulums(2.0, 1.0)
    spread, t = NoPointMasses(mechanism, LEAST), np.linspace(0.0, 0.4, 5)
    right, other = (
        solve(Problem(each, duration=0.4)).trajectory(t) for each in (mechanism, spread.mechanism)
    )
    equations, k = Equations(mechanism), Kinematics(mechanism)
    for joint in mechanism.joints:
        point = k.point(joint.child, joint.child_point)
        for i, (q, u) in enumerate(zip(right.q, right.u, strict=True)):
            acceleration = k.acceleration(point, q, u, equations.solve(q, u, ())[0])
            found = spread.reaction(joint.name, other.joint_reactions[joint.name][i], acceleration)
            truth = right.joint_reactions[joint.name]
            assert np.abs(found - truth[i]).max() < 1e-8 * np.abs(truth).max()
    moved = [
        name
        for name in spread.moved
        if np.abs(other.joint_reactions[name] - right.joint_reactions[name]).max() > 1e-4
    ]
    assert moved


@pytest.mark.parametrize(
    ("inertia", "point", "own", "mass"),
    [
        (0.0, (2.0, 0.0), None, 3.0),  # the point mass itself
        (0.0, (1.0, 0.0), None, None),  # on the rod that holds it
        (0.5, (2.0, 0.0), None, None),  # the centre of a body that is more than its point
        (0.5, (1.0, 0.0), None, None),
        (0.0, (2.0, 0.0), 1.2, 1.2),
        (0.5, (1.0, 0.0), 1.2, 1.2),
    ],
)
def test_what_is_thrown_at_a_marker(
    inertia: float, point: tuple[float, float], own: float | None, mass: float | None
) -> None:
    body = Body(name="bob", angle="beta", mass=3.0, centre=(2.0, 0), inertia=inertia)
    thrown = Marker(name="thrown", body="bob", point=point, mass=own)
    peg = Marker(name="peg", body="ground", point=(0.0, 0.0))
    mechanism = hanging_bob(bodies=(body,), markers=(thrown, peg))
    assert mechanism.thrown_mass(thrown) == mass
    assert mechanism.thrown_mass(peg) is None


def test_bodies_with_any_inertia_are_as_they_are_without_a_least_one() -> None:
    given = fixed()
    made = spread_masses(given, None, "an engine")
    lenders = {joint.parent for joint in given.joints if joint.name in made.moved}
    assert made.moved
    for body, before in zip(made.mechanism.bodies, given.bodies, strict=True):
        assert body.inertia > 0
        assert body == before or before.inertia == 0 or body.name in lenders


def test_point_masses_without_a_pin_are_refused_without_a_least_inertia() -> None:
    body = Body(name="bob", angle="q", mass=1.0, centre=(0.0, 0.0), inertia=0.0)
    free = Mechanism(
        name="free",
        bodies=(body,),
        joints=(FreeJoint(name="air", child="bob", coordinates=("x", "y")),),
        stops=(),
        gravity=9.81,
        start=(0.0, 0.0, 0.0),
    )
    with pytest.raises(UnsupportedProblemError, match="'bob' has no pin"):
        spread_masses(free, None, "an engine")


def test_only_mechanisms_with_little_inertia_can_be_changed() -> None:
    assert spreads_masses(fixed())
    heavy = tuple(body.model_copy(update={"inertia": 1e6}) for body in fixed().bodies)
    assert not spreads_masses(fixed().model_copy(update={"bodies": heavy}))
