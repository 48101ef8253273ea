"""One run of Exudyn's implicit solver: from a state, over equal steps, to a table of all sensors.

Positions and speeds alone carry the state from one run to the next: Exudyn finds accelerations and
multipliers from the equations of motion. So each run starts free of the alternating error that the
trapezoidal rule keeps in its multipliers, and the torque of a stop at a state depends on nothing
but the state.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, auto
from typing import Any, NoReturn

import numpy as np

from ...models.arrays import FloatArray
from ...models.errors import SimulationError
from ...models.kinematics import Kinematics, initial_state
from ...models.mechanism import Mechanism
from ..events import Contacts
from .loops import DEPENDENT, Conditioning, LoopConstraints, built_rows
from .options import ExudynOptions
from .read import BodyCoordinates, Reader, SensorKey, System, Values, coordinates, exu

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
# Redundant joints contradict each other by the drift of the positions, of the order of the
# truncation error, and no iteration gets below that. Just above it iterations end, with multipliers
# that spoil the steps after. So the drift is taken away, unless it was so a short time before: to
# begin anew costs as much as some sixty steps.
_SOON = 64  # steps
# [N, m/s] Residual that is small enough once a step has failed whose joints are redundant.
_CONTRADICTION = 1e-5
_JUMP = 0.2  # of the largest rotational speed: a leap that changes one more is on another branch
_SHORT = 1e-2  # of a step: the error of one so long, of third order, is 1e-6 of a step's
Monitor = Callable[[float], bool]
"""Called with the time after each step; False stops the run there."""


class _Outcome(Enum):
    """How some steps ended."""

    ARRIVED = auto()
    STOPPED = auto()
    """The monitor stopped the run."""
    INTERRUPTED = auto()
    """The run begins anew: loops are or were nearly dependent (:mod:`.loops`)."""
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
        self.system = system
        self.options = options
        self.steps = 0
        widths = [system.now(sensor).shape[1] for sensor in system.sensors]
        ends = np.cumsum([1, *widths]).tolist()
        self.columns: dict[SensorKey, slice] = {
            key: slice(a, b) for key, a, b in zip(system.sensors, ends[:-1], ends[1:], strict=True)
        }
        """Columns of each sensor in a table; column 0 is the time [s]."""
        self._dependent = _may_be_dependent(system.mechanism)
        self._redundant = _has_redundant_joints(system)
        self._residual = options.newton_absolute
        self._kinematics = Kinematics(system.mechanism)
        self._conditioning: Conditioning | None = None

    def start(self) -> BodyState:
        """The state as built."""
        rates = np.array(
            self.system.main.systemData.GetODE2Coordinates_t(exu.ConfigurationType.Initial)
        )
        return BodyState(0.0, np.zeros(len(rates)), rates)

    def state(self, table: FloatArray, row: int) -> BodyState:
        """The state in a row of a table."""
        coordinates = self.of_bodies(table[row], "Coordinates")
        rates = self.of_bodies(table[row], "Coordinates_t")
        return BodyState(float(table[row, 0]), coordinates, rates)

    def of_bodies(self, row: FloatArray, quantity: str) -> FloatArray:
        """A quantity of all nodes in a row of a table: x, y, rotation by body, (3 n_bodies,)."""
        return np.concatenate(
            [row[self.columns["body", b.name, quantity]] for b in self.system.mechanism.bodies]
        )

    def row(self, time: float) -> FloatArray:
        """All sensors now, as a row of a table."""
        return np.concatenate(
            [[time], *(self.system.now(sensor)[0] for sensor in self.system.sensors)]
        )

    def values(self, row: FloatArray) -> Values:
        """Values of the sensors in a row of a table."""
        return lambda sensor: row[None, self.columns[sensor]]

    def torque(self, row: FloatArray, stop: str) -> float:
        """Torque (or force) of an active stop in a row of a table [N m, N]."""
        return float(self.system.constraints[stop].torque(self.values(row))[0])

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
        self._conditioning = self._watched(active)
        table, outcome = self._equal_steps(state, active, end, steps, monitor)
        if outcome is _Outcome.FAILED and end - state.t < _SHORT * self.options.timestep:
            return self._explicit_step(state, active, end)
        failed = closed = -np.inf
        while outcome in (_Outcome.FAILED, _Outcome.INTERRUPTED):
            if outcome is _Outcome.INTERRUPTED:
                table, outcome = self._onwards(table, step, end, monitor)
                continue
            if self._redundant and self._residual < _CONTRADICTION:
                without_drift = None
                if self._conditioning and table[-1, 0] > closed + _SOON * step:
                    without_drift = self._without_drift(table)
                else:
                    self._residual = _CONTRADICTION
                closed = float(table[-1, 0])
                table, outcome = self._onwards(table, step, end, monitor, without_drift)
                continue
            if table[-1, 0] <= failed:
                self._give_up(table, end)
            failed = float(table[-1, 0])
            table, outcome = self._past_failure(table, step, end, monitor)
        return table

    def _equal_steps(
        self,
        state: BodyState,
        active: Contacts,
        end: float,
        steps: int,
        monitor: Monitor | None,
        iterations: int = _ITERATIONS,
    ) -> tuple[FloatArray, _Outcome]:
        """Table of the steps that succeeded, and how they ended."""
        balance = self.balance(state, active)
        self._set(state, balance.accelerations)
        settings = self._settings(state.t, end, steps)
        settings.timeIntegration.newton.maxIterations = iterations
        if self._conditioning:
            self._conditioning.begin(self._coordinates())
        finished, stopped = self._solve(settings, monitor)
        table = self._table()
        table[0] = balance.row  # with accelerations given, Exudyn's own first row has no forces
        self.steps += len(table) - 1
        last = float(table[-1, 0])
        if finished and stopped and last > state.t:
            return table, _Outcome.STOPPED
        if finished and is_at(last, end):
            return table, _Outcome.ARRIVED
        interrupted = finished and self._conditioning is not None and self._conditioning.is_due
        return table, _Outcome.INTERRUPTED if interrupted else _Outcome.FAILED

    def _explicit_step(self, state: BodyState, active: Contacts, end: float) -> FloatArray:
        """Table of one trapezoidal step with the accelerations at an explicit Euler step's end."""
        h, first = end - state.t, self.balance(state, active)
        coordinates = state.coordinates + h * (state.rates + h / 2 * first.accelerations)
        predicted = self.balance(
            BodyState(end, coordinates, state.rates + h * first.accelerations), active
        )
        rates = state.rates + h / 2 * (first.accelerations + predicted.accelerations)
        self.steps += 1
        return np.stack([first.row, self.balance(BodyState(end, coordinates, rates), active).row])

    def _watched(self, active: Contacts) -> Conditioning | None:
        """Monitor of the loops; generalised alpha needs none, as it damps the error."""
        if not self.system.mechanism.loop_joints or not self.options.integrator.startswith(
            "trapezoidal"
        ):
            return None
        return Conditioning(LoopConstraints(self._kinematics, active))

    def _coordinates(self) -> FloatArray:
        return coordinates(self.system.mechanism, self.system.now)[0]

    def _without_drift(self, table: FloatArray) -> BodyState:
        """Nearest state to that at the end of a table with loops and active stops closed."""
        state, reader = self.state(table, -1), Reader(self.system, self.columns, table[-1:])
        bodies, start = BodyCoordinates(self._kinematics), initial_state(self.system.mechanism)[0]
        constraints = LoopConstraints(self._kinematics, self.system.active)
        q, u = constraints.projected(reader.coordinates()[0], reader.speeds()[0])
        return BodyState(state.t, bodies.placed(q) - bodies.placed(start), bodies.jacobian(q) @ u)

    def _past_failure(
        self, table: FloatArray, step: float, end: float, monitor: Monitor | None
    ) -> tuple[FloatArray, _Outcome]:
        """A table without its last steps, with a longer step over the failure and equal ones."""
        table = table[: max(1, len(table) - _BACK)]
        state = self.state(table, -1)
        for length in self._leaps(table):
            leap, outcome = self._leap(state, min(state.t + length * step, end), monitor)
            if outcome is not _Outcome.FAILED:
                break
        else:
            self._give_up(table, end)
        table = np.concatenate([table[:-1], leap])
        if outcome is _Outcome.STOPPED or is_at(float(table[-1, 0]), end):
            return table, outcome
        return self._onwards(table, step, end, monitor)

    def _onwards(
        self,
        table: FloatArray,
        step: float,
        end: float,
        monitor: Monitor | None,
        now: BodyState | None = None,
    ) -> tuple[FloatArray, _Outcome]:
        """A table and equal steps after it, from `now` or the state at its end."""
        watch = self._conditioning
        if now is None:
            nears = watch is not None and watch.is_due and watch.has_neared
            now = self._without_drift(table) if nears else self.state(table, -1)
        rest, outcome = self._equal_steps(
            now, self.system.active, end, max(1, round((end - now.t) / step)), monitor
        )
        return np.concatenate([table[:-1], rest]), outcome

    def _leap(
        self, state: BodyState, until: float, monitor: Monitor | None
    ) -> tuple[FloatArray, _Outcome]:
        """One step, which fails also if the speeds jump: its end is on another branch then."""
        leap, outcome = self._equal_steps(
            state, self.system.active, until, 1, monitor, _LEAP_ITERATIONS
        )
        jump = np.abs(self.state(leap, -1).rates - state.rates)
        if jump[2::3].max() > _JUMP * np.abs(state.rates[2::3]).max():
            return leap, _Outcome.FAILED
        return leap, outcome

    def _leaps(self, table: FloatArray) -> tuple[float, ...]:
        """Lengths, in steps, of those in place of a failed one; only loops are singular."""
        if self.options.adaptive_step or not self.system.mechanism.loop_joints:
            return ()
        if self._conditioning is None:
            return _LEAPS
        reader = Reader(self.system, self.columns, table[-2:])
        ahead = self._conditioning.steps_ahead(reader.coordinates())
        longer = max(1.0, _BEYOND * ahead / _LEAPS[0]) if ahead < _FAR else 1.0
        return tuple(longer * leap for leap in _LEAPS)

    def _give_up(self, table: FloatArray, end: float) -> NoReturn:
        hint = "a shorter timestep may help"
        if self._redundant:
            hint = f"its joints are redundant, and contradict each other as they drift; {hint}"
        elif len(table) <= 1:
            hint = "the step is too long, or a position singular"
        solver = f"exudyn's {self.options.integrator} solver"
        raise SimulationError(
            f"{solver} gave up after t = {table[-1, 0]:.6g} s of {end:.6g} s; {hint}."
        )

    def _solve(self, settings: Any, monitor: Monitor | None) -> tuple[bool, bool]:
        """Whether Exudyn says it finished, and whether the monitor stopped it."""
        start, stopped = settings.timeIntegration.startTime, False

        def after_step(_: Any, time: float) -> bool:
            # Exudyn takes the missing value of a bare `return` for False, and ends the run without
            # a word.
            nonlocal stopped
            stopped = stopped or (monitor is not None and time > start and not monitor(time))
            interrupted = (
                conditioning is not None and time > start and conditioning.look(self._coordinates)
            )
            return not (stopped or interrupted)

        main, conditioning = self.system.main, self._conditioning
        main.SetPostStepUserFunction(after_step if monitor or conditioning else 0)
        settings.timeIntegration.generalizedAlpha.computeInitialAccelerations = False
        try:
            return bool(main.SolveDynamic(settings)), stopped
        except RuntimeError:
            return False, stopped
        finally:
            main.SetPostStepUserFunction(0)

    def _set(self, state: BodyState, accelerations: FloatArray | None = None) -> None:
        data, initial = self.system.main.systemData, exu.ConfigurationType.Initial
        data.SetODE2Coordinates(state.coordinates, initial)
        data.SetODE2Coordinates_t(state.rates, initial)
        if accelerations is not None:
            data.SetODE2Coordinates_tt(accelerations, initial)

    def _table(self) -> FloatArray:
        stored = [
            np.asarray(self.system.main.GetSensorStoredData(n))
            for n in self.system.sensors.values()
        ]
        return np.hstack([stored[0][:, :1], *(data[:, 1:] for data in stored)])

    def _settings(self, start: float, end: float, steps: int) -> Any:
        settings, options = exu.SimulationSettings(), self.options
        time, newton = settings.timeIntegration, settings.timeIntegration.newton
        time.startTime, time.endTime, time.numberOfSteps = start, end, steps
        time.adaptiveStep = options.adaptive_step
        time.generalizedAlpha.useNewmark = options.integrator.startswith("trapezoidal")
        time.generalizedAlpha.useIndex2Constraints = options.integrator.endswith("2")
        time.generalizedAlpha.spectralRadius = options.spectral_radius
        newton.useModifiedNewton = options.modified_newton
        newton.relativeTolerance, newton.absoluteTolerance = options.newton_relative, self._residual
        if self.system.springs:
            # The force of a stiff spring is known only to the rounding of an angle times its
            # stiffness, and would not fall further; the increments of the coordinates do. Exudyn
            # wants both tolerances alike for them.
            newton.residualMode, newton.absoluteTolerance = 1, options.newton_relative
        # A full-pivoting LU that leaves the multipliers out that it cannot tell.
        if self._dependent:
            settings.linearSolverType = exu.LinearSolverType.EigenDense
            settings.linearSolverSettings.ignoreSingularJacobian = True
        settings.solution.file.write = False
        settings.solution.sensors.writePeriod = _EVERY_STEP
        return settings


def _may_be_dependent(mechanism: Mechanism) -> bool:
    """Whether constraints may follow from others: of loops, or of redundant stops."""
    kinematics, (q, _) = Kinematics(mechanism), initial_state(mechanism)
    rows = [kinematics.gap_jacobian(stop.name, q) for stop in mechanism.stops if stop.closed]
    dependent = len(rows) > 1 and int(np.linalg.matrix_rank(np.array(rows), rtol=DEPENDENT)) < len(
        rows
    )
    return dependent or bool(mechanism.loop_joints)


def _has_redundant_joints(system: System) -> bool:
    """Whether conditions of the loops, as they are built, follow from others at the start."""
    rows = built_rows(
        Kinematics(system.mechanism), initial_state(system.mechanism)[0], system.left_out
    )
    return len(rows) > 0 and int(np.linalg.matrix_rank(rows, rtol=DEPENDENT)) < len(rows)


def is_at(time: float, end: float) -> bool:
    """Whether a run that is to end at a time has come there, as far as sums of steps can tell."""
    return abs(time - end) <= _SAME_TIME * max(1.0, end)
