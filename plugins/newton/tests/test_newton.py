"""Newton against the reference, and its measured order."""

from types import SimpleNamespace

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.comparisons.diagnosis.equivalence import check_model
from trebucheck.models.library.registry import benchmark
from trebucheck.reference.solver import solve

FREE_SWING = tb.Problem(tb.fixed().model_copy(update={"stops": ()}), duration=2.0)


def _error(preset: str, step: float, **options: str) -> float:
    """Greatest distance of a marker from where it should be [m]."""
    found = tb.engine("newton", preset, timestep=step, **options).simulate(FREE_SWING)
    truth = solve(FREE_SWING).trajectory(found.t)
    return max(
        float(np.abs(m.position - truth.markers[name].position).max())
        for name, m in found.markers.items()
    )


def test_featherstone_is_of_first_order() -> None:
    coarse, fine = (_error("settings", step, solver="featherstone") for step in (8e-3, 4e-3))
    assert np.log2(coarse / fine) == pytest.approx(1.0, abs=0.2)


def test_mujoco_is_at_the_floor_of_single_precision() -> None:
    """A state of 10 rad is rounded by 5e-7 in each of 500 steps, at 16 m: sqrt(500) times, if the
    signs are random."""
    assert _error("assisted", 4e-3) < np.sqrt(500) * 5e-7 * 16


@pytest.mark.parametrize("preset", ["assisted", "settings"])
@pytest.mark.parametrize("model", ["fixed", "rolling"])
def test_its_limits_release_in_the_step_of_the_reference(model: str, preset: str) -> None:
    problem = tb.Problem(tb.model(model), duration=1.3)
    found = tb.engine("newton", preset).simulate(problem)
    truth = solve(tb.Problem(problem.mechanism, duration=1.31)).trajectory(found.t)
    for name, time in truth.release_times.items():
        assert (found.release_times[name] is None) == (time is None)
        assert time is None or abs(found.release_times[name] - time) <= 2e-3
        # 25 times of the limits' time constant (damping over stiffness, 0.02 s) after the start
        # they have settled.
        settled = found.t > 0.5
        error = np.abs(found.stop_torques[name] - truth.stop_torques[name])[settled].max()
        assert error <= 1e-2 * max(truth.stop_torques[name].max(), 1.0)


def test_loops_are_refused() -> None:
    with pytest.raises(tb.UnsupportedProblemError, match="loop"):
        tb.engine("newton").simulate(benchmark("slider-crank").problem())


@pytest.mark.parametrize(
    "mechanism", [tb.fixed(), tb.rolling(), benchmark("thrown-plate").problem().mechanism]
)
def test_the_built_model_is_shown_and_a_fault_in_it_is_found(mechanism: tb.Mechanism) -> None:
    engine, first = tb.engine("newton"), mechanism.bodies[0]
    assert check_model(engine, mechanism).holds
    # Its inspection of a mechanism whose first body is too heavy by 1e-3, for one of the right
    # mass.
    heavy = mechanism.model_copy(
        update={
            "bodies": (first.model_copy(update={"mass": 1.001 * first.mass}), *mechanism.bodies[1:])
        }
    )
    wrong = SimpleNamespace(
        name="newton",
        capabilities=engine.capabilities,
        inspect=lambda _, states: engine.inspect(heavy, states),  # type: ignore[attr-defined]
    )
    assert not check_model(wrong, mechanism).holds  # type: ignore[arg-type]
