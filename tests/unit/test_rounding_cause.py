"""Rounding as a cause: errors of known laws of the step are told apart by runs at other steps."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from trebucheck.comparisons.diagnosis.rerun import rounding_causes
from trebucheck.models.arrays import FloatArray

SIZE, STEP = 4000, 0.01
RANDOM = np.random.default_rng(0)
SHAPE, OTHER = RANDOM.standard_normal((2, SIZE))
UNCERTAIN = 5 / SIZE**0.5
"""Of a size or a product of random vectors of so many numbers, five standard deviations."""

Error = Callable[[float], FloatArray]


def noise() -> FloatArray:
    return np.random.default_rng(RANDOM.integers(2**32)).standard_normal(SIZE)


def shares(error: Error) -> dict[str, float]:
    causes = rounding_causes(error(STEP), STEP, error)
    return {cause.name: cause.explained for cause in causes}


@pytest.mark.parametrize("order", [1, 2])
def test_an_error_of_an_order_is_the_steps(order: int) -> None:
    found = shares(lambda h: SHAPE * (h / STEP) ** order)
    assert found["time step"] == pytest.approx(1.0, abs=1e-9)
    # Steps that differ by e = 1e-4 differ in their error by a part of order * e: by a share of
    # (order * e)^2 / 4 it passes for noise.
    assert abs(found["rounding to single precision"]) < 1e-7
    assert len(found) == 2


def test_motions_that_differ_by_as_much_as_they_are_off_are_rounded() -> None:
    found = shares(lambda _: noise())
    assert found["rounding to single precision"] > 1.0 - (2 * UNCERTAIN) ** 0.5
    assert found["time step"] < UNCERTAIN


@pytest.mark.parametrize("power", [1, 2])
def test_what_grows_with_the_number_of_steps_is_rounding(power: int) -> None:
    found = shares(lambda h: SHAPE * (STEP / h) ** power)
    assert found["rounding to single precision"] > 0.9
    assert found["time step"] < 0.1


def test_both_are_told_together() -> None:
    # A random walk of the steps. Two runs tell the step's error, with sqrt(1/2 + 1/4) / 2 of the
    # noise: of sqrt(1.25) both leave sqrt(3 / 16) 0.5, and the step alone sqrt(19 / 16) 0.5.
    found = shares(lambda h: SHAPE * h / STEP + 0.5 * (STEP / h) ** 0.5 * noise())
    both, alone = found["time step, rounding to single precision"], found["time step"]
    assert both == pytest.approx(1.0 - (0.75 / 16 / 1.25) ** 0.5, abs=3 * UNCERTAIN)
    assert alone == pytest.approx(1.0 - (4.75 / 16 / 1.25) ** 0.5, abs=UNCERTAIN)


def test_an_error_that_no_step_changes_is_neither() -> None:
    found = shares(lambda _: SHAPE)
    assert max(found.values()) < 1e-9


def test_a_fault_beside_a_little_noise_is_neither() -> None:
    found = shares(lambda h: SHAPE + 0.1 * noise() + 0.1 * OTHER * h / STEP)
    assert max(found.values()) < 0.1


def test_without_runs_there_is_no_cause() -> None:
    assert list(rounding_causes(SHAPE, STEP, lambda _: None)) == []
