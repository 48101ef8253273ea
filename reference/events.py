"""Finding releases and closings on a continuous piece of motion.

Both are roots of a function that starts at or above zero: a torque, or a gap. Inside each step the function is
watched at a few points. A gap that has just opened starts at zero and may be back before the first of them, and one
that grazes zero may dip below between two: its speed tells, and then the turning point is found first.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import DenseOutput
from scipy.optimize import brentq

from ..models.arrays import FloatArray
from .active_set import Moment, Watch
from .equations import Equations

_PROBES = np.linspace(0.0, 1.0, 6)  # where inside a step the functions are watched
_SAME_TIME = 1e-13  # [s] events closer than this are one instant
_ROUNDING = 1e-12  # [rad] a gap this little below zero is one that has just been at zero


@dataclass(frozen=True)
class Event:
    """Something watched for, when it came [s] and the state there, shape (2 n_q,)."""

    watch: Watch
    t: float
    state: FloatArray


class EventFinder:
    """Looks for the first events after a moment, step by step."""

    def __init__(self, equations: Equations, moment: Moment, watched: tuple[Watch, ...]) -> None:
        self.equations = equations
        self.moment = moment
        self.watched = watched
        self.n_q = len(equations.mechanism.coordinates)

    def first(self, piece: DenseOutput, t0: float, t1: float) -> list[Event]:
        """The earliest events between t0 and t1 [s], all of one instant; empty if there are none."""
        if not self.watched:
            return []
        times = t0 + _PROBES * (t1 - t0)
        states = np.asarray(piece(times)).T
        found: list[tuple[float, Watch]] = []
        for watch in self.watched:
            root = self._closing(watch, piece, times, states) if watch.closes else None
            root = self._release(watch, piece, times, states) if not watch.closes else root
            if root is not None:
                found.append((root, watch))
        if not found:
            return []
        earliest = min(t for t, _ in found)
        state = np.asarray(piece(earliest), dtype=np.float64)
        return [Event(watch, earliest, state) for t, watch in found if t - earliest <= _SAME_TIME]

    def _release(self, watch: Watch, piece: DenseOutput, times: FloatArray, states: FloatArray) -> float | None:
        def torque(state: FloatArray) -> FloatArray:
            q, u = state[..., : self.n_q], state[..., self.n_q :]
            column = self.equations.n_loops + self.moment.closed.index(watch.stop)
            return self.equations.solve(q, u, self.moment.closed)[1][..., column]

        values = torque(states)
        falls = np.flatnonzero((values[1:] < 0) & (values[:-1] >= 0))
        if not len(falls):
            return None
        i = int(falls[0])
        return _root(lambda t: float(torque(np.asarray(piece(t)))), float(times[i]), float(times[i + 1]))

    def _closing(self, watch: Watch, piece: DenseOutput, times: FloatArray, states: FloatArray) -> float | None:
        kinematics, n = self.equations.kinematics, self.n_q

        def gap_at(state: FloatArray) -> FloatArray:
            return kinematics.gap(watch.stop, state[..., :n])

        def speed_at(state: FloatArray) -> FloatArray:
            return np.sum(kinematics.gap_jacobian(watch.stop, state[..., :n]) * state[..., n:], axis=-1)

        def gap(t: float) -> float:
            return float(gap_at(np.asarray(piece(t))))

        def speed(t: float) -> float:
            return float(speed_at(np.asarray(piece(t))))

        gaps, speeds = gap_at(states), speed_at(states)
        for i in range(len(times) - 1):
            root = _fall(gap, speed, (float(times[i]), float(times[i + 1])), gaps[i : i + 2], speeds[i : i + 2])
            if root is not None:
                return root
        return None


def _fall(
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
