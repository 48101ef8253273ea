"""Integration under active contacts, for the independent formulations; stops open at zero torque.

Independent of :mod:`..solver`, its event location and its contact problem, on purpose; the system
that is integrated gives only its rates and the torques of its stops (:class:`ConstrainedSystem`).
Release-once law.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import Protocol

import numpy as np
from numpy.polynomial import Chebyshev
from scipy.integrate import DenseOutput
from scipy.optimize import brentq

from ...models.arrays import FloatArray
from ...models.errors import InputError, SimulationError
from ...models.launch import LAUNCH_ANGLE, Launch
from ..integrator import Integrator

# Where inside a step torques are sampled: Chebyshev's points crowd at the ends, where a fall is
# missed most easily.
_SAMPLES = 0.5 * (1.0 - np.cos(np.pi * np.arange(1, 8) / 7))
# DOP853's interpolant is one order short of its steps: inside long ones it is what limits.
_LEAST_STEPS = 150
_FIT = 14  # degree of the polynomial on which the launch is looked for, step by step
_AT_REST = 1e-8  # of the speed at a step's end: a start from rest is no launch
_MOST_STOPS = 10  # all subsets are tried: 1024 of them
PointState = tuple[FloatArray, FloatArray, FloatArray]
"""Position [m], velocity [m/s], acceleration [m/s^2] of a point, each (2,)."""


class ConstrainedSystem(Protocol):
    """First-order equations y' = f(y) under a set of active stops."""

    start: FloatArray  # state at t = 0
    stops: tuple[str, ...]  # stops that touch at the start

    def rates(self, y: FloatArray, active: tuple[str, ...]) -> FloatArray:
        """dy/dt."""
        ...

    def torques(self, y: FloatArray, active: tuple[str, ...]) -> FloatArray:
        """Torques of the active stops [N m]."""
        ...

    def gap_accelerations(
        self, y: FloatArray, active: tuple[str, ...], of: tuple[str, ...]
    ) -> FloatArray:
        """Second derivatives of gaps [rad/s^2] under these active stops."""
        ...

    def projected(self, y: FloatArray, active: tuple[str, ...]) -> FloatArray:
        """The state put back on its constraints."""
        ...


@dataclass(frozen=True)
class _Step:
    start: float
    end: float
    active: tuple[str, ...]
    dense: DenseOutput


@dataclass(frozen=True)
class ConstrainedMotion:
    """A motion of the system, continuous in time."""

    system: ConstrainedSystem
    steps: tuple[_Step, ...]
    release_times: Mapping[str, float | None]

    def active(self, t: float) -> tuple[str, ...]:
        """Stops that are active at t [s]; at a release, those active from there on."""
        return self._step(t).active

    def raw_state(self, t: float) -> FloatArray:
        """The integrator's interpolated state at t [s]."""
        return np.asarray(self._step(t).dense(t), dtype=np.float64)

    def state(self, t: float) -> FloatArray:
        """The state at t [s], on its constraints."""
        return self.system.projected(self.raw_state(t), self.active(t))

    def torques(self, t: float) -> dict[str, float]:
        """Torques of the active stops at t [s], by name [N m]."""
        active = self.active(t)
        return dict(zip(active, self.system.torques(self.state(t), active).tolist(), strict=True))

    def first_launch(
        self, velocity: Callable[[FloatArray], FloatArray], after: float | None
    ) -> Launch | None:
        """The launch at 45 degrees of a point with velocity(y) [m/s], later than `after` [s].

        Its candidates are the real roots of a polynomial through Chebyshev's points of each step.
        """
        if after is None:
            return None
        for step in self.steps:
            if step.end <= after:
                continue

            def across(t: float, step: _Step = step) -> float:
                vx, vy = velocity(np.asarray(step.dense(t)))
                return float(vy * np.cos(LAUNCH_ANGLE) - vx * np.sin(LAUNCH_ANGLE))

            for time in _falls(across, max(step.start, after), step.end):
                fastest = np.abs(velocity(np.asarray(step.dense(step.end)))).max()
                if velocity(np.asarray(step.dense(time))).sum() > _AT_REST * fastest:
                    vx, vy = velocity(self.state(time)).tolist()
                    return Launch(time, float(np.hypot(vx, vy)), (vx, vy))
        return None

    def _step(self, t: float) -> _Step:
        if not 0.0 <= t <= self.steps[-1].end:
            raise InputError(
                f"the motion covers 0 to {self.steps[-1].end:.6g} s; {t:.6g} s was asked for."
            )
        ends = [step.end for step in self.steps[:-1]]
        return self.steps[bisect_right(ends, t)]


def _falls(function: Callable[[float], float], start: float, end: float) -> list[float]:
    """Instants between start and end [s] at which a smooth function falls through zero."""
    fit = Chebyshev.interpolate(np.vectorize(function, otypes=[np.float64]), _FIT, (start, end))
    if np.abs(fit.coef[0]) > 1.001 * np.abs(fit.coef[1:]).sum():
        return []
    inside = sorted(float(root) for root in fit.roots().real if start < root < end)
    # Between two roots the sign is that of their middle; beside the first and the last, that of the
    # ends.
    samples = [start, *(0.5 * (a + b) for a, b in pairwise(inside)), end]
    signs = [function(time) for time in samples]
    falls: list[float] = []
    for i in range(len(samples) - 1):
        if signs[i] > 0 >= signs[i + 1]:
            xtol = 1e-15 * (end - start)
            falls.append(brentq(function, samples[i], samples[i + 1], xtol=xtol, rtol=1e-15))
    return falls


def integrate(system: ConstrainedSystem, duration: float, tolerance: float) -> ConstrainedMotion:
    """Integrate from 0 to `duration` [s], letting each stop go where its torque falls to zero.

    Raises:
        SimulationError: the integrator's step size collapsed, or too many stops touch at the start.
    """
    if len(system.stops) > _MOST_STOPS:
        raise SimulationError(
            f"{len(system.stops)} stops touch at the start; at most {_MOST_STOPS} are followed "
            "here."
        )
    t, y = 0.0, system.start
    releases: dict[str, float | None] = dict.fromkeys(system.stops)
    active, steps = _active_contacts(system, y, system.stops), list[_Step]()
    while True:
        for name in system.stops:
            if name not in active and releases[name] is None:
                releases[name] = t
        steps += _until_release(system, active, t, system.projected(y, active), duration, tolerance)
        t = steps[-1].end
        if t >= duration:
            return ConstrainedMotion(system, tuple(steps), releases)
        y = np.asarray(steps[-1].dense(t))
        torques = system.torques(y, active)
        released = active[int(np.argmin(torques))]
        active = _active_contacts(system, y, tuple(name for name in active if name != released))


def _until_release(
    system: ConstrainedSystem,
    active: tuple[str, ...],
    t: float,
    y: FloatArray,
    duration: float,
    tolerance: float,
) -> list[_Step]:
    """Steps to the first release, the last of them cut there, or to the end."""

    def rates(_: float, y: FloatArray) -> FloatArray:
        return system.rates(y, active)

    longest = duration / _LEAST_STEPS
    stepper = Integrator(rates, t, y, duration, (tolerance, tolerance), longest=longest)
    steps: list[_Step] = []
    while stepper.status == "running":
        started = stepper.t
        stepper.step()
        step = _Step(started, stepper.t, active, stepper.dense_output())
        releases = [_release(system, step, i) for i in range(len(active))]
        first = min((time for time in releases if time is not None), default=None)
        if first is not None:
            return [*steps, _Step(started, first, active, step.dense)]
        steps.append(step)
        # A one-step method may go on from any nearby state, as long as its stored rate goes with
        # it.
        stepper.y = system.projected(stepper.y, active)
        stepper.f = system.rates(stepper.y, active)
    return steps


def _release(system: ConstrainedSystem, step: _Step, i: int) -> float | None:
    """Find when the torque of a step's i-th active stop first falls through zero in it [s]."""

    def torque(t: float) -> float:
        return float(system.torques(np.asarray(step.dense(t)), step.active)[i])

    last, start = torque(step.start), step.start
    for time in step.start + _SAMPLES * (step.end - step.start):
        value = torque(float(time))
        if last >= 0 > value:
            return float(brentq(torque, start, float(time), xtol=1e-15, rtol=1e-15))
        last, start = value, float(time)
    return None


def _active_contacts(
    system: ConstrainedSystem, y: FloatArray, touching: tuple[str, ...]
) -> tuple[str, ...]:
    """The subset that is active while the rest opens, found by trying all, the largest first.

    Torques of the active and gap accelerations of the others must not be negative; by uniqueness of
    the complementarity problem's accelerations at most one motion fulfils that. Where rounding
    leaves none, the subset that violates it least.
    """
    best, least = touching, np.inf
    for size in range(len(touching), -1, -1):
        for active in combinations(touching, size):
            opened = tuple(name for name in touching if name not in active)
            torques = system.torques(y, active)
            accelerations = system.gap_accelerations(y, active, opened)
            violation = 0.0  # relative to the largest of each kind
            for values in (torques, accelerations):
                if len(values) and values.min() < 0:
                    violation = max(violation, float(-(values / np.abs(values).max()).min()))
            if violation == 0:
                return active
            if violation < least:
                best, least = active, violation
    return best
