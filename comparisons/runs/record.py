"""The record of one run: for `compare`, and for every sweep of an engine's settings.

A record says what an engine with its options made of one mechanism: how the run ended, what it
cost, and how far it was from the reference, not yet judged. Failures are outcomes. Records are kept
by a :class:`.store.Store`, so that an interrupted study goes on where it stopped.

Sweeps keep trajectory minus reference as curves on one grid of times, so that runs can be added and
subtracted. Engines sample at times of their own; the difference, not the motion, is interpolated to
the common grid: it is small and smooth (with kinks of higher order at releases), so that only a
small part of it is lost. Positions are interpolated by cubic splines; torques, which have kinks in
their slope, linearly. Two runs that are compared with each other are interpolated linearly.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from statistics import median
from threading import Lock
from typing import Annotated, Any

import numpy as np
from pydantic import Field, JsonValue
from scipy.interpolate import make_interp_spline

from ...engines.protocol import Engine
from ...engines.registry import engine_class, engine_study
from ...engines.study import StepOrder
from ...engines.supplied import stated
from ...models.arrays import FloatArray
from ...models.errors import SimulationError
from ...models.launch import LAUNCH_ANGLE, Launch
from ...models.mechanism import Mechanism
from ...models.spec import Real, Spec
from ...models.trajectory import Trajectory
from ...reference.solver import characteristic_time
from .metrics import SAME_END, THROWN, AlignedRun, against, launch_errors, metrics_of, points
from .process import ProcessError, TimeLimitError, Worker, all_in_order
from .quantities import parse_label
from .results import (
    Diagnosis,
    Equality,
    Machine,
    Metric,
    Outcome,
    Pair,
    Run,
    SingularPosition,
    WorkPoint,
    verdict_on,
)
from .runner import Runner, failure
from .store import Store, conditions
from .study import Study
from .tolerances import Needs, is_table_one, judge
from .work import largest_errors

GRID = 1000  # intervals of the common grid
# Wall time [s] after which no repeat is made: a long run averages over disturbances by itself.
_TIMED_FOR = 0.5
Positions = dict[str, tuple[tuple[Real, ...], tuple[Real, ...]]]


class Curves(Spec):
    """Trajectory minus reference, on a uniform grid from 0 to the end of the compared motion."""

    end: Real  # of the compared motion [s]
    positions: Positions  # x and y of each point of :func:`points` [m], each of GRID + 1 values
    torques: dict[str, tuple[Real, ...]]  # of stops closed at the start [N m, N], on the grid
    force_units: dict[str, str] = Field(default_factory=dict)  # of the torques; N m if left out
    energy: tuple[Real, ...]  # total energy, of that at the start [J], on the grid
    release_times: dict[str, Real | None]  # [s]; None where only one of the two releases
    launch_time: Real | None  # [s]; None where not both launch
    launch_speed: Real | None  # [m/s]

    @property
    def position(self) -> FloatArray:
        """Curves of all points in the order of their names [m], shape (points, 2, GRID + 1)."""
        return np.array([self.positions[name] for name in sorted(self.positions)])

    @property
    def farthest(self) -> str:
        """Name of the point with the largest distance from the reference."""
        distances = {name: np.linalg.norm(xy, axis=0).max() for name, xy in self.positions.items()}
        return max(distances, key=distances.__getitem__)

    def of_point(self, name: str) -> Curves:
        """Returns the same with the position of one point only."""
        return self.model_copy(update={"positions": {name: self.positions[name]}})


class RunRecord(Spec):
    """One engine on one mechanism, measured against the reference, not yet judged."""

    engine: str
    preset: str
    engine_version: str
    settings: dict[str, JsonValue]  # every option
    given_hash: str  # of the mechanism that was simulated; error budgets perturb it
    outcome: Outcome = Outcome.NOT_JUDGED  # NOT_JUDGED: the run came to its end
    message: str | None = None  # why it did not
    time_limit: Real | None = None  # at which it was stopped [s]
    process_failed: bool = False  # not the run failed, but its process: it may succeed if repeated
    steps: Annotated[int, Field(ge=0)] = 0
    wall_times: tuple[Real, ...] = ()  # of the whole simulate, warm, one a repeat [s]
    processor_times: tuple[Real, ...] = ()  # of the same repeats [s]; none: not measured
    reading_times: tuple[Real, ...] = ()  # the adapters' part of these [s]; none: not told apart
    metrics: tuple[Metric, ...] = ()  # without tolerances
    curves: Curves | None = None  # of sweeps that ask for them
    equality: Equality | None = None  # of compare only, as are the next three
    diagnosis: Diagnosis | None = None
    diagnosed_for: dict[str, Real] = Field(default_factory=dict)
    """Tolerances that were exceeded, by label of the metric."""
    trajectory: str | None = None  # SHA-256 of the trajectory's file

    @property
    def ran(self) -> bool:
        """Tell whether the run came to its end and was measured."""
        return self.outcome is Outcome.NOT_JUDGED

    @property
    def costs(self) -> tuple[float, ...]:
        """Processor times of the repeats without reading [s], as far as that is told apart."""
        reading = self.reading_times or (0.0,) * len(self.processor_times)
        return tuple(all_ - ours for all_, ours in zip(self.processor_times, reading, strict=True))

    @property
    def is_timed(self) -> bool:
        """Tell whether its runs took long enough together to be timed by them."""
        return sum(self.wall_times) >= _TIMED_FOR

    @property
    def position(self) -> float | None:
        """Largest distance of any point of :func:`.metrics.points` from the reference [m]."""
        return self.largest("position_max")

    @property
    def torque(self) -> float | None:
        """Largest error of any stop's torque or force at any sample [N m, N]."""
        return self.largest("stop_torque_max")

    @property
    def work(self) -> WorkPoint:
        """Its cost and errors at its time step.

        Raises:
            KeyError: the engine has no time step.
        """
        reading = self.reading_times
        return WorkPoint(
            timestep=self.settings["timestep"],  # pyright: ignore[reportArgumentType]
            steps=self.steps,
            costs=self.costs,
            reading_time=median(reading) if reading else None,
            errors=largest_errors(self.metrics),
        )

    def value(self, name: str, subject: str | None = None) -> float | None:
        """Value of the metric of that name and subject; None if there is none."""
        values = (m.value for m in self.metrics if (m.name, m.subject) == (name, subject))
        return next(values, None)

    def largest(self, name: str) -> float | None:
        """Largest value of the metrics of that name; None if there is none."""
        values = (m.value for m in self.metrics if m.name == name)
        return max((value for value in values if value is not None), default=None)

    def failed(self, error: Exception) -> RunRecord:
        """Returns the record of a run that raised this error."""
        outcome, message = failure(error)
        limit = error.limit if isinstance(error, TimeLimitError) else None
        update = {"outcome": outcome, "message": message, "time_limit": limit}
        return self.model_copy(update={**update, "process_failed": isinstance(error, ProcessError)})

    def measured(
        self, trajectory: Trajectory, metrics: Iterable[Metric], curves: Curves | None = None
    ) -> RunRecord:
        """Returns the record of a run that came to its end, with its steps and its times."""
        update = {"steps": trajectory.provenance.steps, "curves": curves}
        measured = self.model_copy(update={**update, "metrics": tuple(metrics)})
        return measured.timed_again(trajectory)

    def timed_again(self, trajectory: Trajectory) -> RunRecord:
        """Returns the record with the times of one more repeat."""
        run = trajectory.provenance
        times = {
            "wall_times": run.wall_time,
            "processor_times": run.processor_time,
            "reading_times": run.reading_time,
        }
        update = {
            name: (*getattr(self, name), time) for name, time in times.items() if time is not None
        }
        return self.model_copy(update=update)


def new_record(name: str, preset: str, engine: Engine, given: Mechanism) -> RunRecord:
    """Record of a run that has not begun, by the names that were asked for."""
    return RunRecord(
        engine=name,
        preset=preset,
        engine_version=engine_class(name).version(),
        settings=engine.settings,
        given_hash=given.content_hash,
    )


def make(
    runner: Runner, engine: Engine, given: Mechanism | None = None, *, curves: bool = False
) -> RunRecord:
    """Runs an engine and measures it, up to the predictability horizon; a failure is an outcome.

    Args:
        given: mechanism that the engine simulates instead of the runner's.
        curves: whether to keep the difference from the reference over time.
    """
    record = new_record(engine.name, engine.preset, engine, given or runner.mechanism)
    metrics = list[Metric]()
    try:
        thrown, end = runner.until.thrown, runner.judged_to
        run = runner.simulate(engine, given)
        reference = runner.reference(run.t)
        if not run.mechanism.markers:  # `metrics_of` has those of markers
            expected = points(reference)
            for name, position in points(run).items():
                distance = np.linalg.norm(position - expected[name], axis=1)[run.t <= end].max()
                value = float(distance)
                metrics.append(Metric(name="position_max", subject=name, value=value, unit="m"))
        compared = (run, runner.solution, end, reference)
        aligned = against(*compared, scales=runner.scales, thrown=thrown)
        metrics += metrics_of(aligned)
        kept = curves_of(aligned) if curves else None
    except Exception as error:
        return record.failed(error)
    return record.measured(run, metrics, kept)


def curves_of(aligned: AlignedRun) -> Curves:
    """Interpolates trajectory minus reference to the common grid, up to the end.

    The trajectory should go on a little beyond it.
    """
    trajectory, reference, end = aligned.trajectory, aligned.reference, aligned.end
    t, expected_releases = trajectory.t, aligned.solution.release_times
    grid = np.linspace(0.0, end, GRID + 1)
    expected, positions = points(reference), Positions()
    for name, position in points(trajectory).items():
        error = position - expected[name]
        if len(t) < 8:
            columns = [np.interp(grid, t, column) for column in error.T]
        else:
            columns = list(np.asarray(make_interp_spline(t, error, k=3)(np.minimum(grid, t[-1]))).T)
        positions[name] = tuple(columns[0].tolist()), tuple(columns[1].tolist())
    torques, units = dict[str, tuple[float, ...]](), dict[str, str]()
    releases: dict[str, float | None] = {}
    for stop in trajectory.mechanism.stops:
        if not stop.closed:
            continue
        name = stop.name
        time, due = trajectory.release_time(name), expected_releases[name]
        releases[name] = None if time is None or due is None else time - due
        if name in trajectory.stop_torques:
            error = trajectory.stop_torque(name) - reference.stop_torque(name)
            torques[name] = tuple(np.interp(grid, t, error).tolist())
            units[name] = stop.force_unit
    balance, kept = aligned.balance
    launch_time, launch_speed = launch_errors(*aligned.launches)
    return Curves(
        end=end,
        force_units=units,
        positions=positions,
        torques=torques,
        energy=tuple(np.interp(grid, t, balance - kept[0]).tolist()),
        release_times=releases,
        launch_time=launch_time,
        launch_speed=launch_speed,
    )


class EngineRuns:
    """Runs of engines on one mechanism, each made once and kept in memory and in a store.

    Runs are compared up to the end of the motion, or to the predictability horizon if that is
    earlier. Without curves, differences as functions of time, a record is small.

    Raises:
        InputError: the end is not valid, or does not come.
        SimulationError: the reference failed.
    """

    def __init__(self, runner: Runner, store: Store | None = None, *, curves: bool = True) -> None:
        self.runner, self.mechanism, self.solution = runner, runner.mechanism, runner.solution
        self.end = runner.judged_to
        self._store, self._curves = store, curves
        self._known: dict[str, RunRecord] = {}
        self._locks: dict[str, Lock] = {}

    @property
    def compared_motion(self) -> dict[str, Any]:
        """Fields of a :class:`.results.ComparedMotion`."""
        return {
            "model": self.mechanism.name,
            "mechanism": self.mechanism,
            "mechanism_hash": self.mechanism.content_hash,
            "launch_time": self.runner.launch_time,
            "compared_to": self.runner.end,
            "judged_to": self.end,
        }

    @property
    def time_scale(self) -> float:
        """Time of which steps are parts [s].

        It is the characteristic time (without gravity, that of the motion), or the end if earlier.
        """
        time = self.runner.scales.time
        if self.mechanism.gravity:
            time = characteristic_time(self.mechanism)
        return min(time, self.runner.end)

    def uncertainty(self, metric: str) -> float | None:
        """Uncertainty of the reference in a metric, the largest of all its subjects, in its unit.

        That of the centres of mass of a mechanism without markers follows from those of its
        coordinates: each is at the end of a chain of bodies, whose angles count with their lengths.
        """
        known = self.runner.uncertainties.values
        if metric == "position_max" and not self.mechanism.markers:
            slides = len(self.mechanism.slides) * known.get("slide_max", 0.0)
            return self.runner.scales.length * known.get("angle_max", 0.0) + slides
        values = (value for label, value in known.items() if parse_label(label)[0] == metric)
        return max(values, default=None)

    def record(self, engine: Engine, repeats: int = 1, given: Mechanism | None = None) -> RunRecord:
        """Record of an engine's run, which is made if it is not known, or timed too seldom.

        Args:
            repeats: how often it is timed; less often where its runs are long.
            given: mechanism that the engine simulates instead of the one it is compared with: a
                slightly wrong one shows what that wrongness does.
        """
        parts = ((given or self.mechanism).content_hash, *self.runner.conditions, self._curves)
        made_by = conditions(*parts, engine=engine)
        key, store = f"{engine.name}-{made_by[:20]}", self._store
        with self._locks.setdefault(key, Lock()):  # threads that ask for the same run wait for it
            known = self._known.get(key)
            if known is None and store is not None:
                known = store.record(key, RunRecord, made_by)
                known = None if known is not None and known.process_failed else known
                (store.taken if known else store.made).add(key)
            record = known or make(self.runner, engine, given, curves=self._curves)
            # It did run: a repeat that fails costs a time, not the record.
            with suppress(Exception):
                while record.ran and len(record.wall_times) < repeats and not record.is_timed:
                    record = record.timed_again(self.runner.simulate(engine, given))
            if store is not None and record is not known:
                store.keep_record(key, record, made_by, self.runner.worker.jobs)
            self._known[key] = record
            return record


def runs_of(study: Study, worker: Worker) -> tuple[list[EngineRuns], dict[str, str]]:
    """Runs on each mechanism of a study; and why the references of the others failed, by name."""

    def solved(mechanism: Mechanism) -> EngineRuns | str:
        try:
            runner = Runner(mechanism, worker, study.end_of(mechanism), study.law_of(mechanism))
            return EngineRuns(runner, study.store)
        except SimulationError as error:
            return str(error)

    runs, failed = list[EngineRuns](), dict[str, str]()
    solutions = all_in_order(solved, study.mechanisms, study.at_once)
    for mechanism, result in zip(study.mechanisms, solutions, strict=True):
        if isinstance(result, str):
            failed[mechanism.name] = result
        else:
            runs.append(result)
    return runs, failed


def run_row(record: RunRecord, engine: Engine, mechanism: Mechanism) -> Run:
    """Row of a comparison for a record of an engine as it ran, not judged."""
    declared = engine_study(record.engine).step_orders.get(record.preset, StepOrder(None, ""))
    return Run(
        model=mechanism.name,
        engine=record.engine,
        preset=record.preset,
        outcome=record.outcome,
        message=record.message,
        time_limit=record.time_limit,
        engine_version=record.engine_version,
        scheme=declared.scheme,
        order=declared.order,
        supplied=stated(engine, mechanism),
        settings=record.settings,
        steps=record.steps,
        wall_time=next(iter(record.wall_times), None),
        processor_time=next(iter(record.processor_times), None),
        reading_time=next(iter(record.reading_times), None),
        equality=record.equality,
        metrics=record.metrics,
        diagnosis=None if record.ran else record.diagnosis,
    )


def judged(record: RunRecord, engine: Engine, machine: Machine, needs: Needs) -> Run:
    """Row of a comparison for a record, with its verdict if the run came to its end."""
    run = run_row(record, engine, machine.mechanism)
    if not record.ran:
        return run
    metrics = judge(run, machine, needs)
    return run.model_copy(update={"metrics": metrics, "outcome": verdict_on(metrics)})


def machine_row(runner: Runner, needs: Needs) -> Machine:
    """Row of a mechanism as compared: the reference's values, its scales, its uncertainties."""
    mechanism, solution, end = runner.mechanism, runner.solution, runner.end
    launch = solution.launch_at(LAUNCH_ANGLE, runner.until.thrown)
    uncertainties = runner.uncertainties
    start = solution.motion(np.zeros(1))
    passages = [p for p in solution.singular_passages if p.time <= end]
    return Machine(
        model=mechanism.name,
        mechanism=mechanism,
        mechanism_hash=mechanism.content_hash,
        table_one=is_table_one(mechanism),
        stop_law=runner.law,
        compared_to=end,
        judged_to=runner.judged_to,
        stretching=runner.stretching,
        predictability=runner.predictability,
        scales=runner.scales,
        whole_scales=runner.whole_scales,
        needs=needs.texts,
        thrown=runner.until.thrown,
        launch_time=launch.time if launch else None,
        launch_speed=launch.speed if launch else None,
        reference_uncertainty=uncertainties.values,
        uncertainty_source=uncertainties.source,
        impacts=sum(time <= end for time, _ in solution.impacts),
        singular_positions=tuple(SingularPosition(**asdict(p)) for p in passages),
        release_times=dict(solution.release_times),
        start_torques={name: float(torque[0]) for name, torque in start.stop_torques.items()},
    )


@dataclass(frozen=True)
class RunErrors:
    """Errors of one run, for its pairs with other runs.

    Two engines seldom sample the same times: between them the error against the reference, which is
    small and smooth, is interpolated. The reference itself cancels in the difference of two errors.
    """

    t: FloatArray  # [s], shape (n,)
    errors: Mapping[str, FloatArray]  # position of each marker [m], shape (n, 2)
    release_times: dict[str, float | None]
    launch: Launch | None

    @classmethod
    def of(cls, trajectory: Trajectory, reference: Trajectory, thrown: str = THROWN) -> RunErrors:
        """Errors of a trajectory against the reference at its times."""
        errors: dict[str, FloatArray] = {}
        for name, motion in trajectory.markers.items():
            errors[name] = motion.position - reference.marker(name).position
        launch = trajectory.launch(marker=thrown) if thrown in errors else None
        return cls(trajectory.t, errors, dict(trajectory.release_times), launch)


def pair_of(
    model: str, labels: tuple[str, str], first: RunErrors, second: RunErrors, end: float
) -> Pair:
    """Difference of two runs of one machine up to `end` [s], at the times of the coarser one."""
    coarse, fine = sorted((first, second), key=lambda run: len(run.t))
    t = coarse.t[coarse.t <= min(end, fine.t[-1])]
    distances: list[float] = []
    for name in first.errors.keys() & second.errors.keys():
        columns = [np.interp(t, fine.t, column) for column in fine.errors[name].T]
        difference = coarse.errors[name][: len(t)] - np.stack(columns, axis=1)
        distances.append(float(np.linalg.norm(difference, axis=1).max()))
    # Not comparable where a stop has opened in one of the two alone
    releases, same_stops, latest = list[float](), True, end * (1 + SAME_END)
    for name, time in first.release_times.items():
        other = second.release_times.get(name)
        if all(opened is None or opened > latest for opened in (time, other)):
            continue
        if time is None or other is None:
            same_stops = False
        else:
            releases.append(abs(time - other))
    speeds = [run.launch.speed for run in (first, second) if run.launch]
    return Pair(
        model=model,
        first=labels[0],
        second=labels[1],
        position_max=max(distances, default=None),
        release_time_max=max(releases, default=None) if same_stops else None,
        launch_speed=speeds[0] - speeds[1] if len(speeds) == 2 else None,
    )
