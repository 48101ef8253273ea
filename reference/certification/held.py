"""A march under held stops, for the independent formulations: each stop is held until its torque falls to zero.

Written apart from :mod:`..solver`, which has events of its own; what is integrated here says only how its state
moves and what its stops carry (:class:`HeldSystem`). Release-once law.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Protocol

import numpy as np
from scipy.integrate import DOP853, DenseOutput
from scipy.optimize import brentq

from ...models.arrays import FloatArray
from ...models.errors import InputError, SimulationError

# Where inside a step torques are watched: Chebyshev's points crowd at the ends, where a fall is missed most easily.
_WATCHED = 0.5 * (1.0 - np.cos(np.pi * np.arange(1, 8) / 7))
_LEAST_STEPS = 150  # DOP853's interpolant is one order short of its steps: inside long ones it is what limits
_MOST_STOPS = 10  # all subsets are tried: 1024 of them


class HeldSystem(Protocol):
    """First-order equations y' = f(y) under a set of held stops."""

    @property
    def start(self) -> FloatArray:
        """State at t = 0."""
        ...

    @property
    def stops(self) -> tuple[str, ...]:
        """Stops that touch at the start."""
        ...

    def rates(self, y: FloatArray, held: tuple[str, ...]) -> FloatArray:
        """dy/dt."""
        ...

    def torques(self, y: FloatArray, held: tuple[str, ...]) -> FloatArray:
        """Torques of the held stops [N m]."""
        ...

    def gap_accelerations(self, y: FloatArray, held: tuple[str, ...], of: tuple[str, ...]) -> FloatArray:
        """Second derivatives of gaps [rad/s^2] while `held` are held."""
        ...

    def projected(self, y: FloatArray, held: tuple[str, ...]) -> FloatArray:
        """The state put back on its constraints."""
        ...


@dataclass(frozen=True)
class _Step:
    start: float
    end: float
    held: tuple[str, ...]
    dense: DenseOutput


@dataclass(frozen=True)
class HeldMotion:
    """The steps of a march, continuous in time."""

    system: HeldSystem
    steps: tuple[_Step, ...]
    release_times: Mapping[str, float | None]

    def active(self, t: float) -> tuple[str, ...]:
        """Stops that are held at t [s]; at a release, those held from there on."""
        return self._step(t).held

    def raw_state(self, t: float) -> FloatArray:
        """The integrator's interpolated state at t [s]."""
        return np.asarray(self._step(t).dense(t), dtype=np.float64)

    def state(self, t: float) -> FloatArray:
        """The state at t [s], on its constraints."""
        return self.system.projected(self.raw_state(t), self.active(t))

    def first_fall(
        self, value: Callable[[FloatArray], float], wanted: Callable[[FloatArray], bool], after: float
    ) -> float | None:
        """First time later than `after` [s] at which value(y) falls through zero where wanted(y) is true."""
        for step in self.steps:
            if step.end <= after:
                continue
            time = _fall(step, max(step.start, after), lambda y, _: value(y))
            if time is not None and wanted(np.asarray(step.dense(time))):
                return time
        return None

    def _step(self, t: float) -> _Step:
        if not 0.0 <= t <= self.steps[-1].end:
            raise InputError(f"the motion covers 0 to {self.steps[-1].end:.6g} s; {t:.6g} s was asked for.")
        ends = [step.end for step in self.steps[:-1]]
        return self.steps[bisect_right(ends, t)]


def march(system: HeldSystem, duration: float, tolerance: float) -> HeldMotion:
    """Integrate from 0 to `duration` [s], letting each stop go where its torque falls to zero.

    Raises:
        SimulationError: the integrator's step size collapsed, or too many stops touch at the start.
    """
    if len(system.stops) > _MOST_STOPS:
        raise SimulationError(f"{len(system.stops)} stops touch at the start; at most {_MOST_STOPS} are followed here.")
    t, y = 0.0, system.start
    releases: dict[str, float | None] = dict.fromkeys(system.stops)
    held, steps = _pushing(system, y, system.stops), list[_Step]()
    while True:
        for name in system.stops:
            if name not in held and releases[name] is None:
                releases[name] = t
        steps += _until_release(system, held, t, system.projected(y, held), duration, tolerance)
        t = steps[-1].end
        if t >= duration:
            return HeldMotion(system, tuple(steps), releases)
        y = np.asarray(steps[-1].dense(t))
        torques = system.torques(y, held)
        let_go = held[int(np.argmin(torques))]
        held = _pushing(system, y, tuple(name for name in held if name != let_go))


def _until_release(
    system: HeldSystem, held: tuple[str, ...], t: float, y: FloatArray, duration: float, tolerance: float
) -> list[_Step]:
    """Steps to the first release, the last of them cut there, or to the end."""
    longest = duration / _LEAST_STEPS
    stepper = DOP853(
        lambda _, y: system.rates(y, held), t, y, duration, max_step=longest, rtol=tolerance, atol=tolerance
    )
    steps: list[_Step] = []
    while stepper.status == "running":
        started, message = stepper.t, stepper.step()
        if message is not None:
            raise SimulationError(f"the integrator stopped at t = {stepper.t:.6g} s: {message}.")
        step = _Step(started, stepper.t, held, stepper.dense_output())
        falls = [_fall(step, started, _torque_of(system, i)) for i in range(len(held))]
        first = min((time for time in falls if time is not None), default=None)
        if first is not None:
            return [*steps, _Step(started, first, held, step.dense)]
        steps.append(step)
        # A one-step method may go on from any nearby state, as long as its stored rate goes with it.
        stepper.y = system.projected(stepper.y, held)
        stepper.f = system.rates(stepper.y, held)
    return steps


def _torque_of(system: HeldSystem, i: int) -> Callable[[FloatArray, tuple[str, ...]], float]:
    return lambda y, held: float(system.torques(y, held)[i])


def _fall(step: _Step, start: float, value: Callable[[FloatArray, tuple[str, ...]], float]) -> float | None:
    """Where value(y, held) first falls through zero between `start` and the step's end [s]."""

    def at(t: float) -> float:
        return value(np.asarray(step.dense(t)), step.held)

    before, from_time = at(start), start
    for time in start + _WATCHED * (step.end - start):
        here = at(float(time))
        if before >= 0 > here:
            return float(brentq(at, from_time, float(time), xtol=1e-15, rtol=1e-15))
        before, from_time = here, float(time)
    return None


def _pushing(system: HeldSystem, y: FloatArray, touching: tuple[str, ...]) -> tuple[str, ...]:
    """The subset that pushes while the rest opens, found by trying all of them, the largest first.

    Torques of the held and gap accelerations of the others must not be negative; by uniqueness of the
    complementarity problem's accelerations at most one motion fulfils that. Where rounding leaves none, the subset
    that breaks it least.
    """
    best, least = touching, np.inf
    for size in range(len(touching), -1, -1):
        for held in combinations(touching, size):
            broken = _broken(system, y, held, tuple(name for name in touching if name not in held))
            if broken == 0:
                return held
            if broken < least:
                best, least = held, broken
    return best


def _broken(system: HeldSystem, y: FloatArray, held: tuple[str, ...], opened: tuple[str, ...]) -> float:
    torques = system.torques(y, held)
    accelerations = system.gap_accelerations(y, held, opened)
    scaled = [values / np.abs(values).max() for values in (torques, accelerations) if np.abs(values).max(initial=0) > 0]
    return max((float(-values.min()) for values in scaled if values.min() < 0), default=0.0)
