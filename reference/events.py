"""Locating releases and closings on the dense output of a step.

Both are downward zero crossings of a function that starts at or above zero: a torque, or a gap. Inside each step the
function is sampled at a few points. A gap that has just opened starts at zero and may be back before the first of
them, and one that grazes zero may dip below between two: the sign of its speed shows it, and then the turning point is
located first.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import DenseOutput
from scipy.optimize import brentq

from ..models.arrays import FloatArray
from .active_set import EventFunction, PostEventState
from .equations import Equations

_PROBES = np.linspace(0.0, 1.0, 6)  # where inside a step the functions are sampled
_SAME_TIME = 1e-13  # [s] events closer than this are one instant
_ROUNDING = 1e-12  # [rad] a gap this little below zero has just been at zero


@dataclass(frozen=True)
class Event:
    """A located zero crossing: of which function, when [s], and the state there, shape (2 n_q,)."""

    function: EventFunction
    t: float
    state: FloatArray


class EventFinder:
    """Locates the first events after a state, step by step."""

    def __init__(self, equations: Equations, initial: PostEventState, functions: tuple[EventFunction, ...]) -> None:
        self.equations = equations
        self.initial = initial
        self.functions = functions
        self.n_q = len(equations.mechanism.coordinates)

    def first(self, piece: DenseOutput, t0: float, t1: float) -> list[Event]:
        """The earliest events between t0 and t1 [s], all of one instant; empty if there are none."""
        if not self.functions:
            return []
        times = t0 + _PROBES * (t1 - t0)
        states = np.asarray(piece(times)).T
        found: list[tuple[float, EventFunction]] = []
        for function in self.functions:
            root = self._closing(function, piece, times, states) if function.closes else None
            root = self._release(function, piece, times, states) if not function.closes else root
            if root is not None:
                found.append((root, function))
        if not found:
            return []
        earliest = min(t for t, _ in found)
        state = np.asarray(piece(earliest), dtype=np.float64)
        return [Event(function, earliest, state) for t, function in found if t - earliest <= _SAME_TIME]

    def _release(
        self, function: EventFunction, piece: DenseOutput, times: FloatArray, states: FloatArray
    ) -> float | None:
        def torque(state: FloatArray) -> FloatArray:
            q, u = state[..., : self.n_q], state[..., self.n_q :]
            column = self.equations.n_loops + self.initial.closed.index(function.stop)
            return self.equations.solve(q, u, self.initial.closed)[1][..., column]

        values = torque(states)
        falls = np.flatnonzero((values[1:] < 0) & (values[:-1] >= 0))
        if not len(falls):
            return None
        i = int(falls[0])
        return _root(lambda t: float(torque(np.asarray(piece(t)))), float(times[i]), float(times[i + 1]))

    def _closing(
        self, function: EventFunction, piece: DenseOutput, times: FloatArray, states: FloatArray
    ) -> float | None:
        kinematics, n = self.equations.kinematics, self.n_q

        def gap_at(state: FloatArray) -> FloatArray:
            return kinematics.gap(function.stop, state[..., :n])

        def speed_at(state: FloatArray) -> FloatArray:
            return np.sum(kinematics.gap_jacobian(function.stop, state[..., :n]) * state[..., n:], axis=-1)

        def gap(t: float) -> float:
            return float(gap_at(np.asarray(piece(t))))

        def speed(t: float) -> float:
            return float(speed_at(np.asarray(piece(t))))

        gaps, speeds = gap_at(states), speed_at(states)
        for i in range(len(times) - 1):
            root = _downward_zero_crossing(
                gap, speed, (float(times[i]), float(times[i + 1])), gaps[i : i + 2], speeds[i : i + 2]
            )
            if root is not None:
                return root
        return None


def _downward_zero_crossing(
    gap: Callable[[float], float],
    speed: Callable[[float], float],
    interval: tuple[float, float],
    gaps: FloatArray,
    speeds: FloatArray,
) -> float | None:
    """Where a gap falls through zero inside an interval, from its values and speeds at the two ends."""
    start, end = interval
    if speeds[0] >= 0 and speeds[1] >= 0:
        return None
    if speeds[0] < 0 < speeds[1]:  # it dips: does it reach zero?
        lowest = _root(speed, start, end)
        return _root(gap, start, lowest) if gaps[0] > 0 > gap(lowest) else None
    if speeds[0] > 0:  # it opens first: only what comes after the turning point can be a closing
        start = _root(speed, start, end)
    here = gap(start)
    if here > 0:
        return _root(gap, start, end) if gaps[1] < 0 else None
    # At zero, within rounding, and on its way down: it closes here. Rounding alone does not take it far below.
    return start if here >= -_ROUNDING and gaps[1] < -_ROUNDING else None


def _root(function: Callable[[float], float], start: float, end: float) -> float:
    return float(brentq(function, start, end, xtol=1e-15, rtol=1e-15))
