"""Motion of a mechanism by Chipmunk, one segment after another between the impacts of its stops.

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

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
from pymunk import constraints
from scipy.optimize import brentq

from ...models.arrays import ComplexArray, FloatArray, as_vectors
from ...models.errors import SimulationError
from ...models.kinematics import Kinematics, initial_state
from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw
from ..events import (
    SAME_TIME,
    ContactEvents,
    Contacts,
    EventDriver,
    Halt,
    RestitutionRule,
    Watch,
    active_contacts,
    joined,
    resting,
)
from ..impact import pushing
from ..protocol import Recording
from .bodies import Assembly
from .build import build
from .leapfrog import STARTED, STEP, Stepper, settled_increment
from .options import PymunkOptions
from .passes import MOST_PASSES, TRACKED, Convergence, convergence, growth
from .reactions import forces_of, mass_matrix
from .read import MotionReading, reading_of

_CHUNK = 64  # steps between checks of the gaps; at most these are repeated at an impact
_SETTLING_SAMPLES = 3  # after which a contact that has opened must have a gap, or is met
_TRIAL_ITERATIONS = 5_000  # which stops push depends on the mechanism, not on the preset
_CHECKED = 64  # steps between two looks at how many passes loops need
_LOOSE = 1e-4  # of the reach: error of a loop that is not closed
_ROUNDING = 1e-9  # of the largest torque, impulse or speed: error of what should be zero
_NEAR = 4.0  # changes in a step: where an impulse is less, the stop's torque is computed


def _pushing(mechanism: Mechanism, h: float, options: PymunkOptions) -> Contacts:
    """Stops that are active at the start: those that push while the others open."""
    touching = tuple(stop.name for stop in mechanism.stops if stop.closed)
    return active_contacts(
        touching, lambda active: _violated(mechanism, active, touching, h, options.pivot_mass)
    )


def _violated(
    mechanism: Mechanism, active: Contacts, touching: Contacts, h: float, pivot_mass: float
) -> str | None:
    """A touching stop that would have to pull, or would close, by a first step's forces."""
    assembly = build(mechanism, active, 0.0, pivot_mass)
    stepper = Stepper(assembly, h, hold_lengths=True)
    stepper.start(_TRIAL_ITERATIONS, leapfrog=True, settle=bool(mechanism.loop_joints))
    reading = MotionReading(assembly, stepper.samples(0))
    torques = {
        name: float(torque[0])
        for name, torque in forces_of(reading, tuple(assembly.stops)).torques.items()
    }
    least = -_ROUNDING * max(map(abs, torques.values()), default=0.0)
    kinematics, (q, u) = Kinematics(mechanism), initial_state(mechanism)
    a = reading.accelerations()[0]
    rounding = least * _compliance(kinematics, q, touching)

    for name in touching:
        if name in active:
            if torques[name] < least:
                return name
            continue
        opening = float(kinematics.gap_jacobian(name, q) @ a)
        if opening + float(kinematics.gap_bias(name, q, u)) < rounding:
            return name
    return None


def _compliance(kinematics: Kinematics, q: FloatArray, touching: Contacts) -> float:
    """Largest acceleration of a gap by the unit torque or force of its own stop, in the tree."""
    rows = np.array([kinematics.gap_jacobian(name, q) for name in touching])
    moved = np.linalg.pinv(mass_matrix(kinematics, q[None])[0]) @ rows.T
    return float(np.max(np.sum(rows.T * moved, axis=0), initial=0.0))


class SteppedSegment:
    """Steps of an assembly from a start to a given time, and the releases in them."""

    def __init__(
        self, mechanism: Mechanism, options: PymunkOptions, start: float, end: float
    ) -> None:
        """Build the assembly and find which of its closed stops push.

        Args:
            mechanism: in its state at the start.
            options: how to step.
            start, end: times [s].
        """
        self.options, self.begins, self.ends = options, start, end
        self.n = max(1, math.ceil((end - start) / options.timestep * (1 - 1e-12)))
        self.h = h = (end - start) / self.n
        active = _pushing(mechanism, h, options)
        self.assembly = assembly = build(mechanism, active, options.error_bias, options.pivot_mass)
        self.stepper = Stepper(assembly, h, options.hold_lengths)
        self.releases: dict[str, float | None] = {
            stop.name: start if stop.closed and stop.name not in active else None
            for stop in mechanism.stops
        }
        self.regimes = [(0, tuple(assembly.stops))]
        """First sample and active stops of each interval between releases."""
        self._impulses: dict[str, float] = {}
        self._grown = 1.0
        """Growth of the slowest mode's error since passes were last enough to let it decay."""

    def begin(self) -> None:
        """The first sample, and without the leapfrog the first step."""
        stepper, mechanism = self.stepper, self.assembly.mechanism
        closed = self._checks_passes
        passes = self._passes(self._convergence(*initial_state(mechanism)) if closed else None)
        # Stops that meet the joints as well as a trebuchet's do start with the option's passes.
        settle = closed and (bool(mechanism.loop_joints) or passes > self.options.iterations)
        stepper.start(max(self.options.start_iterations, passes), self.options.leapfrog, settle)
        if not self.options.leapfrog:
            # The first step has no impulses to start from; a leapfrog has found them at the start.
            stepper.run(1, self.options.start_iterations)
            self._release_before_next(1)

    def advance(self, last: int) -> None:
        """Step to a sample.

        Raises:
            SimulationError: loops are so nearly rigid or singular that their impulses do not
                converge.
        """
        while self._checks_passes and self.stepper.steps < last:
            first = self.stepper.steps
            (q, *_), (u, *_) = self.reading(first, first).coordinates()
            here = self._convergence(q, u)
            passes = self._passes(here)
            rate = 0.0 if here is None else growth(here.left_after(passes))
            # Singular positions are passed in a few steps, during which impulses need not converge.
            end = min(last, first + (_CHECKED if rate < 1.0 else 1))
            self._advance(end, passes)
            if passes >= MOST_PASSES:
                self._refuse_open_loops(end)
            if here is not None:
                self._note_growth(here, passes, rate, end)
        self._advance(last, self.options.iterations)

    @property
    def _checks_passes(self) -> bool:
        """Whether a step has as many passes as its loops need: if joints keep their lengths."""
        # An active stop closes a loop as a joint does.
        closed = bool(self.assembly.mechanism.loop_joints or self.assembly.stops)
        return self.options.hold_lengths and closed

    def _passes(self, here: Convergence | None) -> int:
        """Passes that a step needs, up to `MOST_PASSES`, and no less than the option says."""
        needed = 1 if here is None else min(here.passes_to(TRACKED), MOST_PASSES)
        return max(needed, self.options.iterations)

    def _convergence(self, q: FloatArray, u: FloatArray) -> Convergence | None:
        """Convergence in a state, shapes (n_q,); None where the run has lost its joints."""
        if not np.isfinite([q, u]).all():
            return None
        # Not validated: stops keep the word on whether they are closed at the start, which decides
        # on the bodies.
        there = self.assembly.mechanism.model_copy(
            update={"start": tuple(q.tolist()), "start_speeds": tuple(u.tolist())}
        )
        return convergence(build(there, tuple(self.assembly.stops), 0.0, self.options.pivot_mass))

    def _refuse_open_loops(self, k: int) -> None:
        mechanism = self.assembly.mechanism
        gaps = self.reading(k, k).gaps()
        for joint in mechanism.loop_joints:
            if not gaps[joint.name][0] <= _LOOSE * _reach(mechanism):
                raise SimulationError(
                    f"pymunk's impulses on the loop that {joint.name!r} closes do not converge in "
                    f"{MOST_PASSES} passes at t = {self.times()[k]:.6g} s: it is rigid or nearly "
                    f"singular there; its points are {gaps[joint.name][0]:.2g} m apart."
                )

    def _note_growth(self, here: Convergence, passes: int, rate: float, k: int) -> None:
        """Refuse a mode that passes hardly see, once its error has grown beyond the tolerance."""
        self._grown = self._grown * rate if rate >= 1.0 else 1.0
        if self._grown * STARTED > TRACKED:
            raise SimulationError(
                f"pymunk's impulses do not converge at t = {self.times()[k]:.6g} s: constraints on "
                f"{' and '.join(map(repr, here.slowest(passes)))} are nearly parallel there, so "
                f"that {passes} passes leave {here.left_after(passes):.2g} of an error, which "
                "grows where that is above 0.5."
            )

    def _advance(self, last: int, iterations: int) -> None:
        stepper = self.stepper
        while self.assembly.stops and stepper.steps < last:
            stepper.run(1, iterations)
            self._release_before_next(stepper.steps)
        stepper.run(max(last - stepper.steps, 0), iterations)

    def _release_before_next(self, k: int) -> None:
        """Release the stop whose torque vanishes next, if that is before sample k + 1."""
        if not self._is_any_near_zero(k):
            return
        first = max(min(max(self.regimes[-1][0], k - 2), k - 1), 0)
        active = tuple(self.assembly.stops)
        reading = MotionReading(self.assembly, self.stepper.samples(first))
        torques = forces_of(reading, active).torques
        find = _foreseen if self.options.locate_releases else _noticed
        due: dict[str, float] = {}
        for name, torque in torques.items():
            step = find(torque)
            if step is not None and k + step <= self.n:
                due[name] = step
        if due:
            self._release(min(due, key=lambda name: due[name]), k, min(due.values()))

    def _is_any_near_zero(self, k: int) -> bool:
        """Whether an impulse may soon be zero, by its size: all that Chipmunk gives at no cost."""
        before = self._impulses
        self._impulses = now = {name: joint.impulse for name, joint in self.assembly.stops.items()}
        if k < self.regimes[-1][0] + 3:
            return True
        return any(now[name] < _NEAR * abs(now[name] - before[name]) for name in now)

    def _release(self, name: str, k: int, step: float) -> None:
        self.releases[name] = self.begins + (k + step) * self.h
        self.stepper.release(name)
        self.regimes.append((k + 1, tuple(self.assembly.stops)))

    def released_until(self, end: float) -> dict[str, float]:
        """Times at which stops have opened, up to one [s]."""
        return {
            name: time for name, time in self.releases.items() if time is not None and time <= end
        }

    def times(self) -> FloatArray:
        """Times of the samples [s], shape (n + 1,)."""
        return np.linspace(self.begins, self.ends, self.n + 1)

    def reading(self, first: int, last: int, near: FloatArray | None = None) -> MotionReading:
        """Samples from one to another, both included; `near` tells full turns of the first."""
        return MotionReading(self.assembly, self.stepper.samples(first, last), near)

    def active_at(self, k: int) -> Contacts:
        """Stops that are active at a sample."""
        return next(active for first, active in reversed(self.regimes) if first <= k)

    def recording(self, last: int) -> Recording:
        """The segment up to a sample."""
        t, reading = self.times()[: last + 1], self.reading(0, last)
        gaps = reading.gaps()
        _refuse_lost_joints(self.assembly.mechanism, gaps, t)
        q, u = reading.coordinates()
        kinetic, potential = reading.energies()
        reactions, torques = self._forces(reading, t)
        return Recording(
            t=t,
            q=q,
            u=u,
            markers=reading.markers(),
            kinetic_energy=kinetic,
            potential_energy=potential,
            stop_torques=torques,
            release_times=self.releases,
            joint_reactions={name: as_vectors(force) for name, force in reactions.items()},
            joint_gaps=gaps,
            steps=len(t) - 1,
        )

    def _forces(
        self, reading: MotionReading, t: FloatArray
    ) -> tuple[dict[str, ComplexArray], dict[str, FloatArray]]:
        """Reactions of the joints and torques of the stops, by which stops are active."""
        joints = [joint.name for joint in reading.mechanism.joints if joint.held_directions]
        reactions = {name: np.zeros(len(t), dtype=np.complex128) for name in joints}
        torques = {stop.name: np.zeros(len(t)) for stop in reading.mechanism.stops}
        ends = [first for first, _ in self.regimes[1:]] + [len(t)]
        for (first, active), end in zip(self.regimes, ends, strict=True):
            forces = forces_of(reading, active)
            for name in joints:
                reactions[name][first:end] = forces.reactions[name][first:end]
            for name, torque in forces.torques.items():
                torques[name][first:end] = np.maximum(torque[first:end], 0.0)
        return reactions, torques


def _refuse_lost_joints(
    mechanism: Mechanism, gaps: Mapping[str, FloatArray], t: FloatArray
) -> None:
    """Impulses that do not converge can separate the bodies although all numbers stay finite."""
    reach = _reach(mechanism)
    for name, gap in gaps.items():
        lost = np.flatnonzero(~(gap <= reach))
        if len(lost):
            raise SimulationError(
                f"pymunk lost the joint {name!r}: its points are {gap[lost[0]]:.3g} m apart at "
                f"t = {t[lost[0]]:.6g} s; a shorter timestep or more iterations may help."
            )


def _reach(mechanism: Mechanism) -> float:
    """Sum of all lengths [m]."""
    reach = 0.0
    for joint in mechanism.joints:
        reach += math.hypot(*joint.parent_point) + math.hypot(*joint.child_point)
    for body in mechanism.bodies:
        # A rotor on its axle has no length but its radius of gyration.
        reach += math.hypot(*body.centre) + math.sqrt(body.inertia / body.mass)
    return reach


def _foreseen(torque: FloatArray) -> float | None:
    """Steps from the last sample to the torque's zero before the next one (negative: past)."""
    if len(torque) < 2:
        return None
    s = np.arange(1 - len(torque), 1, dtype=np.float64)
    polynomial = np.polynomial.Polynomial.fit(s, torque, len(torque) - 1, domain=[-1, 1])
    past = torque[-1] <= 0
    if not past and float(polynomial(1.0)) > 0:
        return None
    low, high = (-1.0, 0.0) if past else (0.0, 1.0)
    roots = [float(root.real) for root in polynomial.roots() if abs(root.imag) < 1e-9]
    inside = [root for root in roots if low <= root <= high]
    return min(inside, default=high)


def _noticed(torque: FloatArray) -> float | None:
    """The last sample, if its torque does not push any more."""
    return 0.0 if torque[-1] <= 0 else None


def run(problem: Problem, options: PymunkOptions) -> Recording:
    """Simulate a problem.

    Raises:
        UnsupportedProblemError: the mechanism has a part that has no counterpart here, or under the
            release-once law starts with a closed stop whose gap changes.
        SimulationError: impacts follow each other without an end, or their impulses do not
            converge.
    """
    unilateral = problem.stop_law is StopLaw.UNILATERAL
    motion = PymunkMotion(problem, options)
    return EventDriver(problem, motion, "pymunk", impacts=unilateral).run()


@dataclass(frozen=True)
class _ContactEvent:
    """The first open contact that is met in a segment."""

    time: float
    """[s]"""
    q: FloatArray
    u: FloatArray
    """State there, before the impact, each of shape (n_q,)."""
    active: Contacts
    touching: Contacts
    met: str
    sample: int
    """The one before it, in its segment."""


class PymunkMotion:
    """Chipmunk at the start of a segment, or at the event that ends one."""

    def __init__(self, problem: Problem, options: PymunkOptions) -> None:
        self.mechanism, self.options = problem.mechanism, options
        self.unilateral = problem.stop_law is StopLaw.UNILATERAL
        self.held: Contacts = ()
        self.kinematics = Kinematics(problem.mechanism)
        self._state = initial_state(problem.mechanism)
        self._start = problem.mechanism
        """The mechanism in its state at the start of the next segment, its held stops closed."""
        self._touching = tuple(stop.name for stop in self.mechanism.stops if stop.closed)
        """Contacts of the last impact; before it, those that touch at the start."""
        self._before_impact: tuple[FloatArray, FloatArray] | None = None
        """State before the last impact; None: there was none."""
        self._plastic, self._kept = frozenset[str](), frozenset[str]()
        """Contacts that did not rebound at the last impact, because their rebounds would have been
        too low; those that came to rest because they came back at once all the same."""
        self._recordings: list[Recording] = []
        if self.unilateral:
            # Raises UnsupportedProblemError at once if a stop cannot be enforced, instead of at the
            # first impact.
            every_stop = [stop.name for stop in self.mechanism.stops]
            placed = _with_closed(self.mechanism, every_stop)
            build(placed, (), options.error_bias, options.pivot_mass)

    def gap(self, stop: str) -> tuple[float, float]:
        """Gap of a stop and its speed at the start, or at the event."""
        q, u = self._state
        speed = float(self.kinematics.gap_jacobian(stop, q) @ u)
        return float(self.kinematics.gap(stop, q)), speed

    def proceed(self, start: float, end: float, watch: Watch) -> Halt:
        """Move through a segment, to the next impact or to the end."""
        segment = SteppedSegment(self._start, self.options, start, end)
        segment.begin()
        if not self.unilateral:
            segment.advance(segment.n)
        event = self._step_to_event(segment, watch) if self.unilateral else None
        if event is None:
            self._recordings.append(segment.recording(segment.n))
            return Halt(end, segment.released_until(end))
        if self._is_too_low(event):
            return self._without_rebound(event)
        last = event.sample
        if event.time - segment.times()[last] < SAME_TIME:
            last -= 1  # at the time of an impact the state after it is recorded
        if last >= 0:
            self._recordings.append(segment.recording(last))
        self._state, self.held = (event.q, event.u), event.active
        self._plastic = self._kept = frozenset()
        return Halt(event.time, segment.released_until(event.time), met=event.met)

    def _step_to_event(self, segment: SteppedSegment, watch: Watch) -> _ContactEvent | None:
        """Step to the next impact; None: to the end."""
        finder, first = _EventFinder(segment, self._touching, watch), 0
        while first < segment.n:
            last = min(max(first + _CHUNK, segment.stepper.steps), segment.n)
            segment.advance(last)
            event = finder.first_event(first, last)
            if event is not None:
                return event if event.time < segment.ends - SAME_TIME else None
            first = last
        return None

    def _is_too_low(self, event: _ContactEvent) -> bool:
        """Whether a contact is met again within the few steps that cannot resolve how it parted."""
        again = self._before_impact is not None and event.met in self._touching
        parted = not self._start.stop(event.met).closed
        return again and parted and event.met not in self._kept and event.sample < _SETTLING_SAMPLES

    def _without_rebound(self, event: _ContactEvent) -> Halt:
        """Go back before the last impact, for it to be resolved without such a low rebound.

        Its contacts that touch again become plastic; one that was plastic comes to rest.
        """
        assert self._before_impact is not None
        self._state = self._before_impact
        if event.met in self._plastic:
            self._kept |= {event.met}
        self._plastic |= set(event.touching) & set(self._touching)
        return Halt(event.time, again=(self._plastic, self._kept))

    def impact(
        self, touching: Contacts, rule: RestitutionRule, kept: frozenset[str]
    ) -> tuple[Mapping[str, float], Contacts]:
        """Resolve the impact of all contacts that touch; those that are kept do not part."""
        q, u = self._before_impact = self._state
        placed = _with_closed(self.mechanism, touching).model_copy(
            update={"start": tuple(q.tolist()), "start_speeds": tuple(u.tolist())}
        )
        restitution = rule(gap_speeds(placed, touching, q, u), q, u)
        impact = resolve_impact(placed, restitution, self.options.pivot_mass, kept)
        self._touching = touching
        self._start = placed.model_copy(update={"start_speeds": tuple(impact.u.tolist())})
        return impact.impulses, impact.resting

    def hold(self, rest: Contacts, time: float) -> Contacts:
        """Hold the contacts at rest; the next segment opens those of them that would pull."""
        self._start = _with_closed(self._start, rest)
        self.held = rest
        return rest

    def recording(self, events: ContactEvents) -> Recording:
        """The recordings of all segments."""
        return joined(self._recordings, events)


class _EventFinder:
    """Finds the first inactive contact that is met in a segment."""

    def __init__(self, segment: SteppedSegment, touched: Collection[str], watch: Watch) -> None:
        self.segment, self.watch = segment, watch
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
        events: list[_ContactEvent] = []
        for stop in reading.mechanism.stops:
            k = self._first_penetration(stop.name, first, q, u)
            if k is not None:
                events.append(self._located(stop.name, k - 1, reading, first))
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
            can_be_met = name in self._parted or k >= opened + _SETTLING_SAMPLES
            if gap > 0:
                self._parted.add(name)
            elif gap < 0 and speed < 0 and can_be_met:
                return k
        return None

    def _opened(self, name: str) -> int | None:
        """Sample from which a contact is inactive; None while it is active."""
        return next((first for first, active in self.segment.regimes if name not in active), None)

    def _located(self, name: str, k: int, reading: MotionReading, first: int) -> _ContactEvent:
        """The event between samples k and k + 1, where a gap is zero."""
        k = max(k, first)
        (q, u), a = reading.coordinates(), reading.accelerations()
        q, u, a = q[k - first], u[k - first], a[k - first]

        def gap(after: float) -> float:
            return float(self.kinematics.gap(name, q + after * (u + after / 2 * a)))

        h = self.segment.h
        after = h if gap(0.0) > 0 else 0.0
        if gap(0.0) > 0 > gap(h):
            after = float(brentq(gap, 0.0, h, xtol=1e-16))
        time, q_event = float(self.segment.times()[k]) + after, q + after * (u + after / 2 * a)
        active = tuple(
            other
            for other in self.segment.active_at(k)
            if (self.segment.releases[other] or np.inf) > time
        )
        touching = self.watch.touching(
            time, name, active, lambda other: float(self.kinematics.gap(other, q_event))
        )
        return _ContactEvent(time, q_event, u + after * a, active, touching, name, k)


def _with_closed(mechanism: Mechanism, closed: Collection[str]) -> Mechanism:
    # Not validated: the start's gaps are zero to rounding only.
    stops = tuple(
        stop.model_copy(update={"closed": stop.name in closed}) for stop in mechanism.stops
    )
    return mechanism.model_copy(update={"stops": stops})


# --- The impact of all contacts that touch, by Chipmunk's own impulses.
#
# A step without gravity to the assembly's present position yields only the impulses that bring each
# joint's speed to its target: zero for the joints, -e times its speed before for a stop (Newton's
# law of restitution). Which contacts take part is decided for all of them at once: those that do
# push, and the others part at no less than their restitution demands (:mod:`..impact`).


@dataclass(frozen=True)
class TrialImpact:
    """Result of an impact in which a set of contacts takes part."""

    u: FloatArray
    """Generalized speeds after it, shape (n_q,)."""
    impulses: Mapping[str, float]
    """Impulse of each contact that touches [N m s, or N s for one on a point]."""
    resting: Contacts
    """Those of them whose gap does not move after it."""
    violated: str | None
    """A contact that would have to pull or goes on closing: other contacts take part."""


def gap_speeds(
    mechanism: Mechanism, names: Collection[str], q: FloatArray, u: FloatArray
) -> dict[str, float]:
    """Speeds of the stops' gaps [rad/s or m/s]."""
    kinematics = Kinematics(mechanism)
    return {name: float(kinematics.gap_jacobian(name, q) @ u) for name in names}


def resolve_impact(
    placed: Mechanism,
    restitution: Mapping[str, float],
    pivot_mass: float,
    held: Collection[str] = (),
) -> TrialImpact:
    """The impact of the contacts that touch.

    Args:
        placed: the mechanism at its position there, with the speeds before; stops that touch are
        closed in it.
        restitution: e of each of them.
        pivot_mass: as the engine's option.
        held: those that come to rest even if they have to pull, which is not recorded: forces bring
            them back to their walls at once. They are left to the others' impact where that
            contradicts itself.

    Raises:
        SimulationError: the impulses do not converge, or no set of contacts takes part.
    """
    # Not validated: stops keep the word on whether they touch.
    weightless = placed.model_copy(update={"gravity": 0.0, "force_elements": ()})
    impact = _complementary(weightless, restitution, pivot_mass, held) if held else None
    impact = impact or _complementary(weightless, restitution, pivot_mass)
    if impact is None and any(restitution.values()):
        impact = _complementary(weightless, dict.fromkeys(restitution, 0.0), pivot_mass)
    if impact is None:
        raise SimulationError(
            f"pymunk finds no impact of the stops {', '.join(restitution)} in which all of them "
            "push."
        )
    return impact


def _complementary(
    placed: Mechanism,
    restitution: Mapping[str, float],
    pivot_mass: float,
    held: Collection[str] = (),
) -> TrialImpact | None:
    impacts: dict[Contacts, TrialImpact] = {}

    def violated(active: Contacts) -> str | None:
        if active not in impacts:
            taking_part = tuple(name for name in restitution if name in active or name in held)
            impacts[active] = _impact_of(placed, taking_part, restitution, pivot_mass, held)
        return impacts[active].violated

    active = pushing(tuple(name for name in restitution if name not in held), violated)
    return (
        None if active is None or not set(held) <= set(impacts[active].resting) else impacts[active]
    )


def _impact_of(
    placed: Mechanism,
    active: Contacts,
    restitution: Mapping[str, float],
    pivot_mass: float,
    held: Collection[str] = (),
) -> TrialImpact:
    """The impact if these contacts alone take part, those that are held even if they pull."""
    assembly = build(placed, active, 0.0, pivot_mass)
    for name in active:
        _set_target(assembly.stops[name], restitution[name])
    increment = settled_increment(assembly)
    impulses = _impulses(assembly, increment, active)
    (q, before), after = initial_state(placed), _speeds_after(assembly, increment)
    came, left = (gap_speeds(placed, restitution, q, u) for u in (before, after))
    rounding = _ROUNDING * (1.0 + max(map(abs, came.values()), default=0.0))
    total = dict.fromkeys(restitution, 0.0) | impulses
    least = -_ROUNDING * max(total.values())
    kinematics = Kinematics(placed)

    def gap(name: str) -> float:
        return float(kinematics.gap(name, q))

    beyond = {name: left[name] + restitution[name] * came[name] for name in restitution}
    wrong = [
        name
        for name in restitution
        if (total[name] < least if name in active else beyond[name] < -rounding)
    ]
    # Stops whose targets contradict each other meet one of them at most. A gap that is left is
    # closed in the step, unless the stop's joint was built where its bodies are.
    wrong += [
        name
        for name in active
        if min(abs(beyond[name]), abs(beyond[name] + gap(name) / STEP)) > rounding
    ]
    recorded = {
        name: max(impulse, 0.0) if name in held else impulse for name, impulse in total.items()
    }
    violated = next((name for name in wrong if name not in held), None)
    return TrialImpact(after, recorded, resting(left, rounding), violated)


def _set_target(joint: constraints.Constraint, restitution: float) -> None:
    """Displace the target of a stop's joint (gear or rod) by the way it is to part in the step."""
    match joint:
        case constraints.GearJoint():
            spin = joint.b.angular_velocity - joint.a.angular_velocity
            joint.phase += -restitution * spin * STEP
        case constraints.PinJoint():
            a = joint.a.position + joint.anchor_a.rotated(joint.a.angle)
            b = joint.b.position + joint.anchor_b.rotated(joint.b.angle)
            speed_a = joint.a.velocity_at_local_point(joint.anchor_a)
            speed_b = joint.b.velocity_at_local_point(joint.anchor_b)
            joint.distance += -restitution * (speed_b - speed_a).dot((b - a).normalized()) * STEP
        case _:
            raise TypeError(f"no stop is a {type(joint).__name__}")


def _impulses(assembly: Assembly, increment: FloatArray, active: Contacts) -> dict[str, float]:
    """Impulses of the contacts that take part, by the bodies' change of momentum."""
    assembly.rates = np.zeros_like(increment)
    torques = forces_of(reading_of(assembly, increment), active).torques
    return {name: float(torques[name][0]) for name in active}


def _speeds_after(assembly: Assembly, increment: FloatArray) -> FloatArray:
    """Generalized speeds after the bodies' change of velocity, shape (n_q,)."""
    assembly.rates = increment
    change = reading_of(assembly).coordinates()[1][0]
    return np.asarray(initial_state(assembly.mechanism)[1] + change, dtype=np.float64)
