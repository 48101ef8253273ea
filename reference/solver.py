"""The reference motion: DOP853 between events, every event found by root finding."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import DOP853, DenseOutput, OdeSolution
from scipy.optimize import brentq

from ..models.arrays import FloatArray
from ..models.errors import SimulationError
from ..models.problem import Problem, StopLaw
from .equations import Equations
from .solution import Segment, Solution
from .stops import impact, pushing

_PROBES = np.linspace(0.0, 1.0, 6)[1:]  # where inside a step the events are watched
_MAX_EVENTS = 1000

TOLERANCE = 3e-14
"""Just above the least SciPy takes (100 machine epsilons): energy then holds to some 1e-13 between the steps, too."""


@dataclass
class _Progress:
    """What the integration knows at the start of a segment."""

    t: float
    q: FloatArray
    u: FloatArray
    closed: tuple[str, ...]
    gone: set[str] = field(default_factory=set[str])


@dataclass(frozen=True)
class _Event:
    t: float
    state: FloatArray
    stop: str
    closes: bool


def solve(problem: Problem, rtol: float = TOLERANCE, atol: float = TOLERANCE) -> Solution:
    """Integrate a problem with SciPy's DOP853.

    Args:
        rtol, atol: local error bounds of the integrator, relative and absolute [rad, m, rad/s, m/s].

    Returns:
        A continuous solution with every release (and, under the unilateral law, impact) located.

    Raises:
        SimulationError: the integrator's step size collapsed, or there are more than a thousand events.
    """
    return _Integration(problem, rtol, atol).run()


class _Integration:
    def __init__(self, problem: Problem, rtol: float, atol: float) -> None:
        self.problem = problem
        self.mechanism = problem.mechanism
        self.equations = Equations(problem.mechanism)
        self.tolerances = {"rtol": rtol, "atol": atol}
        self.n_q = len(self.mechanism.coordinates)
        self.releases: dict[str, float | None] = {stop.name: None for stop in self.mechanism.stops}
        self.impacts: list[tuple[float, dict[str, float]]] = []
        self.evaluations = 0

    def run(self) -> Solution:
        started = time.perf_counter()
        state = self._start()
        segments: list[Segment] = []
        while state.t < self.problem.duration:
            if len(segments) > _MAX_EVENTS:
                raise SimulationError(f"the reference met more than {_MAX_EVENTS} events by t = {state.t:.6g} s.")
            segment, event = self._segment(state)
            segments.append(segment)
            if event is None:
                break
            state = self._after(event, state)
        return Solution(
            problem=self.problem,
            equations=self.equations,
            segments=tuple(segments),
            release_times=self.releases,
            impacts=tuple(self.impacts),
            evaluations=self.evaluations,
            settings=self.tolerances,
            wall_time=time.perf_counter() - started,
        )

    def _start(self) -> _Progress:
        q = np.array(self.mechanism.start)
        u = np.array(self.mechanism.start_speeds or [0.0] * self.n_q)
        touching = tuple(stop.name for stop in self.mechanism.stops if stop.closed)
        state = _Progress(0.0, q, u, touching)
        return self._drop_pullers(state)

    def _drop_pullers(self, state: _Progress) -> _Progress:
        """Release every stop that would have to pull."""
        closed = pushing(self.equations, state.q, state.u, state.closed)
        for name in set(state.closed) - set(closed):
            self._release(name, state)
        state.closed = closed
        return state

    def _release(self, name: str, state: _Progress) -> None:
        if self.releases[name] is None:
            self.releases[name] = state.t
        if self.problem.stop_law is StopLaw.RELEASE_ONCE:
            state.gone.add(name)

    def _segment(self, state: _Progress) -> tuple[Segment, _Event | None]:
        """Integrate under one active set, to its first event or to the end."""
        stepper = DOP853(
            self._right_hand_side(state.closed),
            state.t,
            np.concatenate([state.q, state.u]),
            self.problem.duration,
            rtol=self.tolerances["rtol"],
            atol=self.tolerances["atol"],
        )
        times, pieces = [state.t], list[DenseOutput]()
        event: _Event | None = None
        while stepper.status == "running" and event is None:
            message = stepper.step()
            if message is not None:
                raise SimulationError(f"the reference's integrator stopped at t = {stepper.t:.6g} s: {message}.")
            piece = stepper.dense_output()
            event = self._first_event(state, piece, times[-1], stepper.t)
            pieces.append(piece)
            times.append(stepper.t if event is None else event.t)
        self.evaluations += stepper.nfev
        if len(pieces) > 1 and times[-1] <= times[-2]:
            times.pop()
            pieces.pop()
        return Segment(state.closed, state.t, times[-1], OdeSolution(np.array(times), pieces)), event

    def _right_hand_side(self, closed: tuple[str, ...]) -> Callable[[float, FloatArray], FloatArray]:
        n_q, equations = self.n_q, self.equations

        def rates(t: float, y: FloatArray) -> FloatArray:
            return np.concatenate([y[n_q:], equations.solve(y[:n_q], y[n_q:], closed)[0]])

        return rates

    def _first_event(self, state: _Progress, piece: DenseOutput, t0: float, t1: float) -> _Event | None:
        watched = [(name, False) for name in state.closed]
        if self.problem.stop_law is StopLaw.UNILATERAL:
            names = (stop.name for stop in self.mechanism.stops)
            watched += [(name, True) for name in names if name not in state.closed]
        if not watched:
            return None
        times = np.concatenate([[t0], t0 + _PROBES * (t1 - t0)])
        states = np.asarray(piece(times)).T
        found: list[_Event] = []
        for name, closes in watched:
            values = self._distance(states, name, closes, state.closed)
            falls = np.flatnonzero((values[1:] < 0) & (values[:-1] >= 0))
            if len(falls):
                root = self._root(piece, float(times[falls[0]]), float(times[falls[0] + 1]), name, closes, state)
                found.append(_Event(root, np.asarray(piece(root)), name, closes))
        return min(found, key=lambda event: event.t, default=None)

    def _distance(self, states: FloatArray, name: str, closes: bool, closed: tuple[str, ...]) -> FloatArray:
        """What falls through zero at the event: a torque (a release) or a gap (a closing)."""
        q, u = states[..., : self.n_q], states[..., self.n_q :]
        if closes:
            return self.equations.kinematics.gap(name, q)
        return self.equations.solve(q, u, closed)[1][..., self.equations.n_loops + closed.index(name)]

    def _root(self, piece: DenseOutput, t0: float, t1: float, name: str, closes: bool, state: _Progress) -> float:
        def value(t: float) -> float:
            return float(self._distance(np.asarray(piece(t)), name, closes, state.closed))

        return float(brentq(value, t0, t1, xtol=1e-15, rtol=1e-15))

    def _after(self, event: _Event, before: _Progress) -> _Progress:
        q, u = event.state[: self.n_q].copy(), event.state[self.n_q :].copy()
        state = _Progress(event.t, q, u, before.closed, before.gone)
        if event.closes:
            touching = (*before.closed, event.stop)
            state.u, impulses = impact(self.equations, q, u, touching)
            self.impacts.append((event.t, impulses))
            state.closed = tuple(name for name in touching if impulses[name] > 0 or name in before.closed)
        else:
            self._release(event.stop, state)
            state.closed = tuple(name for name in before.closed if name != event.stop)
        return self._drop_pullers(state)
