"""A proved motion: from event to event, each proved to be the first and the only one.

What holds between two events is an inequality that balls decide: a closed stop pushes, the gap of
an open one that may close is positive, the velocity has not come down to the launch angle. Where
one cannot be decided the motion ends there, and says so: nothing is guessed.

Which stops push after an event is proposed by :mod:`..contact` in doubles, and then proved: of each
stop that was closed or met, either its torque (impulse) is positive, or it moves off.

Loops of joints and closed stops enter by their accelerations (index 1). What is proved is the
motion of these equations from the start as its doubles have it, whose loops and closed stops are
closed to rounding only.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from operator import mul
from typing import Literal, NamedTuple

import numpy as np

from ...models.arrays import FloatArray
from ...models.errors import InputError, SimulationError
from ...models.functions import AngleFunction
from ...models.kinematics import initial_state
from ...models.launch import AT_REST
from ...models.problem import Problem, StopLaw
from ..contact import active_contacts, resolve_impact
from ..equations import Equations
from ..reactions import refuse_dependent
from ..taylor.expressions import TaylorSystem
from ..taylor.numbers import PROJECTILE, projectile_row, relevant_stops, rests_of, structure_of
from .balls import Ball, arb, exact, fmpz_mat, rounded
from .events import UndecidedZeroError, Zero, clear_of_start, keeps_sign, zeros
from .gradients import gradients
from .mechanics import SolvedForces
from .numbers import BallKinematics, Complex, as_coordinates, exact_numbers
from .rest import Impacts, Rest
from .sets import StateSet
from .steps import NoTubeError, Step, StepMaker
from .tape import Algebra, Tape

Kind = Literal["release", "impact", "launch"]
State = tuple[list[Ball], list[Ball]]
_MOST_EVENTS = 1000  # of a motion; more of them pile up
_FLIGHTS = 2.0  # of a gap that has opened, that the first step may last
_REST_WIDER = 1e3  # three digits, which a further impact would take as well
_AT_REST = 1e-9  # [rad/s, m/s] gap speeds of the start below this are rounding of its doubles


class UndecidedError(SimulationError):
    """An inequality that balls do not decide, with the bits, steps and time that are allowed."""

    def __init__(self, inequality: str, time: float) -> None:
        super().__init__(f"not proved: whether {inequality}, at t = {time:.9g} s.")
        self.inequality = inequality
        self.time = time  # [s]

    def __reduce__(self) -> tuple[type[UndecidedError], tuple[str, float]]:
        return UndecidedError, (self.inequality, self.time)


class LimitError(SimulationError):
    """A limit of steps, events or time that a proof has reached."""


@dataclass(frozen=True)
class ProvedEvent:
    """An event, with the state at its time."""

    kind: Kind | Literal["rest", "maximum"]
    """Rest: a stop closes after infinitely many impacts. Maximum: see :mod:`.extrema`."""
    name: str
    """Name of the stop, of the marker that is launched, or of what is largest."""
    time: Ball
    """[s]"""
    q: list[Ball]
    u: list[Ball]
    """Speeds before it."""


@dataclass(frozen=True)
class Limits:
    """Limits of a proof's cost."""

    steps: int = 100_000
    seconds: float = 600.0
    """Limit of processor time [s]."""


_SHORTER = 3  # times that a step is made with a quarter of its length, to decide an event
_FINITE = "accelerations stay finite"
_REGULAR = "loops keep their rank (a singular position)"
_INEQUALITIES: dict[Kind, str] = {
    "release": "{!r} pushes",
    "impact": "{!r} is open",
    "launch": "{!r} is launched",
}


class _Function(NamedTuple):
    """A function of the state, whose fall through zero is an event."""

    kind: Kind
    name: str
    touches: bool = False
    """Whether it is a gap that is zero at the start of its phase."""


class _System(NamedTuple):
    """The equations of one set of closed stops."""

    tape: Tape
    functions: list[_Function]


@dataclass
class Phase:
    """The motion between two events, under one set of closed stops."""

    start: Ball
    """[s]"""
    closed: tuple[str, ...]
    released: str | None = None
    """The stop whose release it begins with, if it does."""
    steps: list[Step] = field(default_factory=list[Step])

    def at(self, t: Ball) -> State:
        """Enclose q and u at the times of a ball [s], within the phase.

        Raises:
            ValueError: the phase is over by then.
        """
        since, found = t - self.start, list[State]()
        for step in self.steps:
            low, high = step.span
            if not (since < low or since > high):
                found.append(step.at(since - low))
        if not found:
            raise ValueError("the phase has not begun, or is over")
        return hull(found)  # of several where the ball lies across the end of a step

    @property
    def end(self) -> Ball:
        """End of its last step [s]."""
        return self.start + exact(self.steps[-1].end)


def hull(states: Sequence[State]) -> State:
    """The least box around some states, at least one."""
    (q, u), *others = states
    for more_q, more_u in others:
        q = [a.union(b) for a, b in zip(q, more_q, strict=True)]
        u = [a.union(b) for a, b in zip(u, more_u, strict=True)]
    return q, u


class ProvedMotion:
    """A problem's motion in balls of the context's precision.

    Args:
        problem: whose doubles are taken exactly.
        order: of the Taylor polynomials.
        bits: the remainder of a step is at most 2^-bits [rad, m and per s].
        limits: of steps and time.
        progress: called with the time that is proved so far [s].
        start: a state, or the least box of several, in place of the mechanism's doubles.
    """

    def __init__(
        self,
        problem: Problem,
        order: int,
        bits: float,
        limits: Limits,
        progress: Callable[[float], None] | None = None,
        start: State | None = None,
    ) -> None:
        mechanism = problem.mechanism
        self.problem = problem
        self.equations = Equations(mechanism)
        self.kinematics = BallKinematics(mechanism)
        self.stops = relevant_stops(problem)
        numbers = exact_numbers(problem, self.kinematics)
        present = np.array([not number.is_zero() for number in numbers])
        self.structure = structure_of(problem, self.kinematics, present)
        self.numbers = [number for number in numbers if not number.is_zero()]
        self.events: list[ProvedEvent] = []
        self.phases: list[Phase] = []
        self.order, self.bits = order, bits
        self._limits, self._progress = limits, progress
        self._start = start
        self._began, self._steps = time.process_time(), 0
        self._systems: dict[tuple[object, ...], _System] = {}
        self._force_tapes: dict[tuple[str, ...], Tape] = {}
        self._impacts: dict[str, Impacts] = {}
        self._rests = rests_of(mechanism)

    def run(self, until: Fraction | None) -> None:
        """Enclose the motion to a time [s], or to the launch (None), at most to the duration.

        Raises:
            UndecidedError: an inequality stays undecided.
            LimitError: a limit is reached.
        """
        q, u = initial_state(self.problem.mechanism)
        state = self._start or ([arb(float(x)) for x in q], [arb(float(x)) for x in u])
        touching = tuple(stop.name for stop in self.problem.mechanism.stops if stop.closed)
        end = rounded(Fraction(self.problem.duration) if until is None else until)
        start, closed, released = arb(0), touching, None
        speeds = self._gap_speeds(state)
        met = [name for name in touching if speeds[name] < -_AT_REST]
        if met:
            for name in met:
                self._note(ProvedEvent("impact", name, start, *state))
            state, closed = self._struck(start, state, touching)
        else:
            closed = self._after_touching(start, state, touching)
        while True:
            opened = tuple(name for name in touching if name not in closed)
            refuse_dependent(self.equations, _middles(state)[0], closed, "A proof")
            phase = Phase(start, closed, released)
            released = None
            self.phases.append(phase)
            event = self._next_event(phase, state, opened, end)
            if event is None:
                return
            self._note(event)
            start, state, touching = event.time, (event.q, event.u), closed
            if event.kind == "launch":
                if until is None:
                    return
            elif event.kind == "release":
                closed = tuple(name for name in closed if name != event.name)
                released = event.name
            else:
                touching = tuple(name for name in self.stops if name in (*closed, event.name))
                launches = self._may_launch(closed)
                state, closed = self._struck(start, state, touching, launches)
                if until is None and self.launch is not None:
                    return
                rest = self._rest(event.name, state) if touching == (event.name,) else None
                if rest is not None and not closed:
                    start, state, closed = start + rest.time, (rest.q, rest.u), touching
                    self._note(ProvedEvent("rest", event.name, start, *state))

    def _rest(self, name: str, state: State) -> Rest | None:
        """The end of infinitely many impacts of a stop, once it is about as narrow as a state."""
        if name not in self._impacts:
            flight, algebra = self._expressions(())
            places = [k for k, other in enumerate(self.stops) if other != name]
            outputs = [*flight.solved[: self.structure.n_q]]
            outputs += [flight.gap_speed(self.stops.index(name)), *map(flight.gap, places)]
            if self._may_launch(()):
                outputs.append(flight.lead)
            made = [algebra.expression(output) for output in outputs]
            system, of_jump = self._expressions((name,))
            jump = system.jump([0.0] * len(self.stops))[: self.structure.n_q]
            changes = [of_jump.expression(change) for change in jump]
            self._impacts[name] = Impacts(
                Tape(algebra, self._names, made),
                Tape(of_jump, self._names, changes),
                self.numbers,
                self.problem.mechanism.stop(name).restitution,
            )
        rest = self._impacts[name].rest(*state)
        if rest is None:
            return None
        known = max(2.0**-self.bits, *(float(x.rad()) for part in state for x in part))
        wide = any(float(x.rad()) > _REST_WIDER * known for x in (rest.time, *rest.q, *rest.u))
        return None if wide else rest

    def _note(self, event: ProvedEvent) -> None:
        self.events.append(event)
        if len(self.events) > _MOST_EVENTS:
            raise LimitError(
                f"not proved: more than {_MOST_EVENTS} events by t = "
                f"{float(event.time.mid()):.6g} s, which may pile up without an end."
            )

    def _after_touching(
        self, start: Ball, state: State, touching: tuple[str, ...]
    ) -> tuple[str, ...]:
        """Stops that stay closed of those that touch; the others open, which is noted."""
        speeds = self._gap_speeds(state)
        resting = [name for name in touching if not speeds[name] > _AT_REST]
        closed = active_contacts(self.equations, *_middles(state), resting)
        for name in touching:
            if name not in closed:
                self._note(ProvedEvent("release", name, start, *state))
        return closed

    # --- impacts

    def _struck(
        self, start: Ball, state: State, touching: tuple[str, ...], launches: bool = False
    ) -> tuple[State, tuple[str, ...]]:
        """The state after an impact of the touching stops, and those that stay closed.

        A launch in it is noted if the projectile is free to be launched.
        """
        mechanism, (q, u) = self.problem.mechanism, state
        restitution = {name: mechanism.stop(name).restitution for name in self.stops}
        e: FloatArray = np.array([restitution[name] for name in touching])
        _, proposed = resolve_impact(self.equations, *_middles(state), touching, e)
        pushing = tuple(name for name in touching if proposed[name] > 0)
        system, algebra = self._expressions(pushing)
        solved = system.jump([restitution[name] for name in self.stops])
        first = self.structure.n_q + self.structure.n_loops
        solved = [algebra.expression(x) for x in solved]
        tape = Tape(algebra, self._names, [*solved[: len(q)], *solved[first:]])
        impulses = dict(zip(self.stops, tape.values(self.numbers, q, u)[len(q) :], strict=True))
        after: State = q, self._changed(tape, state)
        for k in self._stopped([name for name in pushing if not restitution[name]]):
            after[1][k] = arb(0)
        if launches and self._rests.isdisjoint(pushing):
            self._note_launch(start, state, after)
        before = self._gap_speeds(state)
        speeds = self._gap_speeds(after)
        for name in touching:
            if name in pushing:
                self._require(-impulses[name] > 0, f"{name!r} pushes in its impact", start)
            else:
                parts = speeds[name] + restitution[name] * before[name]
                self._require(parts > 0, f"{name!r} parts in an impact", start)
        # A stop without rebound, or one that was closed, stays closed if it pushes.
        resting = tuple(n for n in touching if n not in pushing or restitution[n] > 0)
        held = [n for n in touching if n not in resting]
        return after, active_contacts(self.equations, *_middles(after), held)

    def _stopped(self, plastic: Sequence[str]) -> list[int]:
        """Coordinates whose speeds are zero, not nearly so, where these gaps' speeds are.

        Those of stops on angles have whole numbers for gradients: elimination is exact.
        """
        gaps = [self.kinematics.gaps[name] for name in plastic]
        rows = [list(map(int, g.coefficients)) for g in gaps if isinstance(g, AngleFunction)]
        if not rows:
            return []
        reduced, _, _ = fmpz_mat(rows).rref()
        left = ([k for k, value in enumerate(row) if value] for row in reduced.tolist())
        return [row[0] for row in left if len(row) == 1]

    def _changed(self, tape: Tape, state: State) -> list[Ball]:
        """Speeds after changes by a tape, in mean-value form: a rebound makes their radii less."""
        q, u = state
        centre = [x.mid() for x in (*q, *u)]
        off = [x - c for x, c in zip((*q, *u), centre, strict=True)]
        at_centre = tape.values(self.numbers, centre[: len(q)], centre[len(q) :])
        slopes = gradients(tape, self.numbers, q, u)
        after: list[Ball] = []
        for i, c in enumerate(centre[len(q) :]):
            row = list(slopes[i])
            row[len(q) + i] += 1
            after.append(c + at_centre[i] + sum(map(mul, row, off), arb(0)))
        return after

    def _note_launch(self, t: Ball, before: State, after: State) -> None:
        """Note a launch in an impact that turns the velocity through the launch direction.

        The velocity there is the one on the way from that before to that after.
        """
        leads: list[Ball] = []
        for state in (before, after):
            velocity = self.projectile_velocity(state)
            leads.append(velocity.imag - velocity.real)
        ahead, behind = leads
        if ahead < 0 or behind > 0:
            return
        self._require(ahead > 0 and behind < 0, "the launch is in an impact", t)
        part = ahead / (ahead - behind)
        (q, u), (_, u_after) = before, after
        state = q, [x + part * (y - x) for x, y in zip(u, u_after, strict=True)]
        along = self._points_along(state)
        self._require(along is not None, "the launch is in an impact", t)
        if along:
            self._note(ProvedEvent("launch", PROJECTILE, t, *state))

    def _points_along(self, state: State) -> bool | None:
        """Tell whether a velocity on the launch line points along it; None: undecided.

        One that is zero to rounding (:func:`...models.launch.is_launch`) does not.
        """
        velocity = self.projectile_velocity(state)
        along = velocity.real + velocity.imag  # times the square root of a half
        if along > self._standing:
            return True
        return False if along < self._standing else None

    @cached_property
    def _standing(self) -> float:
        """Sum of the projectile's speeds below which it is at rest [m/s]."""
        kinematics = self.equations.kinematics
        row = projectile_row(self.problem.mechanism, kinematics)
        return math.sqrt(2.0) * AT_REST * float(kinematics.speed_scale(row))

    def _gap_speeds(self, state: State) -> dict[str, Ball]:
        """Speed of each stop's gap."""
        speeds = self._gap_speed_tape.values(self.numbers, *state)
        return dict(zip(self.stops, speeds, strict=True))

    @cached_property
    def _gap_speed_tape(self) -> Tape:
        system, algebra = self._expressions(())
        speeds = [algebra.expression(system.gap_speed(k)) for k in range(len(self.stops))]
        return Tape(algebra, self._names, speeds)

    def _require(self, proved: bool, inequality: str, t: Ball) -> None:
        """Raise UndecidedError unless an inequality is proved."""
        if not proved:
            raise UndecidedError(inequality, float(t.mid()))

    # --- what a state has

    @property
    def launch(self) -> ProvedEvent | None:
        """The launch; None: it has not come."""
        return next((event for event in self.events if event.kind == "launch"), None)

    @property
    def grown(self) -> tuple[float, float] | None:
        """Time of the last step [s] and half the width of its set; None: nothing has grown."""
        phase = self.phases[-1]
        if not phase.steps:
            return None
        step = phase.steps[-1]
        now = float(phase.start.mid()) + float(step.start)
        spread = max(float(x.rad()) for x in step.states.box())
        return (now, spread) if now > 0.0 and spread > 0.0 else None

    def projectile_velocity(self, state: State) -> Complex:
        """Velocity of the projectile, which there must be, x + i y [m/s]."""
        return self.point(PROJECTILE, state)[1]

    def point(self, name: str, state: State) -> tuple[Complex, Complex]:
        """Position [m] and velocity [m/s] of a marker, x + i y.

        Raises:
            InputError: there is no such marker.
        """
        mechanism = self.problem.mechanism
        marker = mechanism.marker(name)
        if marker is None:
            names = [each.name for each in mechanism.markers]
            raise InputError(f"there is no marker {name!r} here; there are {names or 'none'}.")
        q, u = map(as_coordinates, state)
        row = self.kinematics.point(marker.body, marker.point)
        return self.kinematics.vector(row, q), self.kinematics.rate(row, q, u)

    def forces(self, phase: Phase, state: State) -> SolvedForces:
        """Accelerations, multipliers of loops, and torques (forces) of the closed stops."""
        if phase.closed not in self._force_tapes:
            system, algebra = self._expressions(phase.closed)
            outputs = [algebra.expression(x) for x in system.solved]
            self._force_tapes[phase.closed] = Tape(algebra, self._names, outputs)
        values = self._force_tapes[phase.closed].values(self.numbers, *state)
        n_q, first = self.structure.n_q, self.structure.n_q + self.structure.n_loops
        torques = dict(zip(self.stops, (-value for value in values[first:]), strict=True))
        closed = {name: torque for name, torque in torques.items() if name in phase.closed}
        accelerations = as_coordinates(values[:n_q])
        return SolvedForces(accelerations, [-value for value in values[n_q:first]], closed)

    # --- from event to event

    @property
    def _names(self) -> list[str]:
        n = range(self.structure.n_q)
        return [*(f"q{i}" for i in n), *(f"u{i}" for i in n)]

    def _expressions(self, closed: Sequence[str]) -> tuple[TaylorSystem, Algebra]:
        """The equations under closed stops, as expressions."""
        s = self.structure
        switches = {s.active.start + k: float(n in closed) for k, n in enumerate(self.stops)}
        algebra = Algebra(switches)
        return TaylorSystem(s, algebra, algebra.solve), algebra

    def _system(self, closed: tuple[str, ...], opened: tuple[str, ...], launches: bool) -> _System:
        """The equations under closed stops, with the functions whose zeros are events."""
        key = (closed, opened, launches)
        if key not in self._systems:
            system, algebra = self._expressions(closed)
            watches = self.problem.stop_law is StopLaw.UNILATERAL
            outputs, functions = list(system.solved[: self.structure.n_q]), list[_Function]()
            for k, name in enumerate(self.stops):
                if name in closed:
                    functions.append(_Function("release", name))
                    outputs.append(system.torques[k])
                elif watches or name in opened:
                    functions.append(_Function("impact", name, touches=name in opened))
                    outputs.append(system.gap(k))
            if launches:
                functions.append(_Function("launch", PROJECTILE))
                outputs.append(system.lead)
            made = [algebra.expression(output) for output in outputs]
            self._systems[key] = _System(Tape(algebra, self._names, made), functions)
        return self._systems[key]

    def _may_launch(self, closed: Sequence[str]) -> bool:
        """Tell whether a launch is looked for: none has come, and nothing holds the projectile."""
        free = self._rests.isdisjoint(closed)
        return bool(self.structure.throws) and free and self.launch is None

    def _next_event(
        self, phase: Phase, state: State, opened: tuple[str, ...], end: Ball
    ) -> ProvedEvent | None:
        """Make steps to the first event; None: the end comes first.

        Args:
            phase: to which the steps are added.
            state: at its start.
            opened: stops that touch there and are not closed.
            end: of the motion [s].
        """
        launches = self._may_launch(phase.closed)
        system = self._system(phase.closed, opened, launches)
        stepper = StepMaker(system.tape, self.numbers, self.order, self.bits)
        if opened:
            stepper.longest = min(stepper.longest, self._flight_time(system, state))
        begin, states = Fraction(0), StateSet.of([*state[0], *state[1]])
        last = Fraction(float((end - phase.start).upper())) * (1 + Fraction(1, 2**50))
        while begin < last:
            self._count(phase.start + exact(begin))
            if begin and opened:  # they have parted
                opened = ()
                system = self._system(phase.closed, opened, launches)
                stepper.tape = system.tape
            now = float(phase.start.mid()) + float(begin)
            try:
                step, event = self._step(stepper, phase, begin, states, last, system.functions)
            except NoTubeError:
                bound = self.problem.mechanism.bound_by
                raise UndecidedError(_REGULAR if bound else _FINITE, now) from None
            phase.steps.append(step)
            if event is not None:
                return None if event.time > end else event
            states, begin = step.reached(), step.end
        return None

    def _flight_time(self, system: _System, state: State) -> float:
        """Estimate after which time a gap that opens may be closed again [s]."""
        expansion = system.tape.expand(self.numbers, *state, 2)
        shortest = math.inf
        for i, function in enumerate(system.functions):
            if function.touches:
                speed, half = (float(c.mid()) for c in expansion.output(len(state[0]) + i)[1:])
                if speed > 0.0 > half:
                    shortest = min(shortest, _FLIGHTS * speed / -half)
        return shortest

    def _step(
        self,
        stepper: StepMaker,
        phase: Phase,
        begin: Fraction,
        states: StateSet,
        last: Fraction,
        functions: Sequence[_Function],
    ) -> tuple[Step, ProvedEvent | None]:
        """Make a step, and find its first event; a shorter one where that is undecided.

        Remainders of slopes hold for all motions in the step's box, and are wide over a long one.
        """
        left = last - begin
        for _ in range(_SHORTER):
            step = stepper.step(begin, states, left)
            with suppress(UndecidedError):
                return step, self._first(phase, step, functions)
            left = step.length / 4
        step = stepper.step(begin, states, left)
        return step, self._first(phase, step, functions)

    def _count(self, now: Ball) -> None:
        self._steps += 1
        spent = time.process_time() - self._began
        if self._progress is not None:
            self._progress(float(now.mid()))
        if self._steps > self._limits.steps:
            raise LimitError(
                f"not proved: {self._limits.steps} steps are made by t = {float(now.mid()):.6g} s."
            )
        if spent > self._limits.seconds:
            raise LimitError(
                "not proved: the limit of processor time is reached at t = "
                f"{float(now.mid()):.6g} s; a longer one, or fewer digits, may do."
            )

    def _first(
        self, phase: Phase, step: Step, functions: Sequence[_Function]
    ) -> ProvedEvent | None:
        """The first event of a step; None: there is none."""
        found: list[tuple[Zero, int]] = []
        undecided: list[tuple[UndecidedZeroError, _Function]] = []
        for i, function in enumerate(functions):
            try:
                zero = next(self._falls(phase, i, function, step), None)
            except UndecidedZeroError as error:
                undecided.append((error, function))
                continue
            if zero is not None:
                found.append((zero, i))
        for error, function in undecided:
            # What is after an event of this step is not of this motion.
            if any(zero.time < exact(error.low) for zero, _ in found):
                continue
            now = float(phase.start.mid()) + float(step.start)
            raise UndecidedError(
                _INEQUALITIES[function.kind].format(function.name), now + float(error.low)
            )
        if not found:
            return None
        found.sort(key=lambda each: float(each[0].time.mid()))
        (zero, first), *others = found
        function, since = functions[first], phase.start + exact(step.start)
        time, state = step.crossing(first, zero.time)
        for other, second in others:
            inequality = f"{function.name!r} comes before {functions[second].name!r}"
            self._require(time < other.time, inequality, since + time)
        return ProvedEvent(function.kind, function.name, since + time, *state)

    def _falls(self, phase: Phase, i: int, function: _Function, step: Step) -> Iterator[Zero]:
        """Falls of a function through zero that are events, in their order."""
        model, begin = step.functions[i], Fraction(0)
        at_start = model.coefficients[0]
        if step.start and keeps_sign(model, step.length):
            return
        of_all = step.of_all[i]
        if not step.start:
            if function.touches:
                # A stop opens with a force of zero: its gap has no acceleration either.
                known = 2 if function.name == phase.released else 1
                sign, begin = clear_of_start(of_all, step.length, known)
                if sign < 0:
                    raise UndecidedZeroError(Fraction(0), begin, "f > 0")
                if self.problem.stop_law is not StopLaw.UNILATERAL:
                    return
            elif function.kind == "release" and not at_start > 0:
                raise UndecidedZeroError(Fraction(0), Fraction(0), "f > 0")
            elif function.kind == "launch" and of_all.coefficients[0].is_zero():
                _, begin = clear_of_start(of_all, step.length, known=0)
        for zero in zeros(model, of_all.derivative(), step.length, begin):
            if zero.falls and (function.kind != "launch" or self._is_launch(step, zero)):
                yield zero

    def _is_launch(self, step: Step, zero: Zero) -> bool:
        """Tell whether the velocity points along the launch direction, and not against it."""
        along = self._points_along(step.at(zero.time))
        if along is None:
            raise UndecidedZeroError(Fraction(0), step.length, "speed != 0")
        return along


def _middles(state: State) -> tuple[FloatArray, FloatArray]:
    """The middles of a state's balls, in doubles."""
    q, u = (np.array([float(x.mid()) for x in part]) for part in state)
    return q, u
