"""A run under the unilateral law: stops that open may be met again.

Chipmunk cannot change its step without losing its impulses, so a run goes on until a gap is found below zero, back to
where it was zero inside its step, through the impact, and on from there as a new segment with a start of its own. The
state there is that of the sample before, moved on by its speed and acceleration: its error, of third order, is one of
a single step, and so the order of the run stays. A touch that begins and ends within a step is not seen, and a rebound
that would is none: the stop holds.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from scipy.optimize import brentq

from ...models.arrays import FloatArray
from ...models.errors import SimulationError
from ...models.kinematics import Kinematics
from ...models.mechanism import Mechanism
from ...models.problem import Problem
from ...models.trajectory import PointMotion
from ..protocol import Recording
from .build import build, start_of
from .impact import gap_speeds, strike
from .options import PymunkOptions
from .read import Reading
from .segment import Segment

_CHUNK = 64  # steps between looks at the gaps; at most these are run in vain at an impact
_SETTLES = 3  # samples after which a stop that has let go must have a gap, or is met
_AT_REST = 1e-9  # [rad/s, m/s] gap speeds below this are rounding
_SAME_TIME = 1e-12  # [s] samples closer than this are one
_MOST_IMPACTS = 2_000


@dataclass(frozen=True)
class _Meeting:
    """Stops that touch, one of them met: the time [s] and the state there, shape (n_q,)."""

    time: float
    q: FloatArray
    u: FloatArray
    touching: tuple[str, ...]
    met: str | None
    sample: int
    """The one before it, in its segment."""


def record_with_impacts(problem: Problem, engine: PymunkOptions) -> Recording:
    """Run a problem whose stops may be met.

    Raises:
        UnsupportedProblemError: the mechanism has a part that has no counterpart here.
        SimulationError: impacts follow each other without an end, or their impulses do not settle.
    """
    return _UnilateralRun(problem, engine).recording()


class _UnilateralRun:
    def __init__(self, problem: Problem, engine: PymunkOptions) -> None:
        self.problem, self.engine, self.mechanism = problem, engine, problem.mechanism
        self.releases: dict[str, float | None] = {stop.name: None for stop in self.mechanism.stops}
        self.impacts: list[tuple[float, Mapping[str, float]]] = []
        self._last: _Meeting | None = None
        self._tired: frozenset[str] = frozenset()
        """Stops that did not bounce at the last impact, for their rebounds would have been too low."""
        self._parting: dict[str, float | None] = {}
        """When each stop opened that touches at a segment's start and does not rest."""
        # Says now, and not at an impact, which stop it could not hold.
        build(_with_closed(self.mechanism, self.releases), (), engine.error_bias, engine.pivot_mass)

    def recording(self) -> Recording:
        """Segment by segment."""
        pieces: list[Recording] = []
        start: Mechanism | None = self._first()
        while start is not None:
            begins = 0.0 if self._last is None else self._last.time
            segment = Segment(start, self.engine, begins, self.problem.duration)
            meeting = self._run(segment)
            if meeting is not None and self._is_too_low(meeting):
                start = self._without_a_rebound(meeting)
            else:
                pieces += self._accepted(segment, meeting)
                start = None if meeting is None else self._struck(meeting)
        return _joined(pieces, self.releases, tuple(self.impacts))

    def _first(self) -> Mechanism:
        """The start, through an impact where its speeds drive it into a closed stop."""
        q, u = start_of(self.mechanism)
        touching = tuple(stop.name for stop in self.mechanism.stops if stop.closed)
        speeds = gap_speeds(self.mechanism, touching, q, u)
        if any(speed < -_AT_REST for speed in speeds.values()):
            return self._struck(_Meeting(0.0, q, u, touching, None, 0))
        resting = [name for name, speed in speeds.items() if speed <= _AT_REST]
        self._parting = {name: 0.0 for name in touching if name not in resting}
        return _with_closed(self.mechanism, resting)

    def _run(self, segment: Segment) -> _Meeting | None:
        """Go on to the next impact, or to the end."""
        segment.begin()
        touched = {stop.name for stop in segment.machine.mechanism.stops if stop.closed} | self._parting.keys()
        watch, first = _Watch(segment, touched), 0
        while first < segment.n:
            last = min(max(first + _CHUNK, segment.stepper.steps), segment.n)
            segment.advance(last)
            meeting = watch.look(first, last)
            if meeting is not None:
                return meeting if meeting.time < self.problem.duration - _SAME_TIME else None
            first = last
        return None

    def _is_too_low(self, meeting: _Meeting) -> bool:
        """Whether a stop is met again within the few steps that cannot tell a rebound from rest."""
        bounced = self._last is not None and meeting.met in self._last.touching and meeting.met not in self._tired
        return bounced and meeting.met in self._parting and meeting.sample < _SETTLES

    def _without_a_rebound(self, meeting: _Meeting) -> Mechanism:
        """The last impact once more, the stop that is met again not bouncing."""
        assert self._last is not None
        assert meeting.met is not None
        self.impacts.pop()
        return self._struck(self._last, self._tired | {meeting.met})

    def _accepted(self, segment: Segment, meeting: _Meeting | None) -> list[Recording]:
        """What is recorded of a segment."""
        last, end = (segment.n, self.problem.duration) if meeting is None else (meeting.sample, meeting.time)
        if meeting is not None and end - segment.times()[last] < _SAME_TIME:
            last -= 1  # what holds at its instant is what follows the impact
        for name, time in (*self._parting.items(), *segment.releases.items()):
            # The first opening of a stop that was closed at the start counts: the throw depends on it.
            if time is not None and time <= end and self.releases[name] is None and self.mechanism.stop(name).closed:
                self.releases[name] = time
        return [segment.recording(last)] if last >= 0 else []

    def _struck(self, meeting: _Meeting, tired: frozenset[str] = frozenset()) -> Mechanism:
        """The machine as it leaves an impact, in which tired stops do not bounce."""
        if len(self.impacts) >= _MOST_IMPACTS:
            raise SimulationError(f"pymunk gave up at t = {meeting.time:.6g} s: {_MOST_IMPACTS} impacts, and no end.")
        placed = _with_closed(self.mechanism, meeting.touching).model_copy(
            update={"start": tuple(meeting.q.tolist()), "start_speeds": tuple(meeting.u.tolist())}
        )
        restitution = {n: 0.0 if n in tired else self.mechanism.stop(n).restitution for n in meeting.touching}
        impact = strike(placed, restitution, self.engine.pivot_mass)
        self.impacts.append((meeting.time, impact.impulses))
        self._last, self._tired = meeting, tired
        self._parting = {name: meeting.time for name in meeting.touching if name not in impact.resting}
        return _with_closed(placed, impact.resting).model_copy(update={"start_speeds": tuple(impact.u.tolist())})


class _Watch:
    """Looks for the first open stop that is met in a segment."""

    def __init__(self, segment: Segment, touched: Collection[str]) -> None:
        self.segment = segment
        self.kinematics = Kinematics(segment.machine.mechanism)
        mechanism = segment.machine.mechanism
        # One that has just let go may stand below zero by its rounding or drift: it is watched once it has a gap.
        self._parted = {stop.name for stop in mechanism.stops if stop.name not in touched}
        self._near = start_of(mechanism)[0]

    def look(self, first: int, last: int) -> _Meeting | None:
        """The first meeting between two samples, the first one included."""
        reading = self.segment.reading(first, last, self._near)
        q, u = reading.coordinates()
        self._near = q[-1]
        hits = {stop.name: self._hit(stop.name, first, q, u) for stop in self.segment.machine.mechanism.stops}
        met = [self._onto(name, k - 1, reading, first) for name, k in hits.items() if k is not None]
        return min(met, key=lambda found: found.time, default=None)

    def _hit(self, name: str, first: int, q: FloatArray, u: FloatArray) -> int | None:
        """The sample before which a stop is met."""
        opened = self._opened(name)
        if opened is None:
            return None
        gaps = self.kinematics.gap(name, q)
        speeds = np.sum(self.kinematics.gap_jacobian(name, q) * u, axis=-1)
        for k in range(max(first, opened), first + len(q)):
            gap, speed = float(gaps[k - first]), float(speeds[k - first])
            if gap > 0:
                self._parted.add(name)
            elif gap < 0 and speed < 0 and (name in self._parted or k >= opened + _SETTLES):
                return k
        return None

    def _opened(self, name: str) -> int | None:
        """Sample from which a stop is open; None while it is closed."""
        regimes = [(first, closed) for first, closed in self.segment.regimes if name not in closed]
        return regimes[0][0] if regimes else None

    def _onto(self, name: str, k: int, reading: Reading, first: int) -> _Meeting:
        """The state where a gap is zero, between samples k and k + 1."""
        k = max(k, first)
        (q, u), a = reading.coordinates(), reading.accelerations()
        q, u, a = q[k - first], u[k - first], a[k - first]

        def gap(after: float) -> float:
            return float(self.kinematics.gap(name, q + after * (u + after / 2 * a)))

        h = self.segment.h
        after = float(brentq(gap, 0.0, h, xtol=1e-16)) if gap(0.0) > 0 > gap(h) else (h if gap(0.0) > 0 else 0.0)
        time = float(self.segment.times()[k]) + after
        held = [other for other in self.segment.closed_at(k) if (self.segment.releases[other] or np.inf) > time]
        touching = tuple(stop for stop in self.segment.releases if stop == name or stop in held)
        return _Meeting(time, q + after * (u + after / 2 * a), u + after * a, touching, name, k)


def _with_closed(mechanism: Mechanism, closed: Collection[str]) -> Mechanism:
    # Not validated: the start's gaps are zero to rounding only.
    stops = tuple(stop.model_copy(update={"closed": stop.name in closed}) for stop in mechanism.stops)
    return mechanism.model_copy(update={"stops": stops})


def _joined(
    pieces: Sequence[Recording],
    releases: Mapping[str, float | None],
    impacts: tuple[tuple[float, Mapping[str, float]], ...],
) -> Recording:
    """Recordings of one mechanism, one after the other."""
    merged = {
        field.name: _merged([getattr(piece, field.name) for piece in pieces])
        for field in fields(Recording)
        if field.name not in ("release_times", "impacts", "steps")
    }
    return Recording(**merged, release_times=releases, impacts=impacts, steps=sum(piece.steps for piece in pieces))


def _merged(parts: Sequence[Any]) -> Any:
    if isinstance(parts[0], Mapping):
        return {name: _merged([part[name] for part in parts]) for name in parts[0]}
    if isinstance(parts[0], PointMotion):
        return PointMotion(*(np.concatenate([getattr(p, key) for p in parts]) for key in ("position", "velocity")))
    return np.concatenate(parts)
