"""Releases and impacts of stops: their rules, where in a step they are, and the one event driver.

Between events an engine moves the mechanism with a fixed set of active contacts. At an event

- the force of an active contact falls through zero, and the contact opens (a **release**). The
  release time of a stop is that of its first opening.
- the gap of an open contact falls through zero (an **impact**, unilateral law only). All contacts
  that touch at that instant take part, active ones included, each with its restitution e. A contact
  met too slowly to rebound (:data:`SETTLED`, the rule of the reference) is plastic (e = 0),
  so that bouncing with 0 < e < 1 comes to rest after finitely many impacts. Contacts whose gap
  speed is zero afterwards rest; the others part, which is a release.
- two stops may throw a mechanism to and fro ever faster, towards an instant that is never reached.
  Impacts within `TOGETHER` of each other are therefore resolved at once.

The semantics are those of the reference, which has an implementation of its own
(:mod:`...reference.contact`).

:class:`EventDriver` is the loop, the same for every engine: begin (with an impact where the start's
speeds drive into a closed stop), move to the next event, note what opened, resolve the impact, hold
the contacts that rest, go on. What it asks of an engine is :class:`EventMotion`::

    loop:  halt = motion.proceed(time, end, watch)        # records the samples before the event
           note halt.opened                               # the motion has let them go already
           if halt.met: touching = those with zero gap now (motion.gap), and motion.held
                        impulses, rest = motion.impact(touching, rule, kept)
                        motion.hold(rest, time)           # holds those of them that push, records
           if halt.again: the same for the last impact once more, from the state before it

An `EventMotion` owns how it finds an event, how it holds a contact and how it resolves an impact.
For an engine that takes steps of any length from a state that can be saved, :class:`SteppedMotion`
finds the events: whole steps first, as many at once as the engine likes; then the step with an
event again, up to the event. An engine whose time step must not change implements `proceed` itself.
"""

from __future__ import annotations

import functools
import math
from abc import abstractmethod
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..models.arrays import FloatArray
from ..models.errors import SimulationError, UnsupportedProblemError
from ..models.kinematics import Kinematics, initial_state
from ..models.mechanism import Mechanism
from ..models.problem import Problem
from ..models.trajectory import PointMotion
from .impact import (
    AT_REST,
    Contacts,
    Impact,
    Inertia,
    Rebounds,
    active_contacts,  # noqa: F401 # pyright: ignore[reportUnusedImport] - for adapters
    resolve_impact,
    resting,
)
from .protocol import Recording

SAME_TIME = 1e-12  # [s] times closer than this are one instant
TOGETHER = 1e-9  # [s] impacts closer than this are resolved at once
MOST_IMPACTS = 10_000
ROUNDING = 1e-15  # times closer than this (relatively) are one time
ROUNDING_OF_STEPS = 1e-12  # of a number of steps
_TOUCHING = 1e-11  # [rad, m] an inactive contact with a gap below this takes part in an impact
_RECENT = 10  # impacts that are searched for those within TOGETHER
_MOVING = 1e-12  # [rad/s, m/s], or of the terms of a gap speed: below this it is rounding error
_RESOLVED = 1e-13  # of the step in which an event is: error of its time

State = tuple[FloatArray, FloatArray]
"""Coordinates q and speeds u of the mechanism, each of shape (n_q,)."""
RestitutionRule = Callable[[Mapping[str, float], FloatArray, FloatArray], Mapping[str, float]]
"""Restitution e of each contact in an impact, from its gap speed [rad/s, m/s], q and u."""

S = TypeVar("S")
_Names = Collection[str]


# --- Rules


class ContactEvents:
    """The releases and impacts of one run, and their rules; the engine's name is for messages."""

    def __init__(self, mechanism: Mechanism, engine: str) -> None:
        self.mechanism, self.engine = mechanism, engine
        self.releases: dict[str, float | None] = {stop.name: None for stop in mechanism.stops}
        """First opening of each stop that was closed at the start [s]."""
        self.rebounds = Rebounds(mechanism)
        self.impacts: list[tuple[float, Mapping[str, float]]] = []
        """Time [s] and impulse of each contact that took part [N m s, N s]."""

    def release(self, names: Iterable[str], time: float) -> None:
        """Note openings at a time [s]; the first one of a stop counts: the throw depends on it."""
        for name in names:
            if self.releases[name] is None and self.mechanism.stop(name).closed:
                self.releases[name] = time

    def touching(
        self, time: float, met: str, active: Collection[str], gap: Callable[[str], float]
    ) -> Contacts:
        """Contacts that take part in an impact.

        Args:
            time: of the impact [s].
            met: the contact whose gap falls through zero.
            active: contacts that are active there.
            gap: of an inactive contact there [rad, m], by its name.
        """
        certain = {met, *active}
        for before, impulses in self.impacts[-_RECENT:]:
            if time - before <= TOGETHER:
                certain.update(name for name, impulse in impulses.items() if impulse > 0)
        return tuple(
            name for name in self.releases if name in certain or abs(gap(name)) <= _TOUCHING
        )

    def restitution(
        self, speeds: Mapping[str, float], q: FloatArray, u: FloatArray, plastic: _Names = ()
    ) -> dict[str, float]:
        """Restitution e of each contact in an impact: 0 for the plastic ones.

        Args:
            speeds: of the gaps before the impact [rad/s, m/s].
            q, u: the state before it, shape (n_q,).
            plastic: contacts whose rebounds are too low for the adapter's steps to follow.
        """
        self.rebounds.note_impact(q, u)
        restitution = dict.fromkeys(speeds, 0.0)
        for name, speed in speeds.items():
            if name not in plastic and speed < -self.rebounds.least_speed(name, q):
                restitution[name] = self.mechanism.stop(name).restitution
        return restitution

    def note_impact(self, time: float, impulses: Mapping[str, float]) -> None:
        """Record an impact; SimulationError if there are `MOST_IMPACTS` already."""
        if len(self.impacts) >= MOST_IMPACTS:
            raise SimulationError(
                f"{self.engine} gave up at t = {time:.6g} s: {MOST_IMPACTS} impacts, and no end."
            )
        self.impacts.append((time, impulses))

    def retract_impact(self) -> None:
        """Forget the last impact, which is resolved anew."""
        self.impacts.pop()


def refuse_moving_gaps(mechanism: Mechanism, engine: str) -> None:
    """Refuse a start with a closed stop whose gap changes: with an impact or an opening.

    Raises:
        UnsupportedProblemError: there is one.
    """
    kinematics, (q, u) = Kinematics(mechanism), initial_state(mechanism)
    for stop in mechanism.stops:
        terms = kinematics.gap_jacobian(stop.name, q) * u
        if stop.closed and abs(terms.sum()) > _MOVING * max(1.0, float(np.abs(terms).sum())):
            raise UnsupportedProblemError(
                f"{engine} cannot start with stop {stop.name!r} closed while its gap changes at "
                f"{terms.sum():.3g} {stop.speed_unit}: that is an impact or an opening at t = 0."
            )


def whole_steps(duration: float, timestep: float) -> int:
    """Number of whole time steps [s] up to the end of a duration [s], or just beyond."""
    return math.ceil(duration / timestep * (1 - ROUNDING_OF_STEPS))


def note_own_releases(
    events: ContactEvents,
    times: FloatArray,
    efforts: Mapping[str, FloatArray],
    settled: int = 1,
) -> None:
    """Note the releases of an engine that holds its stops itself.

    A stop that was closed is called released at the end of the first step after which it has no
    force; at the start, where it has none after the first steps either: the limits of many engines
    begin without force.

    Args:
        events: of the run.
        times: of its samples [s], shape (n,); the first one is the start.
        efforts: torque or force of each stop in the samples [N m, N], shape (n,).
        settled: steps after which a limit of the engine has its force.
    """
    for stop in events.mechanism.stops:
        effort = efforts[stop.name]
        without = np.flatnonzero(effort[settled:] <= 0.0) + settled
        if stop.closed and len(without):
            first = int(without[0])
            opened = 0.0 if first == settled and (effort[:settled] <= 0.0).all() else times[first]
            events.release([stop.name], float(opened))


# --- The driver


@dataclass(frozen=True)
class Halt:
    """The end of an uninterrupted motion: an event, or the end of the problem."""

    time: float  # [s]
    opened: Mapping[str, float] = field(default_factory=dict[str, float])
    """Contacts that were held and have opened on the way or now, and when [s]."""
    met: str | None = None  # open stop whose gap falls through zero now
    again: tuple[frozenset[str], frozenset[str]] | None = None
    """The last impact is to be resolved once more, with these contacts plastic (e = 0) and these
    kept at rest even if they would have to pull: they came back too soon for the engine's steps.
    The motion is back in the state before that impact, at its time."""


@dataclass(frozen=True)
class Watch:
    """Stops that may be met on the way."""

    open: Contacts  # open stops; none under the release-once law
    parted: frozenset[str]
    """Those of them that an impact opened. Others may have a small speed by drift or softness."""
    rebounds: Rebounds
    touching: Callable[[float, str, Collection[str], Callable[[str], float]], Contacts]
    """:meth:`ContactEvents.touching`, for an engine that has to know before it halts."""

    def least_speed(self, name: str, q: FloatArray, u: FloatArray) -> float:
        """Closing speed from which a stop is met, near a state [rad/s, m/s]."""
        return 0.0 if name in self.parted else self.rebounds.least_speed(name, q, u)


class EventMotion(Protocol):
    """An engine in its present state; it records its samples itself."""

    held: Contacts  # contacts that are held now

    @abstractmethod
    def gap(self, stop: str) -> tuple[float, float]:
        """Gap of a stop now [rad, m], and its speed [rad/s, m/s]."""

    @abstractmethod
    def proceed(self, start: float, end: float, watch: Watch) -> Halt:
        """Move from one time [s] to the next event, or to another time [s].

        Records every sample on the way. At an impact the sample after it is recorded by
        :meth:`hold`, in place of one before it at the same time.
        """

    @abstractmethod
    def impact(
        self, touching: Contacts, rule: RestitutionRule, kept: frozenset[str]
    ) -> tuple[Mapping[str, float], Contacts]:
        """Change the speeds by the impact of all contacts that touch.

        Args:
            touching: these contacts.
            rule: their restitution.
            kept: those that stay at rest whatever the impact does (:attr:`Halt.again`).

        Returns:
            The impulse of each [N m s, N s], and those that rest afterwards.
        """

    @abstractmethod
    def hold(self, rest: Contacts, time: float) -> Contacts:
        """Hold of all contacts those at rest that push, and record the sample at this time [s].

        Called at the start and after every impact.

        Returns:
            The contacts that are held. One of the others may still be found to open now, by the
            next :attr:`Halt.opened`.
        """

    @abstractmethod
    def recording(self, events: ContactEvents) -> Recording:
        """The samples, with the run's events."""


class EventDriver:
    """One run of an engine through the releases and impacts of a problem.

    Args:
        problem: what is to be moved, for how long.
        motion: the engine, at the start.
        engine: its name, for messages.
        impacts: whether stops may be met; otherwise none is watched, and closed gaps that move at
            the start are refused.
    """

    def __init__(
        self, problem: Problem, motion: EventMotion, engine: str, *, impacts: bool
    ) -> None:
        self.problem, self.motion, self.engine, self.impacts = problem, motion, engine, impacts
        self.events = ContactEvents(problem.mechanism, engine)
        self._parted: frozenset[str] = frozenset()
        self._opened: Mapping[str, float] = {}
        """Contacts that did not stay at the last impact, to be noted once it is accepted."""
        self._last_impact: tuple[float, Contacts] = (0.0, ())

    def run(self) -> Recording:
        """Move the mechanism from its start to the problem's end.

        Raises:
            SimulationError: no set of contacts takes part in an impact, or impacts follow each
                other without end.
            UnsupportedProblemError: without impacts, a closed stop starts with a gap that changes.
        """
        self._begin()
        time, duration = 0.0, self.problem.duration
        while time < duration:
            open_stops = (name for name in self.events.releases if name not in self.motion.held)
            watched = tuple(open_stops) if self.impacts else ()
            watch = Watch(watched, self._parted, self.events.rebounds, self.events.touching)
            halt = self.motion.proceed(time, duration, watch)
            time = halt.time
            if halt.again is not None:
                self.events.retract_impact()
                time, touching = self._last_impact
                self._resolve_impact(touching, time, *halt.again)
                continue
            self._note_openings(self._opened)
            self._note_openings(halt.opened)
            self._opened = {}
            if halt.met is not None:
                touching = self.events.touching(
                    time, halt.met, self.motion.held, lambda name: self.motion.gap(name)[0]
                )
                self._resolve_impact(touching, time)
        self._note_openings(self._opened)
        return self.motion.recording(self.events)

    def _begin(self) -> None:
        """Hold the closed stops, after an impact where the start's speeds drive into one."""
        closed = tuple(stop.name for stop in self.problem.mechanism.stops if stop.closed)
        if not self.impacts:
            refuse_moving_gaps(self.problem.mechanism, self.engine)
            self._hold(closed, closed, 0.0)
            return
        speeds = {name: self.motion.gap(name)[1] for name in closed}
        if any(speed < -AT_REST for speed in speeds.values()):
            self._resolve_impact(closed, 0.0)
        else:
            self._hold(closed, resting(speeds), 0.0)

    def _resolve_impact(
        self, touching: Contacts, time: float, plastic: _Names = (), kept: _Names = ()
    ) -> None:
        """Resolve the impact of all contacts that touch at a time [s], and hold those that rest."""
        rule = functools.partial(self.events.restitution, plastic=plastic)
        impulses, rest = self.motion.impact(touching, rule, frozenset(kept))
        self.events.note_impact(time, impulses)
        self._last_impact = time, touching
        self._hold(touching, rest, time)

    def _hold(self, touching: Contacts, rest: Contacts, time: float) -> None:
        held = self.motion.hold(rest, time)
        parting = [name for name in touching if name not in rest]
        self._parted = self._parted - set(rest) | set(parting)
        self._opened = {name: time for name in touching if name not in held}

    def _note_openings(self, opened: Mapping[str, float]) -> None:
        for name, time in opened.items():
            self.events.release([name], time)


class SteppedMotion(EventMotion, Generic[S]):
    """EventMotion of an engine that takes steps of any length from a saved state `S`.

    Subclasses move, hold and record; this class locates events inside a step. Whole steps end at
    multiples of the time step; the last one may be shorter.

    Args:
        problem: what is to be moved.
        timestep: [s].
        locate: whether releases are located inside a step; otherwise a stop opens at the end of the
            first step after which it would pull.
    """

    records_release_at_start: ClassVar[bool] = True
    """Whether a release at the very start of a step replaces the sample there."""
    at_once: ClassVar[int] = 0
    """Greatest number of whole steps that :meth:`ahead` takes; zero: each step is looked at."""

    def __init__(self, problem: Problem, timestep: float, *, locate: bool = True) -> None:
        self.problem, self.timestep, self.locate = problem, timestep, locate
        self.kinematics = Kinematics(problem.mechanism)
        self.held: Contacts = ()
        steps = problem.duration / timestep
        near = abs(steps - round(steps)) < ROUNDING * steps
        self._whole = round(steps) if near else int(steps)
        self._taken = 0  # whole steps taken or begun
        self._step_end = 0.0  # end of the whole step that was begun last [s]

    # --- The engine's part

    @abstractmethod
    def save(self) -> S:
        """The present state."""

    @abstractmethod
    def step(self, before: S, step: float) -> None:
        """Take one step [s] from a state, with the contacts in `held`; zero restores the state."""

    @abstractmethod
    def coordinates(self, states: Sequence[S]) -> State:
        """Coordinates and speeds of the mechanism in saved states, each of shape (n, n_q)."""

    @abstractmethod
    def state(self) -> State:
        """Coordinates and speeds of the mechanism now, each of shape (n_q,)."""

    @abstractmethod
    def pulling(self) -> Contacts:
        """Held contacts that do not push now."""

    @abstractmethod
    def opening(self, before: S, step: float, pulling: Contacts) -> tuple[float, Contacts]:
        """Go to the first release inside a step from a state.

        Args:
            before: state at the step's start.
            step: its length [s].
            pulling: contacts that do not push at its end.

        Returns:
            The part of the step after which it is [s], where the motion is left, and the contacts
            that open there.
        """

    @abstractmethod
    def let_go(self, names: Contacts) -> None:
        """Hold these contacts no longer; `held` is without them already."""

    @abstractmethod
    def record(self, time: float) -> None:
        """Add the present sample, in place of one at the same time [s]."""

    def ahead(self, first: int, n: int, watch: Watch) -> int:
        """Take up to n whole steps at once after the first ones, and record those without an event.

        Returns:
            The number of steps before the first one with an event, at whose start the motion is
            left.
        """
        raise NotImplementedError

    # --- Locating events

    def times(self, steps: ArrayLike) -> FloatArray:
        """Times after numbers of whole steps [s]; the last one is exactly the problem's end."""
        times, duration = self.timestep * np.asarray(steps), self.problem.duration
        return np.where(np.abs(times - duration) < ROUNDING * duration, duration, times)

    def gaps(self, stop: str, state: State) -> tuple[FloatArray, FloatArray]:
        """Gap of a stop [rad, m] and its speed in states, shapes (..., n_q) -> (...)."""
        q, u = state
        speed = np.sum(self.kinematics.gap_jacobian(stop, q) * u, axis=-1)
        return np.asarray(self.kinematics.gap(stop, q)), np.asarray(speed)

    def gap(self, stop: str) -> tuple[float, float]:
        """See :meth:`EventMotion.gap`."""
        gap, speed = self.gaps(stop, self.state())
        return float(gap), float(speed)

    def proceed(self, start: float, end: float, watch: Watch) -> Halt:
        """See :meth:`EventMotion.proceed`."""
        while start < end:
            if start >= self._step_end:  # a new whole step
                n = min(self.at_once, self._whole - self._taken)
                clear = self.ahead(self._taken, n, watch) if n > 0 else 0
                self._taken += clear
                start = self._step_end = float(self.times(self._taken))
                if 0 < n == clear:
                    continue
                self._taken += 1
                last = self._taken > self._whole
                self._step_end = end if last else float(self.times(self._taken))
            halt = self._step_to_event(start, self._step_end, watch)
            if halt.opened or halt.met is not None:
                return halt
            start = halt.time
        return Halt(end)

    def _step_to_event(self, start: float, end: float, watch: Watch) -> Halt:
        """Step to the next event, or from one time to another [s]."""
        before, step = self.save(), end - start
        state = self.state()
        self.step(before, step)
        meetings = self._meetings(before, state, step, watch)
        met = min(meetings, key=lambda name: meetings[name], default=None)
        part = step if met is None else meetings[met]
        reached = end if met is None else start + part
        pulling = self.pulling() if part > 0.0 else ()
        if pulling:  # before a stop is met
            return self._release(before, start, reached, pulling)
        if met is None:
            if end - start > ROUNDING * end:
                self.record(end)
            return Halt(end)
        # What remains to the end, or was stepped since the start, may be no more than rounding.
        reached = end if end - reached < ROUNDING * end else reached
        reached = start if reached - start <= ROUNDING * end else reached
        return Halt(reached, met=met)

    def _meetings(self, before: S, state: State, step: float, watch: Watch) -> dict[str, float]:
        """Open stops that are met in the step just taken, and the part of it after which [s].

        Leaves the motion at the first of them, or at the step's end.
        """
        if not watch.open:
            return {}

        def gap_after(part: float, stop: str) -> tuple[float, float]:
            self.step(before, part)
            return self.gap(stop)

        parts, probed = dict[str, float](), False
        ends = self.coordinates([before, self.save()])
        for name in watch.open:
            (gap, speed), least = self.gaps(name, ends), watch.least_speed(name, *state)
            if may_be_met(gap, speed, least, step).any():
                motion = functools.partial(gap_after, stop=name)
                speeds, probed = (float(speed[0]), float(speed[1])), True
                part = onto_zero_gap(motion, float(gap[0]), speeds, step, least)
                if part is not None:
                    parts[name] = part
        if probed:
            self.step(before, min(parts.values(), default=step))
        return parts

    def _release(self, before: S, start: float, end: float, pulling: Contacts) -> Halt:
        """Go to the first release between two times [s], and let go what opens there."""
        reached = end
        if self.locate:
            part, pulling = self.opening(before, end - start, pulling)
            reached = end if end - (start + part) < ROUNDING * end else start + part
        opened = dict[str, float]()
        while pulling:  # those that are left may have to pull without the others
            opened |= dict.fromkeys(pulling, reached)
            self.held = tuple(name for name in self.held if name not in opened)
            self.let_go(pulling)
            pulling = self.pulling()
        if reached - start > ROUNDING * end or self.records_release_at_start:
            self.record(reached)
        return Halt(reached, opened)


def impact_by_rule(
    inertia: Inertia,
    speeds: FloatArray,
    gaps: Mapping[str, FloatArray],
    held: Contacts,
    restitution: Callable[[Mapping[str, float], FloatArray], Mapping[str, float]],
    engine: str,
) -> Impact:
    """The impact of all contacts that touch, through a mass matrix.

    Args:
        inertia, gaps, engine: as for :func:`.impact.resolve_impact`.
        speeds: before, shape (n_v,); their drift from loops and held contacts is removed.
        held: contacts that were held before.
        restitution: e of each, from the closing speeds of the gaps and the speeds without drift.

    Raises:
        SimulationError: no set of contacts takes part.
    """
    speeds = inertia.without_drift(
        speeds, np.reshape([gaps[name] for name in held], (-1, len(speeds)))
    )
    closing = {name: float(row @ speeds) for name, row in gaps.items()}
    return resolve_impact(inertia, speeds, gaps, restitution(closing, speeds), engine)


# --- Where in a step an event is


def may_be_met(gap: FloatArray, speed: FloatArray, least: float, step: float) -> NDArray[np.bool_]:
    """Tell whether a stop may be met between states that are a step [s] apart; (n + 1,) -> (n,).

    It is met if it closes in penetration at one of the two, or at the lowest point of the cubic
    between them, by the gap [rad, m] and its speed, from a `least` closing speed on [rad/s, m/s].
    """
    closing = (gap < 0) & (speed < -least)
    (g0, g1), (v0, v1) = (gap[:-1], gap[1:]), (speed[:-1] * step, speed[1:] * step)
    turns = (g0 > 0) & (speed[:-1] < -least) & (speed[1:] > 0)
    s = np.where(turns, v0 / np.where(turns, v0 - v1, 1.0), 0.0)
    lowest = (g0 * (1 + 2 * s) + v0 * s) * (1 - s) ** 2 + (g1 * (3 - 2 * s) - v1 * (1 - s)) * s**2
    return closing[:-1] | closing[1:] | (turns & (lowest < 0))


def onto_zero_gap(
    motion: Callable[[float], tuple[float, float]],
    gap: float,
    speeds: tuple[float, float],
    step: float,
    least: float,
) -> float | None:
    """The part of a step [s] after which a stop is met; None if it only comes near, or too slowly.

    Args:
        motion: gap [rad, m] and its speed [rad/s, m/s] after a part of the step [s].
        gap, speeds: the gap before the step, its speeds before and after it.
        step: [s].
        least: closing speed from which it is met.
    """
    speed, last_speed = speeds
    if gap <= 0 and speed < -least:
        return 0.0
    turn = root_in(lambda part: motion(part)[1], 0.0, step) if speed * last_speed < 0 else 0.0
    # Where the gap grew at first the turn is its top, else its lowest point.
    low, high = (turn, step) if speed >= 0 else (0.0, turn or step)
    if motion(high)[0] >= 0:
        return None
    if motion(low)[0] > 0:
        low = root_in(lambda part: motion(part)[0], low, high)
    if motion(low)[1] < -least:
        return low
    if motion(high)[1] < -least:
        return root_in(lambda part: motion(part)[1] + least, low, high)
    return None


def root_in(function: Callable[[float], float], low: float, high: float) -> float:
    """Zero of a function that changes its sign in an interval [s].

    Where rounding hides the change of sign, the end with the smaller value.
    """
    from scipy.optimize import brentq  # a third of a second, which lists of engines do not need

    # An engine's warm start makes a last bit depend on the steps before: each value is taken once.
    function = functools.cache(function)
    first, last = function(low), function(high)
    if first * last >= 0:
        return low if abs(first) <= abs(last) else high
    return float(brentq(function, low, high, xtol=_RESOLVED * high))


# --- Recordings of segments


def joined(segments: Sequence[Recording], events: ContactEvents) -> Recording:
    """The recordings of one run's segments, one after the other, with the run's events."""

    def merged(parts: Sequence[Any]) -> Any:
        if isinstance(parts[0], Mapping):
            return {name: merged([part[name] for part in parts]) for name in parts[0]}
        if isinstance(parts[0], PointMotion):
            columns = ([getattr(p, key) for p in parts] for key in ("position", "velocity"))
            return PointMotion(*map(np.concatenate, columns))
        return np.concatenate(parts)

    return Recording(
        **{
            field.name: merged([getattr(segment, field.name) for segment in segments])
            for field in fields(Recording)
            if field.name not in ("release_times", "impacts", "steps")
        },
        release_times=events.releases,
        impacts=tuple(events.impacts),
        steps=sum(segment.steps for segment in segments),
    )
