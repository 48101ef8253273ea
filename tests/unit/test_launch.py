"""The launch, from samples."""

from __future__ import annotations

import math

import numpy as np
import pytest
from trebucheck.models.launch import locate_launch


def _turning(t: np.ndarray, rate: float = 3.0) -> np.ndarray:
    """A velocity of 5 + t m/s that turns clockwise from 120 degrees."""
    angle = math.radians(120) - rate * t
    return (5.0 + t)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def test_found_between_samples() -> None:
    t = np.arange(0.0, 1.0, 0.01)
    launch = locate_launch(t, _turning(t))
    assert launch is not None
    exact = math.radians(75) / 3.0
    # Eighth-order interpolation: (step times rate)^8 / 8! is below 1e-16.
    assert launch.time == pytest.approx(exact, abs=1e-14)
    assert launch.speed == pytest.approx(5.0 + exact, abs=1e-13)


def test_another_angle() -> None:
    t = np.arange(0.0, 1.0, 0.01)
    launch = locate_launch(t, _turning(t), angle=math.radians(30))
    assert launch is not None
    assert launch.time == pytest.approx(math.radians(90) / 3.0, abs=1e-14)


def test_event_samples_on_a_grid_time_do_no_harm() -> None:
    t = np.sort(np.concatenate([np.arange(0.0, 1.0, 0.01), [0.43, 0.43 + 1e-15]]))
    launch = locate_launch(t, _turning(t))
    assert launch is not None
    assert launch.time == pytest.approx(math.radians(75) / 3.0, abs=1e-14)


def test_turning_up_through_45_degrees_is_no_launch() -> None:
    t = np.arange(0.0, 0.3, 0.01)
    assert locate_launch(t, _turning(t)[::-1]) is None


def test_the_opposite_direction_is_no_launch() -> None:
    t = np.arange(0.0, 1.0, 0.01)
    assert locate_launch(t, -_turning(t)) is None


def test_only_after_the_rest_has_opened() -> None:
    t = np.arange(0.0, 1.0, 0.01)
    assert locate_launch(t, _turning(t), after=0.5) is None


def test_a_handful_of_samples_will_do() -> None:
    t = np.array([0.4, 0.45])
    assert locate_launch(t, _turning(t)) is not None
