"""The reference motion by an adaptive Taylor integrator with event finding of its own.

heyoka (Biscani and Izzo, MNRAS 504 (2021) 2614) expands the motion into its Taylor series at every
step and finds releases, closings and the launch as roots of polynomials. What happens *at* an event
is decided by :mod:`..contact`, as for the DOP853 solver. heyoka is optional; it is imported, and a
structure of machine compiled, when first needed.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, cast

import numpy as np

from ...models.arrays import FloatArray
from ...models.errors import InputError, SimulationError
from ...models.functions import PointCoefficients
from ...models.launch import Launch, is_launch, lead
from ...models.problem import Problem
from ..contact import ActiveSet, EventFunction, PostEventState
from ..equations import Equations
from ..integrator import numerical
from ..reactions import refuse_dependent
from ..singular import RankWatch, Window
from ..solution import Segment, Solution
from ..solver import Event, EventFinder, first_events, releases
from .compiled import scalar_pool, torque_function
from .expressions import heyoka
from .numbers import (
    Real,
    RealType,
    numbers_of,
    projectile_row,
    relevant_stops,
    rests_of,
    structure_of,
)

_MAX_EVENTS = 10_000
_ROUNDING = 1e-12  # [rad] a gap this little off zero may be zero
_STANDING = 1e-9  # [rad/s] a gap speed below this is rounding
_CLEAR = 1e-13  # [rad] a gap this wide is clearly open
_DRIFT = 1e-10  # [rad] how far below zero a gap may be: active, or a rebound too small to follow
_OPENING = 1e-4  # [s] by then a gap that opens with the cube of time is some 1e-12 rad wide


def solve_taylor(
    problem: Problem, tolerance: float | None = None, precision: Precision = "double"
) -> Solution:
    """Integrate a problem with heyoka's adaptive Taylor integrator.

    Args:
        problem: any that :func:`..solver.solve` takes.
        tolerance: relative (or, for small states, absolute) local error; the precision's epsilon if
            left out, at which rounding is all that is left.
        precision: "extended" computes, and locates events, in 80-bit floats; the solution is read
            in doubles.

    Returns:
        A continuous solution; its `evaluations` are Taylor steps.

    Raises:
        EngineNotInstalledError: heyoka is not here.
        InputError: the tolerance or the precision is not usable.
        SimulationError: the motion left the finite numbers, or there are more than ten thousand
            events.
    """
    started = time.perf_counter()
    # Heyoka refuses a system that has no parameters: nothing moves the mechanism.
    with numerical("from the start"):
        run = _Integration(problem, tolerance, precision)
        run.integrate(record=True)
    return Solution(
        problem=problem,
        equations=run.equations,
        segments=tuple(run.segments),
        release_times=run.active_set.releases,
        impacts=tuple(run.active_set.impacts),
        rest_times=run.active_set.rest_times,
        evaluations=run.steps,
        settings={"taylor_tolerance": run.tolerance, "taylor_order": float(run.order)},
        wall_time=time.perf_counter() - started,
    )


@dataclass(frozen=True)
class TaylorQuantities:
    """A throw's figures in the precision of their computation."""

    precision: Precision
    release_times: Mapping[str, np.floating[Any] | None]
    """When each stop opened before the launch [s]."""
    start_torques: Mapping[str, np.floating[Any]]
    """Torque of each stop at the start [N m]."""
    launch_time: np.floating[Any] | None
    """[s]; None, as all below, if there is no launch within the duration."""
    launch_speed: np.floating[Any] | None
    """[m/s]"""
    launch_velocity: Real | None
    """[m/s], shape (2,)"""
    launch_q: Real | None
    """Shape (n_q,) [rad or m]."""
    launch_u: Real | None
    """Shape (n_q,) [rad/s or m/s]."""


def taylor_quantities(
    problem: Problem, precision: Precision = "extended", tolerance: float | None = None
) -> TaylorQuantities:
    """From the start to the launch, both releases and the launch located on the Taylor polynomials.

    Args:
        problem: its duration bounds the search for the launch; where there is none, the motion runs
        to its end.
        precision: of everything, parameters' products included ("extended": 80-bit floats).
        tolerance: local error; the precision's epsilon if left out.

    Raises:
        EngineNotInstalledError, InputError, SimulationError: as :func:`solve_taylor`.
    """
    run = _Integration(problem, tolerance, precision)
    run.integrate(to_launch=True)
    launch = run.launched
    velocity = None if launch is None else run.projectile_velocity(launch.q, launch.u)
    return TaylorQuantities(
        precision=precision,
        release_times=run.release_times,
        start_torques=run.start_torques(),
        launch_time=None if launch is None else launch.time,
        launch_speed=None if velocity is None else np.hypot(*velocity),
        launch_velocity=velocity,
        launch_q=None if launch is None else launch.q,
        launch_u=None if launch is None else launch.u,
    )


def taylor_launch(problem: Problem, tolerance: float | None = None) -> Launch | None:
    """The launch alone, as fast as it goes; None if there is none within the problem's duration.

    Raises:
        EngineNotInstalledError, InputError, SimulationError: as :func:`solve_taylor`.
    """
    run = _Integration(problem, tolerance, "double")
    run.integrate(to_launch=True)
    if run.launched is None:
        return None
    vx, vy = (float(v) for v in run.projectile_velocity(run.launched.q, run.launched.u))
    return Launch(float(run.launched.time), float(np.hypot(vx, vy)), (vx, vy))


@dataclass(frozen=True)
class _State:
    """Time, coordinates and speeds between two events, in the precision of the integrator."""

    time: np.floating[Any]
    q: Real
    u: Real


class _Integration:
    """The integration of one problem through its events."""

    def __init__(self, problem: Problem, tolerance: float | None, precision: str) -> None:
        self.real = real_of(precision)
        self.tolerance = checked_tolerance(tolerance, self.real)
        self.problem = problem
        self.equations = Equations(problem.mechanism)
        self.kinematics = self.equations.kinematics
        self.active_set = ActiveSet(problem, self.equations)
        self.n_q = len(problem.mechanism.coordinates)
        self.stops = relevant_stops(problem)
        numbers = numbers_of(problem, self.kinematics, self.real)
        self.structure = structure_of(problem, self.kinematics, numbers != 0)
        self.numbers = numbers[numbers != 0]
        self.projectile = projectile_row(problem.mechanism, self.kinematics)
        self.speed_scale = self.kinematics.speed_scale(self.projectile)
        self.rests = rests_of(problem.mechanism)
        self.release_times: dict[str, np.floating[Any] | None] = dict.fromkeys(
            self.active_set.releases
        )
        self.segments: list[Segment] = []
        self.launched: _State | None = None
        self.steps = self.order = 0
        self.last_crossing: tuple[PostEventState, Crossing] | None = None
        self.begun = self.active_set.begin()
        refuse_dependent(self.equations, self.begun.q, self.begun.closed, "the Taylor integrator")

    def integrate(self, record: bool = False, to_launch: bool = False) -> None:
        """Integrate to the end, or to the launch."""
        with scalar_pool(self.structure, self.tolerance, self.real).lend() as integrator:
            initial, n_events = self.begun, 0
            self._prepare(integrator, initial)
            while initial.t < self.problem.duration:
                self._switch(integrator, initial, to_launch)
                function = self._segment(integrator, initial, record)
                if function is None:
                    break
                initial = self._after(integrator, initial, function)
                if self.launched is not None:
                    break
                n_events += 1
                if n_events > _MAX_EVENTS:
                    raise SimulationError(
                        f"the reference met more than {_MAX_EVENTS} events by t = {initial.t:.6g} "
                        "s."
                    )

    def start_torques(self) -> dict[str, np.floating[Any]]:
        """Torque of every stop at the start [N m]."""
        torques: dict[str, np.floating[Any]] = {
            name: self.real(0) for name in self.active_set.releases
        }
        if self.stops:
            state = np.concatenate([self.begun.q, self.begun.u]).astype(self.real)
            parameters = self._parameters(self.begun)[: self.structure.active.stop]
            values = torque_function(self.structure, self.real)(state, pars=parameters)
            torques |= dict(zip(self.stops, values, strict=True))
        return torques

    def projectile_velocity(self, q: Real, u: Real) -> Real:
        """[m/s], shape (2,), in the precision of the state."""
        return cast(
            "Real",
            self.kinematics.velocity(self.projectile, cast("FloatArray", q), cast("FloatArray", u)),
        )

    def _parameters(self, initial: PostEventState) -> Real:
        structure = self.structure
        parameters = np.zeros(structure.n_parameters, dtype=self.real)
        parameters[: structure.n_numbers] = self.numbers
        parameters[structure.active] = [name in initial.closed for name in self.stops]
        watched = {
            function.stop
            for function in self.active_set.event_functions(initial)
            if function.closes
        }
        if structure.closes:
            parameters[structure.watched] = [name in watched for name in self.stops]
        return parameters

    def _prepare(self, integrator: Any, initial: PostEventState) -> None:
        integrator.time = self.real(initial.t)
        integrator.state[:] = np.concatenate([initial.q, initial.u, [0.0]])
        self.order = int(integrator.order)
        self._note_releases(integrator)

    def _switch(self, integrator: Any, initial: PostEventState, to_launch: bool) -> None:
        integrator.pars[:] = self._parameters(initial)[: len(integrator.pars)]
        if self.structure.throws:
            integrator.pars[self.structure.launch] = float(to_launch and self._is_free(initial))
        if integrator.with_events:
            integrator.reset_cooldowns()

    def _is_free(self, initial: PostEventState) -> bool:
        """Whether the projectile's own rests have all opened, and none of them pushes it now."""
        opened = all(self.active_set.releases[name] is not None for name in self.rests)
        return opened and not self.rests.intersection(initial.closed)

    def _segment(
        self, integrator: Any, initial: PostEventState, record: bool
    ) -> EventFunction | None:
        """Integrate under one active set, to its first event; None at the end or the launch."""
        if (standing := self._closes_at_once(initial)) is not None:
            return standing
        index = self._while_opening(integrator, initial, record)
        if index is None:
            index = self._step_to_event(integrator, initial, self.problem.duration, record)
        if index is None or index == len(self.stops):
            return None
        return self._event_function(initial, index)

    def _step_to_event(
        self, integrator: Any, initial: PostEventState, until: float, record: bool
    ) -> int | None:
        """Integrate to the first stop's event or the launch, and say which; None without one."""
        while True:
            start, crossing = float(integrator.time), self._crossing(initial)
            result = integrator.propagate_until(
                self.real(until), c_output=record, callback=crossing
            )
            self.steps += int(result[3])
            stopped = int(result[0]) == int(heyoka().taylor_outcome.cb_stop)
            index = None if stopped else self._event(integrator, int(result[0]))
            end = until if index is None and not stopped else float(integrator.time)
            if record and end > start:
                self._record(initial, start, end, result[4])
            if stopped and crossing is not None:
                index = self._cross(integrator, crossing, initial, until, record)
                if index is None and float(integrator.time) < until:
                    continue
            if index != len(self.stops) or self._is_launch(integrator):
                return index

    def _crossing(self, initial: PostEventState) -> Crossing | None:
        """Crossing of the active set after a state; None without loops, which may lose rank."""
        if not self.equations.n_loops:
            return None
        if self.last_crossing is None or self.last_crossing[0] is not initial:
            functions = self.active_set.event_functions(initial)
            finder = EventFinder(self.equations, initial, functions)
            self.last_crossing = initial, Crossing(self.equations, initial, finder)
        return self.last_crossing[1]

    def _cross(
        self,
        integrator: Any,
        crossing: Crossing,
        initial: PostEventState,
        until: float,
        record: bool,
    ) -> int | None:
        """Cross a singular position, to a stop's event there, and say which; None without one."""
        launches = self.structure.throws and integrator.pars[self.structure.launch]
        crossed = crossing.cross(integrator, until, self.projectile if launches else None)
        if crossed is None:
            return None
        window, events = crossed
        if record:
            self._record(initial, window.start, window.end, WindowOutput(window))
            self.segments[-1] = replace(
                self.segments[-1], windows=(*self.segments[-1].windows, window)
            )
        return self.stops.index(events[0].function.stop) if events else None

    def _record(self, initial: PostEventState, start: float, end: float, output: Any) -> None:
        last = self.segments[-1] if self.segments else None
        if last is not None and start > initial.t:  # the same active set goes on
            cast("TaylorOutput", last.interpolant).add(start, output)
            self.segments[-1] = replace(last, end=end)
        else:
            dense = TaylorOutput(start, output, self.real)
            self.segments.append(Segment(initial.closed, start, end, cast("Any", dense)))

    def _while_opening(self, integrator: Any, initial: PostEventState, record: bool) -> int | None:
        """Integrate intervals at whose ends alone gaps that open from zero are checked.

        Such a gap begins with a root (a triple one after a release) amid rounding, which no root
        finder resolves. One that stands still at zero is checked after ever longer intervals.
        """
        waiting = self._opening(initial)
        watched = integrator.pars[self.structure.watched]
        watched[list(waiting)] = 0.0
        while waiting and initial.t < self.problem.duration:
            k = min(waiting, key=lambda stop: waiting[stop])
            index = self._step_to_event(
                integrator, initial, min(initial.t + waiting[k], self.problem.duration), record
            )
            if index is not None:
                return index
            gap, speed = self._gap(self.stops[k], np.array(integrator.state, dtype=np.float64))
            if (
                abs(gap) <= _ROUNDING
                and abs(speed) <= _STANDING
                and float(integrator.time) < self.problem.duration
            ):
                waiting[k] *= 4
                continue
            del waiting[k]
            watched[k] = 1.0
            if gap < _CLEAR / 4 and speed < -_STANDING:  # it has come back, within rounding
                return k
        return None

    def _opening(self, initial: PostEventState) -> dict[int, float]:
        """Open stops whose gap is zero within rounding, and the time until each is clear [s]."""
        state = np.concatenate([initial.q, initial.u])
        gaps = {
            w.stop: self._gap(w.stop, state)
            for w in self.active_set.event_functions(initial)
            if w.closes
        }
        opening = {stop: (gap, v) for stop, (gap, v) in gaps.items() if -_DRIFT <= gap <= _ROUNDING}
        if not opening:
            return {}
        a = self.equations.solve(initial.q, initial.u, initial.closed)[0]
        clearing_times: dict[int, float] = {}
        for stop, (gap, speed) in opening.items():
            acceleration = float(
                self.kinematics.gap_jacobian(stop, initial.q) @ a
                + self.kinematics.gap_bias(stop, initial.q, initial.u)
            )
            clearing_times[self.stops.index(stop)] = _time_to_clear(
                _CLEAR + max(-gap, 0.0), speed, acceleration
            )
        return clearing_times

    def _gap(self, stop: str, state: FloatArray) -> tuple[float, float]:
        """Gap and gap speed of a stop [rad, rad/s]."""
        q, u = state[: self.n_q], state[self.n_q : 2 * self.n_q]
        return float(self.kinematics.gap(stop, q)), float(self.kinematics.gap_jacobian(stop, q) @ u)

    def _event(self, integrator: Any, outcome: int) -> int | None:
        """Which event function fell through zero; None at the time limit."""
        limit = int(heyoka().taylor_outcome.time_limit)
        if outcome < limit or not np.all(np.isfinite(integrator.state)):
            raise SimulationError(
                f"the reference's motion is not finite after t = {float(integrator.time):.6g} s."
            )
        return None if outcome == limit else -outcome - 1

    def _event_function(self, initial: PostEventState, index: int) -> EventFunction:
        return EventFunction(self.stops[index], closes=self.stops[index] not in initial.closed)

    def _closes_at_once(self, initial: PostEventState) -> EventFunction | None:
        """A gap that is zero within rounding and closing, which never falls through zero."""
        state = np.concatenate([initial.q, initial.u])
        for function in self.active_set.event_functions(initial):
            gap, speed = self._gap(function.stop, state)
            if function.closes and -_DRIFT <= gap <= 0 and speed < -_STANDING:
                return function
        return None

    def _is_launch(self, integrator: Any) -> bool:
        """Whether the velocity passes the launch direction itself, and not from rest."""
        state = integrator.state.copy()
        return self._launches(integrator, state[: self.n_q], state[self.n_q : 2 * self.n_q])

    def _launches(self, integrator: Any, q: Real, u: Real) -> bool:
        """Whether a state on the launch direction is a launch, which is then noted."""
        if not is_launch(
            cast("FloatArray", self.projectile_velocity(q, u)), scale=self.speed_scale
        ):
            return False
        self.launched = _State(self.real(integrator.time), q, u)
        return True

    def _after(
        self, integrator: Any, before: PostEventState, function: EventFunction
    ) -> PostEventState:
        """Let the active set decide, in doubles; only an impact's jump changes the state."""
        state = np.array(integrator.state, dtype=np.float64)
        q, u = state[: self.n_q], state[self.n_q : 2 * self.n_q]
        initial = self.active_set.after(float(integrator.time), q, u, before.closed, [function])
        if self.structure.throws and integrator.pars[self.structure.launch] and function.closes:
            self._jump(integrator, initial.u - u)
        integrator.state[self.n_q : 2 * self.n_q] += initial.u - u
        self._note_releases(integrator)
        return initial

    def _jump(self, integrator: Any, jump: FloatArray) -> None:
        """Note a launch where an impact turns the velocity through the launch direction."""
        state = integrator.state.copy()
        q, u = state[: self.n_q], state[self.n_q : 2 * self.n_q]
        before, after = (
            lead(cast("FloatArray", self.projectile_velocity(q, v))) for v in (u, u + jump)
        )
        if before > 0 > after and not any(
            self.active_set.impacts[-1][1].get(name, 0.0) > 0 for name in self.rests
        ):
            self._launches(integrator, q, u + jump * (before / (before - after)))

    def _note_releases(self, integrator: Any) -> None:
        for name, released in self.active_set.releases.items():
            if released is not None and self.release_times[name] is None:
                self.release_times[name] = self.real(integrator.time)


def _time_to_clear(height: float, speed: float, acceleration: float) -> float:
    """Time that a gap takes to `height` [rad], or to shut again before [s]."""
    if speed <= _STANDING:
        return _OPENING
    # Its top is lower than twice that.
    if acceleration < 0 and speed**2 < -4 * acceleration * height:
        return -2 * speed / acceleration
    return min(height / speed, _OPENING)


_SAMPLES = 33  # of a window, in search of a launch


class Crossing:
    """Watches the steps under one active set, and takes the motion across; a callback of heyoka's.

    Args:
        equations: of the mechanism.
        initial: state from which the active set holds.
        finder: of the events after it.
    """

    def __init__(self, equations: Equations, initial: PostEventState, finder: EventFinder) -> None:
        self.n_q = len(initial.q)
        self._watch = RankWatch(equations, initial.closed, initial.q)
        self._locate = finder.first
        self._kinematics = equations.kinematics

    def __call__(self, integrator: Any) -> bool:
        """Whether the integration may take another step."""
        q, u = self._state(integrator)
        return not self._watch.nears(q, u * float(integrator.last_h))

    def cross(
        self, integrator: Any, until: float, launched: PointCoefficients | None
    ) -> tuple[Window, list[Event]] | None:
        """Move the integrator across, to its first events or `until` [s]; None if it needs no help.

        Args:
            integrator: heyoka's, beside a singular position.
            until: [s].
            launched: the point whose launch is looked for, if it is.

        Raises:
            SimulationError: the speed does not tell the branch, a stop opens in the singular
                position, or the point is launched beside it, which is looked for on Taylor's
                polynomials alone.
        """
        window = self._watch.window_from(float(integrator.time), *self._state(integrator))
        if window is None:
            return None
        end, events = first_events(
            self._locate, window.dense_output(), window.start, min(window.end, until)
        )
        window = window.until(end, releases(events))
        if launched is not None and self._passes_launch(window, launched):
            raise SimulationError(
                "the Taylor integrator looks for no launch beside a singular position, from t = "
                f"{window.start:.6g} s to {window.end:.6g} s; DOP853 does."
            )
        q, u = self._watch.projected(*window.dense_output()(end).reshape(2, -1))
        integrator.time = type(integrator.time)(end)
        integrator.state[: 2 * self.n_q] = np.concatenate([q, u])
        return window, events

    def _passes_launch(self, window: Window, point: PointCoefficients) -> bool:
        states = window.dense_output()(np.linspace(window.start, window.end, _SAMPLES)).reshape(
            2, self.n_q, -1
        )
        leads = lead(self._kinematics.velocity(point, states[0].T, states[1].T))
        return bool(np.any((leads[1:] < 0) & (leads[:-1] >= 0)))

    def _state(self, integrator: Any) -> FloatArray:
        return np.array(integrator.state[: 2 * self.n_q], dtype=np.float64).reshape(2, -1)


class WindowOutput:
    """A window read as heyoka's continuous output, with the observer's unused column."""

    def __init__(self, window: Window) -> None:
        self._dense = window.dense_output()
        self.times = np.array([window.start, window.end])

    def __call__(self, t: FloatArray) -> FloatArray:
        """States (n, 2 n_q + 1) at times [s], shape (n,)."""
        times = np.asarray(t, dtype=np.float64)
        return np.column_stack([self._dense(times).T, np.zeros(len(times))])


class TaylorOutput:
    """heyoka's continuous output, called as SciPy's: times (n,) to states (2 n_q, n), doubles."""

    def __init__(self, start: float, output: Any, real: RealType) -> None:
        self._starts = [start]
        self._outputs = [output]
        self._real = real

    def add(self, start: float, output: Any) -> None:
        """Go on with another piece from `start` [s]."""
        self._starts.append(start)
        self._outputs.append(output)

    @property
    def ts(self) -> FloatArray:
        """Ends of the integrator's steps [s], as SciPy's solution has them."""
        return np.concatenate(
            [np.asarray(output.times, dtype=np.float64) for output in self._outputs]
        )

    def __call__(self, t: FloatArray) -> FloatArray:
        """States (2 n_q, n) at times [s], shape (n,); (2 n_q,) at one."""
        times = np.atleast_1d(np.asarray(t, dtype=self._real))
        of = np.searchsorted(self._starts[1:], times, side="right")
        pieces = [
            self._outputs[k](times[of == k])[:, :-1].T
            for k in range(len(self._outputs))
            if np.any(of == k)
        ]
        if len(pieces) == 1 and np.ndim(t) == 0:
            return np.array(pieces[0][:, 0], dtype=np.float64)
        states = np.empty((len(pieces[0]), len(times)))
        for k, piece in zip(np.unique(of), pieces, strict=True):
            states[:, of == k] = piece
        return states


Precision = Literal["double", "extended"]
_REALS: Mapping[str, RealType] = {"double": np.float64, "extended": np.longdouble}
_COARSEST = 1e-2


def real_of(precision: str) -> RealType:
    """The number type of a precision.

    Raises:
        InputError: there is none.
    """
    if precision not in _REALS:
        raise InputError(f"precision = {precision!r} is not one of 'double', 'extended'.")
    real = _REALS[precision]
    if precision == "extended" and np.finfo(real).eps >= np.finfo(np.float64).eps:
        raise InputError(
            "precision = 'extended' needs a machine whose long double is longer than a double."
        )
    return real


def checked_tolerance(tolerance: float | None, real: RealType) -> float:
    """A tolerance, or the number type's epsilon.

    Raises:
        InputError: it is less than that, or coarse.
    """
    least = float(np.finfo(real).eps)
    if tolerance is None:
        return least
    if not least <= tolerance <= _COARSEST:
        raise InputError(
            f"tolerance = {tolerance!r} is not between {least:.3g} (the precision's) and "
            f"{_COARSEST}."
        )
    return float(tolerance)
