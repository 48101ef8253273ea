"""Samples around events.

None is missing, none is there twice, and an event's state is the later one.
"""

from __future__ import annotations

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.models.problem import StopLaw

LOCATING = ["mujoco", "exudyn"]  # engines that step onto an event
STEP = 7e-3


def _off_the_grid(t: np.ndarray, duration: float) -> list[float]:
    """Times that are no multiple of the step, but for the end; every multiple must be there."""
    assert (np.diff(t) > 0).all() and t[0] == 0.0 and t[-1] == duration
    whole = np.arange(int(duration / STEP) + 1) * STEP
    assert max(float(np.abs(t - k).min()) for k in whole) < 1e-12
    return [x for x in t[:-1].tolist() if np.abs(whole - x).min() > 1e-12]


@pytest.mark.parametrize("engine", LOCATING)
def test_a_release_adds_one_sample_at_its_time(engine: str) -> None:
    pytest.importorskip(engine)
    problem = tb.Problem(tb.rolling(), duration=1.0)
    run = tb.engine(engine, timestep=STEP).simulate(problem)
    (release,) = [time for time in run.release_times.values() if time is not None]
    if engine == "exudyn":  # its steps after an event start there
        assert np.abs(run.t - release).min() == 0.0 and (np.diff(run.t) < STEP * 1.001).all()
        return
    assert _off_the_grid(run.t, 1.0) == [release]
    (name,) = [name for name, time in run.release_times.items() if time is not None]
    torque = run.stop_torques[name]
    assert torque[run.t < release].min() > 0.0
    assert not torque[run.t > release].any()


def test_an_impact_adds_one_sample_with_the_state_after_it() -> None:
    pytest.importorskip("mujoco")
    duration = 1.0
    problem = tb.Problem(tb.model("bouncing"), duration, stop_law=StopLaw.UNILATERAL)
    run = tb.engine("mujoco", timestep=STEP).simulate(problem)
    times = [time for time, _ in run.impacts]
    assert times and _off_the_grid(run.t, duration) == times
    truth = tb.engine("reference", timestep=STEP).simulate(problem)
    assert times == pytest.approx([time for time, _ in truth.impacts], abs=1e-6)
    for time in times:
        k = int(np.argmin(np.abs(run.t - time)))
        assert (run.u[k + 1] - run.u[k]).max() == pytest.approx(0.0, abs=0.2)  # no jump after it
        assert np.abs(run.u[k] - run.u[k - 1]).max() > 1.0  # the jump is before it
