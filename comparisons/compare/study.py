"""Machines x engines x presets: run each, measure each, lose none."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from typing import Any

from ...engines.protocol import Engine
from ...models.errors import SimulationError
from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw
from ...models.shown import Reported
from ...models.spec import Spec
from ...models.trajectory import Trajectory
from ...reference.solution import Solution
from ..runs.process import Worker
from ..runs.results import Results
from ..runs.store import Store
from ..runs.study import PRESETS, OnDemand, Study, in_order, one_end
from .machine import Case, FailedMachine, MachineRuns, MadeRun, RunRecord


@dataclass(frozen=True, repr=False)
class Comparison(Reported):
    """Results, and the motions behind them; motions of runs that were finished before are read when asked for."""

    results: Results
    solutions: Mapping[str, Solution]
    """Reference motion by model."""
    trajectories: Mapping[tuple[str, str], Trajectory]
    """By model and run label ('mujoco tuned')."""
    repeated: bool = False
    """Every run and every figure was taken from the store: nothing was measured now."""

    def headline(self) -> str:
        """How many runs came out how."""
        counts = Counter(run.outcome.value for run in self.results.runs)
        found = ", ".join(f"{number} {outcome}" for outcome, number in counts.items())
        return f"Comparison of {', '.join(machine.model for machine in self.results.machines)}: {found}"

    def rows(self) -> Iterator[dict[str, object]]:
        """A quantity of a run a row."""
        for run in self.results.runs:
            head = {
                "model": run.model,
                "engine": run.engine,
                "preset": run.preset,
                "outcome": run.outcome.value,
            }
            for metric in run.metrics:
                yield {**head, **metric.model_dump(), "holds": metric.holds}

    @property
    def passed(self) -> bool:
        """No tolerance broken, no run failed."""
        return self.results.passed


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
    jobs: int = 1,
    progress: Callable[[Case, int, int], None] | None = None,
    **options: Any,
) -> Comparison:
    """Measure engines on machines against the reference, to the launch: `tb.compare(["fixed"], ["mujoco"]).plot()`.

    Args:
        models: names of machines or of the library's problems, mechanisms of your own, or problems.
        engines: names; all known ones if left out. Those not installed become rows that say so.
        presets: 'tuned', 'stock', or both.
        parameters: of the named machines, all of one class; their defaults if left out.
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
        timeout: longest wait for one isolated run [s]; what takes longer becomes a failed row.
        jobs: references, runs and diagnoses made at once, each in a process; the results but for
            wall times are the same in the same order.
        progress: called before each case with the number done and the number of all.
        options: further options, each for every engine that has it, or as 'mujoco.solref' (a key of
            a mapping given with two asterisks) for one.

    Raises:
        InputError: a name or a value is not valid. A run that fails raises nothing: it becomes a
            failed row.
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
        jobs=jobs,
    )
    return compare_study(study, progress)


def compare_study(
    study: Study, progress: Callable[[Case, int, int], None] | None = None
) -> Comparison:
    """As :func:`compare`, of a study.

    Args:
        study: its own `progress` is not used.
        progress: called before each case is measured, with the number done and the number of all.

    Raises:
        InputError: as :func:`compare`.
    """
    cases = [
        Case(m.name, name, preset)
        for m in study.mechanisms
        for name in study.every_engine
        for preset in study.presets
    ]
    # Every engine is made before the first run, so that a wrong name or option costs no waiting.
    engines = {(c.engine, c.preset): study.engine(c.engine, c.preset) for c in cases}
    with study.worker() as worker:
        solved = in_order(partial(_machine_runs, study, worker), study.mechanisms, study.jobs)
        machines = dict(zip((m.name for m in study.mechanisms), solved, strict=True))

        def own(case: Case) -> Engine:
            made, runs = engines[case.engine, case.preset], machines[case.model]
            if not isinstance(runs, MachineRuns):
                return made
            return study.engine_for(case.model, runs.machine.scales.time, made)

        def made(case: Case) -> RunRecord | MadeRun:
            return machines[case.model].made(case, own(case))

        with closing(in_order(made, cases, study.jobs)) as results:
            for done, case in enumerate(cases):
                if progress is not None:
                    progress(case, done, len(cases))
                machines[case.model].add(case, own(case), next(results))
        moved = {name: runs for name, runs in machines.items() if isinstance(runs, MachineRuns)}
        pairs = [pair for runs in moved.values() for pair in runs.pairs()]
    return Comparison(
        Results.made_here(
            machines=tuple(runs.machine for runs in moved.values()),
            runs=tuple(run for runs in machines.values() for run in runs.runs),
            pairs=tuple(pairs),
        ),
        OnDemand({name: lambda runs=runs: runs.runner.solution for name, runs in moved.items()}),
        OnDemand(
            {
                (name, label): make
                for name, runs in moved.items()
                for label, make in runs.motions.items()
            }
        ),
        all(runs.repeated for runs in machines.values()),
    )


def _machine_runs(
    study: Study, worker: Worker, mechanism: Mechanism
) -> MachineRuns | FailedMachine:
    try:
        return MachineRuns(study, mechanism, worker)
    except SimulationError as error:
        return FailedMachine(error)
