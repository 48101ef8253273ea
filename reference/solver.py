"""The reference motion: DOP853 between events, which are roots on its dense output.

Where a damper, and nothing else, keeps its steps short, Radau's implicit method goes on.

Releases and closings are both downward zero crossings of a function that starts at or above zero: a
torque, or a gap. Inside each step the function is sampled at a few points. A gap that has just
opened starts at zero and may be back before the first of them, and one that grazes zero may dip
below between two: the sign of its speed shows it, and then the turning point is located first.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.integrate import DenseOutput, OdeSolution
from scipy.optimize import brentq

from ..models.arrays import FloatArray
from ..models.errors import InputError, SimulationError, UnsupportedProblemError
from ..models.functions import linear_form
from ..models.kinematics import initial_state
from ..models.mechanism import Mechanism
from ..models.problem import LONGEST, Problem, StopLaw
from . import TOLERANCE
from .contact import ActiveSet, EventFunction, PostEventState
from .equations import Equations
from .integrator import (
    MOST_STEPS,
    Interpolant,
    StepLimit,
    numerical,
    one_thread,
)
from .singular import RankWatch, Window, note_singular_start
from .solution import Segment, Solution
from .stiff import Steps

_MAX_EVENTS = 10_000
_LAUNCH_SPANS = (2.0, 5.5)  # characteristic times; Table I launches at 1.5
_PROBES = np.linspace(0.0, 1.0, 6)  # where inside a step the functions are sampled
_PARTS = 8  # of a window across a singular position, each probed as a step is
_SAME_TIME = 1e-13  # [s] events closer than this are one instant
_ROUNDING = 1e-12  # [rad] a gap this little below zero has just been at zero


def solve(
    problem: Problem,
    rtol: float = TOLERANCE,
    atol: float = TOLERANCE,
    equations: Equations | None = None,
    most_steps: int = MOST_STEPS,
) -> Solution:
    """Integrate a problem with SciPy's DOP853, and Radau's method where dampers shorten its steps.

    Args:
        rtol, atol: local error bounds of the integrator, relative and absolute [rad, m, rad/s,
        m/s].
        equations: with a fault (:mod:`.perturbed`); the mechanism's own if left out.
        most_steps: after which it gives up.

    Returns:
        A continuous solution with every release (and, under the unilateral law, impact) located.

    Raises:
        SimulationError: the integrator's step size collapsed or it gets nowhere, the equations are
            singular or leave the finite numbers, or there are more than ten thousand events.
    """
    with numerical("from the start"), one_thread():
        return _integrate(
            problem, equations or Equations(problem.mechanism), rtol, atol, most_steps
        )


def _integrate(
    problem: Problem, equations: Equations, rtol: float, atol: float, most_steps: int
) -> Solution:
    started, mechanism = time.perf_counter(), problem.mechanism
    n_q, evaluations, n_events = len(mechanism.coordinates), 0, 0
    segments: list[Segment] = []
    ends = [*(t for t in mechanism.instants if t < problem.duration), problem.duration]
    held = _held(equations, 0.0)
    active_set = ActiveSet(problem, held)
    limit = StepLimit(2 * n_q, problem.duration, most_steps)
    note_singular_start(held, *initial_state(mechanism))
    initial = active_set.begin()
    while initial.t < problem.duration:
        # Under one active set, to its first events, to an instant of a record, or to the end.
        finder = EventFinder(held, initial, active_set.event_functions(initial))
        y = np.concatenate([initial.q, initial.u])
        to, tolerance = next(end for end in ends if end > initial.t), (rtol, atol)
        segment, events, taken = integrate_segment(
            held, initial.closed, initial.t, y, to, tolerance, finder.first, limit
        )
        evaluations += taken
        n_events += len(events)
        if n_events > _MAX_EVENTS:
            raise SimulationError(
                f"the reference met more than {_MAX_EVENTS} events by t = {initial.t:.6g} s."
            )
        if segment.end > segment.start or not events:
            segments.append(segment)
        if events:
            t, (q, u) = events[0].t, np.split(events[0].state, 2)
            functions = [event.function for event in events]
            initial = active_set.after(t, q.copy(), u.copy(), initial.closed, functions)
        elif to == problem.duration:
            break
        else:
            q, u = np.split(np.asarray(segment.interpolant(to)), 2)
            initial = PostEventState(to, q.copy(), u.copy(), initial.closed)
        if initial.t == to < problem.duration:  # with an event of the stops or without one
            held = _held(equations, to)
            initial = active_set.with_other_forces(held, initial)
    return Solution(
        problem=problem,
        equations=equations,
        segments=tuple(segments),
        release_times=active_set.releases,
        impacts=tuple(active_set.impacts),
        rest_times=active_set.rest_times,
        evaluations=evaluations,
        settings={"rtol": rtol, "atol": atol},
        wall_time=time.perf_counter() - started,
    )


def _held(equations: Equations, t: float) -> Equations:
    """The equations with the forces that act from a time [s] to the next instant of a record."""
    if not equations.mechanism.instants:
        return equations
    if type(equations) is not Equations:
        raise UnsupportedProblemError(
            f"equations of {equations.mechanism.name!r} with a fault follow no record of efforts."
        )
    return Equations(equations.mechanism.at(t))


def characteristic_time(mechanism: Mechanism) -> float:
    """The machine's own time scale, sqrt(reach / g) [s], reach being the sum of its links' lengths.

    A link is as long as its farthest point that has a name or a mass: a balanced arm's centre is
    close to its pin.

    Raises:
        InputError: there is no gravity, and so no such scale.
    """
    if mechanism.gravity == 0:
        raise InputError("gravity = 0.0 of the mechanism: nothing would fall; it must be positive.")
    reach = 0.0
    for body, joint in zip(mechanism.bodies, mechanism.tree_joints, strict=True):
        points = [marker.point for marker in mechanism.markers if marker.body == body.name]
        longest = max(math.dist(joint.child_point, point) for point in (body.centre, *points))
        reach += longest + math.dist(joint.parent_point, (0, 0))
    return math.sqrt(max(reach, 1e-6) / mechanism.gravity)


def solve_until(
    mechanism: Mechanism,
    durations: Iterable[float],
    done: Callable[[Solution], bool],
    stop_law: StopLaw = StopLaw.RELEASE_ONCE,
) -> Solution:
    """Solve for each duration [s] in turn until `done` is true; else the last solution.

    None is longer than :data:`..models.problem.LONGEST`.
    """
    solution: Solution | None = None
    for duration in dict.fromkeys(min(duration, LONGEST) for duration in durations):
        solution = solve(Problem(mechanism, duration=duration, stop_law=stop_law))
        if done(solution):
            break
    if solution is None:
        raise InputError("durations is empty; at least one is needed.")
    return solution


def solve_to_launch(mechanism: Mechanism, stop_law: StopLaw = StopLaw.RELEASE_ONCE) -> Solution:
    """Solve for as long as the launch takes, at most some five characteristic times.

    `Solution.launch` is None if it does not come by then.
    """
    scale = characteristic_time(mechanism)

    def launched(solution: Solution) -> bool:
        launch = solution.launch
        return launch is not None and launch.time < 0.9 * solution.segments[-1].end

    return solve_until(mechanism, (spans * scale for spans in _LAUNCH_SPANS), launched, stop_law)


def integrate_segment(
    equations: Equations,
    closed: tuple[str, ...],
    start: float,
    y: FloatArray,
    end: float,
    tolerance: tuple[float, float],
    locate: Callable[[DenseOutput, float, float], list[Event]] = lambda dense, t0, t1: [],
    limit: StepLimit | None = None,
) -> tuple[Segment, list[Event], int]:
    """Integrate under one active set from `start` to the first events, or to `end` [s].

    Args:
        y: state (q, u) at the start, shape (2 n_q,).
        tolerance: relative and absolute local error bounds.
        locate: finds the events inside a step, from its dense output and its two ends [s].
        limit: of the motion that this is a segment of.

    Returns:
        The segment, its events, and the number of states whose accelerations it took.

    Raises:
        SimulationError: as :class:`.integrator.Integrator`, or a singular position is reached.
    """
    n_q = len(y) // 2
    watch, path = RankWatch(equations, closed, y[:n_q]), _Path(locate, start, end)
    if (window := watch.begin(start, y[:n_q], y[n_q:])) is not None:
        y = np.concatenate(watch.projected(*path.cross(window)))
    steps = Steps(equations, closed, path.times[-1], y, end, tolerance, limit)
    while path.times[-1] < end and not path.events:
        stepper = steps.step()
        dense = stepper.dense_output()
        window = watch.window(dense, path.times[-1], stepper.t, stepper.y[n_q:])
        path.add(dense, stepper.t if window is None else window.start)
        if window is not None and not path.events:
            q, u = watch.projected(*path.cross(window))
            stepper.go_on(path.times[-1], np.concatenate([q, u]))
    return path.segment(equations, closed), path.events, steps.evaluations


class _Path:
    """The pieces of one segment's motion, to its first events."""

    def __init__(
        self, locate: Callable[[DenseOutput, float, float], list[Event]], start: float, end: float
    ) -> None:
        self.times, self.events = [start], list[Event]()
        self._locate, self._end = locate, end
        self._pieces, self._windows = list[DenseOutput](), list[Window]()

    def add(self, piece: DenseOutput, end: float) -> None:
        """Go on by a step, to `end` [s] or its first events."""
        if end > self.times[-1]:
            self.events = self._locate(piece, self.times[-1], end)
            self.times.append(self.events[0].t if self.events else end)
            self._pieces.append(piece)

    def cross(self, window: Window) -> FloatArray:
        """Go on across a singular position; coordinates and speeds behind it, (2, n_q)."""
        piece = window.dense_output()
        last = min(window.end, self._end)
        end, self.events = first_events(self._locate, piece, window.start, last)
        self.times.append(end)
        self._pieces.append(piece)
        self._windows.append(window.until(end, releases(self.events)))
        return np.asarray(piece(end)).reshape(2, -1)

    def segment(self, equations: Equations, closed: tuple[str, ...]) -> Segment:
        """The segment up to here."""
        # The event fell on the step's very start.
        if len(self._pieces) > 1 and self.times[-1] <= self.times[-2]:
            self.times.pop()
            self._pieces.pop()
        interpolant = OdeSolution(np.array(self.times), self._pieces)
        windows = tuple(self._windows)
        return Segment(equations, closed, self.times[0], self.times[-1], interpolant, windows)


def first_events(
    locate: Callable[[DenseOutput, float, float], list[Event]],
    piece: DenseOutput,
    start: float,
    end: float,
) -> tuple[float, list[Event]]:
    """The first events in a window, probed part by part, and their time; else none and the end."""
    for t0, t1 in pairwise(np.linspace(start, end, _PARTS + 1).tolist()):
        if events := locate(piece, t0, t1):
            return events[0].t, events
    return end, []


def releases(events: Iterable[Event]) -> bool:
    """Tell whether a stop opens."""
    return any(not event.function.closes for event in events)


@dataclass(frozen=True)
class Event:
    """A located zero crossing: of which function, when [s], and the state there, shape (2 n_q,)."""

    function: EventFunction
    t: float
    state: FloatArray


class EventFinder:
    """Locates the first events after a state, step by step."""

    def __init__(
        self, equations: Equations, initial: PostEventState, functions: tuple[EventFunction, ...]
    ) -> None:
        self.equations = equations
        self.initial = initial
        self.functions = functions
        self.n_q = len(equations.mechanism.coordinates)
        gaps, n_q = equations.kinematics.gaps, self.n_q
        linear = {
            function.stop: gap
            for function in functions
            if function.closes and (gap := linear_form(gaps[function.stop])) is not None
        }
        self._linear = tuple(linear)
        self._rows = np.array([gap.coefficients for gap in linear.values()]).reshape(-1, n_q)
        self._constants = np.array([gap.constant for gap in linear.values()])

    def _out_of_reach(self, piece: DenseOutput) -> frozenset[str]:
        """Open stops whose gaps are linear and stay positive over a whole step, whatever happens.

        A gap that is linear in the coordinates changes by no more than the sum of the sizes of its
        polynomial's coefficients.
        """
        if not self._linear or not isinstance(piece, Interpolant):
            return frozenset()
        start, coefficients = piece.start_state[: self.n_q], piece.coefficients[:, : self.n_q]
        change = np.abs(coefficients @ self._rows.T).sum(axis=0)
        far = self._rows @ start + self._constants > change + _ROUNDING
        return frozenset(name for name, is_far in zip(self._linear, far, strict=True) if is_far)

    def first(self, piece: DenseOutput, t0: float, t1: float) -> list[Event]:
        """The earliest events between t0 and t1 [s], all of one instant; or none."""
        far = self._out_of_reach(piece)
        near = [f for f in self.functions if not (f.closes and f.stop in far)]
        if not near:
            return []
        times = t0 + _PROBES * (t1 - t0)
        states = np.asarray(piece(times)).T
        crossings: list[tuple[float, EventFunction]] = []
        for function in near:
            locate = self._closing if function.closes else self._release
            root = locate(function.stop, piece, times, states)
            if root is not None:
                crossings.append((root, function))
        if not crossings:
            return []
        earliest = min(t for t, _ in crossings)
        state = np.asarray(piece(earliest), dtype=np.float64)
        together = [function for t, function in crossings if t - earliest <= _SAME_TIME]
        return [Event(function, earliest, state) for function in together]

    def _release(
        self, stop: str, piece: DenseOutput, times: FloatArray, states: FloatArray
    ) -> float | None:
        column = self.equations.n_loops + self.initial.closed.index(stop)

        def torque(state: FloatArray) -> FloatArray:
            q, u = state[..., : self.n_q], state[..., self.n_q :]
            return self.equations.solve(q, u, self.initial.closed)[1][..., column]

        values = torque(states)
        falls = np.flatnonzero((values[1:] < 0) & (values[:-1] >= 0))
        if not len(falls):
            return None
        start, end = times[falls[0] : falls[0] + 2].tolist()
        return _root(lambda t: float(torque(np.asarray(piece(t)))), start, end)

    def _closing(
        self, stop: str, piece: DenseOutput, times: FloatArray, states: FloatArray
    ) -> float | None:
        kinematics, n = self.equations.kinematics, self.n_q

        def gap_at(state: FloatArray) -> FloatArray:
            return kinematics.gap(stop, state[..., :n])

        def speed_at(state: FloatArray) -> FloatArray:
            return np.sum(kinematics.gap_jacobian(stop, state[..., :n]) * state[..., n:], axis=-1)

        def gap(t: float) -> float:
            return float(gap_at(np.asarray(piece(t))))

        def speed(t: float) -> float:
            return float(speed_at(np.asarray(piece(t))))

        gaps, speeds = gap_at(states), speed_at(states)
        for i in range(len(times) - 1):
            interval = (float(times[i]), float(times[i + 1]))
            root = _downward_zero_crossing(gap, speed, interval, gaps[i : i + 2], speeds[i : i + 2])
            if root is not None:
                return root
        return None


def _downward_zero_crossing(
    gap: Callable[[float], float],
    speed: Callable[[float], float],
    interval: tuple[float, float],
    gaps: FloatArray,
    speeds: FloatArray,
) -> float | None:
    """Find where a gap falls through zero in an interval, by its values and speeds at the ends."""
    start, end = interval
    if speeds[0] >= 0 and speeds[1] >= 0:
        return None
    if speeds[0] < 0 < speeds[1]:  # it dips: does it reach zero?
        lowest = _root(speed, start, end)
        return _root(gap, start, lowest) if gaps[0] > 0 > gap(lowest) else None
    if speeds[0] > 0:  # it opens first: only what comes after the turning point can be a closing
        start = _root(speed, start, end)
    start_gap = gap(start)
    if start_gap > 0:
        return _root(gap, start, end) if gaps[1] < 0 else None
    # At zero, within rounding, and on its way down: it closes here. Rounding alone does not take it
    # far below.
    return start if start_gap >= -_ROUNDING and gaps[1] < -_ROUNDING else None


def _root(function: Callable[[float], float], start: float, end: float) -> float:
    """Root of a function; the end nearer to zero if rounding hides the change of sign."""
    first, last = function(start), function(end)
    if first * last >= 0:
        return start if abs(first) <= abs(last) else end
    return float(brentq(function, start, end, xtol=1e-15, rtol=1e-15))
