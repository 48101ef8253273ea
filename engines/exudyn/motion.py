"""Motion of a mechanism by Exudyn, from event to event.

Exudyn's solver runs until a step in which an active stop pulls or, under the unilateral law, an
open one penetrates. The run then goes back some steps and steps exactly onto the event; what
follows from it is decided by :class:`..events.EventDriver`. A contact that begins and ends within
one step is not seen: its penetration is at most the step's length squared times an eighth of the
gap's acceleration.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from ...models.arrays import FloatArray
from ...models.errors import InputError, SimulationError
from ...models.kinematics import Kinematics, initial_state
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
    resting,
    whole_steps,
)
from ..protocol import Recording
from .build import build, silence
from .limits import build_with_limits, recording_with_limits
from .matrices import matrices, resolve_impact, solve_constrained
from .options import ExudynOptions
from .read import Spring, Values, recording
from .solver import Balance, BodyState, Monitor, Solver, is_at

_WHOLE = 1e-6  # of a step: so near to a whole number of steps, it is one
_DIGITS = 1e-4  # of the largest torque: the rounding error of a spring's must be smaller
_RESOLVED = 1e-13  # [s] rounding of a torque over its slope
_MOST_PROBES = 12  # a torque is nearly linear within a step: four are enough
_HELD = 1e-9  # of its acceleration without stops: a gap that redundant stops hold has no less


def run(problem: Problem, options: ExudynOptions) -> Recording:
    """Simulate a problem.

    Raises:
        InputError: stops are to be springs under the unilateral law, or Exudyn's own and switched.
        UnsupportedProblemError: the mechanism cannot be built, or not from this start.
        SimulationError: Exudyn's solver gave up before the end, or impacts follow each other
            without an end.
    """
    if not options.fit_steps:
        duration = whole_steps(problem.duration, options.timestep) * options.timestep
        problem = problem.model_copy(update={"duration": duration})
    if options.own_limits:
        if options.locate_releases or options.stop_stiffness is not None:
            raise InputError(
                "own_limits = true leaves stops to exudyn: locate_releases must be false, and "
                "stop_stiffness left out."
            )
        return _with_own_limits(problem, options)
    unilateral = problem.stop_law is StopLaw.UNILATERAL
    if unilateral and options.stop_stiffness is not None:
        raise InputError(
            f"stop_stiffness = {options.stop_stiffness:g} must be left out under the unilateral "
            "law: exudyn's springs are for stops that open once; its impacts are those of rigid "
            "stops."
        )
    with silence():
        motion = ExudynMotion(problem, options)
        return EventDriver(problem, motion, "exudyn", impacts=unilateral).run()


def _with_own_limits(problem: Problem, options: ExudynOptions) -> Recording:
    with silence():
        period = options.limit_period * options.timestep
        system = build_with_limits(problem.mechanism, problem.stop_law, period)
        solver = Solver(system, options)
        steps = max(1, math.ceil(problem.duration / options.timestep - _WHOLE))
        table = solver.run(solver.start(), (), problem.duration, steps)
    return recording_with_limits(system, solver.columns, table, solver.steps)


class ExudynMotion:
    """Exudyn in a present state; a table of all sensors for each motion between events."""

    def __init__(self, problem: Problem, options: ExudynOptions) -> None:
        self.mechanism, self.duration, self.options = problem.mechanism, problem.duration, options
        self.unilateral = problem.stop_law is StopLaw.UNILATERAL
        self.system = build(problem.mechanism, law=problem.stop_law)
        self.solver = Solver(self.system, options)
        self.kinematics = Kinematics(problem.mechanism)
        self.now = self.solver.start()
        self.held: Contacts = ()
        self.tables: list[FloatArray] = []
        self._changes = [t for t in problem.mechanism.instants if t < problem.duration]
        """Instants ahead at which recorded efforts change [s]."""
        self._contact = initial_state(problem.mechanism)
        """Coordinates and speeds where gaps are measured."""
        self._impacts: list[float] = []
        """Times [s]."""

    def gap(self, stop: str) -> tuple[float, float]:
        """Gap and its speed by the coordinates, at the start or where a stop is met.

        By the bodies' own positions the gaps of redundant stops differ by the joints' drift.
        """
        q, u = self._contact
        speed = float(self.kinematics.gap_jacobian(stop, q) @ u)
        return float(self.kinematics.gap(stop, q)), speed

    def recording(self, events: ContactEvents) -> Recording:
        """The samples; at an event those of the later motion, with the forces of what acts then."""
        table = np.concatenate([*(table[:-1] for table in self.tables[:-1]), self.tables[-1]])
        # Exudyn's sum of steps may end a rounding later, or earlier.
        table[:, 0] = np.minimum(table[:, 0], self.duration)
        table[-1, 0] = self.duration
        columns, steps = self.solver.columns, self.solver.steps
        return recording(self.system, columns, table, events, steps, reopens=self.unilateral)

    # Motion to the next event.

    def proceed(self, start: float, end: float, watch: Watch) -> Halt:
        """Move to the next release, under the unilateral law or impact, or to the end."""
        with self._explained():
            while not (self.tables and is_at(self.now.t, end)):
                if opened := self._change_efforts():
                    return Halt(self.now.t, dict.fromkeys(opened, self.now.t))
                halt = self._to_event(min([end, *self._changes[:1]]), watch)
                if halt.opened or halt.met is not None:
                    return halt
        return Halt(end)

    def _to_event(self, end: float, watch: Watch) -> Halt:
        if self.unilateral or self.options.locate_releases:
            return self._to_next_event(end, watch.open)
        return self._release_after_steps(end)

    def _change_efforts(self) -> Contacts:
        """Let other efforts act if they change now; held stops that would pull open."""
        if not self._changes or not is_at(self.now.t, self._changes[0]):
            return ()
        self.system.set_efforts(self._changes.pop(0))
        before, self.held = self.held, self._pushing(self.held)
        return tuple(name for name in before if name not in self.held)

    @contextmanager
    def _explained(self) -> Generator[None]:
        """Add to an error that the last two impacts are nearer to each other than a step, if so."""
        try:
            yield
        except SimulationError as error:
            times, step = self._impacts[-2:], self.options.timestep
            if len(times) < 2 or times[1] - times[0] >= step:
                raise
            raise SimulationError(
                f"{error} Its last two impacts are {times[1] - times[0]:.2g} s apart, within a "
                f"time step of {step:.2g} s."
            ) from None

    def _run(self, end: float, monitor: Monitor | None) -> FloatArray:
        steps = max(1, math.ceil((end - self.now.t) / self.options.timestep - _WHOLE))
        return self.solver.run(self.now, self.held, end, steps, monitor)

    def _accept(self, table: FloatArray, end: float) -> float:
        """Keep a table; the time of its end [s], which is that asked for if it differs by rounding.

        Exudyn adds up its steps.
        """
        self.tables.append(table)
        self.now = self.solver.state(table[-1])
        return end if is_at(self.now.t, end) else self.now.t

    def _release_after_steps(self, end: float) -> Halt:
        """Move to the end, switching stops off after the step in which their torque is negative."""
        opened: dict[str, float] = {}

        def release(time: float) -> bool:
            for name in [name for name in self.held if self.system.torque(name) < 0.0]:
                self.held = tuple(other for other in self.held if other != name)
                self.system.set_active(self.held)
                opened[name] = time
            return True

        return Halt(self._accept(self._run(end, release if self.held else None), end), opened)

    def _to_next_event(self, end: float, watched: Contacts) -> Halt:
        def is_undisturbed(_: float) -> bool:
            pushing = all(self.system.torque(name) >= 0.0 for name in self.held)
            return pushing and not self._met(watched, self.system.now)

        table = self._run(end, is_undisturbed if self.held or watched else None)
        release, impact = table, table
        opening = [name for name in self.held if self.solver.torque(table[-1], name) < 0.0]
        if opening and self.options.locate_releases:
            release, opening = self._located_release(table)

        first, met = np.inf, None
        for name in self._met(watched, self.solver.values(table[-1])):
            time, up_to = self._onto_zero_gap(table, name)
            if time < first:
                first, impact, met = time, up_to, name

        if opening and release[-1, 0] < first:
            self._accept(release, end)
            # Others may have to pull without the stop that opens.
            others = tuple(name for name in self.held if name != opening[0])
            self.held = self._pushing(others)
            names = (opening[0], *(name for name in others if name not in self.held))
            return Halt(self.now.t, dict.fromkeys(names, self.now.t))
        time = self._accept(impact, end)
        if met is None:
            return Halt(time)
        # Measure gaps where that of the stop which is met is zero, near the present state.
        q, u = self.solver.coordinates(impact[-1])
        speed = float(self.kinematics.gap_jacobian(met, q) @ u)
        if speed < 0:
            q = q - float(self.kinematics.gap(met, q)) / speed * u
        self._contact = q, u
        return Halt(self.now.t, met=met)

    def _met(self, watched: Contacts, values: Values) -> list[str]:
        """Stops in penetration that close; one that has just opened may penetrate by its drift."""
        met: list[str] = []
        for name in watched:
            stop = self.system.constraints[name]
            if stop.gap(values) < 0.0 > stop.gap_speed(values):
                met.append(name)
        return met

    # Where in a step an event is.

    def _located_release(self, table: FloatArray) -> tuple[FloatArray, list[str]]:
        """A table cut to end with steps onto the first release in its last one, and what opens.

        Nothing opens where only the error of the integrator's multiplier is negative: a run may go
        on from there, free of it.
        """
        row = self.solver.balance(self.solver.state(table[-1]), self.held).row
        first, release, opening = np.inf, table, list[str]()
        for name in [name for name in self.held if self.solver.torque(row, name) < 0.0]:
            time, up_to = self._onto_zero_torque(table, name)
            if time < first:
                first, release, opening = time, up_to, [name]
        return release, opening

    def _onto_zero_torque(self, table: FloatArray, name: str) -> tuple[float, FloatArray]:
        """Time near the last step of a table at which a stop's torque is zero [s], and a table.

        The torque is that of the state, not the integrator's: a smooth function of the time, for
        the secant rule.
        """

        def torque(row: FloatArray) -> float:
            balance = self.solver.balance(self.solver.state(row), self.held)
            return self.solver.torque(balance.row, name)

        # Times as asked for: with adaptive steps a table may end a rounding beside them.
        times, values = [float(time) for time in table[-2:, 0]], [torque(table[-2])]

        def secant(probe: FloatArray) -> float:
            values.append(torque(probe[-1]))
            slope = (values[-1] - values[-2]) / (times[-1] - times[-2])
            guess = times[-1] - values[-1] / slope if slope else times[-1]
            times.append(min(guess, float(table[-1, 0])))
            return times[-1]

        return self._onto(table, secant)

    def _onto_zero_gap(self, table: FloatArray, name: str) -> tuple[float, FloatArray]:
        """Time in the last steps of a table at which a stop's gap is zero [s], and a table.

        Newton's iteration from the zero of a cubic through the gaps and speeds at both ends. After
        a rebound lower than a step is long the gap is zero at both of its ends, and the later one
        is the impact: from the far end Newton's iteration would only halve the way to it. Where the
        gap grows, on the wrong side of a turn, half way back.
        """
        stop, latest = self.system.constraints[name], float(table[-1, 0])
        rows = table[max(len(table) - 3, 0)], table[-1]
        begin, ends = float(rows[0][0]), [self.solver.values(row) for row in rows]
        gaps, speeds = [stop.gap(end) for end in ends], [stop.gap_speed(end) for end in ends]
        cubic = CubicHermiteSpline([0.0, latest - begin], gaps, speeds)
        falls = [zero for zero in cubic.roots(extrapolate=False) if cubic(zero, 1) < 0]

        def newton(probe: FloatArray) -> float:
            if probe is table and falls:
                return begin + float(falls[-1])
            time, values = float(probe[-1, 0]), self.solver.values(probe[-1])
            speed = stop.gap_speed(values)
            return (time + latest) / 2 if speed >= 0 else time - stop.gap(values) / speed

        return self._onto(table, newton)

    def _onto(
        self, table: FloatArray, next_guess: Callable[[FloatArray], float]
    ) -> tuple[float, FloatArray]:
        """Time of an event near the last step of a table [s], and a table up to there.

        The steps onto it start two steps back, so that they are longer than half a step wherever it
        is; `next_guess` gives its time from a table that ends near it.
        """
        last, first = len(table) - 1, max(len(table) - 3, 0)
        begin, probe = self.solver.state(table[first]), table
        for _ in range(_MOST_PROBES):
            end = min(next_guess(probe), float(table[last, 0]))
            if end - begin.t <= SAME_TIME:
                return begin.t, table[: first + 1]
            if abs(end - float(probe[-1, 0])) <= _RESOLVED:
                break
            rows = self.solver.run(begin, self.held, end, last - first)
            probe = np.concatenate([table[: first + 1], rows[1:]])
        return float(probe[-1, 0]), probe

    # Which stops act.

    def impact(
        self, touching: Contacts, rule: RestitutionRule, kept: frozenset[str]
    ) -> tuple[Mapping[str, float], Contacts]:
        """Resolve the impact of all contacts that touch, by Exudyn's mass matrix."""
        row = self.tables[-1][-1]
        speeds = self._gap_speeds(touching, self.solver.values(row))
        restitution = rule(speeds, *self.solver.coordinates(row))
        with self._explained():
            self.now, impulses = resolve_impact(self.system, self.now, restitution)
            self._impacts.append(self.now.t)
            values = self.solver.values(self.solver.balance(self.now, ()).row)
        return impulses, resting(self._gap_speeds(touching, values))

    def _gap_speeds(self, names: Contacts, values: Values) -> dict[str, float]:
        return {name: self.system.constraints[name].gap_speed(values) for name in names}

    def hold(self, rest: Contacts, time: float) -> Contacts:
        """Hold the stops that push; at the start they may be replaced by springs."""
        with self._explained():
            self.held = self._pushing(rest)
        if self.held and self.options.stop_stiffness is not None:
            springs = _springs(self.solver, self.now, self.held, self.options.stop_stiffness)
            self.system = build(self.mechanism, springs)
            self.solver = Solver(self.system, self.options)
        return self.held

    def _pushing(self, touching: Contacts) -> Contacts:
        """The touching stops that push while the others open."""
        free = self.solver.balance(self.now, ())
        least = {name: -_HELD * abs(self._opening(name, free)) for name in touching}

        def violated(active: Contacts) -> str | None:
            """First of the touching stops that pulls, or closes faster than by rounding."""
            balance = self.solver.balance(self.now, active)
            for name in touching:
                if name in active:
                    if self.solver.torque(balance.row, name) < 0.0:
                        return name
                # A preloaded spring releases with its gap open: how that moves does not matter.
                elif not self.system.springs and self._opening(name, balance) < least[name]:
                    return name
            return None

        return active_contacts(touching, violated)

    def _opening(self, name: str, balance: Balance) -> float:
        """Acceleration of a stop's gap [rad/s^2, m/s^2]."""
        names = (body.name for body in self.mechanism.bodies)
        rotations = dict(zip(names, balance.accelerations[2::3].tolist(), strict=True))
        values = self.solver.values(balance.row)
        return self.system.constraints[name].gap_acceleration(values, rotations)


def _springs(
    solver: Solver, state: BodyState, active: Contacts, stiffness: float
) -> dict[str, Spring]:
    """A spring for each stop that pushes at a state, in balance there.

    Without the preload a spring would carry no torque at the start, and the torque would then
    oscillate between zero and twice its value at rest.

    Args:
        solver: of the same mechanism with its stops as constraints.
        state: the start.
        active: stops that push there.
        stiffness: of each spring [N m/rad, or N/m on a point].

    Raises:
        InputError: so stiff a spring would turn the rounding of angles or positions into forces
            that matter.
    """
    row = solver.balance(state, active).row
    torques = {name: solver.torque(row, name) for name in active}
    stops = [solver.mechanism.stop(name) for name in active]
    for stop in stops:
        unit = stop.force_unit
        largest = max(torques[other.name] for other in stops if other.force_unit == unit)
        rounding = solver.system.constraints[stop.name].rounding(solver.values(row))
        most = _DIGITS * largest / rounding
        if 0 < most < stiffness:
            what = "angles" if stop.effort == "torque" else "a point's place"
            raise InputError(
                f"stop_stiffness = {stiffness:g} {unit}/{stop.gap_unit} would turn the rounding of "
                f"{what} into a {stop.effort} of {stiffness * rounding:.2g} {unit}, of "
                f"{largest:.3g} {unit} in the stops; at most {most:.2g} is resolved."
            )

    springs, ratio = dict[str, Spring](), solver.options.stop_damping_ratio
    with matrices(solver.system) as state_matrices:
        state_matrices.set(state.coordinates, state.rates)
        for name in active:
            # Inertia that the stop feels, the others open [kg m^2, or kg on a point].
            joints, gap = state_matrices.jacobian(()), state_matrices.stop_row(name)
            still = np.zeros(len(joints))
            response, _ = solve_constrained(state_matrices.mass(), joints, gap, still)
            inertia = 1.0 / float(gap @ response)
            damping = 2 * ratio * math.sqrt(stiffness * inertia)
            springs[name] = Spring(stiffness, damping, torques[name])
    return springs
