"""Duffing's oscillator in closed form: a wheel on a torsion spring with a cubic term.

From rest at the amplitude A, I q'' = -(k q + k3 q^3) has the solution q = A cn(W t | m) with
W^2 = (k + k3 A^2) / I and m = k3 A^2 / (2 (k + k3 A^2)); its period is 4 K(m) / W.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
import trebucheck as tb
from scipy.special import ellipj, ellipk
from trebucheck.models.applied_forces import AppliedForces
from trebucheck.models.kinematics import Kinematics
from trebucheck.reference.solver import solve

INERTIA, STIFFNESS, CUBIC = 0.4, 3.0, 7.0


def wheel(amplitude: float, rest_angle: float = 0.0, **stiffness: float) -> tb.Mechanism:
    """A wheel about its centre of mass, at rest at an amplitude from the spring's rest angle."""
    stiffness = {"stiffness": STIFFNESS, "cubic_stiffness": CUBIC} | stiffness
    return tb.Mechanism(
        name="duffing",
        bodies=(tb.Body(name="wheel", angle="q", mass=2.0, centre=(0, 0), inertia=INERTIA),),
        joints=(
            tb.PinJoint(
                name="axle", parent="ground", child="wheel", parent_point=(0, 0), child_point=(0, 0)
            ),
        ),
        force_elements=(
            tb.CubicTorsionSpring(name="spring", body="wheel", rest_angle=rest_angle, **stiffness),
        ),
        gravity=9.81,
        start=(rest_angle + amplitude,),
    )


def frequency_and_parameter(amplitude: float) -> tuple[float, float]:
    """W [rad/s] and the parameter m of the elliptic functions."""
    total = STIFFNESS + CUBIC * amplitude**2
    return math.sqrt(total / INERTIA), CUBIC * amplitude**2 / (2 * total)


@pytest.mark.parametrize("amplitude", [0.05, 0.7, 2.5])
@pytest.mark.parametrize("rest_angle", [0.0, -0.4])
def test_motion_is_jacobis_cn(amplitude: float, rest_angle: float) -> None:
    rate, m = frequency_and_parameter(amplitude)
    period = 4 * float(ellipk(m)) / rate
    solution = solve(tb.Problem(wheel(amplitude, rest_angle), duration=2 * period))
    t = np.linspace(0.0, 2 * period, 101)
    sn, cn, dn, _ = ellipj(rate * t, m)
    motion = solution.motion(t)
    assert motion.q[:, 0] == pytest.approx(rest_angle + amplitude * cn, abs=3e-11)
    assert motion.u[:, 0] == pytest.approx(-amplitude * rate * sn * dn, abs=3e-10)


def test_after_a_period_it_is_back_and_after_half_of_one_on_the_other_side() -> None:
    rate, m = frequency_and_parameter(1.3)
    half = 2 * float(ellipk(m)) / rate
    motion = solve(tb.Problem(wheel(1.3), duration=2 * half)).motion(np.array([half, 2 * half]))
    assert motion.q[:, 0] == pytest.approx([-1.3, 1.3], abs=1e-11)
    assert motion.u[:, 0] == pytest.approx([0.0, 0.0], abs=1e-10)


def test_energy_is_that_of_the_spring_and_is_kept() -> None:
    amplitude = 1.3
    solution = solve(tb.Problem(wheel(amplitude), duration=3.0))
    motion = solution.motion(np.linspace(0.0, 3.0, 61))
    applied = AppliedForces(Kinematics(solution.problem.mechanism))
    stored = STIFFNESS * motion.q[:, 0] ** 2 / 2 + CUBIC * motion.q[:, 0] ** 4 / 4
    assert applied.potential_energy(motion.q) == pytest.approx(stored, rel=1e-14)
    assert applied.power(motion.q, motion.u) == pytest.approx(0.0, abs=0.0)
    start = STIFFNESS * amplitude**2 / 2 + CUBIC * amplitude**4 / 4
    assert INERTIA * motion.u[:, 0] ** 2 / 2 + stored == pytest.approx(start, rel=1e-11)


def test_without_its_cubic_term_it_is_the_linear_spring() -> None:
    linear = wheel(0.6, 0.2, cubic_stiffness=0.0)
    spring = tb.RotationalSpringDamper(
        name="spring", body="wheel", stiffness=STIFFNESS, rest_angle=0.2
    )
    other = linear.model_copy(update={"force_elements": (spring,)})
    t = np.linspace(0.0, 2.0, 21)
    both = [solve(tb.Problem(m, duration=2.0)).motion(t).q for m in (linear, other)]
    assert both[0] == pytest.approx(both[1], abs=1e-14)


def test_the_opposite_torque_is_on_the_other_body() -> None:
    mechanism = wheel(0.5)
    bodies = (
        *mechanism.bodies,
        tb.Body(name="rim", angle="r", mass=1.0, centre=(0, 0), inertia=0.3),
    )
    axle = mechanism.joints[0].model_copy(update={"name": "second axle", "child": "rim"})
    spring = mechanism.force_elements[0].model_copy(update={"relative_to": "rim"})
    both = tb.Mechanism(
        name="two wheels",
        bodies=bodies,
        joints=(*mechanism.joints, axle),
        force_elements=(spring,),
        gravity=9.81,
        start=(0.9, 0.2),
    )
    q, u = np.array([0.9, 0.2]), np.array([0.3, -1.1])
    torque = -(STIFFNESS * 0.7 + CUBIC * 0.7**3)
    assert AppliedForces(Kinematics(both)).generalized(q, u) == pytest.approx([torque, -torque])


def test_it_is_kept_in_json_and_told_by_the_hash() -> None:
    mechanism = wheel(0.5)
    assert tb.Mechanism.from_json(mechanism.to_json()) == mechanism
    softer = wheel(0.5, cubic_stiffness=6.0)
    assert softer.content_hash != mechanism.content_hash


@pytest.mark.parametrize(
    ("engine", "bound"), [("mujoco", 1e-10), ("exudyn", 1e-4), ("pymunk", 5e-4)]
)
def test_engines_move_it_as_the_closed_form_says(engine: str, bound: float) -> None:
    rate, m = frequency_and_parameter(1.3)
    trajectory = tb.engine(engine, timestep=1e-3).simulate(tb.Problem(wheel(1.3), duration=2.0))
    exact = 1.3 * ellipj(rate * trajectory.t, m)[1]
    assert len(trajectory.t) > 1000
    assert trajectory.q[:, 0] == pytest.approx(exact, abs=bound)
    assert trajectory.potential_energy == pytest.approx(
        STIFFNESS * exact**2 / 2 + CUBIC * exact**4 / 4, abs=50 * bound
    )
