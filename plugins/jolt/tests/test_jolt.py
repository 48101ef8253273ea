"""Jolt's defaults, and Jolt against the reference and closed forms; the rest is in
`plugins/tests`."""

from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.models.library.registry import benchmark
from trebucheck.reference.solver import solve
from trebucheck_jolt.engine import OWN, JoltEngine

EPSILON = 2.0**-24  # of single precision
GRAVITY, MASS, LENGTH = 9.81, 2.0, 1.0


def _rod(start: float, speed: float = 0.0, **changes: Any) -> tb.Mechanism:
    """A uniform rod on a pin at its end; the angle pi / 2 hangs."""
    inertia, middle = MASS * LENGTH**2 / 12, (LENGTH / 2, 0.0)
    rod = tb.Body(name="rod", angle="a", mass=MASS, centre=middle, inertia=inertia)
    pin = tb.PinJoint(
        name="pin", parent="ground", child="rod", parent_point=(0, 0), child_point=(0, 0)
    )
    given = {"stops": (), "gravity": GRAVITY} | changes
    return tb.Mechanism(
        name="rod", bodies=(rod,), joints=(pin,), start=(start,), start_speeds=(speed,), **given
    )


def _error(found: tb.Trajectory, problem: tb.Problem) -> float:
    """Greatest distance of a marker from where it should be [m]."""
    right = solve(problem).trajectory(found.t).markers
    return float(
        max(np.abs(m.position - right[key].position).max() for key, m in found.markers.items())
    )


def test_the_defaults_are_jolts_own() -> None:
    """Those of a fresh world and a fresh body; `Step` has no step size but HelloWorld.cpp's."""
    own = JoltEngine.npm.run(
        """
        import initJolt from "jolt-physics";
        const Jolt = await initJolt();
        const physics = new Jolt.PhysicsSettings(), body = new Jolt.BodyCreationSettings();
        console.log(JSON.stringify({
          velocity: physics.mNumVelocitySteps, position: physics.mNumPositionSteps,
          baumgarte: physics.mBaumgarte, sleep: [physics.mAllowSleeping, body.mAllowSleeping],
          damping: [body.mLinearDamping, body.mAngularDamping],
          fastest: [body.mMaxLinearVelocity, body.mMaxAngularVelocity],
          gyroscopic: body.mApplyGyroscopicForce,
        }));
        """
    )
    default = tb.engine("jolt", "default")
    assert own["velocity"] == default.velocity_steps == default.first_velocity_steps
    assert own["position"] == default.position_steps
    assert own["baumgarte"] == pytest.approx(default.baumgarte, rel=EPSILON)
    assert own["sleep"] == [default.allow_sleep] * 2
    assert own["damping"] == pytest.approx([default.damping] * 2, rel=EPSILON)
    fastest = [default.max_linear_velocity, default.max_angular_velocity]
    assert own["fastest"] == pytest.approx(fastest, rel=EPSILON)
    assert own["gyroscopic"] == default.gyroscopic_force
    # The program sets none of them.
    program = default.script(tb.Problem(tb.fixed(), duration=0.1))
    assert OWN["collision_steps"] == 1 and ".Step(STEP, 1)" in program
    for name in ("PhysicsSettings", "Damping", "Sleeping", "mMaxL", "mMaxA", "Gyroscopic"):
        assert name not in program


def test_a_hanging_rods_pin_carries_its_weight_upwards() -> None:
    problem = tb.Problem(_rod(np.pi / 2), duration=0.5)
    force = tb.engine("jolt").simulate(problem).joint_reactions["pin"]
    # A step changes speeds by g h, which rounding of 1e4 iterations may move by a few parts.
    assert force[-1] == pytest.approx([0.0, MASS * GRAVITY], abs=1e-5 * MASS * GRAVITY)


def test_the_force_of_a_swinging_rod_is_its_closed_form() -> None:
    """Newton's second law of its centre, at the engine's own angle and speed."""
    found = tb.engine("jolt", timestep=1e-3).simulate(tb.Problem(_rod(0.0), duration=1.0))
    q, u = found.q[:, 0], found.u[:, 0]
    turning = 1.5 * GRAVITY / LENGTH * np.cos(q)
    away = np.stack([np.cos(q), -np.sin(q)], axis=1)
    along = np.stack([-np.sin(q), -np.cos(q)], axis=1)
    closed = MASS * LENGTH / 2 * (turning[:, None] * along - u[:, None] ** 2 * away)
    closed += [0.0, MASS * GRAVITY]
    # A step's change of angle is of 1e-2 at most, that of a force a part of it by half a step.
    force = found.joint_reactions["pin"]
    assert np.abs(force - closed)[1:-1].max() < 5e-3 * np.abs(closed).max()


def test_a_slot_in_the_plane_lets_its_body_turn() -> None:
    """Axes of six that lock rotations across the plane would lock that about z: see the README."""
    rolling = tb.Problem(tb.rolling().model_copy(update={"stops": ()}), duration=1.0)
    errors = [
        _error(tb.engine("jolt", timestep=4e-3, plane=plane).simulate(rolling), rolling)
        for plane in (True, False)
    ]
    assert max(errors) < 10.0 * 4e-3  # speeds of 10 m/s times a step
    assert errors[0] == pytest.approx(errors[1], rel=0.1)


def test_a_limit_on_one_side_is_a_limit_half_a_turn_on() -> None:
    """Jolt's hinge takes an angle beyond half a turn for one before its least; without stops, and
    where they are let go for good, it is free."""
    stop = tb.Stop(name="rest", body="rod", sense=1, limit=0.0, closed=True)
    problem = tb.Problem(_rod(0.0, 8.0, stops=(stop,), gravity=0.0), duration=1.0)
    assert tb.engine("jolt", "settings").simulate(problem).q.max() == pytest.approx(np.pi, abs=1e-2)
    bare = tb.Problem(_rod(0.0, 8.0, gravity=0.0), duration=1.0)
    for made, given in ((tb.engine("jolt", "settings"), bare), (tb.engine("jolt"), problem)):
        # A step loses what turns away within it, half the square of its angle, at most.
        loss = 0.5 * (8.0 * made.timestep) ** 2 / made.timestep  # type: ignore[attr-defined]
        assert made.simulate(given).q.max() == pytest.approx(8.0, rel=loss)


def test_the_memory_of_a_long_run_is_flat() -> None:
    problem = benchmark("spring-pendulum").problem()
    text = tb.engine("jolt", "settings", timestep=1e-3).script(
        problem.model_copy(update={"duration": 5.0})
    )
    free = "Jolt.JoltInterface.prototype.sGetFreeMemory()"
    text = text.replace("for (let k = 1;", f"step();\nconst before = {free};\nfor (let k = 1;")
    text = text[: text.rindex("console.log(")]
    text += f"console.log(JSON.stringify([before, {free}, t.length]));"
    found = JoltEngine.npm.run(text)
    assert found[2] == 5001 and found[1] == found[0] > 0


def test_what_it_has_not_is_refused() -> None:
    with pytest.raises(tb.UnsupportedProblemError, match="stops on points"):
        tb.engine("jolt").simulate(benchmark("bouncing").problem())
    far = tb.Stop(name="end", body="rod", sense=-1, limit=-2.2 * np.pi, closed=False)
    problem = tb.Problem(_rod(0.0, stops=(far,)), duration=0.1, stop_law=tb.StopLaw.UNILATERAL)
    with pytest.raises(tb.UnsupportedProblemError, match="within half a turn"):
        tb.engine("jolt").simulate(problem)


def test_a_world_that_breaks_down_is_a_failed_run() -> None:
    with pytest.raises(tb.SimulationError, match=r"Jolt Physics failed: .*"):
        JoltEngine.npm.run(
            'import initJolt from "jolt-physics"; const Jolt = await initJolt();'
            "new Jolt.JoltInterface(new Jolt.JoltSettings()).Step(0.1, 1);"
        )
