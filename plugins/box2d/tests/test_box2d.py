"""Box2D against the reference, and the floor of its precision; orders and limits are in
`plugins/tests`."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.comparisons.diagnosis.equivalence import check_model
from trebucheck.models.library.registry import benchmark
from trebucheck.reference.solver import solve

FREE_SWING = tb.Problem(tb.fixed().model_copy(update={"stops": ()}), duration=2.0)


def _end(step: float, iterations: int) -> np.ndarray:
    found = tb.engine("box2d", timestep=step, velocity_iterations=iterations).simulate(FREE_SWING)
    return np.array([motion.position[-1] for motion in found.markers.values()])


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


@pytest.mark.parametrize("name", ["slider-crank", "chain", "thrown-plate", "spring-pendulum"])
def test_the_world_is_read_back_and_a_fault_in_it_is_found(name: str) -> None:
    engine, mechanism = tb.engine("box2d"), benchmark(name).problem().mechanism
    assert check_model(engine, mechanism).holds
    first = mechanism.bodies[0]
    heavy = mechanism.model_copy(
        update={
            "bodies": (first.model_copy(update={"mass": 1.001 * first.mass}), *mechanism.bodies[1:])
        }
    )
    wrong = SimpleNamespace(
        name="box2d",
        inspect=lambda _, states: engine.inspect(heavy, states),  # type: ignore[attr-defined]
    )
    assert not check_model(wrong, mechanism).holds  # type: ignore[arg-type]


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
