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
)
from ..protocol import Recording
from .build import build, silence
from .matrices import Matrices, matrices, resolve_impact, solve_constrained
from .options import ExudynOptions
from .read import Reader, Spring, Values, recording
from .solver import Balance, BodyState, Solver, is_at

_WHOLE = 1e-6  # of a step: so near to a whole number of steps, it is one
_DIGITS = 1e-4  # of the largest torque: the rounding error of a spring's must be smaller
_RESOLVED = 1e-13  # [s] rounding of a torque over its slope
_MOST_PROBES = 12  # a torque is nearly linear within a step: four are enough
_HELD = 1e-9  # of its acceleration without stops: a gap that redundant stops hold has no less


def run(problem: Problem, options: ExudynOptions) -> Recording:
    """Simulate a problem.

    Raises:
        InputError: stops are to be springs under the unilateral law.
        UnsupportedProblemError: the mechanism cannot be built, or not from this start.
        SimulationError: Exudyn's solver gave up before the end, or impacts follow each other
            without an end.
    """
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


class ExudynMotion:
    """Exudyn in a present state; a table of all sensors for each motion between events."""

    def __init__(self, problem: Problem, options: ExudynOptions) -> None:
        self.mechanism = problem.mechanism
        self.duration = problem.duration
        self.options = options
        self.unilateral = problem.stop_law is StopLaw.UNILATERAL
        self.system = build(problem.mechanism, law=problem.stop_law)
        self.solver = Solver(self.system, options)
        self.kinematics = Kinematics(problem.mechanism)
        self.now = self.solver.start()
        self.held: Contacts = ()
        self.tables: list[FloatArray] = []
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
        reader = Reader(self.system, self.solver.columns, table)
        # Under the unilateral law the multiplier of a stop that is open is zero.
        torques = {
            name: reader.torque(name, None if self.unilateral else released)
            for name, released in events.releases.items()
        }
        return recording(reader, torques, events, self.solver.steps)

    # Motion to the next event.

    def proceed(self, start: float, end: float, watch: Watch) -> Halt:
        """Move to the next release, under the unilateral law or impact, or to the end."""
        if self.tables and is_at(self.now.t, end):
            return Halt(end)
        with self._explained():
            if not (self.unilateral or self.options.locate_releases):
                return self._released_after_steps(end)
            return self._to_next_event(end, watch.open)

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

    def _to_next_event(self, end: float, watched: Contacts) -> Halt:
        def is_undisturbed(_: float) -> bool:
            pushing = all(self.system.torque(name) >= 0.0 for name in self.held)
            return pushing and not self._met(watched, self.system.now)

        monitor = is_undisturbed if self.held or watched else None
        table = self.solver.run(self.now, self.held, end, self._steps_to(end), monitor)
        opened = self._first_opened(table)
        times = [
            (*self._onto_zero_gap(table, name), name)
            for name in self._met(watched, self.solver.values(table[-1]))
        ]
        first, shortest, met = min(times, key=lambda event: event[0], default=(np.inf, table, None))
        if opened and opened[0][-1, 0] < first:
            return self._open(*opened)
        self._accept(shortest)
        if met is None:
            return Halt(end if is_at(self.now.t, end) else self.now.t)
        self._measure_gaps_at(met)
        return Halt(self.now.t, met=met)

    def _steps_to(self, end: float) -> int:
        return max(1, math.ceil((end - self.now.t) / self.options.timestep - _WHOLE))

    def _accept(self, table: FloatArray) -> None:
        self.tables.append(table)
        self.now = self.solver.state(table, -1)

    # Releases.

    def _released_after_steps(self, end: float) -> Halt:
        """Move to the end, switching stops off after the step in which their torque is negative."""
        opened: dict[str, float] = {}

        def release(time: float) -> bool:
            for name in [name for name in self.held if self.system.torque(name) < 0.0]:
                self.held = tuple(other for other in self.held if other != name)
                self.system.set_active(self.held)
                opened[name] = time
            return True

        monitor = release if self.held else None
        self._accept(self.solver.run(self.now, self.held, end, self._steps_to(end), monitor))
        return Halt(end if is_at(self.now.t, end) else self.now.t, opened)

    def _first_opened(self, table: FloatArray) -> tuple[FloatArray, str] | None:
        """A table up to the release in its last step, if there is one, and which stop opens."""
        pulling = (name for name in self.held if self.solver.torque(table[-1], name) < 0.0)
        name = next(pulling, None)
        if name is None or self.options.locate_releases:
            return None if name is None else self._located_release(table)
        return table, name

    def _located_release(self, table: FloatArray) -> tuple[FloatArray, str] | None:
        """A table cut to end with steps onto a release in its last one, and which stop opens there.

        None where only the error of the integrator's multiplier is negative: a run may go on from
        there, free of it.
        """
        row = self.solver.balance(self.solver.state(table, -1), self.held).row
        pulling = [name for name in self.held if self.solver.torque(row, name) < 0.0]
        releases = [(*self._onto_zero_torque(table, name), name) for name in pulling]
        _, earliest, name = min(
            releases, key=lambda release: release[0], default=(0.0, table, None)
        )
        return None if name is None else (earliest, name)

    def _open(self, table: FloatArray, name: str) -> Halt:
        """Open a stop at the end of a table, and others that would have to pull without it."""
        self._accept(table)
        others = tuple(other for other in self.held if other != name)
        opened = {name: self.now.t}
        self.held = self._pushing(others)
        return Halt(self.now.t, opened | {n: self.now.t for n in others if n not in self.held})

    def _onto_zero_torque(self, table: FloatArray, name: str) -> tuple[float, FloatArray]:
        """Time near the last step of a table at which a stop's torque is zero [s], and a table.

        The torque is that of the state, not the integrator's: a smooth function of the time, for
        the secant rule.
        """

        def torque(rows: FloatArray, row: int) -> float:
            balance = self.solver.balance(self.solver.state(rows, row), self.held)
            return self.solver.torque(balance.row, name)

        # Times as asked for: with adaptive steps a table may end a rounding beside them.
        times, values = [float(time) for time in table[-2:, 0]], [torque(table, len(table) - 2)]

        def secant(probe: FloatArray) -> float:
            values.append(torque(probe, -1))
            slope = (values[-1] - values[-2]) / (times[-1] - times[-2])
            guess = times[-1] - values[-1] / slope if slope else times[-1]
            times.append(min(guess, float(table[-1, 0])))
            return times[-1]

        return self._onto(table, secant)

    def _onto(
        self, table: FloatArray, next_guess: Callable[[FloatArray], float]
    ) -> tuple[float, FloatArray]:
        """Time of an event near the last step of a table [s], and a table up to there.

        The steps onto it start two steps back, so that they are longer than half a step wherever it
        is; `next_guess` gives its time from a table that ends near it.
        """
        last, first = len(table) - 1, max(len(table) - 3, 0)
        begin, probe = self.solver.state(table, first), table
        for _ in range(_MOST_PROBES):
            end = min(next_guess(probe), float(table[last, 0]))
            if end - begin.t <= SAME_TIME:
                return begin.t, table[: first + 1]
            if abs(end - float(probe[-1, 0])) <= _RESOLVED:
                break
            rows = self.solver.run(begin, self.held, end, last - first)
            probe = np.concatenate([table[: first + 1], rows[1:]])
        return float(probe[-1, 0]), probe

    # Impacts.

    def _met(self, watched: Contacts, values: Values) -> list[str]:
        """Stops in penetration that close; one that has just opened may penetrate by its drift."""
        stops = self.system.constraints
        return [
            name
            for name in watched
            if stops[name].gap(values) < 0.0 > stops[name].gap_speed(values)
        ]

    def _onto_zero_gap(self, table: FloatArray, name: str) -> tuple[float, FloatArray]:
        """Time in the last steps of a table at which a stop's gap is zero [s], and a table.

        Newton's iteration from the zero of a cubic through the gaps and speeds at both ends. After
        a rebound lower than a step is long the gap is zero at both of its ends, and the later one
        is the impact: from the far end Newton's iteration would only halve the way to it. Where the
        gap grows, on the wrong side of a turn, half way back.
        """
        stop, latest = self.system.constraints[name], float(table[-1, 0])

        def newton(probe: FloatArray) -> float:
            time, values = float(probe[-1, 0]), self.solver.values(probe[-1])
            speed = stop.gap_speed(values)
            cubic = self._zero_of_cubic(table, name) if probe is table else None
            if cubic:
                return cubic
            return (time + latest) / 2 if speed >= 0 else time - stop.gap(values) / speed

        return self._onto(table, newton)

    def _zero_of_cubic(self, table: FloatArray, name: str) -> float | None:
        """Last time [s] at which a cubic through a stop's gaps in a table's end falls to zero."""
        stop, rows = self.system.constraints[name], (table[max(len(table) - 3, 0)], table[-1])
        gaps = [stop.gap(self.solver.values(row)) for row in rows]
        speeds = [stop.gap_speed(self.solver.values(row)) for row in rows]
        begin, span = float(rows[0][0]), float(rows[1][0] - rows[0][0])
        polynomial = CubicHermiteSpline([0.0, span], gaps, speeds)
        falls = [zero for zero in polynomial.roots(extrapolate=False) if polynomial(zero, 1) < 0]
        return begin + float(falls[-1]) if falls else None

    def _measure_gaps_at(self, met: str) -> None:
        """Measure gaps where that of the stop which is met is zero, near the present state."""
        reader = Reader(self.system, self.solver.columns, self.tables[-1][-1:])
        q, u = reader.coordinates()[0], reader.speeds()[0]
        speed = float(self.kinematics.gap_jacobian(met, q) @ u)
        there = q - float(self.kinematics.gap(met, q)) / speed * u if speed < 0 else q
        self._contact = there, u

    def impact(
        self, touching: Contacts, rule: RestitutionRule, kept: frozenset[str]
    ) -> tuple[Mapping[str, float], Contacts]:
        """Resolve the impact of all contacts that touch, by Exudyn's mass matrix."""
        reader = Reader(self.system, self.solver.columns, self.tables[-1][-1:])
        q, u = reader.coordinates()[0], reader.speeds()[0]
        values = self.solver.values(self.tables[-1][-1])
        restitution = rule(self._gap_speeds(touching, values), q, u)
        with self._explained():
            self.now, impulses = resolve_impact(self.system, self.now, restitution)
            self._impacts.append(self.now.t)
            values = self.solver.values(self.solver.balance(self.now, ()).row)
        return impulses, resting(self._gap_speeds(touching, values))

    def _gap_speeds(self, names: Contacts, values: Values) -> dict[str, float]:
        return {name: self.system.constraints[name].gap_speed(values) for name in names}

    # Which stops act.

    def hold(self, rest: Contacts, time: float) -> Contacts:
        """Hold the stops that push; at the start they may be replaced by springs."""
        with self._explained():
            self.held = self._pushing(rest)
        stiffness = self.options.stop_stiffness
        if self.held and stiffness is not None:
            ratio = self.options.stop_damping_ratio
            springs = _springs(self.solver, self.now, self.held, stiffness, ratio)
            self.system = build(self.mechanism, springs)
            self.solver = Solver(self.system, self.options)
        return self.held

    def _pushing(self, touching: Contacts) -> Contacts:
        """Which of the touching stops push while the others open."""
        free = self.solver.balance(self.now, ())
        least = {name: -_HELD * abs(self._opening(name, free)) for name in touching}
        return active_contacts(touching, lambda active: self._violated(least, active))

    def _violated(self, touching: Mapping[str, float], active: Contacts) -> str | None:
        """First of the touching stops that pulls, or closes faster than its given acceleration."""
        balance = self.solver.balance(self.now, active)
        for name, least in touching.items():
            if name in active:
                if self.solver.torque(balance.row, name) < 0.0:
                    return name
            # A preloaded spring releases with its gap open: how that moves does not matter then.
            elif not self.system.springs and self._opening(name, balance) < least:
                return name
        return None

    def _opening(self, name: str, balance: Balance) -> float:
        """Acceleration of a stop's gap [rad/s^2, m/s^2]."""
        names = (body.name for body in self.mechanism.bodies)
        rotations = dict(zip(names, balance.accelerations[2::3].tolist(), strict=True))
        values = self.solver.values(balance.row)
        return self.system.constraints[name].gap_acceleration(values, rotations)


def _springs(
    solver: Solver, state: BodyState, active: Contacts, stiffness: float, damping_ratio: float
) -> dict[str, Spring]:
    """A spring for each stop that pushes at a state, in balance there.

    Without the preload a spring would carry no torque at the start, and the torque would then
    oscillate between zero and twice its value at rest.

    Args:
        solver: of the same mechanism with its stops as constraints.
        state: the start.
        active: stops that push there.
        stiffness: of each spring [N m/rad, or N/m on a point].
        damping_ratio: of each spring, with the inertia that the stop carries at the start; 1 is
            critical.

    Raises:
        InputError: so stiff a spring would turn the rounding of angles or positions into forces
            that matter.
    """
    row = solver.balance(state, active).row
    torques = {name: solver.torque(row, name) for name in active}
    for name in active:
        _refuse_noise(solver, row, stiffness, name, torques)
    with matrices(solver.system) as state_matrices:
        state_matrices.set(state.coordinates, state.rates)
        inertias = {name: _inertia(state_matrices, name) for name in active}
    return {
        name: Spring(
            stiffness, 2 * damping_ratio * math.sqrt(stiffness * inertias[name]), torques[name]
        )
        for name in active
    }


def _refuse_noise(
    solver: Solver, row: FloatArray, stiffness: float, name: str, torques: Mapping[str, float]
) -> None:
    """Refuse a stiffness that turns rounding of angles or positions into forces that matter."""
    mechanism, stop = solver.system.mechanism, solver.system.mechanism.stop(name)
    largest = max(
        t for other, t in torques.items() if mechanism.stop(other).force_unit == stop.force_unit
    )
    rounding = solver.system.constraints[name].rounding(solver.values(row))
    most = _DIGITS * largest / rounding
    if 0 < most < stiffness:
        unit, what = stop.force_unit, "angles" if stop.effort == "torque" else "a point's place"
        raise InputError(
            f"stop_stiffness = {stiffness:g} {unit}/{stop.gap_unit} would turn the rounding of "
            f"{what} into a {stop.effort} of {stiffness * rounding:.2g} {unit}, of {largest:.3g} "
            f"{unit} in the stops; at most {most:.2g} is resolved."
        )


def _inertia(state_matrices: Matrices, stop: str) -> float:
    """Inertia that a stop feels, the others open [kg m^2, or kg on a point]."""
    joints, row = state_matrices.jacobian(()), state_matrices.stop_row(stop)
    opened, _ = solve_constrained(state_matrices.mass(), joints, row, np.zeros(len(joints)))
    return 1.0 / float(row @ opened)
