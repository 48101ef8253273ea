"""Box2D 3's defaults, its forces and gaps by closed forms, and Box2D 3 against the reference.

Orders, limits and presets are in `plugins/tests`.
"""

import multiprocessing
import re
from importlib.resources import files
from typing import Any

import numpy as np
import pyb2d3
import pytest
import trebucheck as tb
from trebucheck.engines.presets import PRESETS
from trebucheck.models.library.registry import benchmark
from trebucheck.reference.solver import solve

EPS = 2.0**-24  # unit roundoff of single precision
OMEGA = 2 * np.pi * 60.0  # [rad/s] of Box2D 3.1's joints, B2_JOINT_CONSTRAINT_HERTZ
DAMPING = 2.0  # their damping ratio, B2_JOINT_CONSTRAINT_DAMPING_RATIO
MASS, ARM, GRAVITY = 2.0, 0.5, 9.81


def _rod(
    *, start: float = 0.0, speed: float = 0.0, gravity: float = GRAVITY, rests: bool = False
) -> tb.Mechanism:
    """A uniform rod of 1 m on a pin, at an angle from +x, clockwise; perhaps with a stop below."""
    stops = (
        () if not rests else (tb.Stop(name="rest", body="rod", sense=-1, limit=0.0, closed=True),)
    )
    return tb.Mechanism(
        name="rod",
        bodies=(tb.Body(name="rod", angle="q", mass=MASS, centre=(ARM, 0.0), inertia=MASS / 12),),
        joints=(
            tb.PinJoint(
                name="pin", parent="ground", child="rod", parent_point=(0, 0), child_point=(0, 0)
            ),
        ),
        stops=stops,
        gravity=gravity,
        start=(start,),
        start_speeds=(speed,),
        markers=(tb.Marker(name="tip", body="rod", point=(1.0, 0.0)),),
    )


def _unsettled(engine: Any, time: float) -> float:
    """Part of a joint's constant load that it does not carry yet [1].

    In each sub-step h a joint solves once with a bias and a softness, moves, and solves rigidly:
    its gap comes to its place at the rate h w^2 / (1 + h w (2 zeta + h w)), which is less the
    shorter the sub-steps are.
    """
    pace = max(1.0, (engine.world_step or 0.0) / engine.timestep)
    h = pace * engine.timestep / engine.sub_steps
    rate = h * OMEGA**2 / (1 + h * OMEGA * (2 * DAMPING + h * OMEGA))
    return float(np.exp(-rate * pace * time))


def _rounding(engine: Any) -> float:
    """Rounding of a load: of each of ten operations, and of a gap of the arm's size times w^2."""
    pace = max(1.0, (engine.world_step or 0.0) / engine.timestep)
    return 10 * EPS + EPS * ARM * (pace * OMEGA) ** 2 / GRAVITY


def _values(thing: object) -> dict[str, object]:
    """Numbers and switches of an object of Box2D's, by name."""
    values = {name: getattr(thing, name) for name in dir(thing) if not name.startswith("_")}
    return {name: value for name, value in values.items() if isinstance(value, int | float)}


def test_the_defaults_are_box2ds_own() -> None:
    """`step` has none: 1/60 s and 4 sub-steps are what its header calls usual."""
    default = tb.engine("pyb2d3", "default")
    header = files("pyb2d3").joinpath("..", "include", "box2d", "box2d.h").read_text("utf-8")
    step, sub_steps = re.findall(
        r"@param timeStep .*Usually 1/(\d+)\.\n.*@param subStepCount .*Usually (\d+)\.", header
    )[0]
    assert default.timestep == 1 / int(step)
    assert default.sub_steps == int(sub_steps)  # type: ignore[attr-defined]
    for problem in ("slider-crank", "bead", "welded-rods"):
        program: dict[str, Any] = {}
        given = benchmark(problem).problem().model_copy(update={"duration": 0.1})
        exec(default.script(given), program)  # type: ignore[attr-defined]
        bare = pyb2d3.World()
        assert _values(program["world"]) | {"id": 0} == _values(bare) | {"id": 0}
        body = bare.create_dynamic_body()
        moved = {"angle", "angular_velocity", "id", "linear_velocity_magnitude", "mass"}
        for name, made in program["bodies"].items():
            if name != "ground":
                own, found = _values(body), _values(made)
                assert {k: v for k, v in found.items() if k not in moved} == {
                    k: v for k, v in own.items() if k not in moved
                }
        for made in program["joints"].values():
            for switch in ("limit_enabled", "motor_enabled", "spring_enabled"):
                assert not getattr(made, switch, False)


def test_a_body_at_rest_falls_asleep_by_default_alone() -> None:
    """Box2D stops what hardly moves for half a second, as its worlds do that set nothing."""
    puck = tb.Body(name="puck", angle="q", mass=1.0, centre=(0.0, 0.0), inertia=0.1)
    made = tb.Mechanism(
        name="slow puck",
        bodies=(puck,),
        joints=(tb.FreeJoint(name="air", child="puck", coordinates=("x", "y")),),
        stops=(),
        gravity=0.0,
        start=(0.0, 0.0, 0.0),
        start_speeds=(0.0, 0.005, 0.0),
    )
    problem = tb.Problem(made, duration=1.0)
    way = {
        preset: tb.engine("pyb2d3", preset).simulate(problem).q[-1, 1]
        for preset in ("default", "settings", "assisted")
    }
    assert way["default"] < 0.6 * 0.005
    for preset in ("settings", "assisted"):
        assert way[preset] == pytest.approx(0.005, rel=1e3 * 2 * EPS)  # a thousand additions


@pytest.mark.parametrize("preset", PRESETS)
def test_a_hanging_rods_pin_carries_its_weight_upwards(preset: str) -> None:
    engine, weight = tb.engine("pyb2d3", preset), MASS * GRAVITY
    found = engine.simulate(tb.Problem(_rod(start=np.pi / 2), duration=0.5))
    assert found.joint_reactions["pin"][-1] == pytest.approx(
        [0.0, weight], abs=_rounding(engine) * weight
    )


@pytest.mark.parametrize("preset", PRESETS)
def test_a_stop_carries_what_holds_a_level_rod(preset: str) -> None:
    """The rod's weight times its arm, and no force of the pin to the side."""
    engine, weight = tb.engine("pyb2d3", preset), MASS * GRAVITY
    found = engine.simulate(tb.Problem(_rod(rests=True), duration=0.5))
    off = 2 * _unsettled(engine, 0.5) + _rounding(engine)
    assert found.release_times["rest"] is None
    assert found.stop_torques["rest"][-1] == pytest.approx(weight * ARM, rel=off)
    assert found.joint_reactions["pin"][-1] == pytest.approx([0.0, weight], abs=off * weight)


@pytest.mark.parametrize("preset", PRESETS)
def test_a_joint_gives_way_like_a_spring_of_60_hz(preset: str) -> None:
    """Gap of a weight on a pin through its centre of mass: g / w^2, whatever the step."""
    made, engine = _rod(), tb.engine("pyb2d3", preset)
    body = made.bodies[0].model_copy(update={"centre": (0.0, 0.0)})
    made = made.model_copy(update={"bodies": (body,)})
    found = engine.simulate(tb.Problem(made, duration=0.5))
    pace = max(1.0, (engine.world_step or 0.0) / engine.timestep)  # type: ignore[attr-defined]
    off = _unsettled(engine, found.t[-1])
    steps = len(found.t)  # each adds what is left to the gap, and rounds
    assert found.joint_gaps["pin"][-1] == pytest.approx(
        GRAVITY / (pace * OMEGA) ** 2 * (1 - off), rel=steps * EPS
    )


def test_a_swinging_rods_force_is_that_of_the_closed_form_and_of_first_order() -> None:
    """m (a - g) of the centre of mass, by the angle and energy of a rod that falls from level."""
    errors = list[float]()
    for step in (4e-3, 2e-3):
        found = tb.engine("pyb2d3", timestep=step).simulate(tb.Problem(_rod(), duration=1.0))
        angle = solve(tb.Problem(_rod(), duration=1.0)).trajectory(found.t).q[:, 0]
        # Inertia m / 3 about the pin: u^2 = 3 g sin q, du/dt = 1.5 g cos q, with q clockwise.
        along = np.exp(-1j * angle)
        centre = -ARM * 3 * GRAVITY * np.sin(angle) * along
        centre += -1j * ARM * 1.5 * GRAVITY * np.cos(angle) * along
        right = MASS * (centre + 1j * GRAVITY)
        force = found.joint_reactions["pin"] @ np.array([1.0, 1j])
        late = found.t > 0.1  # joints begin without impulses
        errors.append(float(np.abs(force - right)[late].max() / np.abs(right).max()))
    # A step's time, in which a force that turns at twice the rod's fastest speed changes by that.
    assert errors[1] < 2e-3 * 2 * np.sqrt(3 * GRAVITY)
    assert np.log2(errors[0] / errors[1]) > 0.7


def test_a_stop_that_is_met_stops_what_meets_it_and_two_on_a_pin_are_one_range() -> None:
    """The unilateral law, without a rebound: the rod then rests on its stop."""
    stops = tuple(
        tb.Stop(name=name, body="rod", sense=sense, limit=sense * limit, closed=False)
        for name, sense, limit in (("below", -1, 1.0), ("above", 1, -0.5))
    )
    made = _rod(speed=2.0).model_copy(update={"stops": stops})
    problem = tb.Problem(made, duration=2.0, stop_law=tb.StopLaw.UNILATERAL)
    found = tb.engine("pyb2d3").simulate(problem)
    step, speed = 1e-3, float(np.abs(found.u).max())
    assert found.q.max() < 1.0 + step * speed
    # Its angle is measured by an arc tangent that is 2.8e-5 rad off, and it gives way.
    weight, inertia = MASS * GRAVITY * ARM * np.cos(1.0), MASS / 12
    assert found.q[-1, 0] == pytest.approx(1.0, abs=2.8e-5 + weight / inertia / (2 * OMEGA) ** 2)
    off = 2 * _unsettled(tb.engine("pyb2d3"), 1.0) + _rounding(tb.engine("pyb2d3"))
    assert found.stop_torques["below"][-1] == pytest.approx(weight, rel=off)
    assert found.stop_torques["above"].max() == 0.0


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("model", ["fixed", "rolling"])
def test_a_stop_is_read_as_released_where_it_has_pushed_last(model: str, preset: str) -> None:
    problem, engine = tb.Problem(tb.model(model), duration=1.4), tb.engine("pyb2d3", preset)
    found, right = engine.simulate(problem), tb.engine("reference").simulate(problem)
    for name, time in right.release_times.items():
        released = found.release_times[name]
        if time is None:
            assert released is None
        else:  # two steps by the scheme and its end
            assert released == pytest.approx(time, abs=2 * engine.timestep)


@pytest.mark.parametrize(
    "name",
    [
        *("slider-crank", "oscillator", "motor", "thrown-plate", "spring-pendulum"),
        *("welded-rods", "bead", "incline", "three-cranks"),
    ],
)
def test_it_builds_every_element(name: str) -> None:
    """First order, with joints as stiff as Box2D makes them: their gaps fall with the step."""
    problem = benchmark(name).problem().model_copy(update={"duration": 0.5})
    truth, errors = solve(problem), list[float]()
    for step in (4e-3, 2e-3, 1e-3):
        engine = tb.engine("pyb2d3", timestep=step, world_step=1 / 60)
        found = engine.simulate(problem)
        right = truth.trajectory(found.t).markers
        size = max(float(np.abs(motion.position).max()) for motion in right.values())
        errors.append(
            max(np.abs(m.position - right[key].position).max() for key, m in found.markers.items())
            / size
        )
        assert all(gap.max() < 1e-2 for gap in found.joint_gaps.values())
    # Down to what single precision leaves.
    assert errors[2] < 1e-3 or np.log2(errors[0] / errors[2]) / 2 == pytest.approx(1.0, abs=0.3)


@pytest.mark.parametrize("sub_steps", [1, 4])
def test_the_free_swing_falls_with_the_first_order_to_a_floor(sub_steps: int) -> None:
    problem = tb.Problem(tb.fixed().model_copy(update={"stops": ()}), duration=2.0)
    truth, errors = solve(problem), dict[float, float]()
    for step in (16e-3 / 4 * sub_steps, 8e-3 / 4 * sub_steps, 4e-3 / 4 * sub_steps):
        engine = tb.engine("pyb2d3", timestep=step, sub_steps=sub_steps, world_step=1 / 60)
        found = engine.simulate(problem)
        right = truth.trajectory(found.t).markers
        errors[step] = max(
            float(np.abs(m.position - right[key].position).max())
            for key, m in found.markers.items()
        )
    coarse, middle, fine = errors.values()
    assert np.log2(coarse / middle) == pytest.approx(1.0, abs=0.2)
    assert np.log2(middle / fine) == pytest.approx(1.0, abs=0.2)


def test_with_joints_of_60_hz_shorter_steps_do_not_help() -> None:
    """The rest that `settings` leaves is not rounding: joints that give way less are closer."""
    problem = tb.Problem(tb.fixed().model_copy(update={"stops": ()}), duration=2.0)
    truth = solve(problem)

    def gap_and_error(step: float, world_step: float | None) -> tuple[float, float]:
        found = tb.engine("pyb2d3", timestep=step, world_step=world_step).simulate(problem)
        right = truth.trajectory(found.t).markers
        error = max(
            float(np.abs(m.position - right[key].position).max())
            for key, m in found.markers.items()
        )
        return max(float(gap.max()) for gap in found.joint_gaps.values()), error

    (gap, error), (same_gap, _) = gap_and_error(1e-3, None), gap_and_error(5e-4, None)
    stiff_gap, stiff_error = gap_and_error(1e-3, 2e-3)
    assert same_gap == pytest.approx(gap, rel=0.1)
    assert stiff_gap == pytest.approx(gap / 4, rel=0.1)  # 1 / w^2
    assert stiff_error < error / 2


def test_what_it_has_not_is_refused() -> None:
    with pytest.raises(tb.UnsupportedProblemError, match="restitution"):
        tb.engine("pyb2d3").simulate(benchmark("bouncing").problem())
    far = tb.Stop(name="far", body="rod", sense=-1, limit=-4.0, closed=False)
    turning = tb.Problem(
        _rod().model_copy(update={"stops": (far,)}),
        duration=1.0,
        stop_law=tb.StopLaw.UNILATERAL,
    )
    with pytest.raises(tb.UnsupportedProblemError, match="half a turn"):
        tb.engine("pyb2d3").simulate(turning)


def test_what_is_missing_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    from trebucheck_pyb2d3.engine import Box2D3Engine

    monkeypatch.setattr(Box2D3Engine, "module", "no_such_module")
    with pytest.raises(tb.EngineNotInstalledError, match="pyb2d3"):
        Box2D3Engine().simulate(tb.Problem(_rod(), duration=0.1))


def test_no_world_is_left_behind() -> None:
    """Box2D has room for 128 worlds; pyb2d3 aborts the process with one more."""
    import gc

    engine, problem = tb.engine("pyb2d3", "default"), tb.Problem(_rod(), duration=0.05)
    gc.disable()
    try:
        for _ in range(3):
            engine.simulate(problem)
            engine.inspect(problem.mechanism, [])  # type: ignore[attr-defined]
        worlds = [each for each in gc.get_objects() if isinstance(each, pyb2d3.World)]
    finally:
        gc.enable()
    assert worlds == []


def _bad_run(queue: Any) -> None:
    """Speeds that no number of single precision holds."""
    try:
        tb.engine("pyb2d3").simulate(tb.Problem(_rod(speed=1e39), duration=0.01))
    except tb.TrebucheckError as error:
        queue.put(str(error))
    else:
        queue.put("")


def test_a_bad_run_is_an_error_and_leaves_the_process_alive() -> None:
    context = multiprocessing.get_context("spawn")
    queue = context.Queue()
    process = context.Process(target=_bad_run, args=(queue,))
    process.start()
    said = queue.get(timeout=60)
    process.join(60)
    assert process.exitcode == 0 and said
