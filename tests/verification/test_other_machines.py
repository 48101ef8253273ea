"""The machines the paper names besides its own.

Closed forms, invariants, one formulation against the other.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
import trebucheck as tb
from conftest import machines
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.integrate import quad
from trebucheck.models.library.registry import model, models, parameters_type
from trebucheck.reference.certification.certificate import load_certificate
from trebucheck.reference.certification.redundant import solve_redundant
from trebucheck.reference.solver import solve, solve_to_launch

OTHERS = ("catapult", "hinged", "floating-arm")
_RANGES = {
    "l1": (7.0, 12.0),
    "l2": (2.5, 5.0),
    "r": (4.0, 10.0),
    "h": (3.0, 12.0),
    "m_b": (30.0, 150.0),
    "m_cw": (1500.0, 5000.0),
    "m_a": (300.0, 2000.0),
    "theta0": (2.0, 2.6),
    "phi0": (-0.1, 0.1),
    "alpha0": (1.3, 1.9),
}


def other_machines(name: str) -> st.SearchStrategy[tb.Mechanism]:
    """Random machines of a kind."""
    kind = parameters_type(name)
    ranges = {key: st.floats(*_RANGES[key]) for key in kind.model_fields if key in _RANGES}
    return st.builds(lambda **values: model(name, kind(**values)), **ranges)


@pytest.mark.slow
@machines(10, few=1)
@given(data=st.data())
@pytest.mark.parametrize("name", OTHERS)
def test_two_formulations_move_alike(name: str, data: st.DataObject) -> None:
    """Up to 80 % of the launch time, both integrated to 3e-14 a step.

    Errors grow with the motion's own speed.
    """
    machine = data.draw(other_machines(name))
    end = 0.8 * _launch_time(machine)
    problem = tb.Problem(machine, duration=end)
    solution, other = solve(problem), solve_redundant(problem)
    t = np.linspace(0, end, 9)
    trajectory = solution.trajectory(t)
    for k, time in enumerate(t):
        q, u = other.state(float(time))
        assert q == pytest.approx(trajectory.q[k], abs=1e-8)
        assert u == pytest.approx(trajectory.u[k], abs=1e-7)
        for joint, force in other.joint_reactions(float(time)).items():
            expected = trajectory.joint_reaction(joint)
            assert force == pytest.approx(expected[k], abs=1e-8 * np.abs(expected).max())
    for stop, time in solution.release_times.items():
        assert other.release_times[stop] == pytest.approx(time, abs=1e-9)
    energy = trajectory.kinetic_energy + trajectory.potential_energy
    assert np.ptp(energy) <= 1e-11 * np.abs(trajectory.potential_energy).max()


def _launch_time(machine: tb.Mechanism) -> float:
    launch = solve_to_launch(machine).launch
    return launch.time if launch is not None else 2.0


@given(machine=other_machines("catapult"))
def test_a_catapult_is_a_quadrature(machine: tb.Mechanism) -> None:
    """One degree of freedom.

    Omega^2 = 2 (U0 - U) / I, and the time is the integral of 1 / omega.
    """
    arm, start = machine.bodies[0], machine.start[0]
    assume(arm.centre[0] < -0.2)  # a longer arm outweighs the counterweight, or turns for minutes
    about_pivot = arm.inertia + arm.mass * arm.centre[0] ** 2
    fall = (
        -2 * arm.mass * machine.gravity * arm.centre[0] / about_pivot
    )  # omega^2 = fall (sin q0 - sin q)
    turned = 5 * math.pi / 4  # the tip moves across the arm
    # q = start + s^2 takes the singularity of the start away.
    time, error = quad(
        lambda s: 2 * s / math.sqrt(fall * (math.sin(start) - math.sin(start + s * s))), 0, 1
    )
    rest, error_of_rest = quad(
        lambda q: 1 / math.sqrt(fall * (math.sin(start) - math.sin(q))), start + 1, turned
    )
    launch = solve(tb.Problem(machine, duration=1.1 * (time + rest))).launch
    assert launch is not None
    omega = math.sqrt(fall * (math.sin(start) - math.sin(turned)))
    assert launch.speed == pytest.approx(omega * machine.markers[0].point[0], rel=1e-11)
    assert launch.time == pytest.approx(time + rest, abs=1e-9 + error + error_of_rest)


@pytest.mark.slow
@given(machine=other_machines("floating-arm"))
def test_a_floating_arm_keeps_to_its_tracks(machine: tb.Mechanism) -> None:
    """The counterweight stays on its line, the wheel on its own, and neither pushes along its
    track.
    """
    end = _launch_time(machine)
    solution = solve(tb.Problem(machine, duration=end))
    trajectory = solution.trajectory(np.linspace(0, end, 50))
    assert np.abs(trajectory.marker("counterweight").position[:, 0]).max() < 1e-10
    assert np.abs(trajectory.marker("wheel").position[:, 1]).max() < 1e-10
    assert np.abs(trajectory.joint_reaction("drop")[:, 1]).max() < 1e-6
    assert np.abs(trajectory.joint_reaction("track")[:, 0]).max() < 1e-6


@pytest.mark.parametrize("name", ["hinged", "floating-arm"])
def test_a_level_sling_at_rest_leaves_the_weight_to_the_trough(name: str) -> None:
    machine = model(name)
    force = solve(tb.Problem(machine, duration=0.1)).motion(np.zeros(1)).stop_torques["trough"][0]
    assert force == pytest.approx(60.0 * machine.gravity, rel=1e-12)


@pytest.mark.parametrize("name", ["hinged", "floating-arm"])
def test_the_projectile_slides_level_until_it_lifts_off(name: str) -> None:
    machine = model(name)
    solution = solve(tb.Problem(machine, duration=1.5))
    lift = solution.release_times["trough"]
    assert lift is not None
    position = solution.trajectory(np.linspace(0, lift, 30)).marker("projectile").position
    assert np.ptp(position[:, 1]) < 1e-11
    after = solution.trajectory(np.linspace(lift, 1.5, 30)[1:]).marker("projectile").position
    assert (after[:, 1] > position[0, 1]).all()


@pytest.mark.parametrize("name", models())
def test_every_machine_has_a_certificate(name: str) -> None:
    certificate = load_certificate(model(name))
    assert certificate is not None
    assert sum(computation.independent for computation in certificate.computations) >= 2


@pytest.mark.parametrize("name", models())
def test_parameters_of_another_machine_are_refused(name: str) -> None:
    other = tb.HingedParameters() if name in ("fixed", "rolling") else tb.TrebuchetParameters()
    with pytest.raises(tb.InputError, match=f"model '{name}' is built from"):
        model(name, other)


Build = Callable[[], tb.Mechanism]


@pytest.mark.parametrize("build", [tb.catapult, tb.hinged, tb.floating_arm])
def test_defaults_are_the_named_machine(build: Build) -> None:
    assert build() == model(build().name)
