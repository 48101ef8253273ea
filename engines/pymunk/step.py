"""Moving a mechanism with Chipmunk from its start to the end, over the releases and impacts of its stops.

Chipmunk cannot change its step without losing its impulses. Under the unilateral law a run
therefore goes on until a gap is below zero, back to where it was zero inside that step, through the
impact, and on from there as a new segment with a start of its own. The state at the impact is that
of the sample before, moved on by its speed and acceleration: its error, of third order, is made
once per impact, so the order of the run stays. A contact that begins and ends within a step is not
seen. A rebound that ends within three steps is none, for its leapfrog has not settled by then: the
contact rests. So does one that has parted because another one was met, and comes back as soon:
steps too long for impacts that follow each other ever faster would go on with them for ever.
Comparisons allow for it.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from ...models.arrays import FloatArray
from ...models.kinematics import Kinematics, initial_state
from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw
from ..contact_events import (
    AT_REST,
    SAME_TIME,
    ContactEvents,
    Contacts,
    joined,
    refuse_moving_gaps,
    resting,
)
from ..protocol import Recording
from .build import build
from .impact import gap_speeds, resolve_impact
from .options import PymunkOptions
from .read import Reading
from .segment import Segment

_CHUNK = 64  # steps between checks of the gaps; at most these are repeated at an impact
_SETTLING_SAMPLES = 3  # after which a contact that has opened must have a gap, or is met


@dataclass(frozen=True)
class _ContactEvent:
    """An inactive contact is met, or speeds at the start drive into a closed one."""

    time: float
    """[s]"""
    q: FloatArray
    u: FloatArray
    """The state there, before the impact, shape (n_q,)."""
    touching: Contacts
    met: str | None
    sample: int
    """The one before it, in its segment."""


def run(problem: Problem, options: PymunkOptions) -> Recording:
    """Simulate a problem.

    Raises:
        UnsupportedProblemError: the mechanism has a part that has no counterpart here, or under the
            release-once law starts with a closed stop whose gap changes.
        SimulationError: impacts follow each other without an end, or their impulses do not
            converge.
    """
    if problem.stop_law is StopLaw.UNILATERAL:
        return _UnilateralRun(problem, options).recording()
    refuse_moving_gaps(problem.mechanism, "pymunk")
    segment = Segment(problem.mechanism, options, 0.0, problem.duration)
    segment.begin()
    segment.advance(segment.n)
    return segment.recording(segment.n)


class _UnilateralRun:
    """Moves one problem whose stops may be met, one segment after another."""

    def __init__(self, problem: Problem, options: PymunkOptions) -> None:
        self.problem, self.options, self.mechanism = problem, options, problem.mechanism
        self.events = ContactEvents(self.mechanism, "pymunk")
        self._last: _ContactEvent | None = None
        self._plastic: frozenset[str] = frozenset()
        """Contacts that did not rebound at the last impact, because their rebounds would have been too low."""
        self._held: frozenset[str] = frozenset()
        """Contacts that came to rest at the last impact, because they came back at once although they were plastic."""
        self._parting: dict[str, float] = {}
        """When each contact opened that touches at a segment's start and does not rest [s]."""
        # Raises UnsupportedProblemError at once if a stop cannot be enforced, instead of at the
        # first impact.
        build(
            _with_closed(self.mechanism, self.events.releases),
            (),
            options.error_bias,
            options.pivot_mass,
        )

    def recording(self) -> Recording:
        """Move from the start to the end, and read out."""
        recordings: list[Recording] = []
        start: Mechanism | None = self._first()
        while start is not None:
            begins = 0.0 if self._last is None else self._last.time
            segment = Segment(start, self.options, begins, self.problem.duration)
            event = self._step_to_event(segment)
            if event is not None and self._is_too_low(event):
                start = self._without_rebound(event)
            else:
                recordings += self._accepted(segment, event)
                start = None if event is None else self._after_impact(event)
        return joined(recordings, self.events)

    def _first(self) -> Mechanism:
        """The start, after an impact where its speeds drive into a closed stop."""
        q, u = initial_state(self.mechanism)
        touching = tuple(stop.name for stop in self.mechanism.stops if stop.closed)
        speeds = gap_speeds(self.mechanism, touching, q, u)
        if any(speed < -AT_REST for speed in speeds.values()):
            return self._after_impact(_ContactEvent(0.0, q, u, touching, None, 0))
        rest = resting(speeds)
        self._parting = {name: 0.0 for name in touching if name not in rest}
        return _with_closed(self.mechanism, rest)

    def _step_to_event(self, segment: Segment) -> _ContactEvent | None:
        """Step to the next impact, or to the end."""
        segment.begin()
        touched = {
            stop.name for stop in segment.assembly.mechanism.stops if stop.closed
        } | self._parting.keys()
        finder, first = _EventFinder(segment, touched, self.events), 0
        while first < segment.n:
            last = min(max(first + _CHUNK, segment.stepper.steps), segment.n)
            segment.advance(last)
            event = finder.first_event(first, last)
            if event is not None:
                return event if event.time < self.problem.duration - SAME_TIME else None
            first = last
        return None

    def _is_too_low(self, event: _ContactEvent) -> bool:
        """Whether a contact is met again within the few steps that cannot resolve how it parted."""
        again = (
            self._last is not None
            and event.met in self._last.touching
            and event.met not in self._held
        )
        return again and event.met in self._parting and event.sample < _SETTLING_SAMPLES

    def _without_rebound(self, event: _ContactEvent) -> Mechanism:
        """The last impact once more: its contacts that touch again are plastic, and one that was it comes to rest."""
        assert self._last is not None
        assert event.met is not None
        self.events.retract_impact()
        plastic = self._plastic | (set(event.touching) & set(self._last.touching))
        held = self._held | {event.met} if event.met in self._plastic else self._held
        return self._after_impact(self._last, plastic, held)

    def _accepted(self, segment: Segment, event: _ContactEvent | None) -> list[Recording]:
        """What is recorded of a segment."""
        last, end = (
            (segment.n, self.problem.duration) if event is None else (event.sample, event.time)
        )
        if event is not None and end - segment.times()[last] < SAME_TIME:
            last -= 1  # at the time of an impact the state after it is recorded
        for name, time in (*self._parting.items(), *segment.releases.items()):
            if time is not None and time <= end:
                self.events.release([name], time)
        return [segment.recording(last)] if last >= 0 else []

    def _after_impact(
        self,
        event: _ContactEvent,
        plastic: frozenset[str] = frozenset(),
        held: frozenset[str] = frozenset(),
    ) -> Mechanism:
        """The mechanism as it leaves an impact, in which plastic contacts do not rebound, and held ones do not part."""
        placed = _with_closed(self.mechanism, event.touching).model_copy(
            update={"start": tuple(event.q.tolist()), "start_speeds": tuple(event.u.tolist())}
        )
        speeds = gap_speeds(placed, event.touching, event.q, event.u)
        restitution = self.events.restitution(speeds, event.q, event.u, plastic)
        impact = resolve_impact(placed, restitution, self.options.pivot_mass, held)
        self.events.note_impact(event.time, impact.impulses)
        self._last, self._plastic, self._held = event, plastic, held
        self._parting = {name: event.time for name in event.touching if name not in impact.resting}
        return _with_closed(placed, impact.resting).model_copy(
            update={"start_speeds": tuple(impact.u.tolist())}
        )


class _EventFinder:
    """Finds the first inactive contact that is met in a segment."""

    def __init__(self, segment: Segment, touched: Collection[str], events: ContactEvents) -> None:
        self.segment, self.events = segment, events
        self.kinematics = Kinematics(segment.assembly.mechanism)
        mechanism = segment.assembly.mechanism
        # A contact that has just opened may penetrate by its rounding or drift: it can be met once
        # it has had a gap.
        self._parted = {stop.name for stop in mechanism.stops if stop.name not in touched}
        self._near = initial_state(mechanism)[0]

    def first_event(self, first: int, last: int) -> _ContactEvent | None:
        """The first event between two samples, the first one included."""
        reading = self.segment.reading(first, last, self._near)
        q, u = reading.coordinates()
        self._near = q[-1]
        hits = {
            stop.name: self._first_penetration(stop.name, first, q, u)
            for stop in reading.mechanism.stops
        }
        events = [
            self._located(name, k - 1, reading, first) for name, k in hits.items() if k is not None
        ]
        return min(events, key=lambda event: event.time, default=None)

    def _first_penetration(self, name: str, first: int, q: FloatArray, u: FloatArray) -> int | None:
        """The sample before which a contact is met."""
        opened = self._opened(name)
        if opened is None:
            return None
        gaps = self.kinematics.gap(name, q)
        speeds = np.sum(self.kinematics.gap_jacobian(name, q) * u, axis=-1)
        for k in range(max(first, opened), first + len(q)):
            gap, speed = float(gaps[k - first]), float(speeds[k - first])
            if gap > 0:
                self._parted.add(name)
            elif (
                gap < 0 and speed < 0 and (name in self._parted or k >= opened + _SETTLING_SAMPLES)
            ):
                return k
        return None

    def _opened(self, name: str) -> int | None:
        """Sample from which a contact is inactive; None while it is active."""
        return next((first for first, active in self.segment.regimes if name not in active), None)

    def _located(self, name: str, k: int, reading: Reading, first: int) -> _ContactEvent:
        """The event between samples k and k + 1, where a gap is zero."""
        k = max(k, first)
        (q, u), a = reading.coordinates(), reading.accelerations()
        q, u, a = q[k - first], u[k - first], a[k - first]

        def gap(after: float) -> float:
            return float(self.kinematics.gap(name, q + after * (u + after / 2 * a)))

        h = self.segment.h
        after = (
            float(brentq(gap, 0.0, h, xtol=1e-16))
            if gap(0.0) > 0 > gap(h)
            else (h if gap(0.0) > 0 else 0.0)
        )
        time, q_event = float(self.segment.times()[k]) + after, q + after * (u + after / 2 * a)
        active = [
            other
            for other in self.segment.active_at(k)
            if (self.segment.releases[other] or np.inf) > time
        ]
        touching = self.events.touching(
            time, name, active, lambda other: float(self.kinematics.gap(other, q_event))
        )
        return _ContactEvent(time, q_event, u + after * a, touching, name, k)


def _with_closed(mechanism: Mechanism, closed: Collection[str]) -> Mechanism:
    # Not validated: the start's gaps are zero to rounding only.
    stops = tuple(
        stop.model_copy(update={"closed": stop.name in closed}) for stop in mechanism.stops
    )
    return mechanism.model_copy(update={"stops": stops})
