"""The cubic torsion spring in every formulation, and elements that no formulation knows."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable

import numpy as np
import pytest
import trebucheck as tb
from pydantic import Field
from scipy.special import ellipj
from trebucheck.models.elements import ELEMENTS, CubicTorsionSpring
from trebucheck.models.mechanism import Body, Marker, Mechanism
from trebucheck.models.problem import Problem
from trebucheck.reference.certification.redundant import solve_redundant
from trebucheck.reference.reactions import joint_reactions
from trebucheck.reference.sensitivity.release import (
    _of_elements,  # pyright: ignore[reportPrivateUsage]
    physical_numbers,
)
from trebucheck.reference.sensitivity.tangent import state_tangent
from trebucheck.reference.sensitivity.variational import VariationalEquations, moved
from trebucheck.reference.solver import solve
from trebucheck.reference.taylor.batch import launch_batch
from trebucheck.reference.taylor.solve import solve_taylor

needs_heyoka = pytest.mark.skipif(
    importlib.util.find_spec("heyoka") is None, reason="heyoka is optional"
)


def sprung_pendulum(**changes: object) -> Mechanism:
    """Two links, the second one held to the first by a cubic spring that is not relaxed."""
    links = [
        Body(name=name, angle=angle, mass=mass, centre=(0.4, 0.05), inertia=0.03)
        for name, angle, mass in (("upper", "a", 1.5), ("lower", "b", 0.8))
    ]
    pins = (
        tb.PinJoint(
            name="pivot", parent="ground", child="upper", parent_point=(0, 0), child_point=(0, 0)
        ),
        tb.PinJoint(
            name="knee", parent="upper", child="lower", parent_point=(1, 0), child_point=(0, 0)
        ),
    )
    spring = {"stiffness": 3.0, "cubic_stiffness": 20.0, "rest_angle": 0.4} | changes
    return Mechanism(
        name="sprung pendulum",
        bodies=tuple(links),
        joints=pins,
        markers=(Marker(name="projectile", body="lower", point=(0.8, 0.1)),),
        force_elements=(
            CubicTorsionSpring(name="coil", body="lower", relative_to="upper", **spring),
        ),
        gravity=9.81,
        start=(0.3, -0.9),
        start_speeds=(0.5, -1.0),
    )


def test_redundant_coordinates_agree_with_minimal_ones() -> None:
    problem = Problem(sprung_pendulum(), duration=0.75)
    minimal, redundant = solve(problem), solve_redundant(problem)
    motion = minimal.motion(np.linspace(0.0, 0.75, 16))
    for t, q, u in zip(np.linspace(0.0, 0.75, 16).tolist(), motion.q, motion.u, strict=True):
        other_q, other_u = redundant.state(t)
        np.testing.assert_allclose(other_q, q, rtol=0, atol=1e-10)
        np.testing.assert_allclose(other_u, u, rtol=0, atol=1e-9)
    energy = [redundant.energy(t) for t in (0.0, 0.3, 0.75)]
    kinetic = minimal.equations.kinematics.kinetic_energy(motion.q, motion.u)
    total = kinetic + minimal.equations.potential_energy(motion.q)
    np.testing.assert_allclose(energy, energy[0], rtol=1e-11)
    np.testing.assert_allclose(total, energy[0], rtol=1e-11)


@needs_heyoka
def test_taylor_series_agree_with_minimal_coordinates() -> None:
    problem, t = Problem(sprung_pendulum(), duration=1.5), np.linspace(0.0, 1.5, 16)
    minimal, taylor = solve(problem).motion(t), solve_taylor(problem).motion(t)
    np.testing.assert_allclose(taylor.q, minimal.q, rtol=0, atol=1e-10)
    np.testing.assert_allclose(taylor.u, minimal.u, rtol=0, atol=1e-9)


@needs_heyoka
def test_a_batch_takes_the_spring() -> None:
    machines = [sprung_pendulum(cubic_stiffness=k) for k in (0.0, 20.0, 30.0)]
    launches = launch_batch(machines, duration=1.5)
    assert len(machines) > 0
    for machine, launched, time in zip(machines, launches.launched, launches.time, strict=True):
        launch = solve(Problem(machine, duration=1.5)).launch
        assert bool(launched) == (launch is not None)
        if launch is not None:
            assert float(time) == pytest.approx(launch.time, abs=1e-9)


def test_it_is_duffings_equation() -> None:
    """Without gravity b = A cn(w t, m), w^2 = (k + k3 A^2) / I, m = k3 A^2 / (2 I w^2)."""
    k, k3, inertia, amplitude = 2.0, 15.0, 0.5, 1.2
    wheel = Body(name="wheel", angle="b", mass=1.0, centre=(0, 0), inertia=inertia)
    pin = tb.PinJoint(
        name="axle", parent="ground", child="wheel", parent_point=(0, 0), child_point=(0, 0)
    )
    coil = CubicTorsionSpring(name="coil", body="wheel", stiffness=k, cubic_stiffness=k3)
    mechanism = Mechanism(
        name="duffing",
        bodies=(wheel,),
        joints=(pin,),
        force_elements=(coil,),
        gravity=0.0,
        start=(amplitude,),
    )
    t = np.linspace(0.0, 3.0, 31)
    w = np.sqrt((k + k3 * amplitude**2) / inertia)
    expected = amplitude * ellipj(w * t, k3 * amplitude**2 / (2 * inertia * w**2))[1]
    q = solve(Problem(mechanism, duration=3.0)).motion(t).q[:, 0]
    np.testing.assert_allclose(q, expected, rtol=0, atol=1e-11)
    redundant = solve_redundant(Problem(mechanism, duration=3.0))
    assert redundant.state(3.0)[0][0] == pytest.approx(expected[-1], abs=1e-11)


@pytest.mark.parametrize("number", ["stiffness", "cubic_stiffness", "rest_angle"])
def test_derivatives_by_its_numbers_are_those_of_the_motion(number: str) -> None:
    mechanism, path, step = sprung_pendulum(), f"force_elements.coil.{number}", 1e-4
    end = 0.4  # [s] long enough for each number to move the end by a hundred times the tolerance
    solution = solve(Problem(mechanism, duration=end))
    tangent = state_tangent(solution, VariationalEquations(mechanism, [{path: 1.0}]), end)
    assert np.abs(tangent.dq[0]).max() > 1e-5
    up, down = (
        solve(Problem(moved(mechanism, {path: sign * step}), duration=end)).motion(np.array([end]))
        for sign in (1.0, -1.0)
    )
    difference = (up.q[0] - down.q[0]) / (2 * step)
    np.testing.assert_allclose(tangent.dq[0], difference, rtol=1e-5, atol=1e-7)


class Stranger(CubicTorsionSpring):
    """An element that is in no table."""


def with_stranger() -> Mechanism:
    mechanism = sprung_pendulum()
    stranger = Stranger(name="odd coil", body="lower", stiffness=1.0)
    return mechanism.model_copy(update={"force_elements": (stranger,)})


@pytest.mark.parametrize(
    "consumer",
    [
        lambda m: solve(Problem.model_construct(mechanism=m, duration=1.0)),
        lambda m: solve_redundant(Problem.model_construct(mechanism=m, duration=1.0)),
        lambda m: physical_numbers(m, "projectile"),
        pytest.param(
            lambda m: solve_taylor(Problem.model_construct(mechanism=m, duration=1.0)),
            marks=needs_heyoka,
        ),
    ],
    ids=["reference", "redundant", "sensitivities", "taylor"],
)
def test_an_unknown_element_is_refused_by_name(consumer: Callable[[Mechanism], object]) -> None:
    with pytest.raises(tb.UnsupportedProblemError, match="odd coil"):
        consumer(with_stranger())


def test_an_unknown_stop_is_refused_by_name() -> None:
    class Wall(tb.Stop):
        pass

    wall = Wall(name="odd wall", body="upper", sense=1, limit=-5.0, closed=False)
    mechanism = sprung_pendulum().model_copy(update={"stops": (wall,)})
    with pytest.raises(tb.UnsupportedProblemError, match="odd wall"):
        solve_redundant(Problem.model_construct(mechanism=mechanism, duration=1.0))
    plain = solve(Problem(sprung_pendulum(), duration=0.1))
    motion = plain.motion(np.array([0.0]))
    plain.equations.kinematics.mechanism.__dict__["stops"] = (wall,)
    with pytest.raises(tb.UnsupportedProblemError, match="odd wall"):
        joint_reactions(
            plain.equations.kinematics,
            motion.q,
            {"upper": np.zeros((1, 2)), "lower": np.zeros((1, 2))},
            motion.loop_multipliers,
            {"odd wall": np.zeros(1)},
        )


def test_a_number_of_a_new_element_is_among_the_sensitivities(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """No list names the numbers of a class: one that is added is differentiated by."""

    class Coil(CubicTorsionSpring):
        quintic_stiffness: float = Field(default=2.0, description="k5 [N m/rad^5]")

    coil = Coil(name="odd coil", body="upper", stiffness=1.0)
    mechanism = sprung_pendulum().model_copy(update={"force_elements": (coil,)})
    with pytest.raises(tb.UnsupportedProblemError, match="odd coil"):
        list(_of_elements(mechanism, None))
    monkeypatch.setattr("trebucheck.models.elements.ELEMENTS", (*ELEMENTS, Coil))
    numbers = {number.name: number for number in _of_elements(mechanism, None)}
    quintic = numbers["quintic stiffness of odd coil spring"]
    assert (quintic.unit, quintic.value) == ("N m/rad^5", 2.0)
    assert quintic.direction == {"force_elements.odd coil.quintic_stiffness": 1.0}
