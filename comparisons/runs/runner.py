"""The reference motion of one mechanism, engines run beside it, and what both may be trusted in.

The reference runs where the engines do, under the same limit of time: in a process of its own if
they are isolated. Its own uncertainty in each metric comes from its certificate, else from a
coarser integration. A trajectory is compared only if it is whole, finite, in shape, and of the
mechanism.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache, partial
from threading import RLock
from typing import Any, Generic, TypeVar

import numpy as np

from ...engines.protocol import Capabilities, Engine
from ...models.arrays import FloatArray
from ...models.errors import (
    EngineNotInstalledError,
    SimulationError,
    StudyEndedError,
    TrebucheckError,
    UnsupportedProblemError,
    shortened,
)
from ...models.launch import LAUNCH_ANGLE
from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw
from ...models.trajectory import Trajectory
from ...reference.certification.certificate import Uncertainties, certified, covering_certificate
from ...reference.solution import Solution
from ...reference.solver import solve
from .metrics import UNSEEN, launch_errors, measure, points
from .process import TimeLimitError, Worker
from .quantities import QUANTITIES, parse_label
from .results import Metric, Outcome, Predictability
from .scales import Scales, scales_until
from .stretching import Stretching, stretching_until
from .study import Until

_SAME_TIME = 1e-9  # of the duration: how late the first sample may be
_LARGEST = 1e100  # in SI units: its square is still a number


def refuse_invalid(
    engine: str, trajectory: object, mechanism: Mechanism, capabilities: Capabilities
) -> Trajectory:
    """The trajectory that an engine gave for a mechanism, if it is a valid one.

    Raises:
        SimulationError: the sentence says what is wrong with it.
    """
    if not isinstance(trajectory, Trajectory):
        kind = type(trajectory).__name__
        raise SimulationError(f"{engine} gave a {kind} instead of a Trajectory.")
    fault = next(_faults(trajectory, mechanism, capabilities), None)
    if fault is not None:
        raise SimulationError(f"{engine} gave an invalid trajectory: {fault}.")
    return trajectory


def _faults(
    trajectory: Trajectory, mechanism: Mechanism, capabilities: Capabilities
) -> Iterator[str]:
    """Faults of a trajectory, the times first: the other arrays are held against them."""
    if trajectory.mechanism != mechanism:
        yield f"it is of another mechanism, {trajectory.mechanism.name!r}"
    yield from _time_faults(trajectory.t)
    stops = {stop.name for stop in mechanism.stops}
    closed = {stop.name for stop in mechanism.stops if stop.closed}
    markers = {marker.name for marker in mechanism.markers}
    joints = {joint.name for joint in mechanism.joints}
    held = {joint.name for joint in mechanism.joints if joint.held_directions}
    torques = closed if capabilities.stop_torques else set[str]()
    reactions = held if capabilities.joint_reactions else set[str]()
    # Field, names that the mechanism has, and those that are needed
    for field, known, needed in (
        ("markers", markers, markers),
        ("stop_torques", stops, torques),
        ("release_times", stops, closed),
        ("joint_gaps", joints, set[str]()),
        ("joint_reactions", joints, reactions),
    ):
        yield from _name_faults(field, getattr(trajectory, field), known, needed)
    yield from _array_faults(trajectory, len(mechanism.coordinates))
    for name, time in trajectory.release_times.items():
        if time is not None and not (np.isfinite(time) and time >= 0):
            yield f"the release time of {name!r} is {time!r} s"
    for time, impulses in trajectory.impacts:
        if not (np.isfinite(time) and time >= 0):
            yield f"an impact's time is {time!r} s"
        yield from _name_faults("impacts", impulses, stops, set())
        for name, impulse in impulses.items():
            if not np.isfinite(impulse):
                yield f"the impulse of {name!r} is {impulse!r}"


def _time_faults(t: Any) -> Iterator[str]:
    if not isinstance(t, np.ndarray) or t.dtype != np.float64:
        yield f"t is {_kind(t)}; an array of float64 is needed"
    elif t.ndim != 1 or len(t) < 2:
        yield f"t has the shape {t.shape}; at least two times are needed"
    elif not np.isfinite(t).all():
        yield f"t[{int(np.argmin(np.isfinite(t)))}] is not finite"
    elif (np.diff(t) < 0).any():
        yield f"t decreases after {t[int(np.argmax(np.diff(t) < 0))]:.6g} s"
    elif not 0.0 <= t[0] <= _SAME_TIME * t[-1]:
        yield f"it begins at t = {t[0]:.6g} s instead of 0"


def _name_faults(
    field: str, values: Mapping[str, object], known: set[str], needed: set[str]
) -> Iterator[str]:
    unknown, missing = sorted(values.keys() - known), sorted(needed - values.keys())
    if unknown:
        yield f"{field} has {unknown[0]!r}, which the mechanism does not have"
    if missing:
        yield f"{field} lacks {missing[0]!r}"


def _array_faults(trajectory: Trajectory, n_q: int) -> Iterator[str]:
    """Faults of anything sampled: its type, shape, numbers or size."""
    t: Any = trajectory.t
    n = len(t)
    arrays: list[tuple[str, Any, tuple[int, ...]]] = [
        ("q", trajectory.q, (n, n_q)),
        ("u", trajectory.u, (n, n_q)),
        ("kinetic_energy", trajectory.kinetic_energy, (n,)),
        ("potential_energy", trajectory.potential_energy, (n,)),
    ]
    for name, motion in trajectory.markers.items():
        arrays.append((f"position of {name!r}", motion.position, (n, 2)))
        arrays.append((f"velocity of {name!r}", motion.velocity, (n, 2)))
    arrays += [(f"torque of {k!r}", v, (n,)) for k, v in trajectory.stop_torques.items()]
    arrays += [(f"reaction of {k!r}", v, (n, 2)) for k, v in trajectory.joint_reactions.items()]
    arrays += [(f"gap of {k!r}", v, (n,)) for k, v in trajectory.joint_gaps.items()]
    for label, values, shape in arrays:
        if not isinstance(values, np.ndarray):
            yield f"{label} is {_kind(values)}; an array is needed"
        elif values.shape != shape:
            yield f"{label} has the shape {values.shape}, not {shape}"
        elif not np.issubdtype(values.dtype, np.number) or np.iscomplexobj(values):
            yield f"{label} holds no real numbers"
        elif not np.isfinite(values).all():
            first = int(np.argmin(np.isfinite(values.reshape(n, -1)).all(axis=1)))
            yield f"{label} is not finite at t = {t[first]:.6g} s"
        elif np.abs(values).max() > _LARGEST:
            yield f"{label} reaches {np.abs(values).max():.3g}, which is too large to compare"


def _kind(value: object) -> str:
    if isinstance(value, np.ndarray):
        return f"an array of {value.dtype}"
    return f"a {type(value).__name__}"


_COARSE = 1e-12  # tolerance of the second integration: some thirty times the reference's own
_SAFETY = 4.0
_ROUNDING = 64 * float(np.finfo(np.float64).eps)
_DENSE, _LEAST, _MOST = 40, 60, 20_000  # samples in a characteristic time, and of all


def reference_uncertainties(
    solution: Solution,
    end: float,
    scales: Scales,
    thrown: str,
    invariants_to: float | None = None,
    stretching: Stretching | None = None,
) -> Uncertainties:
    """Uncertainty of the reference by label of the metric; by its name, of its worst subject.

    The coarser integration is measured as any engine is. Its distance is about its own error,
    thirty times that of the reference unless they agree by chance: hence four times the distance,
    and sixty-four roundings of the scale. What a certificate says of its quantities, up to the
    launch, replaces that. The arguments are those of :func:`.metrics.measure`.
    """
    problem, mechanism = solution.problem, solution.problem.mechanism
    until = invariants_to or end
    margin = min(problem.duration, until * 1.02)  # so that the coarser one's events lie inside, too
    coarse = solve(Problem(mechanism, duration=margin, stop_law=problem.stop_law), _COARSE, _COARSE)
    n = int(np.clip(_DENSE * until / scales.time, _LEAST, _MOST))
    samples = np.unique(np.concatenate([np.linspace(0.0, margin, n), [end, until]]))
    metrics = measure(
        coarse.trajectory(samples[samples <= margin]), solution, end,
        scales=scales, thrown=thrown, invariants_to=invariants_to, stretching=stretching,
    )  # fmt: skip
    # The launch is that of the solution itself, instead of that of its samples.
    launches = (motion.launch_at(LAUNCH_ANGLE, thrown) for motion in (coarse, solution))
    launch = dict(zip(("launch_time", "launch_speed"), launch_errors(*launches), strict=True))
    parted = any(metric.name == "first_parting" and metric.value is not None for metric in metrics)
    estimated: dict[str, float] = {}
    for measured in metrics:
        metric = measured
        # A motion that does not part shows no base error, but a bound of it.
        left_out = metric.name in ("missing_time", UNSEEN, "first_parting")
        if left_out or (metric.name == "base_error" and not parted):
            continue
        if metric.name in launch:
            metric = metric.model_copy(update={"value": launch[metric.name]})
        rounded = QUANTITIES[metric.name].size_of(scales, metric.subject, mechanism)
        value = _SAFETY * _distance(metric, scales, solution) + _ROUNDING * rounded
        estimated[metric.label] = value
        estimated[metric.name] = max(estimated.get(metric.name, 0.0), value)
    certificate = covering_certificate(solution, until)
    if certificate is None:
        return Uncertainties(source="estimate", values=estimated)
    known = certified(certificate).values
    kept = {name: value for name, value in estimated.items() if parse_label(name)[0] not in known}
    return Uncertainties(source="certificate", values=kept | known)


def _distance(metric: Metric, scales: Scales, solution: Solution) -> float:
    """Distance between the two integrations; the scale for an event that only one of them has."""
    if metric.value is None:
        return QUANTITIES[metric.name].scale_of(scales, metric.subject, solution.problem.mechanism)
    # The reference is not known by samples
    return max(0.0, abs(metric.value) - (metric.sampling_error or 0.0))


@dataclass(frozen=True)
class Farthest:
    """Point and time at which a run is farthest from the reference."""

    point: str  # marker, or body of a mechanism without markers
    distance: float  # [m]
    time: float  # [s]
    until: float  # end of the compared time [s]: of the motion, or the predictability horizon


def farthest(trajectory: Trajectory, runner: Runner) -> Farthest:
    """The largest distance of any point from the reference, at the run's own sample times."""
    end = runner.judged_to
    times = trajectory.t[trajectory.t <= end]
    expected = points(runner.reference(times))
    distances = {
        name: np.linalg.norm(position[: len(times)] - expected[name], axis=1)
        for name, position in points(trajectory).items()
    }
    point = max(distances, key=lambda name: float(distances[name].max()))
    at = int(distances[point].argmax())
    return Farthest(point, float(distances[point][at]), float(times[at]), end)


_Result = TypeVar("_Result")
# An engine runs on past the end of what is compared, so that its launch can be found
_TAIL_STEPS, _TAIL = (20, 0.02)
# Time grids on which the reference is kept: runs of one step and engine share theirs. The longest
# takes some 10 MB; longer ones belong to runs beside which the reference is cheap.
_GRIDS, _LONGEST_GRID = 3, 30_000


def run_duration(end: float, step: float, longest: float = math.inf) -> float:
    """Duration of an engine's run [s], by the end of the comparison and the time step [s].

    Args:
        longest: that the reference goes on to [s]; an engine of whole steps may need one more than
            it is asked for.
    """
    return min(end + max(_TAIL, _TAIL_STEPS * step), max(longest - step, end))


_OUTCOMES = {
    EngineNotInstalledError: Outcome.ABSENT,
    TimeLimitError: Outcome.TIMED_OUT,
    UnsupportedProblemError: Outcome.UNSUPPORTED,
}


def failure(error: Exception) -> tuple[Outcome, str]:
    """Outcome and message of a run that raised.

    A plug-in may raise anything, and a study must survive it.

    Raises:
        StudyEndedError: it was one.
    """
    if isinstance(error, StudyEndedError):
        raise error
    if not isinstance(error, TrebucheckError):
        return Outcome.FAILED, shortened(f"{type(error).__name__}: {error}")
    outcomes = (outcome for kind, outcome in _OUTCOMES.items() if isinstance(error, kind))
    return next(outcomes, Outcome.FAILED), str(error)


class _once(Generic[_Result]):  # noqa: N801 - used as a decorator, like the property it stands for
    """A property computed once a runner, by the thread that asks first; others wait for it.

    (functools.cached_property computes it once a thread, and in Python 3.11 one object at a time.)
    """

    def __init__(self, compute: Callable[[Any], _Result]) -> None:
        self._compute, self.__doc__ = compute, compute.__doc__

    def __get__(self, runner: Runner | None, owner: type[Runner]) -> _Result:
        if runner is None:
            return self  # type: ignore[return-value] - documentation asks the class
        name = self._compute.__name__
        with runner.lock:
            if name not in runner.__dict__:
                # Is found there before this is asked again
                runner.__dict__[name] = self._compute(runner)
            return runner.__dict__[name]


class Runner:
    """Runs engines on one mechanism and evaluates its reference motion at their times.

    Args:
        mechanism: compared up to its launch, or as `until` says.
        worker: the process in which engines run; None: this one. Its owner closes it.
        until: end of the compared motion.
        law: of the stops.
        predictable: whether the motion is known to be predictable up to the end: the horizon is not
            computed then.

    Raises:
        InputError: the end is not valid.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        worker: Worker | None = None,
        until: Until | None = None,
        law: StopLaw = StopLaw.RELEASE_ONCE,
        *,
        predictable: bool = False,
    ) -> None:
        self.mechanism, self.worker, self.law = mechanism, worker or Worker(isolate=False), law
        self._predictable = predictable
        self.until, self.lock = until or Until(required=False), RLock()

        @lru_cache(_GRIDS)
        def on_grid(times: bytes) -> Trajectory:
            return self.solution.trajectory(np.frombuffer(times))

        self._on_grid = on_grid

    @_once
    def _solved(self) -> tuple[Solution, float]:
        return self.worker.compute(partial(self.until.solve, self.mechanism, self.law))

    @property
    def solution(self) -> Solution:
        """The reference motion, somewhat longer than the compared one.

        Raises:
            InputError: the reference cannot begin, or the end does not come.
            SimulationError: it failed, or did not come to an end.
        """
        return self._solved[0]

    @property
    def end(self) -> float:
        """End of the compared motion [s]."""
        return self._solved[1]

    @property
    def conditions(self) -> tuple[str, str, str]:
        """Mechanism, end and law: the part of a run's conditions that is not the engine's."""
        return self.mechanism.content_hash, repr(self.until), self.law.value

    @property
    def launch_time(self) -> float | None:
        """Launch time of the reference, if it is within the compared motion [s]."""
        launch = self.solution.launch_at(LAUNCH_ANGLE, self.until.thrown)
        return launch.time if launch and launch.time <= self.end else None

    @_once
    def uncertainties(self) -> Uncertainties:
        """Uncertainties of the reference, up to the end of the compared motion."""
        motion = (self.solution, self.judged_to, self.scales, self.until.thrown)
        estimate = partial(reference_uncertainties, *motion, self.end, self._stretching)
        return self.worker.compute(estimate)

    @_once
    def _stretching(self) -> Stretching:
        grow = partial(stretching_until, self.solution, self.end, self._scales_to_end)
        return self.worker.compute(grow)

    @_once
    def judged_to(self) -> float:
        """The end, or the predictability horizon if that is earlier [s]."""
        return self.end if self._predictable else self._stretching.horizon

    @property
    def known_until(self) -> float:
        """Last time [s] up to which the reference itself is known, at most the end."""
        return self._stretching.known_until

    def rounding(self, time: float) -> float:
        """Estimated error of the reference by rounding up to a time [s], in parts of scales.

        At most 1, which is nothing known: it is infinite where a changed mechanism cannot be moved.
        """
        growth = self._stretching
        return min(1.0, float(growth.rounding[growth.before(time)]))

    @property
    def stretching(self) -> float:
        """Growth of errors of the motion up to there, by parameters."""
        return float(self._stretching.parameters[self._stretching.before(self.judged_to)])

    @property
    def predictability(self) -> Predictability:
        """Stretching at each quarter of the compared time."""
        growth, times = self._stretching, [part * self.end for part in (0.25, 0.5, 0.75, 1.0)]
        at = [growth.before(time) for time in times]
        parameters, start = (
            tuple(float(value) if np.isfinite(value) else None for value in values[at])
            for values in (growth.parameters, growth.start)
        )
        return Predictability(times=tuple(times), parameters=parameters, start=start)

    @_once
    def _scales_to_end(self) -> Scales:
        return scales_until(self.solution, self.end)

    @_once
    def scales(self) -> Scales:
        """Scales of the motion up to there."""
        same = self.judged_to == self.end
        return self._scales_to_end if same else scales_until(self.solution, self.judged_to)

    @_once
    def whole_scales(self) -> Scales | None:
        """Scales of the motion to its end; None where that is the same."""
        return None if self.judged_to == self.end else self._scales_to_end

    def measured(self, trajectory: Trajectory) -> tuple[Metric, ...]:
        """Metrics of a run, up to the predictability horizon; invariants up to the end."""
        return measure(
            trajectory, self.solution, self.judged_to, self.reference(trajectory.t),
            scales=self.scales, thrown=self.until.thrown, invariants_to=self.end,
            stretching=self._stretching,
        )  # fmt: skip

    def problem(self, engine: Engine, given: Mechanism | None = None) -> Problem:
        """Problem that an engine is to simulate, of the given mechanism instead of the runner's."""
        duration = run_duration(self.end, engine.timestep or 0.0, self.solution.problem.duration)
        return Problem(given or self.mechanism, duration=duration, stop_law=self.law)

    def simulate(self, engine: Engine, given: Mechanism | None = None) -> Trajectory:
        """Run an engine, after a short run whose time is not counted.

        Raises:
            Exception: whatever the engine raises; :func:`failure` makes a row of it.
            SimulationError: what it gave is no valid trajectory.
        """
        problem, longest = self.problem(engine, given), self.solution.problem.duration
        trajectory = self.worker.simulate(engine, problem)
        valid = refuse_invalid(engine.name, trajectory, problem.mechanism, engine.capabilities)
        if valid.t[-1] > longest:
            to = f"it goes on to {valid.t[-1]:.6g} s, and {problem.duration:.6g} s was asked for"
            raise SimulationError(f"{engine.name} gave an invalid trajectory: {to}.")
        return valid

    def reference(self, t: FloatArray) -> Trajectory:
        """The reference at these times [s], shape (n,); kept for the last few time grids."""
        return self.solution.trajectory(t) if len(t) > _LONGEST_GRID else self._on_grid(t.tobytes())


def motion_of(given: Mechanism | Problem) -> Runner:
    """Reference run of a problem, or of a mechanism to its launch or some characteristic times.

    Raises:
        InputError: the reference cannot begin.
    """
    if isinstance(given, Problem):
        return Runner(given.mechanism, until=Until.of(given.duration), law=given.stop_law)
    return Runner(given, until=Until.of(None))


def horizon_of(trajectories: Iterable[Trajectory]) -> float | None:
    """Predictability horizon of the first of some motions to reach it before it ends [s].

    None: they can be predicted to their ends, or the reference cannot tell.
    """
    horizons: list[float] = []
    known: set[str] = set()
    for trajectory in trajectories:
        mechanism, end = trajectory.mechanism, float(trajectory.t[-1])
        if mechanism.content_hash in known or not end > 0:
            continue
        known.add(mechanism.content_hash)
        with suppress(TrebucheckError, ValueError):  # the law of an unknown origin is no law
            law = StopLaw(trajectory.provenance.stop_law)
            horizon = Runner(mechanism, until=Until.of(end), law=law).judged_to
            if horizon < end:
                horizons.append(horizon)
    return min(horizons, default=None)
