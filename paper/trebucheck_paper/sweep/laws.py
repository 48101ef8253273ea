"""Launches along the beam under two laws of a stop, and under a faulty root search.

Release-once: a rest whose torque would be negative at the start cannot push and is gone at t = 0.
Bilateral, the paper's: a rest that touches at the start is held, pulling too, until its torque
comes to zero. How the paper finds that zero it does not say. If by Newton's method from one guess
for every position of the fulcrum, there is a position below which the search ends elsewhere: on the
zero of the swing back, or on none at all.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from pydantic import Field
from scipy.optimize import bisect, brentq
from trebucheck.api.mechanics import (
    HANGER_REST,
    PROJECTILE,
    SLING_REST,
    BoolArray,
    ComplexArray,
    FloatArray,
    Mechanism,
    Problem,
    Real,
    Solution,
    Spec,
    Vector,
    characteristic_time,
    launch_batch,
    lead,
    solve,
    solve_scheduled,
    solve_to_launch,
)

from ..evidence.claims import BACKWARD_L1, ZERO_L1
from .rigid_swing import RigidSwing, pendulum

PAPER_GRID = 0.01
"""[m]: its l1 are printed to two digits."""
_GUESSES = (0.3, 0.4, 0.5, 0.6, 0.8, 1.0)  # [s] guesses somebody might type
_EARLY = (9.0, 9.5, 9.89, 10.0, 11.0)  # [m] either side of the paper's threshold
_LATE = (8.6, 9.0, 9.4, 9.8)  # [m] below it
SPANS = 2.5
"""End of the launch search in characteristic times: Table I launches after 1.5 of them."""
_TORQUE_SAMPLES = 600  # over the motion: a spacing of some 7 ms on Table I
_DOP853 = 1e-12  # local error where heyoka is not installed: its batch's own default
# Newton's method doubles its digits in each: whatever has not ended by then wanders.
_ITERATIONS = 50
_CONVERGED = 1e-9  # [s] largest last step of a search that converged
_SAME = 1e-6  # [s] largest difference of one zero found twice; distinct zeros differ by seconds
_BETWEEN = (0.1, 1.0)  # [s] interval of the search for a matching guess
_SCAN = 1e-3  # [s] for crossings of the 45 deg line
_AFTER = 5.0  # [s] of motion simulated after the hanger's late release


class Curve(Spec):
    """Launch speed at 45 degrees against l1, under two laws of a stop (Fig. 5)."""

    l1: tuple[Real, ...] = Field(description="[m]")
    release_once: tuple[Real | None, ...] = Field(
        description="a rest can only push [m/s]; None: no launch"
    )
    bilateral: tuple[Real | None, ...] = Field(
        description="a rest is held, pulling too, until its torque comes to zero [m/s]; None: no "
        "launch"
    )
    times: tuple[Real | None, ...] = Field(description="of the launch, under release-once [s]")


class RootSearch(Spec):
    """Newton's search for the zero of the hanger's torque, from one guess for all places."""

    guess: Real = Field(description="[s]")
    lowest: Real | None = Field(
        description="from here on up to the regime change it finds the first zero [m]"
    )
    later_zero: int = Field(description="places below that where it ends on a later zero")
    no_zero: int = Field(
        description="places below that where it ends on none, or on one before the start"
    )
    fails_at: tuple[Real, ...] = Field(
        description="of the places asked for, those where it misses the first zero [m]"
    )


class WrongZero(Spec):
    """Results of holding the hanger's rest until the second zero of its torque, not the first."""

    l1: Real = Field(description="[m]")
    release_times: dict[str, Real | None] = Field(description="[s]")
    crossings: tuple[Vector, ...] = Field(
        description="time [s] and speed [m/s] when the velocity stands on the 45 deg line, "
        "negative: thrown backward"
    )


class EarlyCrossing(Spec):
    """The velocity on the 45 deg line while the sling's rest still holds."""

    l1: Real = Field(description="[m]")
    time: Real = Field(description="[s]")
    speed: Real = Field(description="[m/s]; negative: along the line backward")


class Artefact(Spec):
    """Test whether errors of computing cause what the paper shows below its threshold.

    Nothing of the paper's program is published: what is found here can only be compatible with it.
    """

    threshold: Real = Field(description="printed [m]")
    step: Real = Field(description="between the places that are searched [m]")
    searches: tuple[RootSearch, ...]
    matching_guess: Real | None = Field(
        description="guess from which the search first fails at the threshold [s]"
    )
    matching_search: RootSearch | None
    wrong_zeros: tuple[WrongZero, ...]
    early_crossings: tuple[EarlyCrossing, ...]


def release_once(mechanisms: Sequence[Mechanism]) -> tuple[FloatArray, FloatArray]:
    """Times [s] and speeds [m/s] of release-once launches, NaN where there is none; each (n,)."""
    duration = SPANS * max(characteristic_time(mechanism) for mechanism in mechanisms)
    if importlib.util.find_spec("heyoka") is not None:
        batch = launch_batch(mechanisms, duration)
        return batch.time, batch.speed
    launches = [
        solve(Problem(mechanism, duration=duration), _DOP853, _DOP853).launch
        for mechanism in mechanisms
    ]
    times = np.array([np.nan if launch is None else launch.time for launch in launches])
    return times, np.array([np.nan if launch is None else launch.speed for launch in launches])


def pulls_at_start(rigid: RigidSwing) -> bool:
    """Tell whether a touching rest would have to pull at the start: then the laws differ."""
    return any(rigid.start_torque(stop.name) < 0 for stop in rigid.mechanism.stops if stop.closed)


def bilateral(rigid: RigidSwing) -> Solution:
    """Motion with each rest held from both sides until its torque is zero, then gone.

    Raises:
        SimulationError: the integrator gave up.
    """
    mechanism = rigid.mechanism
    problem = Problem(mechanism, duration=SPANS * characteristic_time(mechanism))
    releases: dict[str, float | None] = {stop.name: None for stop in mechanism.stops if stop.closed}
    zeros = (
        (time, name) for name in releases for time in rigid.zeros(name) if time < problem.duration
    )
    now, first = min(zeros, default=(0.0, None))
    if first is not None:
        releases[first] = now
    solution = solve_scheduled(problem, releases)
    while event := first_zero(
        solution, [name for name, time in releases.items() if time is None], now
    ):
        now, name = event
        releases[name] = now
        solution = solve_scheduled(problem, releases)
    return solution


def first_zero(solution: Solution, held: Sequence[str], after: float) -> tuple[float, str] | None:
    """Time of the first zero of a held stop's torque later than `after` [s], and the stop."""
    times = np.linspace(after, solution.problem.duration, _TORQUE_SAMPLES)[1:]
    torques = solution.motion(times).stop_torques
    zeros: list[tuple[float, str]] = []
    for name in held:
        changes = np.flatnonzero(np.diff(np.sign(torques[name])) != 0)
        if len(changes):
            before, behind = times[changes[0] : changes[0] + 2]
            zeros.append((_zero(solution, name, float(before), float(behind)), name))
    return min(zeros, default=None)


def _zero(solution: Solution, name: str, before: float, behind: float) -> float:
    def torque(t: float) -> float:
        return float(solution.motion(np.array([t])).stop_torques[name][0])

    return float(brentq(torque, before, behind, xtol=1e-14, rtol=1e-14))


@dataclass(frozen=True)
class Searches:
    """Newton's method on the hanger's torque, both rests held, for many fulcrum positions."""

    l1: FloatArray
    rigids: tuple[RigidSwing, ...]

    def search(self, guess: float, checked: Sequence[float]) -> RootSearch:
        """Search from one guess [s] everywhere.

        Args:
            checked: l1 of positions whose success is reported one by one [m].
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
            fails_at=tuple(x for x in checked if not first[int(np.argmin(np.abs(self.l1 - x)))]),
        )

    def matching_guess(self, threshold: float) -> float | None:
        """Guess [s] at which the search begins to fail at a threshold [m]; None if none does."""

        def above(guess: float) -> float:
            lowest = self.search(guess, ()).lowest
            return (np.inf if lowest is None else lowest) - threshold

        low, high = _BETWEEN
        if above(low) <= 0 or above(high) > 0:
            return None
        return float(bisect(lambda guess: 1.0 if above(guess) > 0 else -1.0, low, high, xtol=1e-4))

    def _ends(self, guess: float) -> tuple[BoolArray, BoolArray]:
        """Find where the search ends on the first zero, and where on a later one."""
        t, step = np.full(len(self.l1), guess), np.full(len(self.l1), np.inf)
        with np.errstate(all="ignore"):  # a search that diverges gives infinities and NaN
            for _ in range(_ITERATIONS):
                value, slope = self._torque(t)
                step = value / slope
                t = t - step
        ended = np.isfinite(t) & (np.abs(step) < _CONVERGED) & (t > 0)
        on_first = ended & (np.abs(t - self._first_zeros) < _SAME)
        return on_first, ended & ~on_first

    def _torque(self, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Torque [N m] and its rate, at one time for each position [s]."""
        constant, wave, amplitude, frequency, sense = self._swings
        turned, rate = pendulum(amplitude, frequency, t)
        turning = wave * np.exp(-1j * sense * turned)
        return constant + turning.real, turning.imag * sense * rate

    @cached_property
    def _swings(self) -> tuple[FloatArray, ComplexArray, FloatArray, FloatArray, FloatArray]:
        torques = [rigid.rest_torque(HANGER_REST) for rigid in self.rigids]
        return (
            np.array([constant for constant, _ in torques]),
            np.array([wave for _, wave in torques]),
            np.array([rigid.amplitude for rigid in self.rigids]),
            np.array([rigid.frequency for rigid in self.rigids]),
            np.array([rigid.sense for rigid in self.rigids]),
        )

    @cached_property
    def _first_zeros(self) -> FloatArray:
        return np.array([min(rigid.zeros(HANGER_REST), default=np.nan) for rigid in self.rigids])


def wrong_zero(rigid: RigidSwing) -> WrongZero | None:
    """Motion with the hanger's rest held to its torque's second zero; None if there is none.

    Raises:
        SimulationError: the integrator gave up.
    """
    zeros = rigid.zeros(HANGER_REST)
    if len(zeros) < 2:
        return None
    problem = Problem(rigid.mechanism, duration=zeros[1] + _AFTER)
    releases: dict[str, float | None] = {HANGER_REST: zeros[1], SLING_REST: None}
    solution = solve_scheduled(problem, releases)
    opened = first_zero(solution, [SLING_REST], zeros[1])
    if opened is not None:
        releases[SLING_REST] = opened[0]
        solution = solve_scheduled(problem, releases)
    return WrongZero(
        l1=rigid.parameters.l1,
        release_times=releases,
        crossings=() if opened is None else tuple(crossings(solution, opened[0], problem.duration)),
    )


def early_crossings(rigid: RigidSwing) -> list[EarlyCrossing]:
    """Crossings of the 45 deg line before the sling's rest has opened, under release-once."""
    solution = solve_to_launch(rigid.mechanism)
    opened = solution.release_times[SLING_REST]
    end = solution.segments[-1].end if opened is None else opened
    return [
        EarlyCrossing(l1=rigid.parameters.l1, time=time, speed=speed)
        for time, speed in crossings(solution, 0.0, end)
    ]


def crossings(solution: Solution, start: float, end: float) -> list[tuple[float, float]]:
    """Times [s] and signed speeds [m/s] of the velocity on the 45 deg line, to a millisecond."""
    times = np.linspace(start, end, max(3, int((end - start) / _SCAN)))[1:]
    velocity = solution.trajectory(times).marker(PROJECTILE).velocity
    changes = np.flatnonzero(np.diff(np.sign(lead(velocity))) != 0)
    along = np.sign(velocity[:, 0]) * np.hypot(velocity[:, 0], velocity[:, 1])
    return [(float(times[i]), float(along[i])) for i in changes]


def artefact(
    rigid: Callable[[float], RigidSwing], start: float, end: float, change: float | None
) -> Artefact:
    """Faulty searches along the beam, and what follows from their wrong zeros.

    Args:
        rigid: the machine with its fulcrum at l1 [m], its rests held.
        start, end: range of l1 [m].
        change: where the hanger's rest would begin to have to pull [m]; None: nowhere.
    """
    last = end if change is None else change
    l1 = np.round(np.arange(start, last, PAPER_GRID), 9)
    root_searches = Searches(l1, tuple(rigid(float(x)) for x in l1))
    guess = root_searches.matching_guess(BACKWARD_L1.value)
    late = [wrong_zero(rigid(x)) for x in _LATE if start <= x <= last]
    early = [zero for x in _EARLY if start <= x <= end for zero in early_crossings(rigid(x))]
    return Artefact(
        threshold=BACKWARD_L1.value,
        step=PAPER_GRID,
        searches=tuple(root_searches.search(each, (ZERO_L1.value,)) for each in _GUESSES),
        matching_guess=guess,
        matching_search=None if guess is None else root_searches.search(guess, (ZERO_L1.value,)),
        wrong_zeros=tuple(zero for zero in late if zero is not None),
        early_crossings=tuple(early),
    )
