"""Joints, walls and force elements of every kind.

The equations against Lagrange's own, by differences of energies.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from mechanisms import body_of, everything
from numpy.typing import NDArray
from trebucheck.models.applied_forces import AppliedForces
from trebucheck.models.features import Basic, Feature, features_of, refuse_features
from trebucheck.models.kinematics import Kinematics, initial_state
from trebucheck.reference.equations import Equations
from trebucheck.reference.solver import solve

Array = NDArray[np.float64]
# Of central differences of fourth order: errors of some (1e-4)^4 and 1e-16 / 1e-4, relative
_STEP = 1e-4


def _slope(function: Callable[[Array], Any], x: Array) -> Array:
    """Derivatives by central differences of fourth order, the component of x first."""
    return np.array([_difference(function, x, e) for e in _STEP * np.eye(len(x))])


def _difference(function: Callable[[Array], Any], x: Array, e: Array) -> Any:
    near, far = function(x + e) - function(x - e), function(x + 2 * e) - function(x - 2 * e)
    return (8 * near - far) / (12 * _STEP)


def _state(mechanism: tb.Mechanism, seed: int) -> tuple[Array, Array]:
    random, (q, u) = np.random.default_rng(seed), initial_state(mechanism)
    return q + 0.5 * random.uniform(-1, 1, len(q)), u + random.uniform(-1, 1, len(u))


_SEEDS = pytest.mark.parametrize("seed", range(3))


@_SEEDS
def test_mass_matrix_and_bias_are_lagranges(seed: int) -> None:
    mechanism = everything()
    equations, kinematics = Equations(mechanism), Kinematics(mechanism)
    q, u = _state(mechanism, seed)

    def momenta(v: Array) -> Array:
        return _slope(lambda w: float(kinematics.kinetic_energy(q, w)), v)

    assert equations.mass_matrix(q) == pytest.approx(_slope(momenta, u), abs=1e-6)
    # d/dt (dT/du) = M a + (d(dT/du)/dq) u
    changing = _slope(lambda p: equations.mass_matrix(p) @ u, q).T @ u
    assert equations.bias(q, u) == pytest.approx(
        changing - _slope(lambda p: float(kinematics.kinetic_energy(p, u)), q), abs=1e-8
    )


@_SEEDS
def test_forces_are_those_of_their_energies_and_powers(seed: int) -> None:
    mechanism = everything()
    equations, applied = Equations(mechanism), AppliedForces(Kinematics(mechanism))
    q, u = _state(mechanism, seed)
    conservative = -_slope(lambda p: float(equations.potential_energy(p)), q)
    at_rest = equations.gravity_forces(q) + applied.generalized(q, 0 * u)
    # Of constant forces and torques: their power per speed, without that of the dampers, which is
    # even in it.
    constant = np.array([(applied.power(q, e) - applied.power(q, -e)) / 2 for e in np.eye(len(u))])
    assert at_rest == pytest.approx(conservative + constant, abs=1e-8)
    damping = applied.generalized(q, u) - applied.generalized(q, 0 * u)
    assert u @ damping == pytest.approx((applied.power(q, u) + applied.power(q, -u)) / 2, abs=1e-10)


@_SEEDS
def test_walls_and_points_move_as_their_derivatives_say(seed: int) -> None:
    mechanism = everything()
    kinematics, row = Kinematics(mechanism), Kinematics(mechanism).point("bob", (0.3, 0.1))
    q, u = _state(mechanism, seed)

    def along(function: Callable[[Array], Any]) -> Any:
        """Time derivative at constant speeds u."""
        return _slope(lambda t: function(q + u * t[0]), np.zeros(1))[0]

    gap_speed, velocity = kinematics.gap_jacobian("deck", q) @ u, kinematics.velocity(row, q, u)
    assert along(lambda p: kinematics.gap("deck", p)) == pytest.approx(gap_speed, abs=1e-9)
    assert along(lambda p: kinematics.position(row, p)) == pytest.approx(velocity, abs=1e-9)
    gap_bias, acceleration = (
        kinematics.gap_bias("deck", q, u),
        kinematics.acceleration(row, q, u, 0 * u),
    )
    assert along(lambda p: kinematics.gap_jacobian("deck", p) @ u) == pytest.approx(
        gap_bias, abs=1e-8
    )
    assert along(lambda p: kinematics.velocity(row, p, u)) == pytest.approx(acceleration, abs=1e-8)


def test_energy_changes_by_the_work_of_dampers_and_motors() -> None:
    solution = solve(tb.Problem(everything(), duration=1.0))
    nodes, weights = np.polynomial.legendre.leggauss(400)
    t = (nodes + 1) / 2
    motion, applied = solution.motion(t), AppliedForces(solution.equations.kinematics)
    work = float(weights @ applied.power(motion.q, motion.u)) / 2
    ends = solution.trajectory(np.array([0.0, 1.0]))
    energy = ends.kinetic_energy + ends.potential_energy
    assert float(energy[1] - energy[0]) == pytest.approx(work, abs=1e-10)


def test_reactions_balance_what_the_whole_moves() -> None:
    """Nothing holds the hull.

    Its free joint has no reaction, and the momentum changes by weight and pull alone.
    """
    solution = solve(tb.Problem(everything(), duration=0.5))
    trajectory = solution.trajectory(np.linspace(0, 0.5, 7))
    assert set(trajectory.joint_reactions) == {"slot", "rail", "weld", "pin"}
    momentum = solution.equations.kinematics.momentum(trajectory.q, trajectory.u)
    mass = sum(body.mass for body in everything().bodies)
    expected = momentum[0] + np.outer(
        trajectory.t, mass * np.array(everything().gravity_vector) + np.array([2.0, -1.0])
    )
    assert momentum == pytest.approx(expected, abs=1e-10)


def test_loop_of_a_slot_in_a_turningbody_of() -> None:
    """A crank's pin in the slot of a rocker (quick return).

    The closed form of the rocker's angle.
    """
    crank, distance = 0.3, 1.0
    mechanism = tb.Mechanism(
        name="quick return",
        bodies=(
            body_of("crank", "a", 1.0, (0.15, 0.0), 0.01),
            body_of("rocker", "b", 2.0, (0.6, 0.0), 0.2),
        ),
        joints=(
            tb.PinJoint(
                name="O",
                parent="ground",
                child="crank",
                parent_point=(distance, 0),
                child_point=(0, 0),
            ),
            tb.PinJoint(
                name="C", parent="ground", child="rocker", parent_point=(0, 0), child_point=(0, 0)
            ),
            tb.SlotJoint(
                name="slot",
                parent="rocker",
                child="crank",
                parent_point=(0, 0),
                child_point=(crank, 0),
                axis=(1, 0),
            ),
        ),
        gravity=0.0,
        start=(0.0, 0.0),
        start_speeds=(5.0, 5.0 * crank / (distance + crank)),
    )
    solution = solve(tb.Problem(mechanism, duration=3.0))
    a, b = solution.motion(np.linspace(0, 3, 50)).q.T
    assert np.unwrap(np.arctan2(crank * np.sin(a), distance + crank * np.cos(a))) == pytest.approx(
        b, abs=1e-10
    )
    kinetic = solution.trajectory(np.array([0.0, 3.0])).kinetic_energy
    assert kinetic[1] == pytest.approx(kinetic[0], rel=1e-11)


def test_sprung_and_damped_oscillator() -> None:
    """A slider on a spring and damper against x = e^{-ct/2m}(A cos wt + B sin wt)."""
    m, k, c, x0 = 2.0, 50.0, 1.2, 0.3
    mechanism = tb.Mechanism(
        name="oscillator",
        bodies=(body_of("block", None, m, (0, 0), 0.0),),
        joints=(
            tb.PrismaticJoint(
                name="rail",
                parent="ground",
                child="block",
                parent_point=(0, 0),
                child_point=(0, 0),
                axis=(1, 0),
                coordinate="x",
            ),
        ),
        force_elements=(
            tb.SpringDamper(
                name="spring",
                body="block",
                point=(0, 0),
                relative_point=(-1.0, 0),
                stiffness=k,
                damping=c,
                rest_length=1.0,
            ),
        ),
        gravity=9.81,
        start=(x0,),
    )
    t = np.linspace(0, 5, 40)
    decay = c / (2 * m)
    w = math.sqrt(k / m - decay**2)
    expected = x0 * np.exp(-decay * t) * (np.cos(w * t) + decay / w * np.sin(w * t))
    assert solve(tb.Problem(mechanism, duration=5.0)).motion(t).q[:, 0] == pytest.approx(
        expected, abs=1e-12
    )


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda d: d["bodies"][2].update(angle="phi"), "needs no angle of its own"),
        (lambda d: d["bodies"][1].update(angle=None), "needs a name for its angle"),
        (lambda d: d["joints"][1].pop("coordinate"), "needs a coordinate for its slide"),
        (
            lambda d: d["joints"][0].update(parent="arm"),
            "a free joint has the ground as its parent",
        ),
        (lambda d: d["force_elements"][0].update(stiffness=-1.0), "greater than or equal to 0"),
        (lambda d: d["force_elements"][0].update(body="boat"), "names the body 'boat'"),
        (lambda d: d["force_elements"][1].update(relative_to="bob"), "between 'bob' and itself"),
        (lambda d: d.update(gravity_direction=[0.0, -2.0]), "gravity_direction must have length 1"),
    ],
)
def test_wrong_elements_are_refused_with_their_name(
    change: Callable[[dict[str, Any]], Any], says: str
) -> None:
    fields = everything().model_dump(mode="json")
    change(fields)
    with pytest.raises(tb.InputError, match=says):
        tb.Mechanism(**fields)


def test_an_engine_without_an_element_names_it() -> None:
    # Elements that not every engine builds have mechanisms of their own.
    later = {
        Feature.COUPLER,
        Feature.CUBIC_SPRING,
        Feature.RECORDED_FORCE,
        Feature.RECORDED_TORQUE,
        Feature.ROTOR_INERTIA,
        Feature.SLIDE_INERTIA,
        Feature.SLIDE_SPRING,
        Feature.TRANSLATION,
    }
    assert set(features_of(everything())) == set(Feature) - later
    with pytest.raises(tb.UnsupportedProblemError, match=r"slots in moving bodies \('slot'\)"):
        refuse_features(everything(), set(Feature) - {Feature.MOVING_SLOT}, "an engine")
    refuse_features(everything(), set(Feature), "an engine")


def test_a_restitution_is_needed_under_the_unilateral_law_only() -> None:
    bouncing = tb.model("bouncing")
    refuse_features(bouncing, set(Feature), "an engine", {Basic.REBOUND}, tb.StopLaw.RELEASE_ONCE)
    with pytest.raises(
        tb.UnsupportedProblemError, match=r"no stops with a restitution \('floor'\)"
    ):
        refuse_features(bouncing, set(Feature), "an engine", {Basic.REBOUND}, tb.StopLaw.UNILATERAL)
