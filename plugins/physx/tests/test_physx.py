"""PhysX's defaults, and PhysX against the reference and closed forms; the rest is in
`plugins/tests`."""

from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.models.library.registry import benchmark
from trebucheck.reference.solver import solve
from trebucheck_physx.engine import OWN, PhysxEngine

FREE_SWING = tb.Problem(tb.fixed().model_copy(update={"stops": ()}), duration=2.0)
EPSILON = 2.0**-24  # of single precision
MASS, LENGTH = 2.0, 1.0


def _rod(start: float, speed: float = 0.0, **changes: Any) -> tb.Mechanism:
    """A uniform rod on a pin at its end; the angle pi / 2 hangs."""
    inertia, middle = MASS * LENGTH**2 / 12, (LENGTH / 2, 0.0)
    rod = tb.Body(name="rod", angle="a", mass=MASS, centre=middle, inertia=inertia)
    pin = tb.PinJoint(
        name="pin", parent="ground", child="rod", parent_point=(0, 0), child_point=(0, 0)
    )
    given = {"stops": (), "gravity": 9.81} | changes
    return tb.Mechanism(
        name="rod", bodies=(rod,), joints=(pin,), start=(start,), start_speeds=(speed,), **given
    )


def _error(found: tb.Trajectory, problem: tb.Problem) -> float:
    """Greatest distance of a marker from where it should be [m]."""
    right = solve(problem).trajectory(found.t).markers
    return float(
        max(np.abs(m.position - right[key].position).max() for key, m in found.markers.items())
    )


def _off(found: tb.Trajectory, problem: tb.Problem) -> tuple[float, float]:
    """Greatest error of a joint's force and of a stop's torque, of the greatest of all."""
    truth = solve(problem).trajectory(found.t)
    pairs = (
        (found.joint_reactions, truth.joint_reactions),
        (found.stop_torques, truth.stop_torques),
    )
    forces, torques = (
        max(float(np.abs(values - right[name]).max()) for name, values in mine.items())
        / max(float(np.abs(values).max()) for values in right.values())
        for mine, right in pairs
    )
    return forces, torques


def test_the_defaults_are_physxs_own() -> None:
    """Those of a fresh body. It tells no iterations: a body to which PhysX's documented four and
    one are given moves as one to which none are given, and not as one with another number."""
    default = tb.engine("physx", "default")
    program = default.script(tb.Problem(_rod(0.0), duration=0.1))  # type: ignore[attr-defined]
    for setter in ("Iteration", "Damping", "MaxAngular", "Sleep"):
        assert setter not in program
    told = "console.log(JSON.stringify([body.getAngularDamping(), body.getLinearDamping(), "
    told += "body.getMaxAngularVelocity(), body.getSleepThreshold()]));"
    fresh = "const body = physics.createRigidDynamic(place([0, 0]));\n" + told
    own = PhysxEngine.npm.run(program[: program.rindex("console.log(")] + fresh)
    given = [OWN["angular_damping"], 0.0, OWN["max_angular_velocity"], OWN["sleep_threshold"]]
    assert own == pytest.approx(given, rel=EPSILON)

    bars = benchmark("n-four-bar").problem().model_copy(update={"duration": 0.5})
    text = default.script(bars)  # type: ignore[attr-defined]
    adding = "  scene.addActor(body);\n"
    assert adding in text
    unset, same, other = (
        PhysxEngine.npm.run(text.replace(adding, set_to + adding))["q"]
        for set_to in (
            "",
            "  body.setSolverIterationCounts(4, 1);\n",
            "  body.setSolverIterationCounts(4, 2);\n",
        )
    )
    assert unset == same != other
    assert (OWN["position_iterations"], OWN["velocity_iterations"]) == (4, 1)


def test_the_plane_costs_nothing() -> None:
    """Bodies whose joints alone hold them in the plane move as those that are locked there."""
    errors = [
        _error(tb.engine("physx", timestep=4e-3, plane=plane).simulate(FREE_SWING), FREE_SWING)
        for plane in (True, False)
    ]
    assert errors[0] == pytest.approx(errors[1], rel=0.1)


def test_forces_of_one_iteration_of_speeds_hold_what_takes_gaps_back() -> None:
    """PhysX's own number of them: limits' torques are then wrong by a part of themselves."""
    problem = tb.Problem(tb.fixed(), duration=0.75)
    few, many = (
        tb.engine("physx", timestep=1e-3, velocity_iterations=n).simulate(problem) for n in (1, 100)
    )
    assert _off(few, problem)[1] > 0.1
    assert _off(many, problem)[1] < 0.01


@pytest.mark.parametrize("preset", ["settings", "assisted"])
def test_stops_release_within_steps_of_the_reference(preset: str) -> None:
    """A step late by the scheme, and one by its end."""
    problem = tb.Problem(tb.fixed(), duration=2.0)
    engine = tb.engine("physx", preset, timestep=1e-3, least_inertia=1e-3)
    found, right = engine.simulate(problem).release_times, solve(problem).release_times
    assert found["arm stop"] is right["arm stop"] is None
    for stop in ("hanger rest", "sling rest"):
        assert found[stop] == pytest.approx(right[stop], abs=2e-3)


def test_a_limit_on_one_side_is_met_again_a_turn_on() -> None:
    """A joint knows its angle within half a turn; one whose stop is let go for good is free."""
    stop = tb.Stop(name="rest", body="rod", sense=1, limit=0.0, closed=True)
    problem = tb.Problem(_rod(0.0, 8.0, stops=(stop,), gravity=0.0), duration=1.0)
    kept = tb.engine("physx", "settings").simulate(problem).q.max()
    assert kept == pytest.approx(2 * np.pi, abs=1e-2)
    bare = tb.Problem(_rod(0.0, 8.0, gravity=0.0), duration=1.0)
    for made, given in ((tb.engine("physx", "settings"), bare), (tb.engine("physx"), problem)):
        # A step loses what turns away within it, half the square of its angle, at most.
        loss = 0.5 * (8.0 * made.timestep) ** 2 / made.timestep  # type: ignore[attr-defined]
        assert made.simulate(given).q.max() == pytest.approx(8.0, rel=loss)


def test_the_memory_of_a_long_run_is_flat() -> None:
    """A vector made late in a run is where one made early was: nothing that steps make stays."""
    problem = benchmark("spring-pendulum").problem().model_copy(update={"duration": 5.0})
    engine: Any = tb.engine("physx", "settings", timestep=1e-3)
    text = engine.script(problem)
    taken = "  told.push(step());\n"
    assert taken in text
    look = "{ const made = new PxVec3(); at.push(physx.getPointer(made)); physx.destroy(made); }\n"
    text = text.replace(taken, f"{taken}  if (k === 100 || k === STEPS) {look}")
    text = "const at = [];\n" + text[: text.rindex("console.log(")]
    early, late = PhysxEngine.npm.run(text + "console.log(JSON.stringify(at));")
    assert early == late > 0


def test_what_it_has_not_is_refused() -> None:
    with pytest.raises(tb.UnsupportedProblemError, match="stops on points"):
        tb.engine("physx").simulate(benchmark("bouncing").problem())
    far = tb.Stop(name="end", body="rod", sense=-1, limit=-1.2 * np.pi, closed=False)
    problem = tb.Problem(_rod(0.0, stops=(far,)), duration=0.1, stop_law=tb.StopLaw.UNILATERAL)
    with pytest.raises(tb.UnsupportedProblemError, match="within half a turn"):
        tb.engine("physx").simulate(problem)


def test_a_world_that_breaks_down_is_a_failed_run() -> None:
    with pytest.raises(tb.SimulationError, match=r"PhysX failed: .*"):
        PhysxEngine.npm.run('import init from "physx-js-webidl"; await init();')
