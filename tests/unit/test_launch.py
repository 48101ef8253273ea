"""The launch, from samples."""

from __future__ import annotations

import math

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.models.launch import (
    LAUNCH_ANGLE,
    SmoothVelocity,
    first_launch,
    launch_interval,
    locate_launch,
    rest_opened,
)

RATE, FIRST = 3.0, math.radians(120)
# 1e-15 m over 0.01 s, over a turning rate of 15 m/s^2, with room for the divided differences
ROUNDING = 1e-12


def _turning(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity of a point whose velocity, 5 + t m/s, turns clockwise from 120
    degrees."""
    along = np.exp(1j * (FIRST - RATE * t))
    velocity = (5.0 + t) * along
    position = along * ((5.0 + t) / (-1j * RATE) + 1 / RATE**2)  # its integral
    return np.stack([position.real, position.imag], axis=1), np.stack(
        [velocity.real, velocity.imag], axis=1
    )


def test_found_between_samples() -> None:
    t = np.arange(0.0, 1.0, 0.01)
    launch = locate_launch(t, *_turning(t))
    assert launch is not None
    exact = math.radians(75) / 3.0
    # Degree 15 over eight samples of 0.01 s: what is left is the rounding of positions, over a
    # step.
    assert launch.time == pytest.approx(exact, abs=ROUNDING)
    assert launch.speed == pytest.approx(5.0 + exact, abs=5 * ROUNDING)


def test_found_at_a_coarse_step() -> None:
    t = np.arange(0.0, 1.0, 0.06)
    launch = locate_launch(t, *_turning(t))
    assert launch is not None
    # Hermite remainder: (step times rate)^16 / 16! times the node polynomial, some 1e-13.
    assert launch.time == pytest.approx(math.radians(75) / 3.0, abs=1e-12)


def test_another_angle() -> None:
    t = np.arange(0.0, 1.0, 0.01)
    launch = locate_launch(t, *_turning(t), angle=math.radians(30))
    assert launch is not None
    assert launch.time == pytest.approx(math.radians(90) / 3.0, abs=ROUNDING)


def test_event_samples_on_a_grid_time_do_no_harm() -> None:
    t = np.sort(np.concatenate([np.arange(0.0, 1.0, 0.01), [0.43, 0.43 + 1e-15]]))
    launch = locate_launch(t, *_turning(t))
    assert launch is not None
    assert launch.time == pytest.approx(math.radians(75) / 3.0, abs=ROUNDING)


def test_turning_up_through_45_degrees_is_no_launch() -> None:
    t = np.arange(0.0, 0.3, 0.01)
    assert locate_launch(t, *(part[::-1] for part in _turning(t))) is None


def test_the_opposite_direction_is_no_launch() -> None:
    t = np.arange(0.0, 1.0, 0.01)
    assert locate_launch(t, *(-part for part in _turning(t))) is None


def test_two_crossings_between_two_samples() -> None:
    """The component across the direction, (t - 0.5)^2 - d^2, is positive at every sample."""
    t, d = np.arange(0.005, 1.0, 0.01), 0.003
    side = ((t - 0.5) ** 2 - d**2, (t - 0.5) ** 3 / 3 - d**2 * t)
    position, velocity = (
        np.stack([f - g, f + g], axis=1) / math.sqrt(2) for f, g in ((t, side[1]), (t**0, side[0]))
    )
    launch = locate_launch(t, position, velocity)
    assert launch is not None
    assert launch.time == pytest.approx(
        0.5 - d, abs=1e-10
    )  # rounding, 1e-15 m over 0.01 s and 0.006 m/s^2
    lifted = np.array([-1.0, 1.0]) * d**2
    assert locate_launch(t, position + t[:, None] * lifted, velocity + lifted) is None


def test_direction_counts_between_the_samples() -> None:
    """The velocity turns by a right angle within a sample interval, and has turned away at its
    end."""
    t = np.arange(0.0, 0.6, 0.1)
    along = np.exp(1j * (FIRST - 16.0 * (t - 0.1)))
    velocity, position = 5.0 * along, 5.0 * along / (-16j)
    launch = locate_launch(t, *(np.stack([z.real, z.imag], axis=1) for z in (position, velocity)))
    assert launch is not None
    assert launch.time == pytest.approx(0.1 + math.radians(75) / 16.0, abs=1e-5)


def test_only_after_the_rest_has_opened() -> None:
    t = np.arange(0.0, 1.0, 0.01)
    assert locate_launch(t, *_turning(t), after=0.5) is None


def test_a_handful_of_samples_will_do() -> None:
    t = np.array([0.4, 0.45])
    assert locate_launch(t, *_turning(t)) is not None


def test_a_projectile_on_its_rest_is_not_launched() -> None:
    """Its rest never opens, though its velocity turns down through 45 degrees as the whole machine
    swings.
    """
    machine = tb.fixed()
    times = {"hanger rest": 1.0, "sling rest": None, "arm stop": None}
    assert rest_opened(machine, "sling", times) is None
    assert rest_opened(machine, "sling", {**times, "sling rest": 1.4}) == 1.4
    assert rest_opened(machine, "arm", times) == 0.0


def _circling(rate: float, start: float) -> SmoothVelocity:
    """A velocity of 3 m/s that turns anticlockwise at a rate, in a hundred steps of 1 s."""

    def at(t: np.ndarray) -> np.ndarray:
        along = 3.0 * np.exp(1j * (start + rate * t))
        return np.stack([along.real, along.imag], axis=1)

    return SmoothVelocity(np.linspace(0.0, 1.0, 101), at)


@pytest.mark.parametrize("time", [0.013, 0.32, 0.33, 0.5, 0.987])
def test_a_launch_in_any_of_many_steps(time: float) -> None:
    launch = first_launch([_circling(-1.0, LAUNCH_ANGLE + time)])
    assert launch is not None
    assert launch.time == pytest.approx(time, abs=1e-14)
    assert launch.velocity == pytest.approx([3.0 * math.sqrt(0.5)] * 2, rel=1e-13)


@pytest.mark.parametrize("time", [0.013, 0.32, 0.33, 0.5, 0.987])
def test_no_launch_in_many_steps(time: float) -> None:
    """The velocity turns up through the direction, or down through its opposite."""
    assert first_launch([_circling(1.0, LAUNCH_ANGLE - time)]) is None
    assert first_launch([_circling(1.0, LAUNCH_ANGLE + math.pi - time)]) is None


@pytest.mark.parametrize("beside", [-3e-15, 0.0, 1e-15, 5e-15])
def test_a_sample_at_the_launch_itself(beside: float) -> None:
    """Whatever rounding makes of the component across the direction, which is zero there."""
    rate, shift = 7.0, 1e3 * np.array([1.0, -2.0])
    for step in (0.008, 0.01, 0.013):
        t = 0.3 + step * np.arange(12)
        along = np.exp(1j * (LAUNCH_ANGLE + beside - rate * (t - t[6])))
        velocity = 4.0 * np.stack([along.real, along.imag], axis=1)
        along /= -1j * rate / 4.0
        launch = locate_launch(t, np.stack([along.real, along.imag], axis=1) + shift, velocity)
        assert launch is not None
        assert launch.time == pytest.approx(t[6], abs=1e-9)


def test_the_interval_of_a_launch() -> None:
    """Down through the direction, clockwise: not up, and not through its opposite."""
    turning = np.exp(1j * np.radians([60, 30, -90, -120, -150, 170, 60, 20]))
    velocity = np.stack([turning.real, turning.imag], axis=1)
    assert launch_interval(velocity) == 0
    assert launch_interval(velocity[1:]) == 5
    assert launch_interval(velocity[1:6]) is None
    assert launch_interval(velocity[4:2:-1]) is None
    assert launch_interval(velocity, math.radians(-100)) == 2
    assert launch_interval(-velocity, math.radians(80)) == 2
