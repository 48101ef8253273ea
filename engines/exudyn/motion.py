"""Moving a mechanism with Exudyn from its start to the end, over the releases and impacts of its stops.

Exudyn's solver runs until a step in which an active stop pulls or, under the unilateral law, an
inactive one penetrates. The run then goes back some steps and steps exactly onto the event; what
follows from it is decided by :mod:`..contact_events`. A contact that begins and ends within one
step is not seen: its penetration is at most the step's length squared times an eighth of the gap's
acceleration.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from ...models.arrays import FloatArray
from ...models.errors import InputError, SimulationError
from ...models.kinematics import Kinematics
from ...models.problem import Problem, StopLaw
from ..events import SAME_TIME, ContactEvents, Contacts, active_contacts, resting
from ..protocol import Recording
from .build import build, silence
from .matrices import Matrices, matrices, resolve_impact, solve_constrained
from .options import ExudynOptions
from .read import Reader, Spring, Values, recording
from .solver import Balance, Solver, State, is_at

_WHOLE = 1e-6  # of a step: so near to a whole number of steps, it is one
_DIGITS = 1e-4  # of the largest torque: the rounding error of a spring's must be smaller
_RESOLVED = 1e-13  # [s] rounding of a torque over its slope
_MOST_PROBES = 12  # a torque is nearly linear within a step: four are enough
_HELD = 1e-9  # of the acceleration that it would have without stops: a gap that redundant stops hold has no less


@dataclass(frozen=True)
class Segment:
    """Motion with the same active contacts, and what follows from its end."""

    table: FloatArray
    """All sensors, the first and the last time included, shape (n, columns)."""
    state: State
    """At the end, after whatever happens there."""
    active: Contacts
    """Contacts that act from there on."""


def run(problem: Problem, options: ExudynOptions) -> Recording:
    """Simulate a problem.

    Raises:
        InputError: stops are to be springs under the unilateral law.
        UnsupportedProblemError: the mechanism cannot be built, or not from this start.
        SimulationError: Exudyn's solver gave up before the end, or impacts follow each other
            without an end.
    """
    once = problem.stop_law is StopLaw.RELEASE_ONCE
    if not once and options.stop_stiffness is not None:
        raise InputError(
            f"stop_stiffness = {options.stop_stiffness:g} must be left out under the unilateral law: exudyn's springs "
            f"are for stops that open once; its impacts are those of rigid stops."
        )
    with silence():
        return (_Motion if once else _UnilateralMotion)(problem, options).recording()


class _Motion:
    """Moves one problem under the release-once law."""

    def __init__(self, problem: Problem, options: ExudynOptions) -> None:
        self.mechanism = problem.mechanism
        self.duration = problem.duration
        self.options = options
        self.system = build(problem.mechanism, law=problem.stop_law)
        self.solver = Solver(self.system, options)
        self.events = ContactEvents(problem.mechanism, "exudyn")

    def recording(self) -> Recording:
        """Move from the start to the end, and read out."""
        state = self.solver.start()
        active = self._pushing(
            state, tuple(stop.name for stop in self.mechanism.stops if stop.closed)
        )
        if active and self.options.stop_stiffness is not None:
            self._replace_by_springs(state, active, self.options.stop_stiffness)
        tables: list[FloatArray] = []
        while not tables or not is_at(state.t, self.duration):
            segment = self._segment(state, active)
            tables.append(segment.table)
            state, active = segment.state, segment.active
        # At the time of an event the later segment has the forces of what acts from there on.
        table = np.concatenate([*(table[:-1] for table in tables[:-1]), tables[-1]])
        # Exudyn's sum of steps may end a rounding later, or earlier.
        table[:, 0] = np.minimum(table[:, 0], self.duration)
        table[-1, 0] = self.duration
        reader = Reader(self.system, self.solver.columns, table)
        return recording(reader, self._torques(reader), self.events, self.solver.steps)

    def _torques(self, reader: Reader) -> dict[str, FloatArray]:
        return {
            name: reader.torque(name, released) for name, released in self.events.releases.items()
        }

    def _replace_by_springs(self, state: State, active: Contacts, stiffness: float) -> None:
        """Go on with springs in place of the constraints that push at the start."""
        springs = _springs(self.solver, state, active, stiffness, self.options.stop_damping_ratio)
        self.system = build(self.mechanism, springs)
        self.solver = Solver(self.system, self.options)

    def _segment(self, state: State, active: Contacts) -> Segment:
        """Move to the next release or the end."""
        if not self.options.located_releases:
            return self._released_after_steps(state, active)

        def all_push(_: float) -> bool:
            return self._all_push(active)

        table = self.solver.run(
            state, active, self.duration, self._steps_from(state), all_push if active else None
        )
        if not active or self._all_push(active):
            return self._continued(table, active)
        release = self._first_release(table, active)
        return self._opened(*release, active) if release else self._continued(table, active)

    def _steps_from(self, state: State) -> int:
        return max(1, math.ceil((self.duration - state.t) / self.options.timestep - _WHOLE))

    def _continued(self, table: FloatArray, active: Contacts) -> Segment:
        return Segment(table, self.solver.state(table, -1), active)

    def _all_push(self, active: Contacts) -> bool:
        return all(self.system.torque(name) >= 0.0 for name in active)

    def _released_after_steps(self, state: State, active: Contacts) -> Segment:
        """Move to the end, switching a stop off after the step in which its torque fell below zero."""
        left = list(active)

        def release(time: float) -> bool:
            for name in [name for name in left if self.system.torque(name) < 0.0]:
                left.remove(name)
                self.events.release([name], time)
                self.system.set_active(tuple(left))
            return True

        table = self.solver.run(
            state, active, self.duration, self._steps_from(state), release if left else None
        )
        return self._continued(table, tuple(left))

    def _first_release(self, table: FloatArray, active: Contacts) -> tuple[FloatArray, str] | None:
        """A table whose last step went beyond a release, cut to end with steps onto it, and which stop opens there.

        None where only the error of the integrator's multiplier is negative: a run may go on from
        there, free of it.
        """
        row = self.solver.balance(self.solver.state(table, -1), active).row
        pulling = [name for name in active if self.solver.torque(row, name) < 0.0]
        releases = [(*self._onto_zero_torque(table, active, name), name) for name in pulling]
        _, earliest, name = min(
            releases, key=lambda release: release[0], default=(0.0, table, None)
        )
        return None if name is None else (earliest, name)

    def _opened(self, table: FloatArray, name: str, active: Contacts) -> Segment:
        """What follows where a stop opens at the end of a table."""
        state = self.solver.state(table, -1)
        self.events.release([name], state.t)
        return Segment(
            table, state, self._pushing(state, tuple(other for other in active if other != name))
        )

    def _onto_zero_torque(
        self, table: FloatArray, active: Contacts, name: str
    ) -> tuple[float, FloatArray]:
        """When the torque of a stop is zero, near the last step of a table [s], and a table up to there.

        The torque is that of the state, not the integrator's: a smooth function of the time, for
        the secant rule.
        """

        def torque(rows: FloatArray, row: int) -> float:
            return self.solver.torque(
                self.solver.balance(self.solver.state(rows, row), active).row, name
            )

        # Times as asked for: with adaptive steps a table may end a rounding beside them.
        times, values = [float(time) for time in table[-2:, 0]], [torque(table, len(table) - 2)]

        def secant(probe: FloatArray) -> float:
            values.append(torque(probe, -1))
            slope = (values[-1] - values[-2]) / (times[-1] - times[-2])
            times.append(
                min(times[-1] - values[-1] / slope if slope else times[-1], float(table[-1, 0]))
            )
            return times[-1]

        return self._onto(table, active, secant)

    def _onto(
        self, table: FloatArray, active: Contacts, next_guess: Callable[[FloatArray], float]
    ) -> tuple[float, FloatArray]:
        """When something happens near the last step of a table [s], and a table up to there.

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
            rows = self.solver.run(begin, active, end, last - first)
            probe = np.concatenate([table[: first + 1], rows[1:]])
        return float(probe[-1, 0]), probe

    def _pushing(self, state: State, touching: Contacts) -> Contacts:
        """Which of the touching stops push while the others open; those that open are released."""
        free = self.solver.balance(state, ())
        least = {name: -_HELD * abs(self._opening(name, free)) for name in touching}
        active = active_contacts(touching, lambda active: self._violated(state, least, active))
        self.events.release((name for name in touching if name not in active), state.t)
        return active

    def _violated(
        self, state: State, touching: Mapping[str, float], active: Contacts
    ) -> str | None:
        """The first of the touching stops that pulls, or closes with less than the acceleration given to it."""
        balance = self.solver.balance(state, active)
        for name, least in touching.items():
            if name not in active and self.system.springs:
                continue  # a preloaded spring releases with its gap open: how that moves then does not matter
            if (
                self.solver.torque(balance.row, name) < 0.0
                if name in active
                else self._opening(name, balance) < least
            ):
                return name
        return None

    def _opening(self, name: str, balance: Balance) -> float:
        """Acceleration of a stop's gap [rad/s^2, m/s^2]."""
        names = (body.name for body in self.mechanism.bodies)
        rotations = dict(zip(names, balance.accelerations[2::3].tolist(), strict=True))
        values = self.solver.values(balance.row)
        return self.system.constraints[name].gap_acceleration(values, rotations)


class _UnilateralMotion(_Motion):
    """Moves one problem whose stops may be met again."""

    def _segment(self, state: State, active: Contacts) -> Segment:
        """Move to the next release or impact, or to the end."""
        try:
            return self._to_next_event(state, active)
        except SimulationError as error:
            raise SimulationError(f"{error}{self._rebounds_within_a_step()}") from None

    def _to_next_event(self, state: State, active: Contacts) -> Segment:
        table = self.solver.run(
            state,
            active,
            self.duration,
            self._steps_from(state),
            lambda _: self._is_undisturbed(active),
        )
        opened = self._first_opened(table, active)
        times = [
            (*self._onto_zero_gap(table, active, name), name)
            for name in self._met(active, self._last(table))
        ]
        first, shortest, name = min(
            times, key=lambda event: event[0], default=(np.inf, table, None)
        )
        if opened and opened[0][-1, 0] < first:
            return self._opened(*opened, active)
        return (
            self._continued(table, active)
            if name is None
            else self._after_impact(shortest, active, name)
        )

    def _rebounds_within_a_step(self) -> str:
        """A sentence on the last two impacts where they are nearer to each other than a step is long, else ''."""
        times, step = [time for time, _ in self.events.impacts[-2:]], self.options.timestep
        if len(times) < 2 or times[1] - times[0] >= step:
            return ""
        return f" Its last two impacts are {times[1] - times[0]:.2g} s apart, within a time step of {step:.2g} s."

    def _first_opened(self, table: FloatArray, active: Contacts) -> tuple[FloatArray, str] | None:
        """The stop that opens in the last step of a table, if one does, and a table up to there."""
        pulling = (name for name in active if self.solver.torque(table[-1], name) < 0.0)
        name = next(pulling, None)
        if name is None or self.options.located_releases:
            return None if name is None else self._first_release(table, active)
        return table, name

    def _is_undisturbed(self, active: Contacts) -> bool:
        return self._all_push(active) and not self._met(active, self.system.now)

    def _met(self, active: Contacts, values: Values) -> list[str]:
        """Inactive stops in penetration that close; one that has just opened may penetrate by the drift it had."""
        return [
            name
            for name, stop in self.system.constraints.items()
            if name not in active and stop.gap(values) < 0.0 > stop.gap_speed(values)
        ]

    def _onto_zero_gap(
        self, table: FloatArray, active: Contacts, name: str
    ) -> tuple[float, FloatArray]:
        """When the gap of a stop is zero, in the last steps of a table [s], and a table up to there.

        Newton's iteration from the zero of a cubic through the gaps and speeds at both ends. After
        a rebound lower than a step is long the gap is zero at both of its ends, and the later one
        is the impact: from the far end Newton's iteration would only halve the way to it. Where the
        gap grows, on the wrong side of a turn, half way back.
        """
        stop, latest = self.system.constraints[name], float(table[-1, 0])

        def newton(probe: FloatArray) -> float:
            time, values = float(probe[-1, 0]), self._last(probe)
            speed = stop.gap_speed(values)
            cubic = self._zero_of_cubic(table, name) if probe is table else None
            return cubic or ((time + latest) / 2 if speed >= 0 else time - stop.gap(values) / speed)

        return self._onto(table, active, newton)

    def _zero_of_cubic(self, table: FloatArray, name: str) -> float | None:
        """The last time at which a cubic through a stop's gaps in the last steps of a table falls through zero [s]."""
        stop, rows = self.system.constraints[name], (table[max(len(table) - 3, 0)], table[-1])
        (g0, g1), (v0, v1) = (
            [measure(self.solver.values(row)) for row in rows]
            for measure in (stop.gap, stop.gap_speed)
        )
        begin, span = float(rows[0][0]), float(rows[1][0] - rows[0][0])
        polynomial = CubicHermiteSpline([0.0, span], [g0, g1], [v0, v1])
        falls = [zero for zero in polynomial.roots(extrapolate=False) if polynomial(zero, 1) < 0]
        return begin + float(falls[-1]) if falls else None

    def _last(self, table: FloatArray) -> Values:
        return self.solver.values(table[-1])

    def _after_impact(self, table: FloatArray, active: Contacts, name: str) -> Segment:
        """What follows where a stop is met at the end of a table."""
        state, values = self.solver.state(table, -1), self._last(table)
        reader = Reader(self.system, self.solver.columns, table[-1:])
        q, u = reader.coordinates()[0], reader.speeds()[0]
        touching = self.events.touching(state.t, name, active, self._gap_without_drift(name, q, u))
        restitution = self.events.restitution(self._gap_speeds(touching, values), q, u)
        after, impulses = resolve_impact(self.system, state, restitution)
        self.events.note_impact(state.t, impulses)
        return Segment(table, after, self._resting(after, touching))

    def _gap_without_drift(self, met: str, q: FloatArray, u: FloatArray) -> Callable[[str], float]:
        """Gap of a stop where that of another is zero, near a state, by the coordinates [rad, m].

        By the bodies' own positions the gaps of redundant stops differ by the joints' drift.
        """
        kinematics = Kinematics(self.mechanism)
        speed = float(kinematics.gap_jacobian(met, q) @ u)
        there = q - float(kinematics.gap(met, q)) / speed * u if speed < 0 else q
        return lambda name: float(kinematics.gap(name, there))

    def _resting(self, state: State, touching: Contacts) -> Contacts:
        """Of the stops that touch after an impact, those that neither part nor would have to pull."""
        values = self.solver.values(self.solver.balance(state, ()).row)
        rest = resting(self._gap_speeds(touching, values))
        self.events.release((name for name in touching if name not in rest), state.t)
        return self._pushing(state, rest)

    def _gap_speeds(self, names: Contacts, values: Values) -> dict[str, float]:
        return {name: self.system.constraints[name].gap_speed(values) for name in names}

    def _torques(self, reader: Reader) -> dict[str, FloatArray]:
        """Of all stops: the multiplier of one that is open is zero."""
        return {name: reader.torque(name, None) for name in self.events.releases}


def _springs(
    solver: Solver, state: State, active: Contacts, stiffness: float, damping_ratio: float
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
    """Refuse a stiffness that turns the rounding of angles or positions into a torque or force that matters."""
    mechanism, stop = solver.system.mechanism, solver.system.mechanism.stop(name)
    largest = max(
        t for other, t in torques.items() if mechanism.stop(other).force_unit == stop.force_unit
    )
    rounding = solver.system.constraints[name].rounding(solver.values(row))
    most = _DIGITS * largest / rounding
    if 0 < most < stiffness:
        unit, what = stop.force_unit, "angles" if stop.effort == "torque" else "a point's place"
        raise InputError(
            f"stop_stiffness = {stiffness:g} {unit}/{stop.gap_unit} would turn the rounding of {what} into a "
            f"{stop.effort} of {stiffness * rounding:.2g} {unit}, of {largest:.3g} {unit} in the stops; at most "
            f"{most:.2g} is resolved."
        )


def _inertia(state_matrices: Matrices, stop: str) -> float:
    """Torque (or force) on a stop's gap that opens it at 1 rad/s^2 (or 1 m/s^2), the others open [kg m^2, kg]."""
    joints, row = state_matrices.jacobian(()), state_matrices.stop_row(stop)
    opened, _ = solve_constrained(state_matrices.mass(), joints, row, np.zeros(len(joints)))
    return 1.0 / float(row @ opened)
