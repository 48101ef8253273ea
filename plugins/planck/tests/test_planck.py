"""planck.js's defaults, and planck.js against the reference; the rest is in `plugins/tests`."""

import re
from itertools import pairwise

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.models.library.registry import benchmark
from trebucheck.reference.solver import solve
from trebucheck_planck.engine import PlanckEngine

FREE_SWING = tb.Problem(tb.fixed().model_copy(update={"stops": ()}), duration=2.0)


def test_the_defaults_are_planck_js_own() -> None:
    """Those of a world that sets nothing; `step` has no step size but that of HelloWorld.ts."""
    own = PlanckEngine.npm.run(
        """
        import * as planck from "planck";
        const world = new planck.World(), body = world.createDynamicBody();
        const { linearSlop, angularSlop } = planck.Settings;
        console.log(JSON.stringify({
          linearSlop, angularSlop, sleep: [world.getAllowSleeping(), body.isSleepingAllowed()],
          velocity: world.m_velocityIterations, position: world.m_positionIterations,
        }));
        """
    )
    default = tb.engine("planck", "default")
    assert own == {
        "linearSlop": default.linear_slop,
        "angularSlop": default.angular_slop,
        "sleep": [default.allow_sleep] * 2,
        "velocity": default.velocity_iterations,
        "position": default.position_iterations,
    }
    assert default.first_iterations == default.velocity_iterations
    example = (PlanckEngine.npm.folder / "node_modules" / "planck" / "HelloWorld.ts").read_text(
        "utf-8"
    )
    (step,) = re.findall(r"var timeStep = ([0-9.]+) / ([0-9.]+);", example)
    assert float(step[0]) / float(step[1]) == default.timestep
    # The program sets none of them.
    program = default.script(tb.Problem(tb.fixed(), duration=0.1))
    assert "Settings" not in program and "allowSleep" not in program


def test_a_body_at_rest_falls_asleep_by_default_alone() -> None:
    """planck.js stops what hardly moves for half a second, as its worlds do that set nothing."""
    body = tb.Body(name="puck", angle="q", mass=1.0, centre=(0.0, 0.0), inertia=0.1)
    made = tb.Mechanism(
        name="slow puck",
        bodies=(body,),
        joints=(tb.FreeJoint(name="air", child="puck", coordinates=("x", "y")),),
        stops=(),
        gravity=0.0,
        start=(0.0, 0.0, 0.0),
        start_speeds=(0.0, 0.005, 0.0),
    )
    problem = tb.Problem(made, duration=1.0)
    assert tb.engine("planck", "default").simulate(problem).u[-1, 1] == 0.0
    for preset in ("settings", "assisted"):
        assert tb.engine("planck", preset).simulate(problem).u[-1, 1] == pytest.approx(0.005)


@pytest.mark.parametrize("preset", ["default", "settings"])
def test_a_stop_is_read_as_released_where_it_has_pushed_last(preset: str) -> None:
    """The correction of the pins opens its limit for some steps; that is no release."""
    problem, engine = tb.Problem(tb.fixed(), duration=1.4), tb.engine("planck", preset)
    found, right = engine.simulate(problem), tb.engine("reference").simulate(problem)
    for name, time in right.release_times.items():
        released = found.release_times[name]
        if time is None:
            assert released is None
        else:  # two steps by the scheme and its end; what pauses hide is as with Box2D
            assert released == pytest.approx(time, abs=2 * engine.timestep + 5e-3)


@pytest.mark.parametrize(
    "name",
    [
        "slider-crank",
        "quick-return",
        "oscillator",
        "motor",
        "thrown-plate",
        "spring-pendulum",
        "welded-rods",
    ],
)
def test_it_builds_every_element(name: str) -> None:
    problem = benchmark(name).problem().model_copy(update={"duration": 0.5})
    truth, errors = solve(problem), list[float]()
    for step in (4e-4, 2e-4):
        found = tb.engine("planck", timestep=step).simulate(problem)
        right = truth.trajectory(found.t).markers
        errors.append(
            float(
                max(
                    np.abs(m.position - right[key].position).max()
                    for key, m in found.markers.items()
                )
            )
        )
    assert np.log2(errors[0] / errors[1]) == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize("model", ["fixed", "rolling"])
def test_forces_are_of_first_order_from_the_first_sample_on(model: str) -> None:
    """Joint forces on the child, in the world, and stop torques, where nothing is let go yet."""
    problem, errors = tb.Problem(tb.model(model), duration=0.75), list[float]()
    for step in (1e-3, 5e-4):
        found = tb.engine("planck", timestep=step).simulate(problem)
        truth = solve(problem).trajectory(found.t)
        forces = [(f, truth.joint_reactions[name]) for name, f in found.joint_reactions.items()]
        forces += [(f, truth.stop_torques[name]) for name, f in found.stop_torques.items()]
        errors.append(
            max(
                float(np.abs(f - right).max() / max(1.0, np.abs(right).max()))
                for f, right in forces
            )
        )
    assert np.log2(errors[0] / errors[1]) > 0.7


def test_forces_of_what_moves_at_the_start_are_of_first_order_too() -> None:
    """Impulses of the first step tell nothing of centripetal forces: without them the error would
    stay."""
    problem, errors = benchmark("bead").problem(), list[float]()
    for step in (1e-3, 5e-4):
        found = tb.engine("planck", timestep=step).simulate(problem)
        truth = solve(problem).trajectory(found.t).joint_reactions
        errors.append(
            max(
                float(np.abs(force - truth[name]).max())
                for name, force in found.joint_reactions.items()
            )
        )
    assert np.log2(errors[0] / errors[1]) > 0.7


def test_a_limit_that_holds_from_one_side_lets_go_by_the_correction_of_pins() -> None:
    problem = tb.Problem(tb.fixed(), duration=1.0)
    assert tb.engine("planck", timestep=1e-4).simulate(problem).release_times["sling rest"] is None
    assert (
        tb.engine("planck", timestep=1e-4, hold=False).simulate(problem).release_times["sling rest"]
        is not None
    )


@pytest.mark.parametrize("preset", ["settings", "assisted"])
def test_a_stop_behind_another_one_has_no_torque(preset: str) -> None:
    rod = tb.Body(name="rod", angle="a", mass=1.0, centre=(0.5, 0.0), inertia=0.1)
    pin = tb.PinJoint(
        name="pin", parent="ground", child="rod", parent_point=(0, 0), child_point=(0, 0)
    )
    near, far = (
        tb.Stop(name=name, body="rod", sense=-1, limit=-angle, closed=False)
        for name, angle in (("near", 0.5), ("far", 0.9))
    )
    made = tb.Mechanism(
        name="between stops",
        bodies=(rod,),
        joints=(pin,),
        stops=(far, near),
        gravity=9.81,
        start=(0.0,),
    )
    problem = tb.Problem(made, duration=1.0, stop_law=tb.StopLaw.UNILATERAL)
    torques = tb.engine("planck", preset).simulate(problem).stop_torques
    weight = 0.5 * 9.81 * np.cos(0.5)
    assert torques["near"][-1] == pytest.approx(weight, rel=1e-3)
    assert not torques["far"].any()


def test_a_stop_that_is_met_stops_what_meets_it() -> None:
    """The unilateral law, over more than a turn, without a rebound: the rod then rests on its
    stop."""
    rod = tb.Body(name="rod", angle="a", mass=1.0, centre=(0.5, 0.0), inertia=0.1)
    pin = tb.PinJoint(
        name="pin", parent="ground", child="rod", parent_point=(0, 0), child_point=(0, 0)
    )
    stop = tb.Stop(name="end", body="rod", sense=-1, limit=-2.2 * np.pi, closed=False)
    made = tb.Mechanism(
        name="turning",
        bodies=(rod,),
        joints=(pin,),
        stops=(stop,),
        gravity=9.81,
        start=(0.0,),
        start_speeds=(8.0,),
        markers=(tb.Marker(name="tip", body="rod", point=(1, 0)),),
    )
    step, speed = 1e-4, 15.0  # [s], and the rod's greatest speed is below this [rad/s]
    found = tb.engine("planck", timestep=step).simulate(
        tb.Problem(made, duration=1.5, stop_law=tb.StopLaw.UNILATERAL)
    )
    assert np.abs(found.u).max() < speed
    assert found.q.max() < 2.2 * np.pi + step * speed
    assert found.q[-1, 0] == pytest.approx(2.2 * np.pi, abs=1e-6)
    weight = 0.5 * 9.81 * np.cos(2.2 * np.pi)
    assert found.stop_torques["end"][-1] == pytest.approx(weight, rel=1e-6)


def test_richardsons_limit_of_the_free_swing_is_the_reference() -> None:
    """The remainder in double precision is of the second order, a quarter at half the steps, and
    2e-6 m."""
    truth = solve(FREE_SWING).trajectory(np.array([2.0]))
    ends = []
    for step in (5e-4, 2.5e-4, 1.25e-4):
        found = tb.engine("planck", timestep=step).simulate(FREE_SWING)
        ends.append(np.array([motion.position[-1] for motion in found.markers.values()]))
    right = np.array([motion.position[-1] for motion in truth.markers.values()])
    coarse, fine = (
        float(np.abs(2 * second - first - right).max()) for first, second in pairwise(ends)
    )
    assert coarse / fine == pytest.approx(4.0, rel=0.2)
    assert coarse < 1e-5


def test_what_it_has_not_is_refused() -> None:
    with pytest.raises(tb.UnsupportedProblemError, match="stops on points"):
        tb.engine("planck").simulate(benchmark("bouncing").problem())
