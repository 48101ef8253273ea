"""Box2D's defaults, Box2D against the reference, and the floor of its precision; orders, limits and
presets are in `plugins/tests`."""

import ast
from importlib.resources import files
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.models.library.registry import benchmark
from trebucheck.reference.solver import solve

FREE_SWING = tb.Problem(tb.fixed().model_copy(update={"stops": ()}), duration=2.0)


def _end(step: float, iterations: int) -> np.ndarray:
    found = tb.engine("box2d", timestep=step, velocity_iterations=iterations).simulate(FREE_SWING)
    return np.array([motion.position[-1] for motion in found.markers.values()])


def _numbers(thing: object, leave: tuple[str, ...]) -> dict[str, object]:
    """Numbers and switches of an object of Box2D's, by name."""
    values = {
        name: getattr(thing, name)
        for name in dir(thing)
        if not name.startswith("_") and name not in leave
    }
    return {name: value for name, value in values.items() if isinstance(value, int | float)}


def test_the_defaults_are_box2ds_own() -> None:
    """`Step` has none: step and iterations of its first example; all else as Box2D makes it."""
    import Box2D

    default, found = tb.engine("box2d", "default"), dict[str, object]()
    example = ast.parse(files("Box2D").joinpath("examples/hello.py").read_text(encoding="utf-8"))
    for node in example.body:
        if isinstance(node, ast.Assign):
            code = compile(ast.Expression(node.value), "hello.py", "eval")
            if "iters" in ast.dump(node) or "timeStep" in ast.dump(node):
                value = eval(code)
                (target,) = node.targets
                names = target.elts if isinstance(target, ast.Tuple) else [target]
                values = value if isinstance(target, ast.Tuple) else (value,)
                found |= {name.id: each for name, each in zip(names, values, strict=True)}
    assert found == {
        "timeStep": default.timestep,
        "vel_iters": default.velocity_iterations,
        "pos_iters": default.position_iterations,
    }
    for problem in ("slider-crank", "bead", "welded-rods"):
        program: dict[str, Any] = {}
        given = benchmark(problem).problem().model_copy(update={"duration": 0.1})
        exec(default.script(given), program)
        bare, world = Box2D.b2World(), program["world"]
        body = bare.CreateDynamicBody()
        counts = ("bodyCount", "jointCount", "contactCount", "proxyCount")
        assert _numbers(world, counts) == _numbers(bare, counts)
        moved = ("angle", "angularVelocity", "inertia", "mass", "awake")
        for name, made in program["bodies"].items():
            if name != "ground":
                assert _numbers(made, moved) == _numbers(body, moved)
        for made in program["joints"].values():
            assert not getattr(made, "limitEnabled", False)
            assert not getattr(made, "motorEnabled", False)


def test_a_body_at_rest_falls_asleep_by_default_alone() -> None:
    """Box2D stops what hardly moves for half a second, as its worlds do that set nothing."""
    rod = tb.Body(name="rod", angle="q", mass=1.0, centre=(0.5, 0.0), inertia=0.1)
    made = tb.Mechanism(
        name="slow rod",
        bodies=(rod,),
        joints=(
            tb.PinJoint(
                name="pin", parent="ground", child="rod", parent_point=(0, 0), child_point=(0, 0)
            ),
        ),
        stops=(),
        gravity=0.0,
        start=(0.0,),
        start_speeds=(0.01,),
    )
    problem = tb.Problem(made, duration=1.0)
    assert tb.engine("box2d", "default").simulate(problem).u[-1, 0] == 0.0
    for preset in ("settings", "assisted"):
        end = tb.engine("box2d", preset).simulate(problem).u[-1, 0]
        assert end == pytest.approx(0.01, rel=1e-4)


@pytest.mark.parametrize("preset", ["default", "settings"])
@pytest.mark.parametrize("model", ["fixed", "rolling"])
def test_a_stop_is_read_as_released_where_it_has_pushed_last(model: str, preset: str) -> None:
    """Its limit pauses where rounding leaves the angle short of it; that is no release."""
    problem, engine = tb.Problem(tb.model(model), duration=1.4), tb.engine("box2d", preset)
    found, right = engine.simulate(problem), tb.engine("reference").simulate(problem)
    for name, time in right.release_times.items():
        released = found.release_times[name]
        if time is None:
            assert released is None
        else:  # two steps by the scheme and its end; rounding as with assistance
            assert released == pytest.approx(time, abs=2 * engine.timestep + 5e-3)


def test_limits_where_the_stops_are_let_go_at_once() -> None:
    """A limit is active only where the angle is not short of it, which rounding decides."""
    problem = tb.Problem(tb.fixed(), duration=0.3)
    assert tb.engine("box2d").simulate(problem).release_times["sling rest"] is None
    assert (
        tb.engine("box2d", set_back=0.0).simulate(problem).release_times["sling rest"] is not None
    )


def test_reactions_are_forces_on_the_child() -> None:
    problem = tb.Problem(tb.rolling(), duration=0.75)
    found = tb.engine("box2d").simulate(problem)
    truth = solve(problem).trajectory(found.t).joint_reactions
    for name, force in found.joint_reactions.items():
        assert np.abs(force - truth[name]).max() < 0.02 * np.abs(truth[name]).max()


@pytest.mark.parametrize(
    "name", ["slider-crank", "quick-return", "oscillator", "motor", "thrown-plate", "welded-rods"]
)
def test_it_builds_every_element(name: str) -> None:
    problem = benchmark(name).problem().model_copy(update={"duration": 0.5})
    truth, errors = solve(problem), list[float]()
    for step in (1e-3, 5e-4):
        found = tb.engine("box2d", timestep=step).simulate(problem)
        right = truth.trajectory(found.t).markers
        size = max(float(np.abs(motion.position).max()) for motion in right.values())
        errors.append(
            max(np.abs(m.position - right[key].position).max() for key, m in found.markers.items())
            / size
        )
        assert all(gap.max() < 1e-3 for gap in found.joint_gaps.values())
    # Of first order, down to what single precision leaves.
    assert errors[1] < 1e-3 or np.log2(errors[0] / errors[1]) == pytest.approx(1.0, abs=0.3)


def test_rebounds_and_stops_on_points_are_refused() -> None:
    with pytest.raises(tb.UnsupportedProblemError, match="restitution"):
        tb.engine("box2d").simulate(benchmark("bouncing").problem())


def test_the_rounding_of_the_iterations_is_less_with_many() -> None:
    """Richardson's limit of steps 4 and 2 ms: with 20 000 iterations a second-order remainder, with
    100 a bias."""
    right = solve(FREE_SWING).trajectory(np.array([2.0]))
    end = np.array([motion.position[-1] for motion in right.markers.values()])
    ends = {n: [_end(step, n) for step in (8e-3, 4e-3, 2e-3)] for n in (100, 20_000)}
    left = {
        n: [np.abs(2 * fine - coarse - end).max() for coarse, fine in pairwise(each)]
        for n, each in ends.items()
    }
    assert left[20_000][0] / left[20_000][1] == pytest.approx(4.0, rel=0.4)
    assert left[100][1] > 3 * left[20_000][1]
