"""Havok's defaults, what it makes of masses and slow bodies, and Havok against the reference.

The engine alone is in `plugins/tests/test_alone.py`. Its masses have eight bits, so that orders are
measured on machines whose masses it can hold: `_held` rounds them, for engine and reference alike.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.comparisons.diagnosis.equivalence import check_model
from trebucheck.engines.point_masses import NoPointMasses
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.library.registry import benchmark, library_problem
from trebucheck.reference.solver import solve
from trebucheck_havok.engine import OWN, HavokEngine

EIGHT_BITS = 2.0**-8
"""Greatest relative error of a number that is rounded to eight bits, and of its inverse."""
SINGLE = 2.0**-24


def _eight_bits(inverse: float) -> float:
    """A number rounded to eight bits, as Havok keeps inverses of masses and inertias."""
    fraction, exponent = np.frexp(inverse)
    return float(np.ldexp(np.round(fraction * 256), exponent - 8))


def _held(mechanism: tb.Mechanism) -> tb.Mechanism:
    """A mechanism with the masses and inertias that Havok keeps, none of them without inertia."""
    spread = NoPointMasses(mechanism, 1e-3).mechanism
    bodies = tuple(
        body.model_copy(
            update={
                "mass": 1 / _eight_bits(1 / body.mass),
                "inertia": 1 / _eight_bits(1 / body.inertia),
            }
        )
        for body in spread.bodies
    )
    return spread.model_copy(update={"bodies": bodies})


FREE_SWING = tb.Problem(_held(tb.fixed().model_copy(update={"stops": ()})), duration=2.0)


def _error(problem: tb.Problem, step: float, **options: Any) -> float:
    """Greatest distance of a marker from where it should be [m]."""
    found = tb.engine("havok", timestep=step, **options).simulate(problem)
    right = solve(problem).trajectory(found.t).markers
    return max(
        float(np.abs(motion.position - right[name].position).max())
        for name, motion in found.markers.items()
    )


def _rod(speed: float = 0.0, angle: float = 0.0, stop: float | None = None) -> tb.Mechanism:
    """A rod of 2 kg on a pin of the ground; a stop holds its angle below a value [rad]."""
    rod = tb.Body(name="rod", angle="a", mass=2.0, centre=(1.0, 0.0), inertia=0.5)
    pin = tb.PinJoint(
        name="pin", parent="ground", child="rod", parent_point=(0, 0), child_point=(0, 0)
    )
    stops = [tb.Stop(name="end", body="rod", sense=-1, limit=-(stop or 0.0), closed=False)]
    return tb.Mechanism(
        name="rod",
        bodies=(rod,),
        joints=(pin,),
        stops=tuple(stops[: stop is not None]),
        gravity=9.81,
        start=(angle,),
        start_speeds=(speed,),
        markers=(tb.Marker(name="tip", body="rod", point=(2, 0)),),
    )


def test_the_defaults_are_those_of_a_world_that_sets_nothing() -> None:
    """Step and locked axes are Babylon.js's; the others are read or measured."""
    own = HavokEngine.npm.run(
        """
        import { readFileSync } from "node:fs";
        import { createRequire } from "node:module";
        import HavokPhysics from "@babylonjs/havok";
        const { resolve } = createRequire(import.meta.url);
        const wasmBinary = readFileSync(resolve("@babylonjs/havok/lib/esm/HavokPhysics.wasm"));
        const hk = await HavokPhysics({ wasmBinary });
        const types = readFileSync(resolve("@babylonjs/havok/lib/esm/HavokPhysics.wasm")
          .replace("lib/esm/HavokPhysics.wasm", "HavokPhysics.d.ts"), "utf8");
        const [, ideal] = types.match(/call HP_World_Step\\(\\). Defaults to ([0-9/]+)/);
        const [, world] = hk.HP_World_Create(), [, body] = hk.HP_Body_Create();
        hk.HP_Body_SetMotionType(body, hk.MotionType.DYNAMIC);
        const [, speed_limit, turning_limit] = hk.HP_World_GetSpeedLimit(world);
        hk.HP_World_SetGravity(world, [0, 1, 0]);
        hk.HP_World_AddBody(world, body, false);
        hk.HP_Body_SetLinearVelocity(body, [0.05, 0, 0]);
        hk.HP_World_Step(world, 1e-6);
        const slowed = (0.05 - hk.HP_Body_GetLinearVelocity(body)[1][0]) / 1e-6;
        hk.HP_Body_SetLinearVelocity(body, [0, 0, 0]);
        hk.HP_World_SetGravity(world, [0, 0, 0]);
        for (let k = 0; k < 1000; k++) hk.HP_World_Step(world, 1 / 60);
        const [, activation] = hk.HP_Body_GetActivationState(body);
        console.log(JSON.stringify({
          speed_limit, turning_limit, angular_damping: hk.HP_Body_GetAngularDamping(body)[1],
          linear_damping: hk.HP_Body_GetLinearDamping(body)[1], slowed,
          asleep: activation === hk.ActivationState.INACTIVE,
          ideal,
        }));
        """
    )
    assert own["angular_damping"] == pytest.approx(OWN["angular_damping"], rel=SINGLE)
    assert own["speed_limit"] == OWN["speed_limit"]
    assert own["turning_limit"] == OWN["turning_limit"]
    assert own["linear_damping"] == 0.0
    assert own["ideal"] == "1/60" and OWN["ideal_step"] == 1 / 60
    assert own["slowed"] > 0.0 and OWN["stabilization"]
    assert own["asleep"] and OWN["allow_sleep"]
    default = tb.engine("havok", "default")
    assert {name: getattr(default, name) for name in OWN} == OWN
    program = default.script(tb.Problem(_rod(), duration=0.1))  # type: ignore[attr-defined]
    for setter in ("Damping", "SpeedLimit", "IdealStepTime", "ActivationControl", "GravityFactor"):
        assert f"Set{setter}" not in program


@pytest.mark.parametrize("name", ["slider-crank", "thrown-plate", "motor", "fixed"])
def test_masses_have_eight_bits(name: str) -> None:
    """A machine whose masses Havok can hold is built to single precision, another one is not."""
    known = library_problem(name, None)
    given = tb.model(name) if known is None else known.mechanism
    worst: list[float] = []
    for mechanism in (_held(given), given):
        found = check_model(tb.engine("havok"), mechanism)
        assert found.holds
        worst.append(max(check.value or 0.0 for check in found.checks))
    assert worst[0] < 1000 * SINGLE < worst[1] < 2 * EIGHT_BITS


@pytest.mark.parametrize("plane", [False, True])
def test_the_free_swing_is_of_first_order(plane: bool) -> None:
    coarse, fine = (_error(FREE_SWING, step, locks_plane=plane) for step in (4e-3, 2e-3))
    assert np.log2(coarse / fine) == pytest.approx(1.0, abs=0.2)


def test_each_of_what_the_settings_take_out_moves_the_free_swing() -> None:
    """More than half a step of the scheme does, at a step where that is the smaller error."""
    alone = _error(FREE_SWING, 1e-3)
    for own in ({"angular_damping": 0.1}, {"stabilization": True}):
        assert _error(FREE_SWING, 1e-3, **own) > 2 * alone


@pytest.mark.parametrize(
    "name",
    [
        "slider-crank",
        "n-four-bar",
        "double-pendulum",
        "oscillator",
        "motor",
        "spring-pendulum",
        "bead",
        "incline",
        "thrown-plate",
        "welded-rods",
    ],
)
def test_it_builds_every_element(name: str) -> None:
    given = benchmark(name).problem()
    problem = given.model_copy(update={"mechanism": _held(given.mechanism), "duration": 0.5})
    errors = [_error(problem, step) for step in (4e-3, 2e-3)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(1.0, abs=0.3)


@pytest.mark.parametrize("preset", ["default", "settings", "assisted"])
def test_a_hanging_rod_pulls_its_pin_down(preset: str) -> None:
    """The force on the child is its weight upwards, to what the softness of the pin leaves."""
    made = _rod(angle=np.pi / 2)
    found = tb.engine("havok", preset).simulate(tb.Problem(made, duration=0.5))
    assert found.joint_reactions["pin"][-2] == pytest.approx([0.0, 2.0 * 9.81], abs=1e-2)


def test_a_swinging_rod_has_the_force_of_its_closed_form() -> None:
    """First order: along the rod m g sin a + m r w^2, across it from the turning moment."""
    problem, errors = tb.Problem(_rod(speed=1.0), duration=1.0), list[float]()
    for step in (8e-3, 4e-3):
        found = tb.engine("havok", timestep=step).simulate(problem)
        a, w = found.q[:, 0], found.u[:, 0]
        turning = 2.0 * 9.81 * np.cos(a) / 2.5  # m g r cos a over I + m r^2 [rad/s^2]
        along, across = np.array([np.cos(a), -np.sin(a)]), np.array([-np.sin(a), -np.cos(a)])
        force = 2.0 * (turning * across - w**2 * along) + np.array([[0.0], [2.0 * 9.81]])
        # The first step tells nothing of the centripetal part, which the second one makes up for.
        errors.append(float(np.abs(found.joint_reactions["pin"] - force.T)[2:].max()))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(1.0, abs=0.2)


def test_a_rod_rests_on_its_stop_beyond_a_turn() -> None:
    """The limit knows an angle beyond a turn, and its torque carries the weight."""
    end = 2.2 * np.pi
    problem = tb.Problem(_rod(8.0, stop=end), duration=6.0, stop_law=tb.StopLaw.UNILATERAL)
    found = tb.engine("havok").simulate(problem)
    weight = 2.0 * 9.81 * np.cos(found.q[-1, 0])
    assert found.q[-1, 0] == pytest.approx(end, abs=1e-3)
    assert found.stop_torques["end"][-10:].mean() == pytest.approx(weight, rel=1e-2)


def test_a_limit_on_one_side_would_have_another_at_half_a_turn() -> None:
    """The program sets it far away: a rod turns away from its stop by a turn."""
    made = _rod(-8.0, stop=0.1).model_copy(update={"gravity": 0.0})
    problem = tb.Problem(made, duration=1.0, stop_law=tb.StopLaw.UNILATERAL)
    assert tb.engine("havok").simulate(problem).q[-1, 0] < -2 * np.pi


def test_a_slow_body_is_braked_by_default_alone() -> None:
    puck = tb.Body(name="puck", angle="q", mass=1.0, centre=(0.0, 0.0), inertia=0.5)
    made = tb.Mechanism(
        name="slow puck",
        bodies=(puck,),
        joints=(tb.FreeJoint(name="air", child="puck", coordinates=("x", "y")),),
        stops=(),
        gravity=0.0,
        start=(0.0, 0.0, 0.0),
        start_speeds=(0.0, 0.05, 0.0),
    )
    problem = tb.Problem(made, duration=1.0)
    assert tb.engine("havok", "default").simulate(problem).u[-1, 1] < 0.001
    for preset in ("settings", "assisted"):
        assert tb.engine("havok", preset).simulate(problem).u[-1, 1] == pytest.approx(0.05)


@pytest.mark.parametrize("model", ["fixed", "rolling"])
def test_its_limits_hold_both_machines(model: str) -> None:
    """A release is known to the time that its gap takes to grow to the one from which it is looked
    back for, and to two steps by the scheme and its end."""
    mechanism, errors = _held(tb.model(model)), list[float]()
    for step in (2e-3, 1e-3):
        engine = tb.engine("havok", timestep=step)
        found = engine.simulate(tb.Problem(mechanism, duration=1.4))
        truth = solve(tb.Problem(mechanism, duration=1.4 + step)).trajectory(found.t)
        errors.append(
            max(
                float(np.abs(motion.position - truth.markers[name].position).max())
                for name, motion in found.markers.items()
            )
        )
    assert np.log2(errors[0] / errors[1]) > 0.7
    for name, time in truth.release_times.items():
        released = found.release_times.get(name)
        assert (released is None) == (time is None)
        if released is not None and time is not None:
            gap = np.asarray(Kinematics(mechanism).gap(name, truth.q))
            grown = float(truth.t[np.argmax(gap > engine.release_gap)])
            assert abs(released - time) <= grown - time + 2e-3


def test_what_it_has_not_is_refused() -> None:
    with pytest.raises(tb.UnsupportedProblemError, match="stops on points"):
        tb.engine("havok").simulate(benchmark("bouncing").problem())


def test_what_havok_does_not_do_is_a_failed_run() -> None:
    """Its functions return codes, and its WebAssembly aborts: both end as a sentence."""
    with pytest.raises(tb.SimulationError, match="Havok failed: "):
        HavokEngine.npm.arrays("throw new Error('Havok has not done what was asked');")
