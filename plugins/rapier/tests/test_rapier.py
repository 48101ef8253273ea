"""Rapier's defaults, Rapier against the reference; orders and limits are in `plugins/tests`."""

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.models.library.registry import benchmark
from trebucheck.reference.solver import solve
from trebucheck_rapier.engine import RapierEngine

FREE_SWING = tb.Problem(tb.fixed().model_copy(update={"stops": ()}), duration=2.0)


def _error(problem: tb.Problem, step: float) -> float:
    """Greatest distance of a marker from where it should be [m]."""
    found = tb.engine("rapier", timestep=step).simulate(problem)
    truth = solve(problem).trajectory(found.t)
    return max(
        float(np.abs(m.position - truth.markers[name].position).max())
        for name, m in found.markers.items()
    )


def test_the_defaults_are_rapiers_own() -> None:
    """Those of a world and a body that set nothing, its step among them."""
    own = RapierEngine.npm.run(
        """
        import R from "@dimforge/rapier2d-compat";
        await R.init({});
        const world = new R.World({ x: 0, y: 0 });
        console.log(JSON.stringify({
          timestep: world.timestep, substeps: world.numSolverIterations,
          passes: world.numInternalPgsIterations, sleep: R.RigidBodyDesc.dynamic().canSleep,
        }));
        """
    )
    default = tb.engine("rapier", "default")
    assert own == {
        "timestep": default.timestep,
        "substeps": default.substeps,
        "passes": default.passes,
        "sleep": default.allow_sleep,
    }
    # The program sets none of them.
    program = default.script(tb.Problem(tb.fixed(), duration=0.1))
    assert not any(word in program for word in ("world.timestep", "world.num", "setCanSleep"))


def test_slots_and_far_stops_are_refused_alone() -> None:
    """A carriage in a slot is trebucheck's; a limit that is set once is within half a turn."""
    with pytest.raises(tb.UnsupportedProblemError, match="builds no slots"):
        tb.engine("rapier", "default").simulate(tb.Problem(tb.rolling(), duration=0.5))
    with pytest.raises(tb.UnsupportedProblemError, match="our adapter sets limits"):
        tb.engine("rapier", "default").simulate(_turning())
    with pytest.raises(tb.UnsupportedProblemError, match="our adapter sets limits"):
        tb.engine("rapier", move_limits=False).simulate(_turning())


@pytest.mark.parametrize("options", [{"move_limits": False}, {"opening": None}])
def test_each_part_of_what_helps_limits_can_be_off_alone(options: dict[str, object]) -> None:
    """The stops of the fixed machine are near: they hold it all the same."""
    problem = tb.Problem(tb.fixed(), duration=0.6)
    right = solve(problem)
    found = tb.engine("rapier", **options).simulate(problem)
    assert np.abs(found.q - right.trajectory(found.t).q).max() < 1e-3


def _turning() -> tb.Problem:
    """A rod with a stop at one and a half turns."""
    rod = tb.Body(name="rod", angle="a", mass=1.0, centre=(0.5, 0.0), inertia=0.1)
    pin = tb.PinJoint(
        name="pin", parent="ground", child="rod", parent_point=(0, 0), child_point=(0, 0)
    )
    stop = tb.Stop(name="end", body="rod", sense=-1, limit=-3 * np.pi, closed=False)
    made = tb.Mechanism(
        name="turning",
        bodies=(rod,),
        joints=(pin,),
        stops=(stop,),
        gravity=9.81,
        start=(0.0,),
        start_speeds=(12.0,),
        markers=(tb.Marker(name="tip", body="rod", point=(1, 0)),),
    )
    return tb.Problem(made, duration=1.0, stop_law=tb.StopLaw.UNILATERAL)


def test_a_stop_stays_where_it_is_over_many_turns() -> None:
    """Rapier knows an angle within half a turn: a stop at one and a half turns is met there and not
    before."""
    turned = tb.engine("rapier").simulate(_turning()).q[:, 0]
    assert turned.max() == pytest.approx(3 * np.pi, abs=1e-3)


@pytest.mark.parametrize(
    "name",
    [
        "slider-crank",
        "incline",
        "oscillator",
        "motor",
        "thrown-plate",
        "spring-pendulum",
        "welded-rods",
    ],
)
def test_it_builds_every_element(name: str) -> None:
    problem = benchmark(name).problem().model_copy(update={"duration": 0.4})
    size = max(
        float(np.abs(m.position).max())
        for m in solve(problem).trajectory(np.array([0.0, 0.4])).markers.values()
    )
    coarse, fine = (_error(problem, step) / size for step in (4e-3, 2e-3))
    # Of first order, down to what single precision leaves.
    assert fine < 1e-3 or np.log2(coarse / fine) == pytest.approx(1.0, abs=0.3)


def test_what_it_has_not_is_refused() -> None:
    with pytest.raises(tb.UnsupportedProblemError, match="stops on points"):
        tb.engine("rapier").simulate(benchmark("bouncing").problem())
