"""Stops that act on one motion and have different restitution.

Every engine resolves their impact by the same law.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
import trebucheck as tb
from mechanisms import angle_stop, floor, pin, rod_pendulum
from trebucheck.models.elements import GROUND, ConstantTorque
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.models.trajectory import Trajectory

TURN, REACH = 1.0, 2.0
CAME = math.sqrt(
    2 * 2.0 * 9.81 * math.sin(TURN) / (0.5 + 2.0)
)  # [rad/s] of the rod of 2 kg at its stops


def engine_run(engine: str, mechanism: Mechanism) -> Trajectory:
    pytest.importorskip(engine) if engine != "reference" else None
    return tb.engine(engine, **({} if engine == "reference" else {"timestep": 1e-3})).simulate(
        Problem(mechanism, duration=0.6, stop_law=StopLaw.UNILATERAL)
    )


def speed_after_impact(trajectory: Trajectory) -> float:
    """By the balance of energy from the first sample behind it [rad/s]."""
    i = int(np.searchsorted(trajectory.t, trajectory.impacts[0][0])) + 1
    q, u = trajectory.q[i, 0], trajectory.u[i, 0]
    return -math.sqrt(u**2 - 2 * 2.0 * 9.81 * (math.sin(q) - math.sin(TURN)) / 2.5)


@pytest.mark.parametrize("engine", ["reference", "mujoco", "exudyn", "pymunk"])
@pytest.mark.parametrize(("on_angle", "on_point"), [(0.2, 0.8), (0.8, 0.2), (0.0, 1.0), (0.5, 0.5)])
def test_the_stop_that_asks_for_the_higher_speed_decides(
    engine: str, on_angle: float, on_point: float
) -> None:
    """An angle's stop and a floor under the rod's tip, met at one angle.

    Least squares gave a speed between the two.
    """
    stops = (
        angle_stop(TURN, on_angle, body="rod"),
        floor(REACH * math.sin(TURN), on_point, "rod", (REACH, 0)),
    )
    trajectory = engine_run(engine, rod_pendulum(*stops))
    highest = max(on_angle, on_point)
    error = {"reference": 1e-10, "mujoco": 1e-9}.get(
        engine, 1e-3
    )  # a step's: the impact is located by its own order
    assert speed_after_impact(trajectory) == pytest.approx(-highest * CAME, abs=error * CAME)
    impulses = trajectory.impacts[0][1]
    total = impulses["stop"] + impulses["floor"] * REACH * math.cos(TURN)
    assert total == pytest.approx((1 + highest) * CAME * 2.5, rel=error)


@pytest.mark.parametrize("engine", ["reference", "mujoco", "pymunk"])
def test_stops_on_both_sides_leave_no_rebound(engine: str) -> None:
    """A rod held from both sides starts with a speed: no speed but zero is free of penetration."""
    low = angle_stop(TURN, 0.5, body="rod")
    high = tb.Stop(name="high", body="rod", sense=1, limit=TURN, closed=True, restitution=0.5)
    held = rod_pendulum(low.model_copy(update={"closed": True}), high, start=TURN)
    trajectory = engine_run(engine, held.model_copy(update={"start_speeds": (2.0,)}))
    assert np.abs(trajectory.u[1:]).max() < 1e-8
    assert trajectory.impacts[0][1]["stop"] == pytest.approx(2.0 * 2.5, rel=1e-9)


def trio(mass: float, order: int) -> tuple[Mechanism, dict[str, float]]:
    """Two rods, one on the other, and a third one, each on a stop; and the torques of these [N m].

    The third one's pushes in any case. Of the two others both would have to pull if both were held:
    pivoting by the least index lets one of them go, then the other, and holds the upper one's again
    because it closes.
    """
    start, inertia = {"upper": 0.2, "lower": 0.3, "third": 0.0}, 0.2 + 0.6**2
    coupling = 0.6 * math.cos(0.1)
    lower = 1.5 * (inertia + 1.0) / coupling  # [rad/s^2] of the free rod; the upper one's is -1
    torques = {
        "upper": mass * (coupling * lower - (inertia + 1.0)),
        "lower": mass * (inertia * lower - coupling),
        "third": -mass,
    }
    stops = [
        tb.Stop(name=name, body=name, sense=1, limit=limit, closed=True)
        for name, limit in start.items()
    ]
    mechanism = Mechanism(
        name="trio",
        bodies=tuple(
            tb.Body(name=name, angle=name, mass=mass, centre=(0.6, 0), inertia=0.2 * mass)
            for name in start
        ),
        joints=(
            pin("shoulder", GROUND, "upper"),
            pin("elbow", "upper", "lower", (1.0, 0.0)),
            pin("hinge", GROUND, "third"),
        ),
        stops=tuple(stops[::order]),
        force_elements=tuple(
            ConstantTorque(name=f"on {name}", body=name, torque=torque)
            for name, torque in torques.items()
        ),
        gravity=0.0,
        start=tuple(start.values()),
    )
    held = mass * (inertia + 1.0 - coupling**2 / inertia)
    return mechanism, {"upper": held, "lower": 0.0, "third": mass}


@pytest.mark.parametrize("engine", ["reference", "mujoco", "exudyn", "pymunk"])
@pytest.mark.parametrize("order", [1, -1])
def test_a_stop_is_held_again_if_it_closes_without_the_other(engine: str, order: int) -> None:
    mechanism, torques = trio(1.0, order)
    pytest.importorskip(engine) if engine != "reference" else None
    run = tb.engine(engine).simulate(Problem(mechanism, duration=0.01))
    assert run.release_times == {"upper": None, "lower": 0.0, "third": None}
    for name, torque in torques.items():
        assert run.stop_torque(name)[0] == pytest.approx(torque, rel=1e-6)


def test_what_closes_is_told_from_rounding_at_any_mass() -> None:
    pytest.importorskip("pymunk")
    from trebucheck.engines.pymunk.motion import (
        _active_at_start,  # pyright: ignore[reportPrivateUsage]
    )

    for mass in (1e-6, 1e6):
        assert _active_at_start(trio(mass, 1)[0], 1e-3, 1e4) == ("upper", "third")
