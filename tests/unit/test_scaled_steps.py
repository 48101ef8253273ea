"""Steps of presets on the library's problems: scaled, and not below what numbers carry."""

from dataclasses import replace

import numpy as np
import pytest
import trebucheck.comparisons.runs.study as module
from trebucheck.comparisons.runs import tolerances
from trebucheck.comparisons.runs.scales import Scales, scales_until
from trebucheck.comparisons.runs.study import Study
from trebucheck.engines.presets import ASSISTED, DEFAULT, SETTINGS
from trebucheck.engines.registry import engine_study
from trebucheck.models.library.registry import benchmark
from trebucheck.reference.solver import solve


def _scales(name: str) -> Scales:
    problem = benchmark(name).problem()
    return scales_until(solve(problem), problem.duration)


def _step(name: str, scales: Scales, preset: str = SETTINGS) -> tuple[float, float]:
    """Step on a problem, and that of the preset [s]."""
    study = Study([name], ["mujoco"], [preset])
    made = study.engine("mujoco", preset)
    step = study.engine_for(name, scales, made).timestep
    assert step is not None and made.timestep is not None
    return step, made.timestep


def _single(monkeypatch: pytest.MonkeyPatch, additions: int = 1) -> None:
    """Take MuJoCo for an engine of single precision."""
    single = replace(
        engine_study("mujoco"), single_precision=lambda _: True, additions=lambda _: additions
    )
    for each in (module, tolerances):
        monkeypatch.setattr(each, "engine_study", lambda _: single)


def test_a_step_is_a_part_of_the_characteristic_time_and_the_defaults_is_its_own() -> None:
    scales = _scales("thrown-plate")
    step, of_preset = _step("thrown-plate", scales)
    assert step == pytest.approx(of_preset * scales.time, rel=0.05)  # two digits
    step, of_preset = _step("thrown-plate", scales, DEFAULT)
    assert step == of_preset


def test_steps_of_settings_are_no_longer_than_those_of_the_default() -> None:
    """On a mechanism that is slow: of a problem of 8 s MuJoCo's 1 ms would be 8 ms."""
    slow = _scales("pendulum").model_copy(update={"time": 8.0})
    _, default = _step("pendulum", slow, DEFAULT)
    assert _step("pendulum", slow)[0] == default
    assert _step("pendulum", slow, ASSISTED)[0] > default


def test_single_precision_has_a_shortest_step_and_substeps_lengthen_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scales = _scales("thrown-plate")
    short, _ = _step("thrown-plate", scales)
    least = 0.5 * float(np.finfo(np.float32).eps) / 1e-3 * scales.way / scales.speed
    assert short < least < 4 * least < 1e-3
    _single(monkeypatch)
    assert _step("thrown-plate", scales)[0] == pytest.approx(least, rel=0.05)
    _single(monkeypatch, additions=4)
    assert _step("thrown-plate", scales)[0] == pytest.approx(4 * least, rel=0.05)
    assert _step("thrown-plate", scales, DEFAULT)[0] == _step("thrown-plate", scales, DEFAULT)[1]


def test_a_step_that_single_precision_carries_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    scales = _scales("pendulum")
    before = _step("pendulum", scales)
    _single(monkeypatch)
    assert _step("pendulum", scales) == before


def test_what_a_shortest_step_bounds_is_a_sum_rounded_to_one_side() -> None:
    """A steady motion in single precision is off by more than 1e-3 at an eighth of that step."""
    way, speed = 1.0, 1.0
    least = 0.5 * float(np.finfo(np.float32).eps) / 1e-3 * way / speed

    def error(step: float) -> float:
        """Of the sum over the last binade before the way, for a speed near to the given one."""
        steps = round(0.5 * way / (speed * step))
        worst = 0.0
        for part in np.linspace(0.9, 1.0, 7):
            place, move = np.float32(0.5), np.float32(part * speed * step)
            for _ in range(steps):
                place += move
            worst = max(worst, abs(float(place) - 0.5 - steps * float(move)))
        return worst

    assert error(least) <= 1e-3 * way
    assert error(least / 8) > 1e-3 * way
