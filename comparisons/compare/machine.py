"""One machine of a comparison: its reference, its runs, their measures, and what a store keeps of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from itertools import combinations

import numpy as np

from ...engines.protocol import Engine
from ...engines.registry import engine_class, engine_study
from ...engines.study import StepOrder
from ...engines.supplied import stated
from ...models.errors import SimulationError, UnwritableError
from ...models.launch import LAUNCH_ANGLE
from ...models.mechanism import Mechanism
from ...models.spec import Spec
from ...models.trajectory import Trajectory
from ..diagnosis.diagnose import check_and_diagnose, diagnose_motion, failed_diagnosis
from ..diagnosis.rerun import Rerun
from ..report.numbers import format_number
from ..runs.pairs import Compared, pair_of
from ..runs.process import Worker, simulate
from ..runs.results import (
    Diagnosis,
    Equality,
    Machine,
    Outcome,
    Pair,
    Run,
    SingularPosition,
    verdict_on,
)
from ..runs.runner import Runner, failure, time_limit
from ..runs.store import conditions, digest
from ..runs.study import Study
from ..runs.tolerances import Needs, is_table_one, judge


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


class _MachineRecord(Spec):
    """What a store keeps of a machine: its row, and its pairs by what their trajectories' files hold."""

    machine: Machine
    pairs: dict[str, Pair]


class RunRecord(Spec):
    """What a store keeps of a run beside its trajectory."""

    trajectory: str
    """SHA-256 of the trajectory's file."""
    run: Run


@dataclass(frozen=True)
class MadeRun:
    """A run that was made and measured now, and its motion where it has one."""

    run: Run
    trajectory: Trajectory | None = None
    compared: Compared | None = None


class FailedMachine:
    """A machine whose reference failed: no engine runs on it, and each of its rows says why."""

    repeated = False

    def __init__(self, error: SimulationError) -> None:
        self.error, self.runs = error, list[Run]()

    def made(self, case: Case, engine: Engine) -> MadeRun:
        """A row that says why."""
        outcome, message = failure(self.error)
        ended = {"message": message, "time_limit": time_limit(self.error)}
        return MadeRun(_row(case, engine, outcome).model_copy(update=ended))

    def add(self, case: Case, engine: Engine, result: RunRecord | MadeRun) -> None:
        """Take the row."""
        self.runs.append(result.run)


class MachineRuns:
    """One machine: its reference, its runs so far, and what the store has of them.

    Raises:
        InputError: the duration is not valid, or the reference cannot begin.
        SimulationError: the reference failed.
    """

    def __init__(self, study: Study, mechanism: Mechanism, worker: Worker) -> None:
        self.store, self._needs = study.store, study.needs
        self.runner = Runner(mechanism, worker, study.end_of(mechanism), study.law_of(mechanism))
        self.runs: list[Run] = []
        self.diagnoses = True
        """Whether the causes of what is broken are looked for."""
        self.motions: dict[str, Callable[[], Trajectory]] = {}
        self._compared: dict[str, Compared] = {}
        self._files: dict[str, str] = {}
        self._parts = (
            mechanism.content_hash,
            repr(self.runner.until),
            repr(study.needs),
            self.runner.law.value,
        )
        """Of the conditions under which a record is used again: whatever decides its content must be among them."""
        self._kept = (
            self.store.record(mechanism.name, _MachineRecord, conditions(*self._parts))
            if self.store
            else None
        )
        self.machine = self._kept.machine if self._kept else machine_row(self.runner, self._needs)
        self.repeated = self._kept is not None

    def made(self, case: Case, engine: Engine) -> RunRecord | MadeRun:
        """The finished run from the store, or one made, measured and diagnosed now; from any thread."""
        return self._finished(case, engine) or self._made(case, engine)

    def add(self, case: Case, engine: Engine, result: RunRecord | MadeRun) -> None:
        """Take a run over; in the order of the cases."""
        self.runs.append(result.run)
        if isinstance(result, RunRecord):
            assert self.store is not None
            self.store.taken.add(self.store.path(case.model, case.label).stem)
            self._files[case.label] = result.trajectory
            self.motions[case.label] = lambda: self._load(case)
            return
        self.repeated = False
        if result.trajectory is not None and result.compared is not None:
            self.motions[case.label] = lambda trajectory=result.trajectory: trajectory
            self._compared[case.label] = result.compared
            self._keep(case, engine, result.run)

    def _load(self, case: Case) -> Trajectory:
        assert self.store is not None
        return self.store.load(case.model, case.label)

    def _finished(self, case: Case, engine: Engine) -> RunRecord | None:
        if self.store is None:
            return None
        path = self.store.path(case.model, case.label)
        record = self.store.record(path.stem, RunRecord, conditions(*self._parts, engine=engine))
        return record if record is not None and record.trajectory == digest(path) else None

    def _made(self, case: Case, engine: Engine) -> MadeRun:
        run = _row(case, engine, Outcome.NOT_JUDGED)
        try:
            equality, diagnosis = self.runner.worker.call(
                check_and_diagnose, engine, self.runner.mechanism
            )
            run = run.model_copy(update={"equality": equality, "diagnosis": diagnosis})
            if not equality.holds:
                unequal = {"outcome": Outcome.NOT_EQUIVALENT, "message": _unequal(equality)}
                return MadeRun(run.model_copy(update=unequal))
            trajectory = self._trajectory(case, engine)
            metrics = self.runner.measured(trajectory)
        except UnwritableError:
            raise
        except Exception as error:
            outcome, message = failure(error)
            ended = {"outcome": outcome, "message": message, "time_limit": time_limit(error)}
            return MadeRun(run.model_copy(update=ended))
        return self._judged(run.model_copy(update={"metrics": metrics}), trajectory, engine)

    def _judged(self, run: Run, trajectory: Trajectory, engine: Engine) -> MadeRun:
        cost = {"steps": trajectory.provenance.steps, "wall_time": trajectory.provenance.wall_time}
        judged = judge(run, self.machine, self._needs)
        run = run.model_copy(update={"metrics": judged, "outcome": verdict_on(judged), **cost})
        if run.broken and self.diagnoses:
            run = run.model_copy(update={"diagnosis": self._diagnosed(run, trajectory, engine)})
        return MadeRun(run, trajectory, self._for_pairs(trajectory))

    def _trajectory(self, case: Case, engine: Engine) -> Trajectory:
        if self.store is None:
            return self.runner.simulate(engine)
        problem = self.runner.problem(engine)
        made_by = conditions(
            problem.mechanism.content_hash, problem.duration, problem.stop_law, engine=engine
        )
        kept = self.store.trajectory(case.model, case.label, made_by)
        if kept is None:
            self.store.made.add(self.store.path(case.model, case.label).stem)
            kept = self.runner.simulate(engine)
            self.store.keep(kept, case.model, case.label, made_by, self.runner.worker.jobs)
        return kept

    def _keep(self, case: Case, engine: Engine, run: Run) -> None:
        """Write what was measured, for a trajectory that is in the store."""
        if self.store is None or self.store.records is None:
            return
        path = self.store.path(case.model, case.label)
        file = self._files[case.label] = digest(path) or ""
        record = RunRecord(trajectory=file, run=run)
        self.store.keep_record(path.stem, record, conditions(*self._parts, engine=engine))

    def _diagnosed(self, run: Run, trajectory: Trajectory, engine: Engine) -> Diagnosis:
        motions = trajectory, self.runner.solution, self.runner.end
        diagnose = partial(diagnose_motion, run.broken, *motions, Rerun(engine, simulate))
        try:
            return self.runner.worker.compute(
                diagnose, "the diagnosis"
            )  # it solves and runs many changed machines
        except Exception as error:
            return failed_diagnosis(run.broken, error)

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
        return Compared.of(
            trajectory, self.runner.reference(trajectory.t), self.runner.until.thrown
        )

    def _pair(self, first: str, second: str) -> Pair:
        for label in (first, second):
            if label not in self._compared:
                trajectory = self.motions[label]()
                self._compared[label] = self._for_pairs(trajectory)
        end = self.machine.judged_to
        return pair_of(
            self.machine.model, (first, second), self._compared[first], self._compared[second], end
        )


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
        singular_positions=tuple(
            SingularPosition(**asdict(p)) for p in solution.singular_passages if p.time <= end
        ),
        release_times=dict(solution.release_times),
        start_torques={
            name: float(torque[0])
            for name, torque in solution.motion(np.zeros(1)).stop_torques.items()
        },
    )


def _row(case: Case, engine: Engine, outcome: Outcome) -> Run:
    version = engine_class(case.engine).version()
    declared = engine_study(case.engine).step_orders.get(case.preset, StepOrder(None, ""))
    return Run(model=case.model, engine=case.engine, preset=case.preset, engine_version=version,
               scheme=declared.scheme, order=declared.order, supplied=stated(engine), settings=engine.settings,
               outcome=outcome)  # fmt: skip


def _unequal(equality: Equality) -> str:
    if equality.note:
        return equality.note
    broken = ", ".join(
        f"{check.label} off by {format_number(check.value)}" for check in equality.broken
    )
    return f"the built model differs before any motion: {broken}; its motion was not compared."
