"""Machines x engines x presets: run each, measure each, lose none."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import closing
from dataclasses import asdict, dataclass
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np

from ...engines.protocol import Engine
from ...engines.registry import engine_class
from ...models.errors import SimulationError, UnwritableError
from ...models.launch import LAUNCH_ANGLE
from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw
from ...models.spec import Spec
from ...models.trajectory import Trajectory
from ...reference.solution import Solution
from ..diagnosis.model import check_and_diagnose
from ..diagnosis.motion import diagnose_motion
from ..report.numbers import format_number
from ..runs.pairs import Compared, pair_of
from ..runs.results import Diagnosis, Equality, Machine, Outcome, Pair, Results, Run, SingularPosition, verdict_on
from ..runs.runner import Runner, Worker, failure, simulate_warm
from ..runs.store import Store, conditions, digest
from ..runs.study import PRESETS, OnDemand, Study, in_order, one_end
from ..runs.tolerances import Needs, is_table_one, judge


@dataclass(frozen=True)
class Comparison:
    """Results, and the motions behind them; motions of runs that were finished before are read when asked for."""

    results: Results
    solutions: Mapping[str, Solution]
    """Reference motion by model."""
    trajectories: Mapping[tuple[str, str], Trajectory]
    """By model and run label ('mujoco tuned')."""
    repeated: bool = False
    """Every run and every figure was taken from the store: nothing was measured now."""

    @property
    def passed(self) -> bool:
        """No tolerance broken, no run failed."""
        return self.results.passed


@dataclass(frozen=True)
class Case:
    """One run to be made."""

    model: str
    engine: str
    preset: str

    @property
    def label(self) -> str:
        """As the report names it."""
        return f"{self.engine} {self.preset}"


def compare(
    models: Iterable[str | Mechanism | Problem] = ("fixed", "rolling"),
    engines: Iterable[str] | None = None,
    presets: Iterable[str] = PRESETS,
    *,
    parameters: Spec | None = None,
    timestep: float | None = None,
    duration: float | None = None,
    until: str | float | None = None,
    tolerances: Mapping[str, float | str] | None = None,
    stop_law: StopLaw | str | None = None,
    store: Store | None = None,
    isolate: bool = True,
    timeout: float = 600.0,
    progress: Callable[[Case, int, int], None] | None = None,
    **options: Any,
) -> Comparison:
    """Run engines on machines and measure them against the reference, up to the launch.

    Args:
        models: names of machines or of the library's problems, mechanisms of your own, or problems.
        engines: names; all known ones if left out. Those not installed become rows that say so.
        presets: 'tuned', 'stock', or both.
        parameters: of the named machines, all of one class; their defaults if left out.
        timestep: of every engine [s]; each preset's own if left out.
        duration: end of the compared motion [s]; a problem's own, else the reference's launch, if left out.
        until: the end in other words: 'launch:MARKER', 'release:STOP', or a time [s].
        tolerances: needs by quantity, in its unit or in parts of its scale, e.g. {'position': 1e-3, 'energy': '0.1%'};
            for one subject 'position:projectile'; for whatever has none, 'default'. What is left out is held against
            the engine's claim or the default.
        stop_law: 'release-once' or 'unilateral'; a problem's own, else 'release-once', if left out.
        store: where trajectories are kept and, if asked, taken from again.
        isolate: simulate in a process of its own, so that an engine's crash costs only its row.
        timeout: longest wait for one isolated run [s]; what takes longer becomes a failed row.
        progress: called before each case with the number done and the number of all.
        options: further options, each for every engine that has it, or as 'mujoco.solref' (a key of a mapping given
            with two asterisks) for one.

    Raises:
        InputError: a name or a value is not valid. A run that fails raises nothing: it becomes a failed row.
    """
    study = Study(
        models=models,
        engines=engines,
        presets=presets,
        parameters=parameters,
        options=options if timestep is None else {"timestep": timestep, **options},
        stop_law=stop_law,
        until=one_end(duration, until),
        tolerances=tolerances,
        store=store,
        isolate=isolate,
        timeout=timeout,
    )
    return compare_study(study, progress)


def compare_study(study: Study, progress: Callable[[Case, int, int], None] | None = None) -> Comparison:
    """As :func:`compare`, of a study; `study.jobs` engine runs are made at once, results stay in the same order.

    Args:
        study: its own `progress` is not used.
        progress: called before each case is measured, with the number done and the number of all.

    Raises:
        InputError: as :func:`compare`.
    """
    cases = [
        Case(m.name, name, preset) for m in study.mechanisms for name in study.every_engine for preset in study.presets
    ]
    # Every engine is made before the first run, so that a wrong name or option costs no waiting.
    engines = {(c.engine, c.preset): study.engine(c.engine, c.preset) for c in cases}
    with study.worker() as worker:
        machines = {m.name: _machine_runs(study, m, worker) for m in study.mechanisms}

        def own(case: Case) -> Engine:
            made, runs = engines[case.engine, case.preset], machines[case.model]
            return study.engine_for(runs.machine, made) if isinstance(runs, _MachineRuns) else made

        def simulated(case: Case) -> _RunRecord | _Simulated:
            return machines[case.model].simulated(case, own(case))

        with closing(in_order(simulated, cases, study.jobs)) as results:
            for done, case in enumerate(cases):
                if progress is not None:
                    progress(case, done, len(cases))
                machines[case.model].add(case, own(case), next(results))
        moved = {name: runs for name, runs in machines.items() if isinstance(runs, _MachineRuns)}
        pairs = [pair for runs in moved.values() for pair in runs.pairs()]
    return Comparison(
        Results.made_here(
            machines=tuple(runs.machine for runs in moved.values()),
            runs=tuple(run for runs in machines.values() for run in runs.runs),
            pairs=tuple(pairs),
        ),
        OnDemand({name: lambda runs=runs: runs.runner.solution for name, runs in moved.items()}),
        OnDemand({(name, label): make for name, runs in moved.items() for label, make in runs.motions.items()}),
        all(runs.repeated for runs in machines.values()),
    )


class _MachineRecord(Spec):
    """What a store keeps of a machine: its row, and its pairs by what their trajectories' files hold."""

    machine: Machine
    pairs: dict[str, Pair]


class _RunRecord(Spec):
    """What a store keeps of a run beside its trajectory."""

    trajectory: str
    """SHA-256 of the trajectory's file."""
    run: Run


@dataclass(frozen=True)
class _Simulated:
    """What an engine did with a case."""

    equality: Equality | None
    diagnosis: Diagnosis | None
    trajectory: Trajectory | None = None
    error: Exception | None = None

    def motion(self) -> Trajectory:
        """The trajectory; raises the engine's error where there is none."""
        if self.error is not None:
            raise self.error
        assert self.trajectory is not None
        return self.trajectory


def _machine_runs(study: Study, mechanism: Mechanism, worker: Worker) -> _MachineRuns | _FailedMachine:
    try:
        return _MachineRuns(study, mechanism, worker)
    except SimulationError as error:
        return _FailedMachine(error)


class _FailedMachine:
    """A machine whose reference failed: no engine runs on it, and each of its rows says why."""

    repeated = False

    def __init__(self, error: SimulationError) -> None:
        self.error, self.runs = error, list[Run]()

    def simulated(self, case: Case, engine: Engine) -> _Simulated:
        """Nothing."""
        return _Simulated(None, None, error=self.error)

    def add(self, case: Case, engine: Engine, _: object) -> None:
        """Note the failure as a row."""
        outcome, message = failure(self.error)
        run = _row(case, engine, outcome)
        self.runs.append(run.model_copy(update={"message": message}))


class _MachineRuns:
    """One machine: its reference, its runs so far, and what the store has of them.

    Raises:
        InputError: the duration is not valid, or the reference cannot begin.
        SimulationError: the reference failed.
    """

    def __init__(self, study: Study, mechanism: Mechanism, worker: Worker) -> None:
        self.store, self._needs = study.store, study.needs
        self.runner = Runner(mechanism, worker, study.end_of(mechanism), study.law_of(mechanism))
        self.runs: list[Run] = []
        self.motions: dict[str, Callable[[], Trajectory]] = {}
        self._compared: dict[str, Compared] = {}
        self._files: dict[str, str] = {}
        self._parts = (mechanism.content_hash, repr(self.runner.until), repr(study.needs), self.runner.law.value)
        """Of the conditions under which a record is used again: whatever decides its content must be among them."""
        self._kept = self.store.record(mechanism.name, _MachineRecord, conditions(*self._parts)) if self.store else None
        self.machine = self._kept.machine if self._kept else machine_row(self.runner, self._needs)
        self.repeated = self._kept is not None

    def simulated(self, case: Case, engine: Engine) -> _RunRecord | _Simulated:
        """The finished run from the store, or what the engine does now; may be called from several threads."""
        record = self._finished(case, engine)
        if record is not None:
            return record
        equality, diagnosis = None, None
        try:
            equality, diagnosis = self.runner.worker.call(check_and_diagnose, engine, self.runner.mechanism)
            trajectory = self._trajectory(case, engine) if equality.holds else None
        except UnwritableError:
            raise
        except Exception as error:
            return _Simulated(equality, diagnosis, error=error)
        return _Simulated(equality, diagnosis, trajectory)

    def add(self, case: Case, engine: Engine, result: _RunRecord | _Simulated) -> None:
        """Take a finished run over, or measure a new one; in the order of the cases."""
        if isinstance(result, _RunRecord):
            assert self.store is not None
            self.store.taken.add(self.store.path(case.model, case.label).stem)
            self._files[case.label] = result.trajectory
            self.motions[case.label] = lambda: self._load(case)
            self.runs.append(result.run)
        else:
            self.repeated = False
            self.runs.append(self._measured(case, engine, result))

    def _load(self, case: Case) -> Trajectory:
        assert self.store is not None
        return self.store.load(case.model, case.label)

    def _finished(self, case: Case, engine: Engine) -> _RunRecord | None:
        if self.store is None:
            return None
        path = self.store.path(case.model, case.label)
        record = self.store.record(path.stem, _RunRecord, conditions(*self._parts, engine=engine))
        return record if record is not None and record.trajectory == digest(path) else None

    def _measured(self, case: Case, engine: Engine, simulated: _Simulated) -> Run:
        checked = {"equality": simulated.equality, "diagnosis": simulated.diagnosis}
        run = _row(case, engine, Outcome.NOT_JUDGED).model_copy(update=checked)
        if simulated.equality is not None and not simulated.equality.holds:
            return run.model_copy(update={"outcome": Outcome.NOT_EQUIVALENT, "message": _unequal(simulated.equality)})
        try:
            trajectory = simulated.motion()
            metrics = self.runner.measured(trajectory)
        except Exception as error:
            outcome, message = failure(error)
            return run.model_copy(update={"outcome": outcome, "message": message})
        cost = {"steps": trajectory.provenance.steps, "wall_time": trajectory.provenance.wall_time}
        run = run.model_copy(update={"metrics": metrics, **cost})
        judged = judge(run, self.machine, self._needs)
        run = run.model_copy(update={"metrics": judged, "outcome": verdict_on(judged)})
        if run.broken:
            run = run.model_copy(update={"diagnosis": self._diagnosed(run, trajectory, engine)})
        self.motions[case.label] = lambda: trajectory
        self._compared[case.label] = self._for_pairs(trajectory)
        self._keep(case, engine, run)
        return run

    def _trajectory(self, case: Case, engine: Engine) -> Trajectory:
        if self.store is None:
            return self.runner.simulate(engine)
        problem = self.runner.problem(engine)
        made_by = conditions(problem.mechanism.content_hash, problem.duration, problem.stop_law, engine=engine)
        kept = self.store.trajectory(case.model, case.label, made_by)
        if kept is None:
            self.store.made.add(self.store.path(case.model, case.label).stem)
            kept = self.runner.simulate(engine)
            self.store.keep(kept, case.model, case.label, made_by)
        return kept

    def _keep(self, case: Case, engine: Engine, run: Run) -> None:
        """Write what was measured, for a trajectory that is in the store."""
        if self.store is None or self.store.records is None:
            return
        path = self.store.path(case.model, case.label)
        file = self._files[case.label] = digest(path) or ""
        record = _RunRecord(trajectory=file, run=run)
        self.store.keep_record(path.stem, record, conditions(*self._parts, engine=engine))

    def _diagnosed(self, run: Run, trajectory: Trajectory, engine: Engine) -> Diagnosis | None:
        motions = trajectory, self.runner.solution, self.runner.end
        diagnose = partial(diagnose_motion, run, *motions, engine, simulate_warm)
        try:
            return self.runner.worker.compute(diagnose, "the diagnosis")  # it solves and runs many changed machines
        except Exception:  # a diagnosis that fails must not cost the row it is about
            return None

    def pairs(self) -> list[Pair]:
        """Every two runs that moved, compared with each other; kept in the store with the machine's row."""
        kept = self._kept.pairs if self._kept else {}
        pairs: dict[str, Pair] = {}
        for labels in combinations(self.motions, 2):
            key = ", ".join(f"{label}: {self._files.get(label)}" for label in labels)
            pairs[key] = kept.get(key) or self._pair(*labels)
        self.repeated = self.repeated and pairs.keys() <= kept.keys()
        if self.store and not self.repeated:
            record = _MachineRecord(machine=self.machine, pairs=kept | pairs)
            self.store.keep_record(self.machine.model, record, conditions(*self._parts))
        return list(pairs.values())

    def _for_pairs(self, trajectory: Trajectory) -> Compared:
        return Compared.of(trajectory, self.runner.reference(trajectory.t), self.runner.until.thrown)

    def _pair(self, first: str, second: str) -> Pair:
        for label in (first, second):
            if label not in self._compared:
                trajectory = self.motions[label]()
                self._compared[label] = self._for_pairs(trajectory)
        end = self.machine.judged_to
        return pair_of(self.machine.model, (first, second), self._compared[first], self._compared[second], end)


def machine_row(runner: Runner, needs: Needs) -> Machine:
    """A machine as compared: the reference's figures, its scales and how far it is known."""
    mechanism, solution, end = runner.mechanism, runner.solution, runner.end
    launch = solution.launch_at(LAUNCH_ANGLE, runner.until.thrown)
    uncertainties = runner.uncertainties
    return Machine(
        model=mechanism.name,
        mechanism=mechanism,
        mechanism_hash=mechanism.content_hash,
        table_one=is_table_one(mechanism),
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
        singular_positions=tuple(SingularPosition(**asdict(p)) for p in solution.singular_passages if p.time <= end),
        release_times=dict(solution.release_times),
        start_torques={name: float(torque[0]) for name, torque in solution.motion(np.zeros(1)).stop_torques.items()},
    )


def _row(case: Case, engine: Engine, outcome: Outcome) -> Run:
    version = engine_class(case.engine).version()
    return Run(model=case.model, engine=case.engine, preset=case.preset, engine_version=version,
               settings=engine.settings, outcome=outcome)  # fmt: skip


def _unequal(equality: Equality) -> str:
    if equality.note:
        return equality.note
    broken = ", ".join(f"{check.label} off by {format_number(check.value)}" for check in equality.broken)
    return f"the built model differs before any motion: {broken}; its motion was not compared."
