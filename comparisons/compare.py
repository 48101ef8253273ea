"""Comparisons: machines x engines x presets, each run made or taken from a store, and judged."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Any

from ..engines.presets import SETTINGS
from ..engines.protocol import Engine
from ..engines.registry import Engines, Names, presets_of
from ..engines.registry import engine as make_engine
from ..models.errors import InputError, SimulationError
from ..models.files import read_bytes
from ..models.library.registry import Models
from ..models.mechanism import Mechanism
from ..models.problem import StopLaw
from ..models.shown import Reported
from ..models.spec import Spec
from ..models.trajectory import Trajectory, load
from ..reference.solution import Solution
from .diagnosis.diagnose import check_and_diagnose, diagnose_motion, failed_diagnosis
from .diagnosis.rerun import Rerun, SearchTime
from .report.document import format_number
from .runs.process import OnDemand, Worker, in_order, simulate
from .runs.record import (
    EngineRuns,
    RunErrors,
    RunRecord,
    judged,
    machine_row,
    new_record,
    pair_of,
    run_row,
)
from .runs.results import (
    COMPARED,
    FORMAT,
    Diagnosis,
    Machine,
    OfEngine,
    Outcome,
    Pair,
    Results,
    Run,
    WorkPoint,
)
from .runs.runner import Runner
from .runs.store import Store, conditions, digest
from .runs.study import Study, Until

__path__: list[str] = []  # names of earlier releases below this module: see renamed.py


HOLDS = 1e-3
"""Position error in parts of the way that a cheapest run may have: a default verdict's."""
_SHORTER, _LONGER = (0.5, 0.25, 0.125), (2.0, 4.0, 8.0, 16.0, 32.0)  # steps of a sweep
_LOST = 0.1  # position error in parts of the way beyond which longer steps tell nothing
_LONGEST_STEP = 0.05  # of the compared time
_LONG = 5.0  # [s] a run at half the step of one that took longer is not made
_TIMED = 3  # repeats, fewer where runs are long
_LEAST_SEARCH = 20.0  # [s] that runs with other settings may take where runs are short
_SEARCH = 10.0  # times a run's own time, where they are longer


@dataclass(frozen=True)
class RunKey(OfEngine):
    """One run to be made."""

    model: str
    engine: str
    preset: str


class _KeptMachine(Spec):
    """Record of a machine: its row, and its pairs by the contents of their files."""

    machine: Machine
    pairs: dict[str, Pair]


@dataclass(frozen=True)
class FinishedRun:
    """A run of a comparison, with its motion if it came to its end."""

    record: RunRecord
    run: Run
    motion: Callable[[], Trajectory] | None = None
    errors: RunErrors | None = None  # for its pairs with other runs, if they are known already
    taken: bool = False  # whether all of it was taken from the store


# A record, its motion if it came to its end, and the errors of what was made now
_Measured = tuple[RunRecord, Callable[[], Trajectory] | None, RunErrors | None]


class MachineRuns:
    """One machine of a comparison: its reference, its row, and its runs.

    Raises:
        InputError: the duration is not valid, or the reference cannot begin.
        SimulationError: the reference failed.
    """

    def __init__(self, study: Study, mechanism: Mechanism, worker: Worker) -> None:
        self.store, self._needs, self.diagnoses = study.store, study.needs, study.diagnose
        self._study, self._sweeps = study, study.sweep
        self.runner = Runner(mechanism, worker, study.end_of(mechanism), study.law_of(mechanism))
        self._made_by, kept = conditions(*self.runner.conditions), None
        if self.store is not None:
            kept = self.store.record(mechanism.name, _KeptMachine, self._made_by)
        self._pairs = {} if kept is None else kept.pairs
        machine = machine_row(self.runner, study.needs) if kept is None else kept.machine
        needs = study.needs.texts  # they decide verdicts, and no record
        # Whether the row was taken from the store as it is
        self.taken = kept is not None and machine.needs == needs
        self.machine = machine.model_copy(update={"needs": needs})

    def run(self, case: RunKey, engine: Engine) -> FinishedRun:
        """Takes a run from the store, or makes and measures it; judges and diagnoses it.

        It may be called from any thread.
        """
        # Conditions of a record: those of the run, and the code that checks and diagnoses it
        made_by = conditions(*self.runner.conditions, engine=engine, code="comparisons/diagnosis")
        kept = self._kept(case, made_by)
        record, motion, errors = kept or self._made(case, engine)
        run, taken = judged(record, engine, self.machine, self._needs), kept is not None
        if motion is None:
            return FinishedRun(record, run)
        if run.broken and self.diagnoses:
            # A record's diagnosis is for certain tolerances: for others it is made anew, and where
            # its process failed.
            exceeded = {metric.label: metric.tolerance for metric in run.broken}
            failed = record.diagnosis is not None and record.diagnosis.note
            if failed or not (taken and record.diagnosed_for == exceeded):
                taken = False
                diagnosis = self._diagnosis(run, motion(), engine)
                update = {"diagnosis": diagnosis, "diagnosed_for": exceeded}
                record = record.model_copy(update=update)
            run = run.model_copy(update={"diagnosis": record.diagnosis})
        if self.store is not None and self.store.records is not None and not taken:
            path = self.store.path(case.model, case.label)
            record = record.model_copy(update={"trajectory": digest(path) or ""})
            self.store.keep_record(path.stem, record, made_by)
        if self._sweeps and run.outcome in COMPARED:
            run = run.model_copy(update={"sweep": tuple(self._swept(engine, record))})
        return FinishedRun(record, run, motion, errors, taken)

    def _swept(self, made: Engine, run: RunRecord) -> list[WorkPoint]:
        """Cost and errors at the step and at longer ones, until the error says nothing any more.

        Where the run is off by more than a thousandth of its way, at shorter ones as well. The run
        itself is one of them if it took long enough to be timed once.
        """
        step, longest = made.timestep, _LONGEST_STEP * self.machine.judged_to
        if step is None:
            return []
        runs, points = EngineRuns(self.runner, self.store, curves=False), list[WorkPoint]()
        way, took = self.machine.scales.way, [0.0]

        def recorded(factor: float) -> RunRecord:
            if factor == 1.0 and run.position is not None and run.is_timed:
                return run
            options = {**made.settings, "timestep": float(f"{factor * step:.10g}")}
            return runs.record(make_engine(made.name, made.preset, **options), _TIMED)

        def measured(factor: float) -> float:
            """Position error at this part of the step, in parts of the way; infinite if none."""
            record = recorded(factor)
            if record.ran:
                points.append(record.work)
                took.append(record.wall_times[0])
            return math.inf if record.position is None else record.position / way

        error = measured(1.0)
        for factor in _SHORTER if error > HOLDS else ():
            if took[-1] > _LONG or measured(factor) <= HOLDS:
                break
        for factor in _LONGER:
            if factor * step > longest or measured(factor) > _LOST:
                break
        return sorted(points, key=lambda point: -point.timestep)

    def _kept(self, case: RunKey, made_by: str) -> _Measured | None:
        """The run from the store, if its trajectory's file is unchanged."""
        if self.store is None:
            return None
        path = self.store.path(case.model, case.label)
        record = self.store.record(path.stem, RunRecord, made_by)
        if record is None or record.trajectory != digest(path):
            return None
        self.store.taken.add(path.stem)
        return record, partial(self.store.load, case.model, case.label), None

    def _made(self, case: RunKey, engine: Engine) -> _Measured:
        mechanism = self.runner.mechanism
        record = new_record(case.engine, case.preset, engine, mechanism)
        try:
            equality, diagnosis = self.runner.worker.call(check_and_diagnose, engine, mechanism)
            record = record.model_copy(update={"equality": equality, "diagnosis": diagnosis})
            if not equality.holds:
                broken = [f"{c.label} off by {format_number(c.value)}" for c in equality.broken]
                message = equality.note or (
                    f"the built model differs before any motion: {', '.join(broken)}; its motion "
                    "was not compared."
                )
                update = {"outcome": Outcome.NOT_EQUIVALENT, "message": message}
                return record.model_copy(update=update), None, None
            trajectory = self._trajectory(case, engine)
            record = record.measured(trajectory, self.runner.measured(trajectory))
            return record, lambda: trajectory, self._errors(trajectory)
        except Exception as error:
            return record.failed(error), None, None

    def _trajectory(self, case: RunKey, engine: Engine) -> Trajectory:
        if self.store is None:
            return self.runner.simulate(engine)
        problem = self.runner.problem(engine)
        parts = problem.mechanism.content_hash, problem.duration, problem.stop_law
        made_by = conditions(*parts, engine=engine)
        kept = self.store.trajectory(case.model, case.label, made_by)
        if kept is None:
            self.store.made.add(self.store.path(case.model, case.label).stem)
            kept = self.runner.simulate(engine)
            self.store.keep(kept, case.model, case.label, made_by, self.runner.worker.jobs)
        return kept

    def _diagnosis(self, run: Run, trajectory: Trajectory, engine: Engine) -> Diagnosis:
        """Made in a process: it solves and runs many changed mechanisms."""
        motions = trajectory, self.runner.solution, self.runner.end
        # One run may take longer than is foreseen: the other half of the time is left for it.
        allowed = max(_LEAST_SEARCH, _SEARCH * (run.wall_time or 0.0))
        allowed = min(allowed, self.runner.worker.timeout / 2)
        rerun = Rerun(engine, simulate, self._finest(engine), SearchTime(allowed))
        diagnose = partial(diagnose_motion, run.broken, *motions, rerun)
        try:
            return self.runner.worker.compute(diagnose, "the diagnosis")
        except Exception as error:
            return failed_diagnosis(run.broken, error)

    def _finest(self, engine: Engine) -> float | None:
        """Step of the engine's preset `settings` on this problem [s]; None where it has none."""
        if SETTINGS not in presets_of(engine.name):
            return None
        made = self._study.engine(engine.name, SETTINGS)
        return self._study.engine_for(self.machine.model, self.machine.scales, made).timestep

    def _errors(self, trajectory: Trajectory) -> RunErrors:
        reference = self.runner.reference(trajectory.t)
        return RunErrors.of(trajectory, reference, self.runner.until.thrown)

    def pairs(self, runs: Iterable[FinishedRun]) -> list[Pair]:
        """Compares every two runs that came to their end; keeps them in the store with the row."""
        moved = {finished.run.label: finished for finished in runs if finished.motion is not None}
        errors = {label: finished.errors for label, finished in moved.items()}

        def errors_of(label: str) -> RunErrors:
            known, motion = errors[label], moved[label].motion
            if known is None:
                assert motion is not None
                known = errors[label] = self._errors(motion())
            return known

        pairs: dict[str, Pair] = {}
        for first, second in combinations(moved, 2):
            labels = first, second
            key = ", ".join(f"{label}: {moved[label].record.trajectory}" for label in labels)
            pair = self._pairs.get(key)
            if pair is None:
                model, end = self.machine.model, self.machine.judged_to
                pair = pair_of(model, labels, errors_of(first), errors_of(second), end)
            pairs[key] = pair
        self.taken = self.taken and pairs.keys() <= self._pairs.keys()
        if self.store is not None and not (self.taken and all(run.taken for run in moved.values())):
            kept = _KeptMachine(machine=self.machine, pairs=self._pairs | pairs)
            self.store.keep_record(self.machine.model, kept, self._made_by)
        return list(pairs.values())


@dataclass(frozen=True, repr=False)
class Comparison(Reported):
    """Results, and the motions behind them; motions of earlier runs are read when asked for."""

    results: Results
    solutions: Mapping[str, Solution]  # reference motion by model
    trajectories: Mapping[tuple[str, str], Trajectory]
    """Motions by model and run label ('mujoco assisted')."""
    repeated: bool = False  # all was taken from the store: nothing was measured now

    def headline(self) -> str:
        """Tell how many runs came out how."""
        counts = Counter(run.outcome.value for run in self.results.runs)
        outcomes = ", ".join(f"{number} {outcome}" for outcome, number in counts.items())
        models = ", ".join(machine.model for machine in self.results.machines)
        return f"Comparison of {models}: {outcomes}"

    def rows(self) -> Iterator[dict[str, object]]:
        """A quantity of a run a row."""
        for run in self.results.runs:
            head = {"model": run.model, "engine": run.engine, "preset": run.preset}
            head["outcome"] = run.outcome.value
            for metric in run.metrics:
                yield {**head, **metric.model_dump(), "holds": metric.holds}

    @property
    def passed(self) -> bool:
        """No tolerance broken, no run failed."""
        return self.results.passed


def compare(
    models: Models = ("fixed", "rolling"),
    engines: Engines | None = None,
    presets: Names | None = None,
    *,
    parameters: Spec | None = None,
    options: Mapping[str, Any] | None = None,
    timestep: float | None = None,
    duration: float | None = None,
    until: str | float | None = None,
    tolerances: Mapping[str, float | str] | None = None,
    stop_law: StopLaw | str | None = None,
    store: Store | None = None,
    isolate: bool = True,
    diagnose: bool = True,
    sweep: bool = False,
    timeout: float = 600.0,
    jobs: int | None = None,
    cluster: Any = None,
    progress: Callable[[RunKey, int, int], None] | None = None,
    **more_options: Any,
) -> Comparison:
    """Measure engines against the reference: `tb.compare("fixed", "mujoco").plot()`.

    Args:
        models: one or several: names of machines or of the library's problems, paths of mechanisms'
            .json files, mechanisms, or problems.
        engines: one or several: names, or engines as `tb.engine` makes them; all known ones but the
            reference if left out. Those not installed become rows that say so.
        presets: of 'default', 'settings' and 'assisted'; those of the engines given, else all that
            an engine has, if left out.
        parameters: of the named machines, all of one class; their defaults if left out.
        options: over each preset's: of every engine that has them, or of one, as 'mujoco.solref'.
        timestep: of every engine [s]; each preset's own if left out.
        duration: end of the compared motion [s]; a problem's own, else the reference's launch, if
            left out.
        until: the end in other words: 'launch:MARKER', 'release:STOP', or a time [s].
        tolerances: needs by quantity, in its unit or in parts of its scale, e.g. {'position': 1e-3,
            'energy': '0.1%'}; for one subject 'position:projectile'; for whatever has none,
            'default'. What is left out is held against the engine's claim or the default.
        stop_law: 'release-once' or 'unilateral'; a problem's own, else 'release-once', if left out.
        store: where trajectories are kept and, if asked, taken from again.
        isolate: simulate in a process of its own, so that an engine's crash costs only its row.
        diagnose: look for the causes of exceeded tolerances, which runs changed mechanisms and may
            take several times as long as the runs themselves; without it, verdicts are the same.
        sweep: run at longer time steps as well, and at shorter ones where a run is off by more than
            a thousandth of its way, for work-precision diagrams; doubles the time of the runs.
        timeout: longest wait for one isolated run [s]; a longer run becomes a failed row.
        jobs: references, runs and diagnoses made at once, each in a process; the results but for
            wall times are the same in the same order.
        cluster: Dask cluster that makes them instead: address of its scheduler, path of a scheduler
            file, a `distributed.Client`, or what :func:`cluster` gives; as many at once as it has
            threads.
        progress: called before each case with the number done and the number of all.
        more_options: further ones of `options`.

    Raises:
        InputError: a name or a value is not valid. A run that fails raises nothing: it becomes a
            failed row.
    """
    study = Study.of(
        models,
        engines,
        presets,
        parameters=parameters,
        options={**(options or {}), **more_options},
        timestep=timestep,
        duration=duration,
        until=until,
        stop_law=stop_law,
        tolerances=tolerances,
        store=store,
        isolate=isolate,
        diagnose=diagnose,
        sweep=sweep,
        timeout=timeout,
        jobs=jobs,
        cluster=cluster,
    )
    return compare_study(study, progress)


def compare_study(
    study: Study, progress: Callable[[RunKey, int, int], None] | None = None
) -> Comparison:
    """Measure the engines of a study (not its own `progress`); raises as :func:`compare`."""
    cases = [
        RunKey(m.name, name, preset)
        for m in study.mechanisms
        for name in study.compared_engines
        for preset in study.presets_of(name)
    ]
    # Every engine is made before the first run, so that a wrong name or option costs no waiting.
    engines = {(c.engine, c.preset): study.engine(c.engine, c.preset) for c in cases}
    by_name = {mechanism.name: mechanism for mechanism in study.mechanisms}
    finished: dict[RunKey, FinishedRun] = {}
    pairs: list[Pair] = []
    with study.worker() as worker:

        def solved(mechanism: Mechanism) -> MachineRuns | SimulationError:
            try:
                return MachineRuns(study, mechanism, worker)
            except SimulationError as error:
                return error

        references = in_order(solved, study.mechanisms, study.at_once)
        machines = dict(zip(by_name, references, strict=True))

        def run(case: RunKey) -> FinishedRun:
            machine, engine = machines[case.model], engines[case.engine, case.preset]
            if isinstance(machine, SimulationError):
                record = new_record(case.engine, case.preset, engine, by_name[case.model])
                record = record.failed(machine)
                return FinishedRun(record, run_row(record, engine, by_name[case.model]))
            return machine.run(case, study.engine_for(case.model, machine.machine.scales, engine))

        with closing(in_order(run, cases, study.at_once)) as results:
            for done, case in enumerate(cases):
                if progress is not None:
                    progress(case, done, len(cases))
                finished[case] = next(results)
        moved = {name: each for name, each in machines.items() if isinstance(each, MachineRuns)}
        for name, machine in moved.items():
            pairs += machine.pairs(each for case, each in finished.items() if case.model == name)
    motions = {
        (case.model, case.label): each.motion
        for case, each in finished.items()
        if each.motion is not None
    }
    return Comparison(
        Results.made_here(
            machines=tuple(machine.machine for machine in moved.values()),
            runs=tuple(each.run for each in finished.values()),
            pairs=tuple(pairs),
            **study.times,
        ),
        OnDemand({name: lambda m=machine: m.runner.solution for name, machine in moved.items()}),
        OnDemand(motions),
        all(machine.taken for machine in moved.values())
        and all(each.taken or each.motion is None for each in finished.values()),
    )


def stored(folder: str | Path) -> Comparison:
    """Results and motions of an earlier comparison; the reference is solved again, no engine runs.

    Raises:
        InputError: the folder holds no comparison, or a file of it cannot be read.
    """
    results = read_results(folder)
    store = Store(Path(folder) / "trajectories")
    kept = {(run.model, run.label): store.path(run.model, run.label) for run in results.ran}
    missing = [str(path) for path in kept.values() if not path.is_file()]
    if missing:
        raise InputError(f"trajectory {missing[0]!r} is missing; make the comparison again.")
    solutions = {
        m.model: Until("time", m.compared_to).solve(m.mechanism, m.stop_law)[0]
        for m in results.machines
    }
    trajectories = {key: load(path) for key, path in kept.items()}
    return Comparison(results, solutions, trajectories, repeated=True)


def read_results(path: str | Path) -> Results:
    """Results of a comparison, by the path of results.json or of the folder that holds it.

    Raises:
        InputError: the file is not there, is of another kind or format, or is broken.
    """
    path = Path(path)
    path = path / "results.json" if path.is_dir() else path
    # A file of another kind or format is refused at once, before its fields are read.
    needed = f"a results.json of `trebucheck compare` has {FORMAT!r}: make it again."
    format_of(path, (FORMAT,), needed)
    results = Results.load(path)
    runs = Counter((run.model, run.engine, run.preset) for run in results.runs)
    twice = [name for name, number in runs.items() if number > 1]
    if twice:
        raise InputError(f"{path}: the run {', '.join(twice[0])} is there twice; once is needed.")
    known = {machine.model for machine in results.machines}
    for run in results.runs:
        if run.outcome in COMPARED and run.model not in known:
            raise InputError(
                f"{path}: there are runs of {run.model!r}, which is not among the machines."
            )
    return results


def format_of(path: Path, formats: Collection[str], needed: str) -> object:
    """The format that a file of results states.

    Raises:
        InputError: it is not JSON, or of none of these formats; the sentence ends with what is
            needed.
    """
    text = read_bytes(path, Results.largest_file)
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        raise InputError(
            f"{path} is not JSON; the results.json of `trebucheck compare` is needed."
        ) from None
    stated = content.get("format") if isinstance(content, dict) else None
    if stated not in formats:
        has = "no format" if stated is None else f"format {str(stated)[:60]!r}"
        raise InputError(f"{path} has {has}; {needed}")
    return stated
