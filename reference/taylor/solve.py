"""The reference motion by an adaptive Taylor integrator with event finding of its own.

heyoka (Biscani and Izzo, MNRAS 504 (2021) 2614) expands the motion into its Taylor series at every
step and finds releases, closings and the launch as roots of polynomials. What happens *at* an event
is decided by :mod:`..contact`, as for the DOP853 solver. heyoka is optional; it is imported, and a
structure of machine compiled, when first needed.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
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
from .expressions import heyoka, scalar_pool, torque_function
from .numbers import (
    Real,
    RealType,
    numbers_of,
    projectile_row,
    relevant_stops,
    rests_of,
    structure_of,
)

Precision = Literal["double", "extended"]
_REALS: Mapping[str, RealType] = {"double": np.float64, "extended": np.longdouble}
_COARSEST = 1e-2  # tolerance
_MAX_EVENTS = 10_000
_ROUNDING = 1e-12  # [rad] a gap this little off zero may be zero
_STANDING = 1e-9  # [rad/s] a gap speed below this is rounding
_CLEAR = 1e-13  # [rad] a gap this wide is clearly open
_DRIFT = 1e-10  # [rad] how far below zero a gap may be: active, or a rebound too small to follow
_OPENING = 1e-4  # [s] by then a gap that opens with the cube of time is some 1e-12 rad wide
_SAMPLES = 33  # of a window across a singular position, in search of a launch


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
    """A throw's figures in the precision of their computation; None if it does not launch."""

    precision: Precision
    release_times: Mapping[str, np.floating[Any] | None]
    """When each stop opened before the launch [s]."""
    start_torques: Mapping[str, np.floating[Any]]  # torque of each stop at the start [N m]
    launch_time: np.floating[Any] | None = None  # [s]
    launch_speed: np.floating[Any] | None = None  # [m/s]
    launch_velocity: Real | None = None  # [m/s], shape (2,)
    launch_q: Real | None = None
    launch_u: Real | None = None
    """Shape (n_q,) [rad, m, rad/s, m/s]."""

    @property
    def launch(self) -> Launch | None:
        """The launch in double precision; None without one."""
        if self.launch_time is None or self.launch_velocity is None:
            return None
        vx, vy = (float(v) for v in self.launch_velocity)
        return Launch(float(self.launch_time), float(np.hypot(vx, vy)), (vx, vy))


def taylor_quantities(
    problem: Problem, precision: Precision = "extended", tolerance: float | None = None
) -> TaylorQuantities:
    """Solve from the start to the launch; events are located on the Taylor polynomials.

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
    start = TaylorQuantities(precision, run.release_times, run.start_torques())
    if run.launched is None:
        return start
    launch_time, q, u = run.launched
    velocity = run.projectile_velocity(q, u)
    return replace(
        start,
        launch_time=launch_time,
        launch_speed=np.hypot(*velocity),
        launch_velocity=velocity,
        launch_q=q,
        launch_u=u,
    )


class _Integration:
    """The integration of one problem through its events."""

    def __init__(self, problem: Problem, tolerance: float | None, precision: str) -> None:
        if precision not in _REALS:
            raise InputError(f"precision = {precision!r} is not one of 'double', 'extended'.")
        self.real = _REALS[precision]
        least = float(np.finfo(self.real).eps)
        if precision == "extended" and least >= np.finfo(np.float64).eps:
            raise InputError(
                "precision = 'extended' needs a machine whose long double is longer than a double."
            )
        self.tolerance = least if tolerance is None else float(tolerance)
        if not least <= self.tolerance <= _COARSEST:
            raise InputError(
                f"tolerance = {tolerance!r} is not between {least:.3g} (the precision's) and "
                f"{_COARSEST}."
            )
        mechanism = problem.mechanism
        self.problem = problem
        self.equations = Equations(mechanism)
        self.kinematics = self.equations.kinematics
        self.active_set = ActiveSet(problem, self.equations)
        self.n_q = len(mechanism.coordinates)
        self.stops = relevant_stops(problem)
        numbers = numbers_of(problem, self.kinematics, self.real)
        self.structure = structure_of(problem, self.kinematics, numbers != 0)
        self.numbers = numbers[numbers != 0]
        self.projectile = projectile_row(mechanism, self.kinematics)
        self.speed_scale = self.kinematics.speed_scale(self.projectile)
        self.rests = rests_of(mechanism)
        self.release_times: dict[str, np.floating[Any] | None]
        self.release_times = dict.fromkeys(self.active_set.releases)
        self.segments: list[Segment] = []
        self.launched: tuple[np.floating[Any], Real, Real] | None = None
        """Time, q and u of the launch, in the precision of the integrator."""
        self.steps = self.order = 0
        self.begun = self.initial = self.active_set.begin()
        refuse_dependent(self.equations, self.begun.q, self.begun.closed, "the Taylor integrator")

    def integrate(self, record: bool = False, to_launch: bool = False) -> None:
        """Integrate to the end, or to the launch."""
        structure, n_events = self.structure, 0
        with scalar_pool(structure, self.tolerance, self.real).lend() as integrator:
            self.integrator, self.recorded = integrator, record
            integrator.time = self.real(self.initial.t)
            integrator.state[:] = np.concatenate([self.initial.q, self.initial.u, [0.0]])
            self.order = int(integrator.order)
            self._note_releases()
            while self.initial.t < self.problem.duration:
                integrator.pars[:] = self._parameters(self.initial)[: len(integrator.pars)]
                if structure.throws:
                    # The projectile's own rests have all opened, and none of them pushes it now.
                    opened = all(self.active_set.releases[name] is not None for name in self.rests)
                    free = opened and not self.rests.intersection(self.initial.closed)
                    integrator.pars[structure.launch] = float(to_launch and free)
                if integrator.with_events:
                    integrator.reset_cooldowns()
                stop = self._next_stop()
                if stop is None:
                    break
                self._pass_event(stop)
                if self.launched is not None:
                    break
                n_events += 1
                if n_events > _MAX_EVENTS:
                    raise SimulationError(
                        f"the reference met more than {_MAX_EVENTS} events by t = "
                        f"{self.initial.t:.6g} s."
                    )

    def start_torques(self) -> dict[str, np.floating[Any]]:
        """Torque of every stop at the start [N m]."""
        torques: dict[str, np.floating[Any]]
        torques = {name: self.real(0) for name in self.active_set.releases}
        if self.stops:
            state = np.concatenate([self.begun.q, self.begun.u]).astype(self.real)
            parameters = self._parameters(self.begun)[: self.structure.active.stop]
            values = torque_function(self.structure, self.real)(state, pars=parameters)
            torques |= dict(zip(self.stops, values, strict=True))
        return torques

    def projectile_velocity(self, q: Real, u: Real) -> Real:
        """[m/s], shape (2,), in the precision of the state."""
        q, u = cast("FloatArray", q), cast("FloatArray", u)
        return cast("Real", self.kinematics.velocity(self.projectile, q, u))

    @property
    def _time(self) -> float:
        return float(self.integrator.time)

    def _parameters(self, initial: PostEventState) -> Real:
        structure = self.structure
        parameters = np.zeros(structure.n_parameters, dtype=self.real)
        parameters[: structure.n_numbers] = self.numbers
        parameters[structure.active] = [name in initial.closed for name in self.stops]
        if structure.closes:
            functions = self.active_set.event_functions(initial)
            watched = {function.stop for function in functions if function.closes}
            parameters[structure.watched] = [name in watched for name in self.stops]
        return parameters

    def _next_stop(self) -> str | None:
        """Integrate under one active set to the first stop's event; None: the end or the launch."""
        initial = self.initial
        for function in self.active_set.event_functions(initial):
            # A gap that is zero within rounding and closing never falls through zero.
            gap, speed = self._gap(function.stop, initial.q, initial.u)
            if function.closes and -_DRIFT <= gap <= 0 and speed < -_STANDING:
                return function.stop
        self.crossing = None if not self.equations.n_loops else _Crossing(self)
        index = self._while_opening()
        if index is None:
            index = self._step_to_event(self.problem.duration)
        return None if index is None or index == len(self.stops) else self.stops[index]

    def _step_to_event(self, until: float) -> int | None:
        """Integrate to the first stop's event or the launch, and say which; None without one."""
        integrator, outcomes = self.integrator, heyoka().taylor_outcome
        while True:
            start, index = self._time, None
            result = integrator.propagate_until(
                self.real(until), c_output=self.recorded, callback=self.crossing
            )
            outcome, output = int(result[0]), result[4]
            self.steps += int(result[3])
            stopped = outcome == int(outcomes.cb_stop)
            if not stopped:
                limit = int(outcomes.time_limit)
                if outcome < limit or not np.all(np.isfinite(integrator.state)):
                    raise SimulationError(
                        f"the reference's motion is not finite after t = {self._time:.6g} s."
                    )
                index = None if outcome == limit else -outcome - 1
            end = until if index is None and not stopped else self._time
            if self.recorded and end > start:

                def states(times: FloatArray, output: Any = output) -> FloatArray:
                    return output(times)[:, :-1].T  # without the observer

                self._record(start, end, output.times, states)
            if stopped and self.crossing is not None:
                index = self._cross(self.crossing, until)
                if index is None and self._time < until:
                    continue
            state = integrator.state.copy()
            if index != len(self.stops) or self._note_launch(
                state[: self.n_q], state[self.n_q : 2 * self.n_q]
            ):
                return index

    def _cross(self, crossing: _Crossing, until: float) -> int | None:
        """Cross a singular position, to a stop's event there, and say which; None without one."""
        launches = self.structure.throws and self.integrator.pars[self.structure.launch]
        crossed = crossing.cross(self.integrator, until, self.projectile if launches else None)
        if crossed is None:
            return None
        window, events = crossed
        if self.recorded:
            dense = window.dense_output()

            def states(times: FloatArray) -> FloatArray:
                return np.asarray(dense(np.asarray(times, dtype=np.float64)))

            self._record(window.start, window.end, [window.start, window.end], states)
            last = self.segments[-1]
            self.segments[-1] = replace(last, windows=(*last.windows, window))
        return self.stops.index(events[0].function.stop) if events else None

    def _record(
        self, start: float, end: float, times: Any, states: Callable[[FloatArray], FloatArray]
    ) -> None:
        if self.segments and start > self.initial.t:  # the same active set goes on
            dense = cast("_TaylorOutput", self.segments[-1].interpolant)
            self.segments[-1] = replace(self.segments[-1], end=end)
        else:
            dense = _TaylorOutput(2 * self.n_q, self.real)
            held = self.equations, self.initial.closed
            self.segments.append(Segment(*held, start, end, cast("Any", dense)))
        dense.add(start, times, states)

    def _while_opening(self) -> int | None:
        """Integrate intervals at whose ends alone gaps that open from zero are checked.

        Such a gap begins with a root (a triple one after a release) amid rounding, which no root
        finder resolves. One that stands still at zero is checked after ever longer intervals.
        """
        duration = self.problem.duration
        waiting = self._clearing_times()
        watched = self.integrator.pars[self.structure.watched]
        watched[list(waiting)] = 0.0
        while waiting and self.initial.t < duration:
            k = min(waiting, key=lambda stop: waiting[stop])
            index = self._step_to_event(min(self.initial.t + waiting[k], duration))
            if index is not None:
                return index
            state = np.array(self.integrator.state, dtype=np.float64)
            gap, speed = self._gap(self.stops[k], state[: self.n_q], state[self.n_q : 2 * self.n_q])
            if abs(gap) <= _ROUNDING and abs(speed) <= _STANDING and self._time < duration:
                waiting[k] *= 4
                continue
            del waiting[k]
            watched[k] = 1.0
            if gap < _CLEAR / 4 and speed < -_STANDING:  # it has come back, within rounding
                return k
        return None

    def _clearing_times(self) -> dict[int, float]:
        """Open stops whose gap is zero within rounding, and the time until each is clear [s]."""
        initial, kinematics = self.initial, self.kinematics
        opening: dict[str, tuple[float, float]] = {}
        for function in self.active_set.event_functions(initial):
            gap, speed = self._gap(function.stop, initial.q, initial.u)
            if function.closes and -_DRIFT <= gap <= _ROUNDING:
                opening[function.stop] = gap, speed
        if not opening:
            return {}
        a = self.equations.solve(initial.q, initial.u, initial.closed)[0]
        times: dict[int, float] = {}
        for stop, (gap, speed) in opening.items():
            row, bias = kinematics.gap_jacobian, kinematics.gap_bias
            acceleration = float(row(stop, initial.q) @ a + bias(stop, initial.q, initial.u))
            height = _CLEAR + max(-gap, 0.0)
            if speed <= _STANDING:
                clear = _OPENING
            elif acceleration < 0 and speed**2 < -4 * acceleration * height:
                clear = -2 * speed / acceleration  # shut again: its top is lower than twice that
            else:
                clear = min(height / speed, _OPENING)
            times[self.stops.index(stop)] = clear
        return times

    def _gap(self, stop: str, q: FloatArray, u: FloatArray) -> tuple[float, float]:
        """Gap and gap speed of a stop [rad, rad/s]."""
        return float(self.kinematics.gap(stop, q)), float(self.kinematics.gap_jacobian(stop, q) @ u)

    def _note_launch(self, q: Real, u: Real) -> bool:
        """Note a launch: the velocity passes the launch direction itself, and not from rest."""
        velocity = cast("FloatArray", self.projectile_velocity(q, u))
        if not is_launch(velocity, scale=self.speed_scale):
            return False
        self.launched = self.real(self.integrator.time), q, u
        return True

    def _pass_event(self, stop: str) -> None:
        """Let the active set decide, in doubles; only an impact's jump changes the state."""
        integrator, before = self.integrator, self.initial
        state = np.array(integrator.state, dtype=np.float64)
        q, u = state[: self.n_q], state[self.n_q : 2 * self.n_q]
        function = EventFunction(stop, closes=stop not in before.closed)
        self.initial = self.active_set.after(self._time, q, u, before.closed, [function])
        jump = self.initial.u - u
        if self.structure.throws and integrator.pars[self.structure.launch] and function.closes:
            # An impact that turns the velocity through the launch direction is a launch, unless one
            # of the projectile's own rests takes part.
            exact = integrator.state.copy()
            q, u = exact[: self.n_q], exact[self.n_q : 2 * self.n_q]
            ahead, behind = (
                lead(cast("FloatArray", self.projectile_velocity(q, v))) for v in (u, u + jump)
            )
            impulses = self.active_set.impacts[-1][1]
            if ahead > 0 > behind and not any(impulses.get(name, 0.0) > 0 for name in self.rests):
                self._note_launch(q, u + jump * (ahead / (ahead - behind)))
        integrator.state[self.n_q : 2 * self.n_q] += jump
        self._note_releases()

    def _note_releases(self) -> None:
        for name, released in self.active_set.releases.items():
            if released is not None and self.release_times[name] is None:
                self.release_times[name] = self.real(self.integrator.time)


class _Crossing:
    """Watches the steps under one active set, and takes the motion across; a callback of heyoka's.

    Loops may lose rank; the integrator then stops beside the singular position.
    """

    def __init__(self, run: _Integration) -> None:
        initial, equations = run.initial, run.equations
        self._watch = RankWatch(equations, initial.closed, initial.q)
        functions = run.active_set.event_functions(initial)
        self._locate = EventFinder(equations, initial, functions).first
        self._n_q, self._kinematics = run.n_q, equations.kinematics

    def __call__(self, integrator: Any) -> bool:
        """Tell whether the integration may take another step."""
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
        last = min(window.end, until)
        end, events = first_events(self._locate, window.dense_output(), window.start, last)
        window = window.until(end, releases(events))
        dense = window.dense_output()
        if launched is not None:
            states = dense(np.linspace(window.start, window.end, _SAMPLES))
            q, u = states.reshape(2, self._n_q, -1)
            leads = lead(self._kinematics.velocity(launched, q.T, u.T))
            if np.any((leads[1:] < 0) & (leads[:-1] >= 0)):
                raise SimulationError(
                    "the Taylor integrator looks for no launch beside a singular position, from "
                    f"t = {window.start:.6g} s to {window.end:.6g} s; DOP853 does."
                )
        q, u = self._watch.projected(*dense(end).reshape(2, -1))
        integrator.time = type(integrator.time)(end)
        integrator.state[: 2 * self._n_q] = np.concatenate([q, u])
        return window, events

    def _state(self, integrator: Any) -> FloatArray:
        return np.array(integrator.state[: 2 * self._n_q], dtype=np.float64).reshape(2, -1)


class _TaylorOutput:
    """A segment's continuous output, called as SciPy's: times (n,) to states (2 n_q, n)."""

    def __init__(self, n: int, real: RealType) -> None:
        self._n, self._real = n, real
        self._starts: list[float] = []
        self._pieces: list[Callable[[FloatArray], FloatArray]] = []
        self.ts = np.empty(0)
        """Ends of the integrator's steps [s], as SciPy's solution has them."""

    def add(
        self, start: float, times: FloatArray, states: Callable[[FloatArray], FloatArray]
    ) -> None:
        """Go on with another piece from `start` [s]."""
        self._starts.append(start)
        self._pieces.append(states)
        self.ts = np.concatenate([self.ts, np.asarray(times, dtype=np.float64)])

    def __call__(self, t: FloatArray) -> FloatArray:
        """States (2 n_q, n) at times [s], shape (n,); (2 n_q,) at one."""
        times = np.atleast_1d(np.asarray(t, dtype=self._real))
        pieces = np.searchsorted(self._starts[1:], times, side="right")
        states = np.empty((self._n, len(times)))
        for k in np.unique(pieces):
            states[:, pieces == k] = self._pieces[k](times[pieces == k])
        return states[:, 0] if np.ndim(t) == 0 else states
