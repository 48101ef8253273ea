"""One run of Exudyn's implicit solver: from a state, over equal steps, to a table of all sensors.

Positions and speeds alone carry the state from one run to the next: Exudyn finds accelerations and
multipliers from the equations of motion. So each run starts free of the alternating error that the
trapezoidal rule keeps in its multipliers, and the torque of a stop at a state depends on nothing
but the state.

Loops need more: in positions in which their constraints depend on each other two errors of the
trapezoidal rule of index 2 grow without bounds, with 1/s or 1/s^2 for the constraints' least
singular value s:

* The rule carries an error of the accelerations along the constraints on without damping, with the
  other sign after every step (its stability function is -1 at infinity); in the multipliers it is
  that error over s. Steps beside a singular position, where multipliers have poles, make it of any
  size. Accelerations and multipliers that follow from the state are free of it: behind such a
  position a run begins anew whenever s has doubled.
* Constraints hold speeds, and positions drift by d = O(h^2). A drifted loop has no singular
  position: its branches are those of a hyperbola, at a distance of sqrt(d) = O(h) from where they
  should cross, however short the step is. So the drift is taken away a few steps before the
  position. It is not taken away elsewhere: the rule's drift follows the accelerations and vanishes
  again with them, and what a projection takes away of a part of it does not.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum, auto
from typing import Any

import numpy as np

from ...models.arrays import FloatArray
from ...models.errors import SimulationError
from ...models.kinematics import Kinematics, initial_state
from ...models.mechanism import Mechanism
from ..events import Contacts, State
from .options import ExudynOptions
from .read import BodyCoordinates, System, Values, coordinates, exu

DEPENDENT = 1e-6
"""Singular value of a Jacobian, over its largest, below which constraints are dependent."""
_EVERY_STEP = 1e-12  # [s] the default is 0.01 s; this is below any step
_SAME_TIME = 1e-9  # of the run's last time: Exudyn adds up its steps
_DIFFERENCE = 3e-5  # relative step of Exudyn's difference quotients: 1e-6 to 1e-4 do as well

# Exudyn's Newton iteration leaves out how the joints' Jacobian changes with the step, which matters
# beside a singular position: a step of length h that ends at a distance x from one converges by h /
# 2 x an iteration, or not at all.
# As Exudyn has it; more would reach another branch of the motion where the right one repels.
_ITERATIONS = 25
# A leap goes over a singular position, to an end that is farther from it than the start: in steps;
# the shortest one in distances to the position, where that is nearer than _FAR steps.
_LEAPS = (5.0, 6.0, 8.0, 12.0)
_BEYOND, _FAR = 2.2, 50.0
_BACK = 2  # good steps that a leap takes back: the last ones were near the position as well
_LEAP_ITERATIONS = 200
_JUMP = 0.2  # of the largest rotational speed: a leap that changes one more is on another branch
# Redundant joints contradict each other by the drift of the positions, of the order of the
# truncation error, and no iteration gets below that. Just above it iterations end, with multipliers
# that spoil the steps after. So the drift is taken away, unless it was so a short time before: to
# begin anew costs as much as some sixty steps.
_SOON = 64  # steps
# [N, m/s] Residual that is small enough once a step has failed whose joints are redundant.
_CONTRADICTION = 1e-5
_SHORT = 1e-2  # of a step: the error of one so long, of third order, is 1e-6 of a step's

_GROWN = 2.0  # times: so much the least singular value grows until a run begins anew
# Steps to a singular position, between which the drift is taken away.
_FARTHEST, _NEAREST = 256.0, 4.0
_VANISHED = 0.1  # of the present singular value: what falls below that at this rate vanishes
_AHEAD = 0.25  # of the steps to a singular position at the present rate, until the next look
_LONGEST = 32  # steps without a look
_CORRECTIONS = 3

Monitor = Callable[[float], bool]
"""Called with the time after each step; False stops the run there."""


# --- Loops


class LoopConstraints:
    """Closures of the loops and gaps of active stops."""

    def __init__(self, kinematics: Kinematics, active: Contacts) -> None:
        self.kinematics, self.active = kinematics, active

    def jacobian(self, q: FloatArray) -> FloatArray:
        """Jacobian with respect to q, shape (n, n_q)."""
        stops = [self.kinematics.gap_jacobian(name, q)[None] for name in self.active]
        return np.concatenate([self.kinematics.loop_jacobian(q), *stops])

    def projected(self, q: FloatArray, u: FloatArray) -> State:
        """The nearest coordinates and speeds without drift."""
        for _ in range(_CORRECTIONS):
            gaps = [self.kinematics.gap(name, q) for name in self.active]
            residual = np.array([*self.kinematics.loop_residual(q), *gaps])
            q = q - np.linalg.pinv(self.jacobian(q), rcond=DEPENDENT) @ residual
        rows = self.jacobian(q)
        return q, u - np.linalg.pinv(rows, rcond=DEPENDENT) @ (rows @ u)


class Conditioning:
    """Monitor of the least singular value of constraints from step to step."""

    def __init__(self, constraints: LoopConstraints) -> None:
        self.constraints = constraints
        self.is_due = False
        """Whether the run should begin anew at the end of the step that was looked at last."""
        self.has_neared = False
        """Whether that is so because a singular position is ahead, and then without drift."""
        self._jacobian, self._rank = np.zeros((0, 0)), 0
        self._value = self._least = self._ahead = np.inf
        self._since, self._wait = 0, 1

    def begin(self, q: FloatArray) -> None:
        """Start at the coordinates where a run begins, shape (n_q,)."""
        self._jacobian = self.constraints.jacobian(q)
        values = np.linalg.svd(self._jacobian, compute_uv=False)
        self._rank = self._rank or int(np.sum(values > DEPENDENT * values[0]))
        self._value = self._least = float(values[self._rank - 1])
        self._since, self._wait, self.is_due = 0, 1, False

    def look(self, position: Callable[[], FloatArray]) -> bool:
        """Note one more step; whether the run should begin anew at its end.

        Args:
            position: gives the coordinates, which are seldom needed.
        """
        self._since += 1
        if self._since < self._wait:
            return False
        jacobian = self.constraints.jacobian(position())
        change, value = (jacobian - self._jacobian) / self._since, self._least_value(jacobian)
        fall = (self._value - value) / self._since
        self._value, self._least, self._jacobian = value, min(self._least, value), jacobian
        rate = float(np.linalg.norm(change, 2))  # no singular value changes faster
        self._since = 0
        self._wait = int(np.clip(_AHEAD * value / rate if rate else np.inf, 1, _LONGEST))
        # A singular position is near, for the first time or at half the last distance.
        self.has_neared = False
        ahead = value / fall if fall > 0 else np.inf
        if _NEAREST < ahead < min(_FARTHEST, self._ahead / 2):
            self.has_neared = self._least_value(jacobian + ahead * change) <= _VANISHED * value
        if self.has_neared:
            self._ahead = ahead
        is_left_behind = value > _GROWN * self._least
        if is_left_behind:
            self._ahead = np.inf
        self.is_due = self.has_neared or is_left_behind
        return self.is_due

    def steps_ahead(self, q: FloatArray) -> float:
        """Number of steps from the last of some equal ones to the next singular position.

        Args:
            q: coordinates at the end of each step, shape (n, n_q).
        """
        if len(q) < 2:
            return np.inf
        before, value = (self._least_value(self.constraints.jacobian(end)) for end in q[-2:])
        return value / (before - value) if value < before else np.inf

    def _least_value(self, jacobian: FloatArray) -> float:
        return float(np.linalg.svd(jacobian, compute_uv=False)[self._rank - 1])


# --- The solver


class _Outcome(Enum):
    """End of some steps."""

    ARRIVED = auto()
    STOPPED = auto()
    """The monitor stopped the run."""
    INTERRUPTED = auto()
    """The run begins anew: loops are or were nearly dependent."""
    FAILED = auto()


@dataclass(frozen=True)
class BodyState:
    """Displacements (x, y, rotation by body) from the reference and rates, (3 n_bodies,)."""

    t: float
    coordinates: FloatArray
    rates: FloatArray


@dataclass(frozen=True)
class Balance:
    """Solution of the equations of motion at a state."""

    row: FloatArray
    """All sensors: a row of a table."""
    accelerations: FloatArray
    """Second derivatives of Exudyn's coordinates [m/s^2, rad/s^2], shape (3 n_bodies,)."""


class Solver:
    """Runs a system and reads its sensors; `steps` counts the steps taken."""

    def __init__(self, system: System, options: ExudynOptions) -> None:
        self.system, self.mechanism, self.options = system, system.mechanism, options
        self.steps = 0
        self.columns = system.columns()
        self._kinematics = Kinematics(self.mechanism)
        self._start, _ = initial_state(self.mechanism)
        # Constraints of loops may follow from others, and so may those of several closed stops.
        closed = [stop.name for stop in self.mechanism.stops if stop.closed]
        gaps = np.array([self._kinematics.gap_jacobian(name, self._start) for name in closed])
        self._dependent = bool(self.mechanism.bound_by) or (
            len(gaps) > 1 and int(np.linalg.matrix_rank(gaps, rtol=DEPENDENT)) < len(gaps)
        )
        self._residual = options.newton_absolute
        self._conditioning: Conditioning | None = None
        self._monitor: Monitor | None = None

    def start(self) -> BodyState:
        """The state as built."""
        data, initial = self.system.main.systemData, exu.ConfigurationType.Initial
        rates = np.array(data.GetODE2Coordinates_t(initial))
        return BodyState(0.0, np.zeros(len(rates)), rates)

    # Rows of a table.

    def row(self, time: float) -> FloatArray:
        """Sensors now, as a row of a table."""
        sensors = (self.system.now(sensor)[0] for sensor in self.system.sensors)
        return np.concatenate([[time], *sensors])

    def values(self, row: FloatArray) -> Values:
        """Values of the sensors in a row of a table."""
        return lambda sensor: row[None, self.columns[sensor]]

    def of_bodies(self, row: FloatArray, quantity: str) -> FloatArray:
        """A quantity of all nodes in a row: x, y, rotation by body, shape (3 n_bodies,)."""
        names = (body.name for body in self.mechanism.bodies)
        return np.concatenate([row[self.columns["body", name, quantity]] for name in names])

    def state(self, row: FloatArray) -> BodyState:
        """Exudyn's state in a row."""
        displacements = self.of_bodies(row, "Coordinates")
        return BodyState(float(row[0]), displacements, self.of_bodies(row, "Coordinates_t"))

    def coordinates(self, row: FloatArray) -> State:
        """Coordinates and speeds of the mechanism in a row, each of shape (n_q,)."""
        values = self.values(row)
        q = coordinates(self.mechanism, values)[0]
        return q, coordinates(self.mechanism, values, speeds=True)[0]

    def torque(self, row: FloatArray, stop: str) -> float:
        """Torque (or force) of an active stop in a row [N m, N]."""
        return float(self.system.constraints[stop].torque(self.values(row))[0])

    # Equations of motion.

    def balance(self, state: BodyState, active: Contacts) -> Balance:
        """Sensors and accelerations at a state, under the joints and the active stops.

        Exudyn takes the constraints' second derivative from one-sided difference quotients, which
        leaves an error of 1e-4 N m in the torques at best; two of them, extrapolated to no
        difference at all, leave 1e-6.

        Raises:
            SimulationError: the constraints cannot be solved there.
        """
        self.system.set_active(active)
        self._set(state)
        once = self._differenced(state.t, _DIFFERENCE)
        twice = self._differenced(state.t, 2 * _DIFFERENCE)
        return Balance(2 * once.row - twice.row, 2 * once.accelerations - twice.accelerations)

    def _differenced(self, time: float, difference: float) -> Balance:
        settings = self._settings(time, time + self.options.timestep, 1)
        settings.timeIntegration.newton.numericalDifferentiation.relativeEpsilon = difference
        main, solver = self.system.main, exu.MainSolverImplicitSecondOrder()
        failure = f"exudyn finds no accelerations at t = {time:.6g} s: is the position singular?"
        try:
            # Exudyn solves for the accelerations here; where it fails those of the last state stay.
            solved = bool(solver.InitializeSolver(main, settings))
        except RuntimeError:  # of Exudyn's own; its text is a page
            raise SimulationError(failure) from None
        row = self.row(time)
        accelerations = np.array(main.systemData.GetODE2Coordinates_tt())
        if not (solved and np.isfinite(accelerations).all()):
            raise SimulationError(failure)
        solver.FinalizeSolver(main, settings)
        return Balance(row, accelerations)

    def _set(self, state: BodyState) -> None:
        data, initial = self.system.main.systemData, exu.ConfigurationType.Initial
        data.SetODE2Coordinates(state.coordinates, initial)
        data.SetODE2Coordinates_t(state.rates, initial)
        if self.system.limits:  # whether they act
            data.SetDataCoordinates(data.GetDataCoordinates(), initial)

    # Steps.

    def run(
        self,
        state: BodyState,
        active: Contacts,
        end: float,
        steps: int,
        monitor: Monitor | None = None,
    ) -> FloatArray:
        """Table of all sensors at the start and after each step, shape (n, columns).

        A step that ends too near to a singular position of a loop fails; a longer one over the
        position takes its place, unless Exudyn is to shorten steps by itself. Where joints are
        redundant, their drift is taken away first; if a step fails soon after that, a larger
        residual is small enough from then on. Between events that follow each other closely
        Newton's iteration may end at the rounding of the accelerations over the step, above its
        tolerance; there the trapezoidal rule is applied explicitly.

        Args:
            state: where to start.
            active: stops that act.
            end: time of the last step's end [s].
            steps: number of equal steps.
            monitor: called after every step.

        Raises:
            SimulationError: a step failed, or the end was not reached although the monitor did not
                stop the run.
        """
        step = (end - state.t) / steps
        self._monitor, self._conditioning = monitor, None
        # Generalised alpha needs no monitor of the loops, as it damps the error.
        trapezoidal = self.options.rule(self.mechanism).startswith("trapezoidal")
        if self.options.restarts and self.mechanism.bound_by and trapezoidal:
            self._conditioning = Conditioning(LoopConstraints(self._kinematics, active))
        table, outcome = self._equal_steps(state, active, end, steps)
        if outcome is _Outcome.FAILED and end - state.t < _SHORT * self.options.timestep:
            return self._explicit_step(state, active, end)
        if outcome is _Outcome.FAILED and not self.options.restarts:
            raise self._failure(table, end)
        failed = projected = -np.inf
        while outcome in (_Outcome.FAILED, _Outcome.INTERRUPTED):
            last, drifts = float(table[-1, 0]), False
            if outcome is _Outcome.FAILED:
                if self.system.redundant and self._residual < _CONTRADICTION:
                    drifts = self._conditioning is not None and last > projected + _SOON * step
                    if not drifts:
                        self._residual = _CONTRADICTION
                    projected = last
                elif last <= failed:
                    raise self._failure(table, end)
                else:
                    failed = last
                    table, outcome = self._leap(table, step, end)
                    if outcome is _Outcome.STOPPED or is_at(float(table[-1, 0]), end):
                        break
            # Begin anew at the end of the table.
            watch, now = self._conditioning, self.state(table[-1])
            if drifts or (watch is not None and watch.is_due and watch.has_neared):
                now = self._without_drift(now, table[-1])
            left = max(1, round((end - now.t) / step))
            rest, outcome = self._equal_steps(now, self.system.active, end, left)
            table = np.concatenate([table[:-1], rest])
        return table

    def _equal_steps(
        self,
        state: BodyState,
        active: Contacts,
        end: float,
        steps: int,
        iterations: int = _ITERATIONS,
    ) -> tuple[FloatArray, _Outcome]:
        """Table of the steps that succeeded, and how they ended."""
        settings = self._settings(state.t, end, steps)
        settings.timeIntegration.newton.maxIterations = iterations
        balance: Balance | None = None
        if self.options.start_accelerations:
            balance = self.balance(state, active)
            data, initial = self.system.main.systemData, exu.ConfigurationType.Initial
            data.SetODE2Coordinates_tt(balance.accelerations, initial)
            settings.timeIntegration.generalizedAlpha.computeInitialAccelerations = False
        self.system.set_active(active)
        self._set(state)
        if self._conditioning:
            self._conditioning.begin(self._position())
        finished, stopped = self._solve(settings)
        table = self.system.stored()
        if balance is not None:
            table[0] = balance.row  # with accelerations given, Exudyn's own has no forces
        self.steps += len(table) - 1
        last = float(table[-1, 0])
        if finished and stopped and last > state.t:
            return table, _Outcome.STOPPED
        if finished and is_at(last, end):
            return table, _Outcome.ARRIVED
        interrupted = finished and self._conditioning is not None and self._conditioning.is_due
        return table, _Outcome.INTERRUPTED if interrupted else _Outcome.FAILED

    def _solve(self, settings: Any) -> tuple[bool, bool]:
        """Tell whether Exudyn says it finished, and whether the monitor stopped it."""
        start, stopped = settings.timeIntegration.startTime, False
        main, monitor, conditioning = self.system.main, self._monitor, self._conditioning

        def after_step(_: Any, time: float) -> bool:
            # Exudyn takes the missing value of a bare `return` for False, and ends the run without
            # a word.
            nonlocal stopped
            if time <= start:
                return not stopped
            stopped = stopped or (monitor is not None and not monitor(time))
            interrupted = conditioning is not None and conditioning.look(self._position)
            return not (stopped or interrupted)

        main.SetPostStepUserFunction(after_step if monitor or conditioning else 0)
        try:
            return bool(main.SolveDynamic(settings)), stopped
        except RuntimeError:
            return False, stopped
        finally:
            main.SetPostStepUserFunction(0)

    def _position(self) -> FloatArray:
        return coordinates(self.mechanism, self.system.now)[0]

    def _explicit_step(self, state: BodyState, active: Contacts, end: float) -> FloatArray:
        """Table of one trapezoidal step with the accelerations at an explicit Euler step's end."""
        h, first = end - state.t, self.balance(state, active)
        displacements = state.coordinates + h * (state.rates + h / 2 * first.accelerations)
        euler = BodyState(end, displacements, state.rates + h * first.accelerations)
        both = first.accelerations + self.balance(euler, active).accelerations
        after = BodyState(end, displacements, state.rates + h / 2 * both)
        self.steps += 1
        return np.stack([first.row, self.balance(after, active).row])

    def _without_drift(self, state: BodyState, row: FloatArray) -> BodyState:
        """Nearest state to that in a row with loops and active stops closed."""
        constraints = LoopConstraints(self._kinematics, self.system.active)
        q, u = constraints.projected(*self.coordinates(row))
        bodies = BodyCoordinates(self._kinematics)
        displacements = bodies.placed(q) - bodies.placed(self._start)
        return BodyState(state.t, displacements, bodies.jacobian(q) @ u)

    def _leap(self, table: FloatArray, step: float, end: float) -> tuple[FloatArray, _Outcome]:
        """A table with a longer step over the position where one failed, and how that ended."""
        table = table[: max(1, len(table) - _BACK)]
        state, longer = self.state(table[-1]), 1.0
        if self._conditioning is not None:
            q = coordinates(self.mechanism, lambda sensor: table[-2:, self.columns[sensor]])
            ahead = self._conditioning.steps_ahead(q)
            if ahead < _FAR:
                longer = max(1.0, _BEYOND * ahead / _LEAPS[0])
        only_loops_are_singular = self.mechanism.bound_by and not self.options.adaptive_step
        for length in _LEAPS if only_loops_are_singular else ():
            until = min(state.t + longer * length * step, end)
            active = self.system.active
            leap, outcome = self._equal_steps(state, active, until, 1, _LEAP_ITERATIONS)
            # If speeds jump, its end is on another branch of the motion.
            jump = np.abs(self.state(leap[-1]).rates - state.rates)[2::3].max()
            jumps = jump > _JUMP * np.abs(state.rates[2::3]).max()
            if outcome is not _Outcome.FAILED and not jumps:
                return np.concatenate([table[:-1], leap]), outcome
        raise self._failure(table, end)

    def _failure(self, table: FloatArray, end: float) -> SimulationError:
        hint = "a shorter timestep may help"
        if self.system.redundant:
            hint = f"its joints are redundant, and contradict each other as they drift; {hint}"
        elif len(table) <= 1:
            hint = "the step is too long, or a position singular"
        rule = self.options.rule(self.mechanism)
        return SimulationError(
            f"exudyn's {rule} solver gave up after t = {table[-1, 0]:.6g} s of {end:.6g} s; {hint}."
        )

    def _settings(self, start: float, end: float, steps: int) -> Any:
        dependent = self._dependent and self.options.ignore_singular
        changes = numerics(self.options, self.mechanism, dependent=dependent)
        settings = changed_settings(changes)
        time, newton = settings.timeIntegration, settings.timeIntegration.newton
        time.startTime, time.endTime, time.numberOfSteps = start, end, steps
        newton.absoluteTolerance = self._residual
        if self.system.springs:
            # The force of a stiff spring is known only to the rounding of an angle times its
            # stiffness, and would not fall further; the increments of the coordinates do. Exudyn
            # wants both tolerances alike for them.
            newton.residualMode, newton.absoluteTolerance = 1, self.options.newton_relative
        return settings


def numerics(options: ExudynOptions, mechanism: Mechanism, *, dependent: bool) -> dict[str, object]:
    """Fields of Exudyn's SimulationSettings that follow from options, and those of a silent run.

    Args:
        options: numerical options.
        mechanism: what is to be moved.
        dependent: whether multipliers are left out that constraints do not determine, by an LU
            decomposition with full pivoting.
    """
    rule = options.rule(mechanism)
    fields: dict[str, object] = {
        "timeIntegration.generalizedAlpha.useNewmark": rule.startswith("trapezoidal"),
        "timeIntegration.generalizedAlpha.useIndex2Constraints": rule.endswith("2"),
        "timeIntegration.generalizedAlpha.spectralRadius": options.spectral_radius,
        "timeIntegration.adaptiveStep": options.adaptive_step,
        "timeIntegration.minimumStepSize": options.minimum_step,
        "timeIntegration.newton.useModifiedNewton": options.modified_newton,
        "timeIntegration.newton.relativeTolerance": options.newton_relative,
        "timeIntegration.newton.absoluteTolerance": options.newton_absolute,
        "solution.file.write": False,
        "solution.sensors.writePeriod": _EVERY_STEP,
    }
    if dependent:
        fields["linearSolver.solverType"] = exu.LinearSolverType.EigenDense
        fields["linearSolver.ignoreSingularJacobian"] = True
    return fields


def changed_settings(fields: Mapping[str, object]) -> Any:
    """Exudyn's SimulationSettings with some fields changed, each named by its path."""
    settings = exu.SimulationSettings()
    for path, value in fields.items():
        *parts, name = path.split(".")
        owner = settings
        for part in parts:
            owner = getattr(owner, part)
        setattr(owner, name, value)
    return settings


def is_at(time: float, end: float) -> bool:
    """Tell whether a run has come to its end, to the rounding of sums of steps."""
    return abs(time - end) <= _SAME_TIME * max(1.0, end)
