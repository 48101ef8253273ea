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

Where a recorded effort changes, a segment ends as well, and the next one begins in its last state
with the new effort: an instant is the beginning of a step, and both halves of a leapfrog's kick
have the effort of their own step.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np
from pymunk import constraints
from scipy.optimize import brentq

from ...models.arrays import FloatArray, as_vectors
from ...models.elements import RotorInertia
from ...models.elements.recorded_effort import ROUNDED
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
    State,
    Watch,
    active_contacts,
    joined,
    resting,
)
from ..impact import Inertia, mass_matrix, pushing
from ..protocol import Recording
from ..reading import timed_reading
from ..supplied import has_loops
from .build import build
from .leapfrog import STARTED, STEP, Stepper, settled_increment
from .options import PymunkOptions
from .passes import MOST_PASSES, TRACKED, Convergence, convergence, growth
from .read import MotionReading, forces_of, reading_of

_CHUNK = 64  # steps between checks of the gaps; at most these are repeated at an impact
_SETTLING_SAMPLES = 3  # after which a contact that has opened must have a gap, or is met
_TRIAL_ITERATIONS = 5_000  # which stops push depends on the mechanism, not on the preset
_CHECKED = 64  # steps between two looks at how many passes loops need
_LOOSE = 1e-4  # of the reach: error of a loop that is not closed
_ROUNDING = 1e-9  # of the largest torque, impulse or speed: error of what should be zero
_NEAR = 4.0  # changes in a step: where an impulse is less, the stop's torque is computed


def run(problem: Problem, options: PymunkOptions) -> Recording:
    """Simulate a problem.

    Raises:
        UnsupportedProblemError: the mechanism has a part that has no counterpart here, or under the
            release-once law starts with a closed stop whose gap changes.
        SimulationError: impacts do not end, or impulses do not converge.
    """
    motion = PymunkMotion(problem, options)
    return EventDriver(problem, motion, "pymunk", impacts=motion.unilateral).run()


def _placed(mechanism: Mechanism, q: FloatArray, u: FloatArray) -> Mechanism:
    # Not validated: gaps are zero to rounding only, and stops keep the word on whether they are
    # closed at the start, which decides on the bodies.
    return mechanism.model_copy(
        update={"start": tuple(q.tolist()), "start_speeds": tuple(u.tolist())}
    )


def _with_closed(mechanism: Mechanism, closed: Collection[str]) -> Mechanism:
    stops = (stop.model_copy(update={"closed": stop.name in closed}) for stop in mechanism.stops)
    return mechanism.model_copy(update={"stops": tuple(stops)})


def _reach(mechanism: Mechanism) -> float:
    """Sum of all lengths [m]."""
    reach = 0.0
    for joint in mechanism.joints:
        reach += math.hypot(*joint.parent_point) + math.hypot(*joint.child_point)
    for body in mechanism.bodies:
        # A rotor on its axle has no length but its radius of gyration.
        reach += math.hypot(*body.centre) + math.sqrt(body.inertia / body.mass)
    return reach


# --- A segment: steps and releases


def _active_at_start(mechanism: Mechanism, h: float, pivot_mass: float) -> Contacts:
    """Closed stops that push while the others open, by the forces of a first step."""
    touching = tuple(stop.name for stop in mechanism.stops if stop.closed)
    kinematics, (q, u) = Kinematics(mechanism), initial_state(mechanism)

    def violated(active: Contacts) -> str | None:
        """A touching stop that would have to pull, or would close."""
        assembly = build(mechanism, active, 0.0, pivot_mass)
        stepper = Stepper(assembly, h, hold_lengths=True)
        stepper.start(_TRIAL_ITERATIONS, leapfrog=True, settle=has_loops(mechanism))
        reading = MotionReading(assembly, stepper.samples(0))
        _, forces = forces_of(reading, tuple(assembly.stops))
        torques = {name: float(torque[0]) for name, torque in forces.items()}
        least = -_ROUNDING * max(map(abs, torques.values()), default=0.0)
        # Largest acceleration of a gap by the unit torque or force of its own stop, in the tree.
        rows = np.array([kinematics.gap_jacobian(name, q) for name in touching])
        moved = np.linalg.pinv(mass_matrix(kinematics, q[None])[0]) @ rows.T
        rounding = least * float(np.max(np.sum(rows.T * moved, axis=0), initial=0.0))
        a = reading.motion[2][0]
        for name in touching:
            if name in active:
                if torques[name] < least:
                    return name
            else:
                opening = float(kinematics.gap_jacobian(name, q) @ a)
                if opening + float(kinematics.gap_bias(name, q, u)) < rounding:
                    return name
        return None

    return active_contacts(touching, violated)


class SteppedSegment:
    """Steps of a mechanism from its start state at one time to another [s], and the releases."""

    def __init__(
        self, mechanism: Mechanism, options: PymunkOptions, start: float, end: float
    ) -> None:
        self.options, self.begins, self.ends = options, start, end
        self.n = max(1, math.ceil((end - start) / options.timestep * (1 - 1e-12)))
        self.h = h = (end - start) / self.n
        self.times = np.linspace(start, end, self.n + 1)  # times of the samples [s]
        active = _active_at_start(mechanism, h, options.pivot_mass)
        self.assembly = assembly = build(mechanism, active, options.error_bias, options.pivot_mass)
        self.stepper = Stepper(assembly, h, options.hold_lengths, self.n)
        self.releases: dict[str, float | None] = {
            stop.name: start if stop.closed and stop.name not in active else None
            for stop in mechanism.stops
        }
        self.regimes = [(0, tuple(assembly.stops))]
        """First sample and active stops of each interval between releases."""
        self._impulses: dict[str, float] = {}
        self._grown = 1.0
        """Growth of the slowest mode's error since passes were last enough to let it decay."""
        # The first sample, and without the leapfrog the first step.
        stepper, closed, passes = self.stepper, self._checks_passes, options.iterations
        if closed:
            _, passes = self._convergence(*initial_state(mechanism))
        # Stops that meet the joints as well as a trebuchet's do start with the option's passes.
        settle = closed and (has_loops(mechanism) or passes > options.iterations)
        stepper.start(max(options.start_iterations, passes), options.leapfrog, settle)
        if not options.leapfrog:
            # The first step has no impulses to start from; a leapfrog has found them at the start.
            stepper.run(1, options.start_iterations, self._release_before_next)

    def advance(self, last: int) -> None:
        """Step to a sample; loops whose impulses do not converge are refused."""
        while self._checks_passes and self.stepper.steps < last:
            first = self.stepper.steps
            q, u, _ = self.reading(first, first).motion
            here, passes = self._convergence(q[0], u[0])
            rate = 0.0 if here is None else growth(here.left_after(passes))
            # Singular positions are passed in a few steps, during which impulses need not converge.
            end = min(last, first + (_CHECKED if rate < 1.0 else 1))
            self._take_steps(end, passes)
            self._refuse_divergence(end, here, passes, rate)
        self._take_steps(last, self.options.iterations)

    def _refuse_divergence(
        self, k: int, here: Convergence | None, passes: int, rate: float
    ) -> None:
        """Raise SimulationError at sample k if loops are open, or an unseen mode has grown."""
        mechanism, time = self.assembly.mechanism, self.times[k]
        if passes >= MOST_PASSES:
            gaps = self.reading(k, k).gaps()
            for joint in mechanism.loop_joints:
                gap = gaps[joint.name][0]
                if not gap <= _LOOSE * _reach(mechanism):
                    raise SimulationError(
                        f"pymunk's impulses on the loop that {joint.name!r} closes do not converge "
                        f"in {MOST_PASSES} passes at t = {time:.6g} s: it is rigid or nearly "
                        f"singular there; its points are {gap:.2g} m apart."
                    )
        if here is None:
            return
        # A mode that passes hardly see comes up from the rounding error of the start.
        self._grown = self._grown * rate if rate >= 1.0 else 1.0
        if self._grown * STARTED > TRACKED:
            raise SimulationError(
                f"pymunk's impulses do not converge at t = {time:.6g} s: constraints on "
                f"{' and '.join(map(repr, here.slowest(passes)))} are nearly parallel there, so "
                f"that {passes} passes leave {here.left_after(passes):.2g} of an error, which "
                "grows where that is above 0.5."
            )

    @property
    def _checks_passes(self) -> bool:
        """Tell whether steps have the passes that loops need: if joints keep their lengths."""
        # An active stop closes a loop as a joint does.
        closed = has_loops(self.assembly.mechanism) or bool(self.assembly.stops)
        return self.options.hold_lengths and closed

    def _convergence(self, q: FloatArray, u: FloatArray) -> tuple[Convergence | None, int]:
        """Convergence in a state, None where joints are lost, and the passes that a step needs.

        These are `MOST_PASSES` at most, and no less than the option says.
        """
        least = self.options.iterations
        if not np.isfinite([q, u]).all():
            return None, least
        there, active = _placed(self.assembly.mechanism, q, u), tuple(self.assembly.stops)
        here = convergence(build(there, active, 0.0, self.options.pivot_mass))
        return here, max(least, min(here.passes_to(TRACKED), MOST_PASSES))

    def _take_steps(self, last: int, iterations: int) -> None:
        watch = self._release_before_next if self.assembly.stops else None
        self.stepper.run(max(last - self.stepper.steps, 0), iterations, watch)

    def _release_before_next(self) -> None:
        """Release the stop whose torque vanishes next, if that is before the next sample."""
        k, stops, before = self.stepper.steps, self.assembly.stops, self._impulses
        now: dict[str, float] = {}
        # Impulses tell at no cost, but by their size only, whether one may soon be zero.
        far = k >= self.regimes[-1][0] + 3 or not stops
        for name, joint in stops.items():
            now[name] = impulse = joint.impulse
            far = far and impulse >= _NEAR * abs(impulse - before[name])
        self._impulses = now
        if far:
            return
        first = max(min(max(self.regimes[-1][0], k - 2), k - 1), 0)
        reading = MotionReading(self.assembly, self.stepper.samples(first))
        due: dict[str, float] = {}
        _, torques = forces_of(reading, tuple(self.assembly.stops))
        for name, torque in torques.items():
            step = 0.0 if torque[-1] <= 0 else None
            if self.options.locate_releases:
                step = _foreseen(torque)
            if step is not None and k + step <= self.n:
                due[name] = step
        if due:
            name = min(due, key=lambda name: due[name])
            self.releases[name] = self.begins + (k + due[name]) * self.h
            self.stepper.release(name)
            self.regimes.append((k + 1, tuple(self.assembly.stops)))

    def released_until(self, end: float) -> dict[str, float]:
        """Times at which stops have opened, up to one [s]."""
        return {
            name: time for name, time in self.releases.items() if time is not None and time <= end
        }

    def reading(self, first: int, last: int, near: FloatArray | None = None) -> MotionReading:
        """Samples from one to another, both included; `near` tells full turns of the first."""
        return MotionReading(self.assembly, self.stepper.samples(first, last), near)

    def last_state(self) -> State:
        """Coordinates and speeds at the end, joints that were lost refused."""
        reading = self.reading(0, self.n)
        self._refuse_lost(reading.gaps())
        q, u, _ = reading.motion
        return q[-1], u[-1]

    def _refuse_lost(self, gaps: Mapping[str, FloatArray]) -> None:
        """Raise SimulationError if the gap of a joint [m] is too large in a sample from the first.

        Impulses that did not converge may have separated bodies although all numbers are finite.
        """
        reach = _reach(self.assembly.mechanism)
        for name, gap in gaps.items():
            lost = np.flatnonzero(~(gap <= reach))
            if len(lost):
                raise SimulationError(
                    f"pymunk lost the joint {name!r}: its points are {gap[lost[0]]:.3g} m apart at "
                    f"t = {self.times[lost[0]]:.6g} s; a shorter timestep or more iterations may "
                    "help."
                )

    @timed_reading()
    def recording(self, last: int) -> Recording:
        """The segment up to a sample."""
        t, reading = self.times[: last + 1], self.reading(0, last)
        mechanism, gaps = self.assembly.mechanism, reading.gaps()
        self._refuse_lost(gaps)
        reactions = {name: np.zeros(len(t), dtype=np.complex128) for name in gaps}
        torques = {stop.name: np.zeros(len(t)) for stop in mechanism.stops}
        ends = [first for first, _ in self.regimes[1:]] + [len(t)]
        for (first, active), end in zip(self.regimes, ends, strict=True):
            forces, pushes = forces_of(reading, active)
            for name, reaction in reactions.items():
                reaction[first:end] = forces[name][first:end]
            for name, torque in pushes.items():
                torques[name][first:end] = np.maximum(torque[first:end], 0.0)
        q, u, _ = reading.motion
        kinetic, potential = reading.energies()
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
    return min((root for root in roots if low <= root <= high), default=high)


# --- The segments of a run, and the impacts between them


@dataclass(frozen=True)
class _ContactEvent:
    """The first open contact that is met in a segment."""

    time: float  # [s]
    q: FloatArray
    u: FloatArray  # state there, before the impact, each of shape (n_q,)
    active: Contacts
    touching: Contacts
    met: str
    sample: int  # the one before it, in its segment


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
        self._parted = self._open(self._touching)
        """Contacts that have had a gap since then. One that has just opened may penetrate by its
        rounding or drift: it can be met once it has had a gap."""
        self._instants = (*self.mechanism.instants, math.inf)
        self._before_impact: State | None = None
        """State before the last impact; None: there was none, or an effort has changed since."""
        self._plastic, self._kept = frozenset[str](), frozenset[str]()
        """Contacts that did not rebound at the last impact, because their rebounds would have been
        too low; those that came to rest because they came back at once all the same."""
        self._recordings: list[Recording] = []
        if self.unilateral:
            # Raises UnsupportedProblemError at once if a stop cannot be enforced, instead of at the
            # first impact.
            placed = _with_closed(self.mechanism, [stop.name for stop in self.mechanism.stops])
            build(placed.at(0.0), (), options.error_bias, options.pivot_mass)

    def _open(self, touching: Contacts) -> set[str]:
        return {stop.name for stop in self.mechanism.stops} - set(touching)

    def gap(self, stop: str) -> tuple[float, float]:
        """Gap of a stop and its speed at the start, or at the event."""
        q, u = self._state
        return float(self.kinematics.gap(stop, q)), self._gap_speed(stop, q, u)

    def _gap_speed(self, stop: str, q: FloatArray, u: FloatArray) -> float:
        return float(self.kinematics.gap_jacobian(stop, q) @ u)

    def proceed(self, start: float, end: float, watch: Watch) -> Halt:
        """Move through a segment, to the next impact, change of an effort, or to the end."""
        stage, until = self._stage(start, end)
        segment = SteppedSegment(stage, self.options, start, until)
        if not self.unilateral:
            segment.advance(segment.n)
        event = self._step_to_event(segment, watch) if self.unilateral else None
        if event is None:
            if until < end:
                self._begin_anew(segment)
            else:
                self._recordings.append(segment.recording(segment.n))
            return Halt(until, segment.released_until(until))
        # A contact met again within the few steps that cannot resolve how it parted.
        again = self._before_impact is not None and event.met in self._touching
        parted = not self._start.stop(event.met).closed
        too_low = event.met not in self._kept and event.sample < _SETTLING_SAMPLES
        if again and parted and too_low:
            # Back before the last impact, for it to be resolved without such a low rebound. Its
            # contacts that touch again become plastic; one that was plastic comes to rest.
            assert self._before_impact is not None
            self._state = self._before_impact
            if event.met in self._plastic:
                self._kept |= {event.met}
            self._plastic |= set(event.touching) & set(self._touching)
            return Halt(event.time, again=(self._plastic, self._kept))
        last = event.sample
        if event.time - segment.times[last] < SAME_TIME:
            last -= 1  # at the time of an impact the state after it is recorded
        if last >= 0:
            self._recordings.append(segment.recording(last))
        self._state, self.held = (event.q, event.u), event.active
        self._plastic = self._kept = frozenset()
        return Halt(event.time, segment.released_until(event.time), met=event.met)

    def _stage(self, start: float, end: float) -> tuple[Mechanism, float]:
        """The mechanism with the efforts that act from one time on, and until when [s]."""
        rounding = ROUNDED * self.options.timestep
        until = self._instants[bisect_right(self._instants, start + rounding)]
        return self._start.at(start + rounding), until if until < end - rounding else end

    def _begin_anew(self, segment: SteppedSegment) -> None:
        """Record a segment, and begin the next one in its last state, which that one records."""
        recording = segment.recording(segment.n - 1)
        self._recordings.append(replace(recording, steps=segment.n))
        (q, u), self.held = segment.last_state(), tuple(segment.assembly.stops)
        # Speeds are means of those before and after a step: they may violate what closes a loop by
        # O(h^2), which a first step would undo by forces of O(h).
        inertia = Inertia(mass_matrix(self.kinematics, q), self.kinematics.loop_jacobian(q))
        active = [self.kinematics.gap_jacobian(name, q) for name in self.held]
        self._state = q, inertia.without_drift(u, np.reshape(active, (-1, len(u))))
        self._start = _placed(_with_closed(self.mechanism, self.held), *self._state)
        self._before_impact = None

    def _step_to_event(self, segment: SteppedSegment, watch: Watch) -> _ContactEvent | None:
        """Step to the next impact; None: to the end."""
        first, near = 0, initial_state(self._start)[0]
        while first < segment.n:
            last = min(max(first + _CHUNK, segment.stepper.steps), segment.n)
            segment.advance(last)
            q, u, a = segment.reading(first, last, near).motion
            events: list[_ContactEvent] = []
            for stop in self.mechanism.stops:
                name = stop.name
                opened = next((k for k, active in segment.regimes if name not in active), None)
                if opened is None:  # still active
                    continue
                gaps = self.kinematics.gap(name, q)
                speeds = np.sum(self.kinematics.gap_jacobian(name, q) * u, axis=-1)
                for k in range(max(first, opened), last + 1):
                    i = k - first
                    if gaps[i] > 0:
                        self._parted.add(name)
                    settled = name in self._parted or k >= opened + _SETTLING_SAMPLES
                    if settled and gaps[i] < 0 and speeds[i] < 0:
                        i = max(i - 1, 0)
                        state = q[i], u[i], a[i]
                        events.append(self._located(name, segment, first + i, state, watch))
                        break
            if events:
                event = min(events, key=lambda event: event.time)
                return event if event.time < segment.ends - SAME_TIME else None
            first, near = last, q[-1]
        return None

    def _located(
        self,
        name: str,
        segment: SteppedSegment,
        k: int,
        state: tuple[FloatArray, FloatArray, FloatArray],
        watch: Watch,
    ) -> _ContactEvent:
        """The event between samples k and k + 1, where a gap is zero, from the state at k."""
        q, u, a = state

        def gap(after: float) -> float:
            return float(self.kinematics.gap(name, q + after * (u + after / 2 * a)))

        after = segment.h if gap(0.0) > 0 else 0.0
        if gap(0.0) > 0 > gap(segment.h):
            after = float(brentq(gap, 0.0, segment.h, xtol=1e-16))
        time, q_event = float(segment.times[k]) + after, q + after * (u + after / 2 * a)
        regime = next(active for first, active in reversed(segment.regimes) if first <= k)
        active = tuple(other for other in regime if (segment.releases[other] or np.inf) > time)
        touching = watch.touching(
            time, name, active, lambda other: float(self.kinematics.gap(other, q_event))
        )
        return _ContactEvent(time, q_event, u + after * a, active, touching, name, k)

    def impact(
        self, touching: Contacts, rule: RestitutionRule, kept: frozenset[str]
    ) -> tuple[Mapping[str, float], Contacts]:
        """Resolve the impact of all contacts that touch; those that are kept do not part."""
        q, u = self._before_impact = self._state
        placed = _placed(_with_closed(self.mechanism, touching), q, u)
        restitution = rule({name: self._gap_speed(name, q, u) for name in touching}, q, u)
        impact = resolve_impact(placed, restitution, self.options.pivot_mass, kept)
        self._touching, self._parted = touching, self._open(touching)
        self._start = _placed(placed, q, impact.u)
        return impact.impulses, impact.resting

    def hold(self, rest: Contacts, time: float) -> Contacts:
        """Hold the contacts at rest; the next segment opens those of them that would pull."""
        self._start = _with_closed(self._start, rest)
        self.held = rest
        return rest

    @timed_reading()
    def recording(self, events: ContactEvents) -> Recording:
        """The recordings of all segments."""
        return joined(self._recordings, events)


# --- The impact of all contacts that touch, by Chipmunk's own impulses.
#
# A step without gravity to the assembly's present position yields only the impulses that bring each
# joint's speed to its target: zero for the joints, -e times its speed before for a stop (Newton's
# law of restitution). Which contacts take part is decided for all of them at once: those that do
# push, and the others part at no less than their restitution demands (:mod:`..impact`).


@dataclass(frozen=True)
class TrialImpact:
    """Result of an impact in which a set of contacts takes part."""

    u: FloatArray  # generalized speeds after it, shape (n_q,)
    impulses: Mapping[str, float]
    """Impulse of each contact that touches [N m s, or N s for one on a point]."""
    resting: Contacts  # those of them whose gap does not move after it
    violated: str | None
    """A contact that would have to pull or goes on closing: other contacts take part."""


def resolve_impact(
    placed: Mechanism,
    restitution: Mapping[str, float],
    pivot_mass: float,
    held: Collection[str] = (),
) -> TrialImpact:
    """The impact of the contacts that touch, each with its restitution e.

    They are closed in the mechanism, which is placed there with the speeds before. Held contacts
    come to rest even if they have to pull, which is not recorded: forces bring them back to their
    walls at once. They are left to the others' impact where that contradicts itself.

    Raises:
        SimulationError: the impulses do not converge, or no set of contacts takes part.
    """
    rotors = tuple(each for each in placed.force_elements if isinstance(each, RotorInertia))
    weightless = placed.model_copy(update={"gravity": 0.0, "force_elements": rotors})
    attempts: list[tuple[Mapping[str, float], Collection[str]]] = [(restitution, ())]
    if held:
        attempts.insert(0, (restitution, held))
    if any(restitution.values()):
        attempts.append((dict.fromkeys(restitution, 0.0), ()))
    for coefficients, kept in attempts:
        impact = _complementary(weightless, coefficients, pivot_mass, kept)
        if impact is not None:
            return impact
    raise SimulationError(
        f"pymunk finds no impact of the stops {', '.join(restitution)} in which all of them push."
    )


def _complementary(
    placed: Mechanism, restitution: Mapping[str, float], pivot_mass: float, held: Collection[str]
) -> TrialImpact | None:
    impacts: dict[Contacts, TrialImpact] = {}

    def violated(active: Contacts) -> str | None:
        if active not in impacts:
            taking_part = tuple(name for name in restitution if name in active or name in held)
            impacts[active] = _impact_of(placed, taking_part, restitution, pivot_mass, held)
        return impacts[active].violated

    active = pushing(tuple(name for name in restitution if name not in held), violated)
    if active is None or not set(held) <= set(impacts[active].resting):
        return None
    return impacts[active]


def _impact_of(
    placed: Mechanism,
    active: Contacts,
    restitution: Mapping[str, float],
    pivot_mass: float,
    held: Collection[str],
) -> TrialImpact:
    """The impact if these contacts alone take part, those that are held even if they pull."""
    assembly = build(placed, active, 0.0, pivot_mass)
    for name in active:
        _set_target(assembly.stops[name], restitution[name])
    increment = settled_increment(assembly)
    # Impulses by the bodies' change of momentum, and speeds after by their change of velocity.
    assembly.rates = np.zeros_like(increment)
    _, torques = forces_of(reading_of(assembly, increment), active)
    impulses = dict.fromkeys(restitution, 0.0)
    for name in active:
        impulses[name] = float(torques[name][0])
    assembly.rates = increment
    kinematics, (q, before) = Kinematics(placed), initial_state(placed)
    after = np.asarray(before + reading_of(assembly).motion[1][0], dtype=np.float64)

    rows = {name: kinematics.gap_jacobian(name, q) for name in restitution}
    came = {name: float(row @ before) for name, row in rows.items()}
    left = {name: float(row @ after) for name, row in rows.items()}
    rounding = _ROUNDING * (1.0 + max(map(abs, came.values()), default=0.0))
    least = -_ROUNDING * max(impulses.values())
    wrong: list[str] = []
    contradicted: list[str] = []
    for name in restitution:
        beyond = left[name] + restitution[name] * came[name]
        if name not in active:
            if beyond < -rounding:
                wrong.append(name)
            continue
        if impulses[name] < least:
            wrong.append(name)
        # Stops whose targets contradict each other meet one of them at most. A gap that is left is
        # closed in the step, unless the stop's joint was built where its bodies are.
        closed = beyond + float(kinematics.gap(name, q)) / STEP
        if min(abs(beyond), abs(closed)) > rounding:
            contradicted.append(name)
    violated = next((name for name in (*wrong, *contradicted) if name not in held), None)
    for name in restitution:
        if name in held:
            impulses[name] = max(impulses[name], 0.0)
    return TrialImpact(after, impulses, resting(left, rounding), violated)


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
