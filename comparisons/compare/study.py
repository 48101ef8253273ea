"""Machines x engines x presets: run each, measure each, lose none."""

from __future__ import annotations

import platform
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np
from pydantic import JsonValue

from ...engines.protocol import Engine
from ...engines.registry import engine, engine_class, engine_names
from ...models.errors import EngineNotInstalledError, InputError, TrebucheckError, UnsupportedProblemError
from ...models.machines.registry import model
from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw
from ...models.spec import Spec
from ...models.trajectory import Trajectory
from ...reference.certification.certificate import reference_uncertainty
from ...reference.solution import Solution
from ...reference.solver import solve, solve_to_launch
from ..diagnosis.model import gate
from ..diagnosis.motion import diagnose_motion
from ..report.numbers import format_number
from ..runs.metrics import measure
from ..runs.pairs import against_each_other
from ..runs.results import Diagnosis, Equality, Machine, Metric, Outcome, Pair, Results, Run
from ..runs.store import Store
from ..runs.tolerances import judge
from ..runs.worker import Worker, simulate_warm


@dataclass(frozen=True)
class _Runner:
    """How engines are called: here, or in a process of their own."""

    simulate: Callable[[Engine, Problem], Trajectory]
    gate: Callable[[Engine, Mechanism], tuple[Equality, Diagnosis | None]]


PRESETS = ("tuned", "stock")
_TAIL_STEPS, _TAIL = 20, 0.02  # an engine runs on past the reference's launch, so that its own can be found
_REFERENCE_TAIL = 1.0  # [s] and the reference further still


@dataclass(frozen=True)
class Comparison:
    """Results, and the motions behind them."""

    results: Results
    solutions: dict[str, Solution]
    """Reference motion by model."""
    trajectories: dict[tuple[str, str], Trajectory]
    """By model and run label ('mujoco tuned')."""

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


@dataclass(frozen=True)
class _Setup:
    """A machine with its reference."""

    machine: Machine
    solution: Solution
    stop_law: StopLaw
    peaks: dict[str, float]


def compare(
    models: Iterable[str | Mechanism] = ("fixed", "rolling"),
    engines: Iterable[str] | None = None,
    presets: Iterable[str] = PRESETS,
    *,
    parameters: Spec | None = None,
    timestep: float | None = None,
    duration: float | None = None,
    stop_law: StopLaw | str = StopLaw.RELEASE_ONCE,
    store: Store | None = None,
    isolate: bool = True,
    timeout: float = 600.0,
    progress: Callable[[Case, int, int], None] | None = None,
    **options: Any,
) -> Comparison:
    """Run engines on machines and measure them against the reference, up to the launch.

    Args:
        models: names of machines (:func:`...models.machines.registry.models`) or mechanisms of your own.
        engines: names; all known ones if left out. Those not installed become rows that say so.
        presets: 'tuned', 'stock', or both.
        parameters: of the named machines, all of one class; their defaults if left out.
        timestep: of every engine [s]; each preset's own if left out.
        duration: end of the compared motion [s]; the reference's launch if left out.
        stop_law: 'release-once' or 'unilateral'.
        store: where trajectories are kept and, if asked, taken from again.
        isolate: simulate in a process of its own, so that an engine's crash costs only its row.
        timeout: longest wait for one isolated run [s]; what takes longer becomes a failed row.
        progress: called before each case with the number done and the number of all.
        options: further options for every engine that has them.

    Raises:
        InputError: a name or a value is not valid. A run that fails raises nothing: it becomes a failed row.
    """
    if not timeout > 0:
        raise InputError(f"timeout = {timeout!r} s must be positive.")
    law = _law(stop_law)
    mechanisms = _mechanisms(models, parameters)
    names = _unique(engines if engines is not None else engine_names())
    cases = [Case(mechanism.name, name, preset) for mechanism in mechanisms for name in names for preset in presets]
    makers = {(case.engine, case.preset): _checked_engine(case, timestep, options) for case in cases}
    setups = {mechanism.name: _setup(mechanism, duration, law) for mechanism in mechanisms}
    trajectories: dict[tuple[str, str], Trajectory] = {}
    runs: list[Run] = []
    with Worker(timeout) as worker:
        calls = _Runner(worker.simulate, partial(worker.call, gate)) if isolate else _Runner(simulate_warm, gate)
        for done, case in enumerate(cases):
            if progress:
                progress(case, done, len(cases))
            run, trajectory = _run(case, makers[case.engine, case.preset], setups[case.model], store, calls)
            runs.append(run)
            if trajectory is not None:
                trajectories[case.model, case.label] = trajectory
    pairs = tuple(_pairs(setups, trajectories))
    machines = tuple(setup.machine for setup in setups.values())
    results = _results(machines, runs, pairs)
    return Comparison(results, {name: setup.solution for name, setup in setups.items()}, trajectories)


def _law(stop_law: StopLaw | str) -> StopLaw:
    try:
        return StopLaw(stop_law)
    except ValueError:
        valid = ", ".join(law.value for law in StopLaw)
        raise InputError(f"stop_law = {stop_law!r} is unknown; there are: {valid}.") from None


def _unique(names: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(names))


def _mechanisms(models: Iterable[str | Mechanism], parameters: Spec | None) -> list[Mechanism]:
    found = [model(m, parameters) if isinstance(m, str) else m for m in models]
    by_name = {mechanism.name: mechanism for mechanism in found}
    if not by_name:
        raise InputError("no model was named; at least one is needed.")
    return list(by_name.values())


def _checked_engine(case: Case, timestep: float | None, options: dict[str, Any]) -> Engine:
    """Make every engine before the first run, so that a wrong name or option costs no waiting."""
    own = dict(options) if timestep is None else {"timestep": timestep, **options}
    return engine(case.engine, case.preset, **own)


def _setup(mechanism: Mechanism, duration: float | None, law: StopLaw) -> _Setup:
    solution, end = _reference(mechanism, duration, law)
    launch = solution.launch
    uncertainties = reference_uncertainty(solution, end)
    start = solution.motion(np.zeros(1))
    times = np.linspace(0.0, end, 2001)
    peaks = {name: float(torque.max()) for name, torque in solution.motion(times).stop_torques.items()}
    machine = Machine(
        model=mechanism.name,
        mechanism=mechanism,
        mechanism_hash=mechanism.content_hash,
        table_one=_is_table_one(mechanism),
        compared_to=end,
        launch_time=launch.time if launch else None,
        launch_speed=launch.speed if launch else None,
        reference_uncertainty=uncertainties.values,
        uncertainty_source=uncertainties.source,
        impacts=sum(time <= end for time, _ in solution.impacts),
        release_times=dict(solution.release_times),
        start_torques={name: float(torque[0]) for name, torque in start.stop_torques.items()},
    )
    return _Setup(machine, solution, law, peaks)


def _reference(mechanism: Mechanism, duration: float | None, law: StopLaw) -> tuple[Solution, float]:
    """The reference motion, somewhat longer than the compared one, and the end of that [s]."""
    if duration is not None:
        asked = Problem(mechanism, duration=duration, stop_law=law)
        return solve(Problem(mechanism, duration=asked.duration + _REFERENCE_TAIL, stop_law=law)), asked.duration
    solution = solve_to_launch(mechanism, law)
    return solution, solution.launch.time if solution.launch else solution.problem.duration


def _is_table_one(mechanism: Mechanism) -> bool:
    try:
        return model(mechanism.name).content_hash == mechanism.content_hash
    except InputError:
        return False


def _run(
    case: Case, runner: Engine, setup: _Setup, store: Store | None, calls: _Runner
) -> tuple[Run, Trajectory | None]:
    settings = runner.settings
    run = Run(
        model=case.model,
        engine=case.engine,
        preset=case.preset,
        outcome=Outcome.OK,
        engine_version=engine_class(case.engine).version(),
        settings=settings,
    )
    try:
        equality, diagnosis = calls.gate(runner, setup.machine.mechanism)
        run = run.model_copy(update={"equality": equality, "diagnosis": diagnosis})
        if not equality.holds:
            return run.model_copy(update={"outcome": Outcome.UNEQUAL, "message": _unequal(equality)}), None
        trajectory = _trajectory(case, runner, setup, settings, store, calls.simulate)
        metrics = measure(trajectory, setup.solution, setup.machine.compared_to)
    except TrebucheckError as error:
        return run.model_copy(update={"outcome": _outcome_of(error), "message": str(error)}), None
    except Exception as error:  # a plug-in may raise anything; the report must survive it
        message = f"{type(error).__name__}: {error}"
        return run.model_copy(update={"outcome": Outcome.FAILED, "message": message}), None
    run = _judged(run, trajectory, metrics, setup)
    if run.broken:
        run = run.model_copy(update={"diagnosis": _diagnosed(run, trajectory, setup, runner, calls)})
    return run, trajectory


def _unequal(equality: Equality) -> str:
    if equality.note:
        return equality.note
    broken = ", ".join(f"{check.label} off by {format_number(check.value)}" for check in equality.broken)
    return f"the built model differs before any motion: {broken}; its motion was not compared."


def _diagnosed(run: Run, trajectory: Trajectory, setup: _Setup, runner: Engine, calls: _Runner) -> Diagnosis | None:
    try:
        return diagnose_motion(run, trajectory, setup.solution, setup.machine.compared_to, runner, calls.simulate)
    except Exception:  # a diagnosis that fails must not cost the row it is about
        return None


def _outcome_of(error: TrebucheckError) -> Outcome:
    if isinstance(error, EngineNotInstalledError):
        return Outcome.ABSENT
    return Outcome.UNSUPPORTED if isinstance(error, UnsupportedProblemError) else Outcome.FAILED


def _trajectory(
    case: Case,
    runner: Engine,
    setup: _Setup,
    settings: dict[str, JsonValue],
    store: Store | None,
    simulate: Callable[[Engine, Problem], Trajectory],
) -> Trajectory:
    step = settings.get("timestep")
    tail = max(_TAIL, _TAIL_STEPS * step) if isinstance(step, float) else _TAIL
    duration = min(setup.machine.compared_to + tail, setup.solution.problem.duration)
    problem = Problem(setup.machine.mechanism, duration=duration, stop_law=setup.stop_law)
    if store is None:
        return simulate(runner, problem)
    return store.kept_or_made(case.label, settings, problem, lambda: simulate(runner, problem))


def _judged(base: Run, trajectory: Trajectory, metrics: Sequence[Metric], setup: _Setup) -> Run:
    provenance = trajectory.provenance
    run = base.model_copy(
        update={"metrics": tuple(metrics), "steps": provenance.steps, "wall_time": provenance.wall_time}
    )
    run = run.model_copy(update={"metrics": judge(run, setup.machine, setup.peaks)})
    return run.model_copy(update={"outcome": Outcome.BROKEN if run.broken else Outcome.OK})


def _pairs(setups: dict[str, _Setup], trajectories: dict[tuple[str, str], Trajectory]) -> Iterable[Pair]:
    for model_name, setup in setups.items():
        own = {label: t for (name, label), t in trajectories.items() if name == model_name}
        for first, second in combinations(own, 2):
            yield against_each_other(
                setup.solution, (first, own[first]), (second, own[second]), setup.machine.compared_to
            )


def _results(machines: tuple[Machine, ...], runs: list[Run], pairs: tuple[Pair, ...]) -> Results:
    from ...version import __version__

    return Results(
        trebucheck_version=__version__,
        python_version=platform.python_version(),
        platform=f"{platform.system()} {platform.machine()}",
        machines=machines,
        runs=tuple(runs),
        pairs=pairs,
    )
