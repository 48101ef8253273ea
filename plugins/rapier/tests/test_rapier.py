"""Rapier against the reference, its measured order and the floor of its precision."""

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.models.problems.registry import benchmark
from trebucheck.reference.solver import solve
from trebucheck_rapier import bridge

FREE_SWING = tb.Problem(tb.fixed().model_copy(update={"stops": ()}), duration=2.0)


def _error(problem: tb.Problem, preset: str, step: float) -> float:
    """Greatest distance of a marker from where it should be [m]."""
    found = tb.engine("rapier", preset, timestep=step).simulate(problem)
    truth = solve(problem).trajectory(found.t)
    return max(float(np.abs(m.position - truth.markers[name].position).max()) for name, m in found.markers.items())


@pytest.mark.parametrize("preset", ["stock", "tuned"])
def test_it_is_of_first_order(preset: str) -> None:
    ratio = _error(FREE_SWING, preset, 16e-3) / _error(FREE_SWING, preset, 8e-3)
    assert np.log2(ratio) == pytest.approx(1.0, abs=0.3)


@pytest.mark.parametrize("model", ["fixed", "rolling"])
def test_it_agrees_with_stops(model: str) -> None:
    problem = tb.Problem(tb.model(model), duration=1.3)
    found = tb.engine("rapier").simulate(problem)
    truth = solve(problem).trajectory(found.t)
    # First order: 6e-3 m at 8 ms are 7e-4 m at 1 ms; and a thousandth of a mass in the slot, on 20 m of way.
    for name, motion in found.markers.items():
        assert np.abs(motion.position - truth.markers[name].position).max() < 5e-3
    for name, time in truth.release_times.items():
        if tb.model(model).stop(name).closed:
            assert (found.release_times[name] is None) == (time is None)
            # Speeds of some 5e-3 rad/s are the rounding of a limit; the opening gap has that speed after 1e-2 s.
            assert time is None or abs(found.release_times[name] - time) < 1e-2


def test_a_stop_stays_where_it_is_over_many_turns() -> None:
    """Rapier knows an angle within half a turn: a stop at one and a half turns is met there and not before."""
    rod = tb.Body(name="rod", angle="a", mass=1.0, centre=(0.5, 0.0), inertia=0.1)
    pin = tb.PinJoint(name="pin", parent="ground", child="rod", parent_point=(0, 0), child_point=(0, 0))
    stop = tb.Stop(name="end", body="rod", sense=-1, limit=-3 * np.pi, closed=False)
    made = tb.Mechanism(
        name="turning", bodies=(rod,), joints=(pin,), stops=(stop,), gravity=9.81, start=(0.0,), start_speeds=(12.0,),
        markers=(tb.Marker(name="tip", body="rod", point=(1, 0)),),
    )  # fmt: skip
    problem = tb.Problem(made, duration=1.0, stop_law=tb.StopLaw.UNILATERAL)
    turned = tb.engine("rapier").simulate(problem).q[:, 0]
    assert turned.max() == pytest.approx(3 * np.pi, abs=1e-3)


@pytest.mark.parametrize(
    "name", ["slider-crank", "incline", "oscillator", "motor", "thrown-plate", "spring-pendulum", "welded-rods"]
)
def test_it_builds_every_element(name: str) -> None:
    problem = benchmark(name).problem().model_copy(update={"duration": 0.4})
    size = max(
        float(np.abs(m.position).max()) for m in solve(problem).trajectory(np.array([0.0, 0.4])).markers.values()
    )
    coarse, fine = (_error(problem, "tuned", step) / size for step in (4e-3, 2e-3))
    # Of first order, down to what single precision leaves.
    assert fine < 1e-3 or np.log2(coarse / fine) == pytest.approx(1.0, abs=0.3)


def test_what_it_has_not_is_refused() -> None:
    with pytest.raises(tb.UnsupportedProblemError, match="stops on points"):
        tb.engine("rapier").simulate(benchmark("bouncing").problem())


def test_what_is_missing_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(tb.EngineNotInstalledError, match=r"no program `node` is on the path\.$"):
        tb.engine("rapier").simulate(FREE_SWING)
    assert bridge.version() == "not installed"
