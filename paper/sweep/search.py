"""How a faulty root search might come by what the paper shows below its threshold.

The paper takes each rest away where its multiplier first comes to zero. How it finds that zero it does not say. If by
Newton's method from one guess for every place of the fulcrum, there is a place below which the search ends elsewhere:
on the zero of the swing back, or on none at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import bisect

from ...models.arrays import BoolArray, ComplexArray, FloatArray
from ...models.launch import lead
from ...models.machines.trebuchet import HANGER_REST, PROJECTILE, SLING_REST
from ...models.problem import Problem
from ...reference.perturbed import solve_scheduled
from ...reference.solution import Solution
from .laws import first_zero
from .results import EarlyCrossing, RootSearch, WrongZero
from .rigid_swing import Whole, pendulum

_ITERATIONS = 50  # Newton's method doubles its digits in each: whatever has not ended by then wanders
_FOUND = 1e-9  # [s] of the last step
_SAME = 1e-6  # [s] zeros are seconds apart
_GUESSES = (0.1, 1.0)  # [s] a matching guess is looked for between these
_SCAN = 1e-3  # [s] for crossings of the 45 deg line
_AFTER = 5.0  # [s] of motion looked at after the hanger's late release


@dataclass(frozen=True)
class Places:
    """Newton's method on the hanger's torque, both rests held, at many places of the fulcrum at once."""

    l1: FloatArray
    wholes: tuple[Whole, ...]

    def search(self, guess: float, asked: Sequence[float]) -> RootSearch:
        """From one guess [s] everywhere.

        Args:
            asked: l1 of places whose success is wanted one by one [m].
        """
        first, later = self._ends(guess)
        missed = np.flatnonzero(~first)
        lowest = int(missed[-1]) + 1 if len(missed) else 0
        below = slice(0, lowest)
        return RootSearch(
            guess=guess,
            lowest=float(self.l1[lowest]) if lowest < len(self.l1) else None,
            later_zero=int(later[below].sum()),
            no_zero=int((~first & ~later)[below].sum()),
            fails_at=tuple(x for x in asked if not first[int(np.argmin(np.abs(self.l1 - x)))]),
        )

    def matching_guess(self, threshold: float) -> float | None:
        """Guess [s] at which the search begins to fail just at a threshold [m]; None if none does so."""

        def above(guess: float) -> float:
            lowest = self.search(guess, ()).lowest
            return (np.inf if lowest is None else lowest) - threshold

        low, high = _GUESSES
        if above(low) <= 0 or above(high) > 0:
            return None
        return float(bisect(lambda guess: 1.0 if above(guess) > 0 else -1.0, low, high, xtol=1e-4))

    def _ends(self, guess: float) -> tuple[BoolArray, BoolArray]:
        """Where the search ends on the first zero, and where on a later one."""
        t, step = np.full(len(self.l1), guess), np.full(len(self.l1), np.inf)
        with np.errstate(all="ignore"):  # a search that runs away does so in infinities
            for _ in range(_ITERATIONS):
                value, slope = self._torque(t)
                step = value / slope
                t = t - step
        ended = np.isfinite(t) & (np.abs(step) < _FOUND) & (t > 0)
        on_first = ended & (np.abs(t - self._first_zeros) < _SAME)
        return on_first, ended & ~on_first

    def _torque(self, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Torque [N m] and its rate, at one time for each place [s]."""
        constant, wave, amplitude, frequency, sense = self._swings
        turned, rate = pendulum(amplitude, frequency, t)
        turning = wave * np.exp(-1j * sense * turned)
        return constant + turning.real, turning.imag * sense * rate

    @cached_property
    def _swings(self) -> tuple[FloatArray, ComplexArray, FloatArray, FloatArray, FloatArray]:
        torques = [whole.rest_torque(HANGER_REST) for whole in self.wholes]
        return (
            np.array([constant for constant, _ in torques]),
            np.array([wave for _, wave in torques]),
            np.array([whole.amplitude for whole in self.wholes]),
            np.array([whole.frequency for whole in self.wholes]),
            np.array([whole.sense for whole in self.wholes]),
        )

    @cached_property
    def _first_zeros(self) -> FloatArray:
        return np.array([min(whole.zeros(HANGER_REST), default=np.nan) for whole in self.wholes])


def wrong_zero(whole: Whole) -> WrongZero | None:
    """The motion when the hanger's rest is held to the second zero of its torque; None if there is none.

    Raises:
        SimulationError: the integrator gave up.
    """
    zeros = whole.zeros(HANGER_REST)
    if len(zeros) < 2:
        return None
    problem = Problem(whole.mechanism, duration=zeros[1] + _AFTER)
    releases: dict[str, float | None] = {HANGER_REST: zeros[1], SLING_REST: None}
    solution = solve_scheduled(problem, releases)
    opened = first_zero(solution, [SLING_REST], zeros[1])
    if opened is not None:
        releases[SLING_REST] = opened[0]
        solution = solve_scheduled(problem, releases)
    return WrongZero(
        l1=whole.parameters.l1,
        release_times=releases,
        crossings=() if opened is None else tuple(crossings(solution, opened[0], problem.duration)),
    )


def early_crossings(l1: float, solution: Solution) -> list[EarlyCrossing]:
    """Crossings of the 45 deg line before the sling's rest has opened."""
    opened = solution.release_times[SLING_REST]
    end = solution.segments[-1].end if opened is None else opened
    return [EarlyCrossing(l1=l1, time=time, speed=speed) for time, speed in crossings(solution, 0.0, end)]


def crossings(solution: Solution, start: float, end: float) -> list[tuple[float, float]]:
    """Times [s] and signed speeds [m/s] of the velocity on the 45 deg line, to a millisecond."""
    times = np.linspace(start, end, max(3, int((end - start) / _SCAN)))[1:]
    velocity = solution.trajectory(times).marker(PROJECTILE).velocity
    found = np.flatnonzero(np.diff(np.sign(lead(velocity))) != 0)
    along = np.sign(velocity[:, 0]) * np.hypot(velocity[:, 0], velocity[:, 1])
    return [(float(times[i]), float(along[i])) for i in found]
