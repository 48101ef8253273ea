"""Engine x problem x quantity, from results of `compare` and `converge` and from older matrices.

A matrix keeps of each run what its cell shows: its verdict, an error with its tolerance for each
quantity, its cause, what of it is the engine's own, its settings and versions. Files of releases
that kept less are read as well; what they lack is None.
"""

from __future__ import annotations

import json
import math
import shlex
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum
from functools import cache, cached_property
from itertools import combinations
from pathlib import Path
from statistics import median
from typing import Annotated, Any, Literal, TypeVar

from pydantic import Field, JsonValue, model_validator

from ..engines.presets import FORMER_NAMES, PRESETS
from ..engines.supplied import Own, concerned, own
from ..models.errors import InputError
from ..models.features import features_of
from ..models.library.registry import find_benchmark, model_of
from ..models.problem import Problem, StopLaw
from ..models.spec import Positive, Real, Spec
from .compare import HOLDS, format_of, read_results
from .converge import FORMAT as CONVERGE
from .converge import Studies
from .runs.quantities import QUANTITIES, MetricKind, parse_label
from .runs.results import FORMAT as COMPARE
from .runs.results import (
    REFERENCE,
    Check,
    Machine,
    OfEngine,
    Outcome,
    ResultFile,
    Results,
    Run,
    WorkPoint,
    optional,
    share_of,
    verdict_on,
    with_time_limit,
)

__path__: list[str] = []  # names of earlier releases below this module: see renamed.py

FORMAT = "trebucheck-matrix-1"
POSITION = "position_max"
"""Quantity by which schemes and implementations are compared."""


def preset_rank(preset: str) -> tuple[int, str]:
    """Place of a preset in tables, as a key to sort by; those of plug-ins' own come last."""
    present = FORMER_NAMES.get(preset, preset)
    order = (*PRESETS, present)
    return order.index(present), preset


class Error(Spec):
    """Errors of a run in one quantity.

    Value, tolerance and subject are those of the figure that is farthest beyond its tolerance, or
    nearest to it where all hold; without tolerances of the largest one.
    """

    metric: str
    subject: str | None = optional(None, "marker, stop or joint, if it is of one")
    value: Real | None = Field(description="None where a figure is missing; `note` says why")
    unit: str
    part: Real | None = Field(
        description="the largest of the quantity's figures in parts of their scales, which are the "
        "same for all engines; None where one is missing"
    )
    observed: bool = optional(True, "false: the engine does not tell it, or it is not determined")
    tolerance: Real | None = optional(None, "of that figure")
    source: Literal["need", "claim", "default"] | None = optional(None, "of the tolerance")
    holds: bool | None = optional(None, "all of the quantity's figures; None: not judged")
    judged: Annotated[int, Field(ge=0)] | None = optional(
        None, "figures with a tolerance; None: not kept in this file"
    )
    held: Annotated[int, Field(ge=0)] = optional(0, "figures within their tolerance")
    note: str | None = optional(None, "why there is no value, or no tolerance")

    @property
    def ratio(self) -> float | None:
        """Value / tolerance; infinite for a missing value, None without a tolerance."""
        return share_of(self.value, self.tolerance)

    @property
    def kept(self) -> bool:
        """Tell whether its value is the one that the verdict is about.

        Files of earlier releases keep the largest figure, which may hold while another one breaks.
        """
        return self.judged is not None or self.holds is not False or (self.ratio or 0.0) > 1.0


class Breach(Spec):
    """The figure of a run that is the farthest beyond its tolerance, or the nearest to it."""

    label: str
    ratio: Real | None = Field(description="of the error to its tolerance; None: no figure")

    @property
    def kind(self) -> MetricKind:
        """Its kind of metric."""
        return QUANTITIES[parse_label(self.label)[0]]


class MatrixRun(OfEngine, Spec):
    """An engine and preset on a problem."""

    problem: str
    engine: str
    preset: str
    engine_version: str
    scheme: str = Field(default="", description="as its study names it; '': not stated")
    order: Real | None = Field(default=None, description="declared; None: no power of the step")
    supplied: dict[str, str] | None = Field(
        default=None, description="what trebucheck does in its place, by part; None: not stated"
    )
    timestep: Positive | None = Field(default=None, description="[s]")
    outcome: Outcome
    message: str | None = optional(None, "the refusal's or the failure's sentence")
    time_limit: Real | None = optional(None, "of a run that timed out [s]")
    judged: Annotated[int, Field(ge=0)] = 0
    held: Annotated[int, Field(ge=0)] = 0
    worst: Breach | None = None
    errors: tuple[Error, ...] = ()
    first_in: str | None = optional(None, "figure that leaves its tolerance first")
    first_at: Real | None = optional(None, "when [s]; None: before any motion, or not kept")
    causes: tuple[str, ...] = optional((), "likeliest; empty where unknown or not looked for")
    explained: Real | None = optional(None, "share, by the first cause")
    confirmed: bool = optional(False, "the first cause, by a run of the engine without it")
    settings: dict[str, JsonValue] | None = optional(None, "None: not kept in this file")
    steps: Annotated[int, Field(ge=0)] | None = optional(None, "None: not kept, or none was made")
    wall_time: Real | None = optional(None, "of the whole run, warm [s]; None: not kept, no run")
    cost: Real | None = optional(
        None, "processor time without our reading, where that is told apart [s]; None: not kept"
    )
    date: str = Field(description="of the file of runs, YYYY-MM-DD")
    made_by: str = Field(description="version of trebucheck")
    commit: str | None = optional(None, "of trebucheck's sources; None: not kept in this file")

    @property
    def made_text(self) -> str:
        """Version of trebucheck, commit and date that the run was made with."""
        commit = "" if self.commit is None else f" at {self.commit}"
        return f"trebucheck {self.made_by}{commit}, {self.date}"

    @model_validator(mode="before")
    @classmethod
    def _read_old_outcome(cls, given: Any) -> Any:
        return with_time_limit(given)

    def error(self, metric: str) -> Error | None:
        """Error of a quantity; None if the run has none."""
        return next((error for error in self.errors if error.metric == metric), None)

    def own_on(self, problem: MatrixProblem) -> Own | None:
        """Share of the run that is the engine's; None where it is not stated."""
        if self.supplied is None:
            return None
        affected = concerned(
            stops=problem.stops,
            impacts=problem.group is ProblemClass.IMPACTS,
            loops=problem.loops,
            elements=problem.elements,
        )
        return own(self.supplied, affected)

    @property
    def is_dynamics(self) -> bool:
        """Tell whether its steps are trebucheck's.

        Such a run speaks for an engine's mass matrix and forces alone, and is counted apart.
        """
        return self.supplied is not None and own(self.supplied) is Own.DYNAMICS


class ProblemClass(StrEnum):
    """Classes of problems, by what they ask of an engine; in the order of columns."""

    CHAINS = "open chains"
    ELEMENTS = "springs, dampers, motors"
    LOOPS = "loops"
    STOPS = "releases"  # of stops that open once
    IMPACTS = "impacts"


class MatrixProblem(Spec):
    """A problem as compared."""

    name: str
    number: str = Field(
        default="", description="by which the library sorts it; '' where it is not from there"
    )
    mechanism_hash: str
    stop_law: str
    judged_to: Real = Field(description="[s]")
    stops: bool
    loops: bool
    elements: bool = Field(default=False, description="springs, dampers or motors")
    features: tuple[str, ...] | None = optional(
        None, "elements that not every engine has; None: not kept in this file"
    )
    until: Real | None = optional(None, "end that was asked for [s]; None: the problem's own")

    @property
    def group(self) -> ProblemClass:
        """Its class."""
        if self.stops:
            met = self.stop_law == StopLaw.UNILATERAL
            return ProblemClass.IMPACTS if met else ProblemClass.STOPS
        if self.loops:
            return ProblemClass.LOOPS
        return ProblemClass.ELEMENTS if self.elements else ProblemClass.CHAINS

    @cached_property
    def arguments(self) -> str:
        """Options of `compare` that ask for it; NAME.json is the file of a mechanism of its own."""
        library = _library_problem(self.name)
        if library is None or library.mechanism.content_hash != self.mechanism_hash:
            until = self.judged_to if self.until is None else self.until
            options = ["--models", f"{self.name}.json", "--until", f"{until:.10g}"]
            own_law = StopLaw.RELEASE_ONCE
        else:
            options = ["--models", self.name]
            if self.until is not None:
                options += ["--until", f"{self.until:.10g}"]
            own_law = library.stop_law
        if self.stop_law != own_law:
            options += ["--stop-law", self.stop_law]
        return shlex.join(options)


@cache
def _library_problem(name: str) -> Problem | None:
    """The machine or problem of that name with its default parameters; None if there is none."""
    try:
        model = model_of(name)
    except InputError:
        return None
    return model if isinstance(model, Problem) else Problem(model, duration=1.0)


def command_of(run: MatrixRun, problem: MatrixProblem) -> str:
    """Command line that makes a run again where its engine is installed."""
    step = "" if run.timestep is None else f" --timestep {run.timestep!r}"
    return (
        f"trebucheck compare {problem.arguments} --engines {run.engine} --preset {run.preset}{step}"
    )


class MeasuredOrder(OfEngine, Spec):
    """Convergence of an engine's position error with the time step, by `trebucheck converge`."""

    engine: str
    preset: str
    problem: str
    exponent: Real | None = Field(description="None: no power of the step was found")
    half_width: Real | None = Field(default=None, description="of its 95 % confidence interval")
    floor: Real | None = Field(default=None, description="[m]; None: not reached")
    floor_cause: str = Field(default="", description="what sets it")


class DynamicsCheck(OfEngine, Spec):
    """Mass matrix, forces and accelerations of an engine in random states of a problem."""

    problem: str
    engine: str
    preset: str
    engine_version: str
    states: Annotated[int, Field(ge=0)]
    checks: tuple[Check, ...]


class StepCost(Spec):
    """Cost and position error at one time step."""

    timestep: Positive = Field(description="[s]")
    steps: Annotated[int, Field(ge=0)]
    cost: Real = Field(description="processor time without our reading, median [s]")
    part: Real = Field(description="largest position error, of the longest way of a point")


class CostSweep(OfEngine, Spec):
    """An engine and preset on a problem at several time steps."""

    problem: str
    engine: str
    preset: str
    engine_version: str
    points: tuple[StepCost, ...]
    processor: str | None = optional(None, "that they were measured on")
    date: str = optional("", "of the file of runs, YYYY-MM-DD")

    @property
    def cheapest(self) -> StepCost | None:
        """The cheapest of its steps that hold `HOLDS`, of equal ones the longest; None: none."""
        holding = (point for point in self.points if point.part <= HOLDS)
        return min(holding, key=lambda point: (point.cost, -point.timestep), default=None)


class Matrix(ResultFile):
    """Runs of several comparisons side by side; the reference's own are left out."""

    format: Literal["trebucheck-matrix-1"] = FORMAT
    problems: tuple[MatrixProblem, ...]
    runs: tuple[MatrixRun, ...]
    orders: tuple[MeasuredOrder, ...] = ()
    dynamics: tuple[DynamicsCheck, ...] = optional((), "of engines that trebucheck's steps move")
    sweeps: tuple[CostSweep, ...] = optional((), "of time steps, where they were measured")

    @cached_property
    def presets(self) -> tuple[str, ...]:
        """Presets of the runs, from what an engine does by itself to what is done for it."""
        return tuple(sorted({run.preset for run in self.runs}, key=preset_rank))

    def of_commit(self, commit: str) -> Matrix:
        """Returns the same, with this commit kept with the runs that have none."""
        runs = tuple(
            run.model_copy(update={"commit": commit}) if run.commit is None else run
            for run in self.runs
        )
        return self.model_copy(update={"runs": runs})

    def run(self, label: str, problem: str) -> MatrixRun | None:
        """The run of an engine and preset on a problem; None if it was not made."""
        return next((run for run in self.of(label) if run.problem == problem), None)

    def cheapest(self, engine: str, problem: str) -> tuple[CostSweep, StepCost] | None:
        """Preset and step of an engine that hold `HOLDS` of the position at the least cost.

        None: nothing was measured, or no step holds it.
        """
        found = [
            (sweep, point)
            for sweep in self.sweeps
            if (sweep.engine, sweep.problem) == (engine, problem)
            and (point := sweep.cheapest) is not None
        ]
        return min(found, key=lambda pair: (pair[1].cost, -pair[1].timestep), default=None)

    def schemes(self) -> dict[str, list[str]]:
        """Engines with their presets by scheme, alphabetically; those without one last."""
        schemes: dict[str, dict[str, None]] = {}
        for run in sorted(self.runs, key=lambda run: (run.engine, preset_rank(run.preset))):
            schemes.setdefault(run.scheme, {})[run.label] = None
        names = sorted(schemes, key=lambda name: (not name, name.lower()))
        return {name: [*schemes[name]] for name in names}

    def of(self, label: str) -> Iterable[MatrixRun]:
        """Runs of an engine and preset."""
        return (run for run in self.runs if run.label == label)

    def to_json(self) -> str:
        """JSON text with a line for each problem, run and order: the files are kept, and grow."""
        lines: list[str] = []
        for name, value in self.model_dump(mode="json").items():
            text = json.dumps(value, ensure_ascii=False)
            if isinstance(value, list):
                items = ",\n".join(json.dumps(item, ensure_ascii=False) for item in value)
                text = f"[\n{items}\n]"
            lines.append(f'"{name}": {text}')
        return "{\n" + ",\n".join(lines) + "\n}"


_SAME_END = 1e-6  # of the end: horizons are computed, and other libraries round otherwise
_Part = TypeVar("_Part", MatrixRun, MeasuredOrder, DynamicsCheck)


def matrix(files: str | Path | Iterable[str | Path], *, commit: str | None = None) -> Matrix:
    """Put results of several comparisons together: engine x problem x quantity.

        >>> import trebucheck as tb
        >>> found = tb.matrix(["report", "converge/converge.json"])  # doctest: +SKIP
        >>> [(order.engine, order.exponent) for order in found.orders]  # doctest: +SKIP

    Args:
        files: one or several paths: of results.json of `compare`, converge.json of `converge` and
            data of `matrix`, or of folders with one.
        commit: of trebucheck's sources, kept with the runs that have none; default: unknown.

    Raises:
        InputError: there is no file, a file is of another kind or broken, two files have the same
            run, or they mean different mechanisms or motions by one name; or the commit is empty.
    """
    if commit is not None and not commit.strip():
        raise InputError(f"commit = {commit!r} is empty; the name of a commit is needed.")
    paths = [Path(files)] if isinstance(files, str | Path) else [Path(file) for file in files]
    if not paths:
        raise InputError("no file: the results.json of one comparison at least is needed.")
    parts = [(path, _read(path)) for path in paths]
    runs = _once("the run", [(path, run) for path, part in parts for run in part.runs])
    runs = tuple(run for run in runs if run.engine != REFERENCE)
    orders = _once("the order of", [(path, order) for path, part in parts for order in part.orders])
    checks = _once("the check of", [(path, each) for path, part in parts for each in part.dynamics])
    if not runs:
        raise InputError(f"{', '.join(map(str, paths))}: there is no run of any engine.")
    # One name is one mechanism and motion
    problems: dict[str, tuple[Path, MatrixProblem]] = {}
    for path, part in parts:
        for problem in part.problems:
            before, other = problems.setdefault(problem.name, (path, problem))
            same = problem.mechanism_hash == other.mechanism_hash
            same = same and problem.stop_law == other.stop_law
            if not (same and math.isclose(problem.judged_to, other.judged_to, rel_tol=_SAME_END)):
                raise InputError(
                    f"{problem.name!r} is another mechanism or motion in {path} than in "
                    f"{before}; a matrix compares engines on the same."
                )
    classes = [*ProblemClass]
    ordered = sorted(
        (problem for _, problem in problems.values()),
        key=lambda problem: (classes.index(problem.group), problem.number, problem.name),
    )
    sweeps = tuple(_longest(sweep for _, part in parts for sweep in part.sweeps))
    found = Matrix.made_here(
        problems=tuple(ordered), runs=runs, orders=orders, dynamics=checks, sweeps=sweeps
    )
    return found if commit is None else found.of_commit(commit)


def _longest(sweeps: Iterable[CostSweep]) -> Iterable[CostSweep]:
    """Sweeps, the one with most steps of each run: `compare` and `converge` may both have one."""
    kept: dict[tuple[str, str], CostSweep] = {}
    for sweep in sweeps:
        known = kept.setdefault((sweep.label, sweep.problem), sweep)
        if len(sweep.points) > len(known.points):
            kept[sweep.label, sweep.problem] = sweep
    return kept.values()


def _once(what: str, parts: Iterable[tuple[Path, _Part]]) -> tuple[_Part, ...]:
    """Parts of all files; none may be there twice."""
    merged: dict[tuple[str, str], tuple[Path, _Part]] = {}
    for path, part in parts:
        before, known = merged.setdefault((part.label, part.problem), (path, part))
        if known is not part:
            raise InputError(
                f"{what} {part.label} on {part.problem} is in {before} and in {path}; once is "
                "needed."
            )
    return tuple(part for _, part in merged.values())


def _read(path: Path) -> Matrix:
    """A file, or the one file of a folder, as a matrix."""
    if path.is_dir():
        names = ("results.json", "converge.json", "matrix.json")
        inside = [path / name for name in names if (path / name).is_file()]
        if len(inside) != 1:
            raise InputError(
                f"{path} holds {len(inside)} of results.json, converge.json and matrix.json; name "
                "one file."
            )
        path = inside[0]
    formats = (COMPARE, CONVERGE, FORMAT)
    stated = format_of(path, formats, f"needed is one of {', '.join(formats)}.")
    if stated == FORMAT:
        return Matrix.load(path)
    if stated == CONVERGE:
        studies = Studies.load(path)
        orders, sweeps = tuple(orders_of(studies)), tuple(sweeps_of(studies))
        return Matrix.made_here(problems=(), runs=(), orders=orders, sweeps=sweeps)
    date = datetime.fromtimestamp(path.stat().st_mtime, UTC).date().isoformat()
    return distilled(read_results(path), date)


def orders_of(studies: Studies) -> Iterator[MeasuredOrder]:
    """Orders of the sweeps of the time step in which something moved."""
    for machine in studies.machines:
        for study in machine.studies:
            if study.knob != "timestep" or all(p.position is None for p in study.points):
                continue
            law, floor = study.curve("position").law, study.curve("position").floor
            yield MeasuredOrder(
                engine=study.engine,
                preset=study.preset,
                problem=machine.model,
                exponent=None if law is None else law.exponent,
                half_width=None if law is None else law.half_width,
                floor=None if floor is None else floor.error,
                floor_cause="" if floor is None else floor.cause,
            )


def sweeps_of(studies: Studies) -> Iterator[CostSweep]:
    """Sweeps of the time step with what each point costs."""
    for machine in studies.machines:
        for study in machine.studies:
            points = [point.work for point in study.points if point.work is not None]
            costs = tuple(_step_costs(points, machine.way))
            if costs:
                yield CostSweep(
                    problem=machine.model,
                    engine=study.engine,
                    preset=study.preset,
                    engine_version=study.engine_version,
                    points=costs,
                    processor=studies.processor,
                )


def _step_costs(points: Iterable[WorkPoint], way: float | None) -> Iterator[StepCost]:
    """Points whose cost and position error are known; none without the way that is its scale."""
    for point in points:
        error = point.errors.get(POSITION)
        if way is not None and error is not None and point.cost is not None:
            yield StepCost(
                timestep=point.timestep, steps=point.steps, cost=point.cost, part=error / way
            )


def distilled(results: Results, date: str) -> Matrix:
    """The part of a comparison that a matrix needs; the reference against itself is left out."""
    machines = {machine.model: machine for machine in results.machines}
    problems: list[MatrixProblem] = []
    for name, machine in machines.items():
        mechanism, entry = machine.mechanism, find_benchmark(name)
        problem = MatrixProblem(
            name=name,
            number="" if entry is None else entry.number,
            mechanism_hash=machine.mechanism_hash,
            stop_law=machine.stop_law,
            judged_to=machine.judged_to,
            stops=bool(mechanism.stops),
            loops=bool(mechanism.loop_joints),
            elements=bool(mechanism.force_elements or mechanism.couplers),
            features=tuple(features_of(mechanism)),
            until=_end_asked_for(machine),
        )
        problems.append(problem)
    runs: list[MatrixRun] = []
    dynamics: list[DynamicsCheck] = []
    for run in results.runs:
        if run.engine == REFERENCE:
            continue
        kept = _run(run, machines.get(run.model), date, results.trebucheck_version)
        runs.append(kept)
        if kept.is_dynamics and run.equality is not None and run.equality.exposed:
            check = DynamicsCheck(
                problem=run.model,
                engine=run.engine,
                preset=run.preset,
                engine_version=run.engine_version,
                states=run.equality.states,
                checks=run.equality.checks,
            )
            dynamics.append(check)
    sweeps: list[CostSweep] = []
    for run in results.runs:
        if run.engine != REFERENCE and run.sweep and run.model in machines:
            sweep = CostSweep(
                problem=run.model,
                engine=run.engine,
                preset=run.preset,
                engine_version=run.engine_version,
                points=tuple(_step_costs(run.sweep, machines[run.model].scales.way)),
                processor=results.processor,
                date=date,
            )
            sweeps.append(sweep)
    return Matrix.made_here(
        problems=tuple(problems),
        runs=tuple(runs),
        dynamics=tuple(dynamics),
        sweeps=tuple(sweeps),
    )


def _end_asked_for(machine: Machine) -> float | None:
    """End of the motion, where it is not the problem's own duration or a machine's launch [s]."""
    library = _library_problem(machine.model)
    usual = machine.launch_time
    if library is not None and find_benchmark(machine.model) is not None:
        usual = library.duration
    if usual is not None and math.isclose(machine.compared_to, usual, rel_tol=_SAME_END):
        return None
    return machine.compared_to


def _run(run: Run, machine: Machine | None, date: str, version: str) -> MatrixRun:
    diagnosis, step = run.diagnosis, run.settings.get("timestep")
    causes = () if diagnosis is None else diagnosis.named
    # Of the error to its tolerance; infinite for a missing value
    ratios = {metric.label: metric.share or 0.0 for metric in run.judged}
    worst = max(ratios, key=ratios.__getitem__, default=None)
    return MatrixRun(
        problem=run.model,
        engine=run.engine,
        preset=run.preset,
        engine_version=run.engine_version,
        scheme=run.scheme,
        order=run.order,
        supplied=run.supplied,
        timestep=step if isinstance(step, float) else None,
        outcome=run.outcome,
        message=run.message,
        time_limit=run.time_limit,
        judged=len(run.judged),
        held=len(run.judged) - len(run.broken),
        worst=None if worst is None else Breach(label=worst, ratio=_finite(ratios[worst])),
        errors=() if machine is None else tuple(_errors(run, machine)),
        first_in=None if diagnosis is None or diagnosis.note else diagnosis.leads,
        first_at=None if diagnosis is None or diagnosis.note else diagnosis.parts_at,
        causes=tuple(cause.name for cause in causes),
        explained=causes[0].explained if causes else None,
        confirmed=bool(causes) and causes[0].confirmed,
        settings=run.settings,
        steps=run.steps or None,
        wall_time=run.wall_time,
        cost=run.cost,
        date=date,
        made_by=version,
    )


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


_HOLDS = {Outcome.AGREES: True, Outcome.DISAGREES: False, Outcome.NOT_JUDGED: None}


def _errors(run: Run, machine: Machine) -> Iterator[Error]:
    """Errors in each quantity that has a verdict of its own, where the run has figures of it."""
    for name, quantity in QUANTITIES.items():
        metrics = [metric for metric in run.metrics if metric.name == name]
        if not metrics or quantity.follows is not None:
            continue
        scales = machine.scales_for(invariant=quantity.invariant)
        # Errors as parts of the quantity's scale; infinite where there is no value
        parts: dict[str, float] = {}
        for metric in metrics:
            size = math.inf if metric.value is None else abs(metric.value)
            scale = quantity.scale_of(scales, metric.subject, machine.mechanism)
            parts[metric.label] = size / scale
        observed = [metric for metric in metrics if metric.observed] or metrics
        judged = [metric for metric in observed if metric.holds is not None]
        if judged:
            farthest = max(judged, key=lambda metric: metric.share or 0.0)
        else:
            farthest = max(observed, key=lambda metric: parts[metric.label])
        yield Error(
            metric=name,
            subject=farthest.subject,
            value=farthest.value,
            unit=farthest.unit,
            part=_finite(max(parts[metric.label] for metric in observed)),
            observed=farthest.observed,
            tolerance=farthest.tolerance,
            source=farthest.source,
            note=farthest.note,
            holds=_HOLDS[verdict_on(tuple(metrics))],
            judged=len(judged),
            held=sum(metric.holds is True for metric in judged),
        )


# Spread of engines of one scheme

FLOOR = 1e-12  # part of the scale: smaller errors are rounding over thousands of steps, count as it


@dataclass(frozen=True)
class Ratio:
    """Ratio of two errors, the larger by the smaller."""

    value: float
    runs: str  # which two, and on which problem


@dataclass(frozen=True)
class Spread:
    """Spread of one scheme, on problems with stops or loops or on those without."""

    scheme: str
    constrained: bool
    engines: tuple[str, ...]
    moved: tuple[str, ...]  # those of them whose steps are trebucheck's: one implementation
    within: tuple[Ratio, ...]  # of two engines of the scheme
    between: tuple[Ratio, ...]  # of one of them and one of another scheme


def spreads(matrix: Matrix) -> Iterator[Spread]:
    """Spread of every scheme that two engines have, where there are pairs."""
    for scheme, labels in matrix.schemes().items():
        runs = [run for label in labels for run in matrix.of(label)]
        engines = sorted({run.engine for run in runs})
        if not scheme or len(engines) < 2:
            continue
        moved = sorted({run.engine for run in runs if own(run.supplied or {}) is Own.DYNAMICS})
        for constrained in (False, True):
            within: list[Ratio] = []
            between: list[Ratio] = []
            for problem in matrix.problems:
                if (problem.stops or problem.loops) != constrained:
                    continue
                for a, b, ratio in _pairs(matrix, problem.name):
                    if a.scheme == b.scheme == scheme:
                        within.append(ratio)
                    elif scheme in (a.scheme, b.scheme):
                        between.append(ratio)
            if within:
                pairs = tuple(within), tuple(between)
                yield Spread(scheme, constrained, tuple(engines), tuple(moved), *pairs)


def _pairs(matrix: Matrix, problem: str) -> Iterator[tuple[MatrixRun, MatrixRun, Ratio]]:
    """Two runs of different engines with equal steps, and the ratio of their errors."""
    errors: list[tuple[MatrixRun, float]] = []
    for run in matrix.runs:
        error = run.error(POSITION)
        part = error.part if error is not None and error.observed else None
        if run.problem == problem and run.scheme and part is not None:
            errors.append((run, max(part, FLOOR)))
    for (a, first), (b, second) in combinations(errors, 2):
        steps = a.timestep or 0.0, b.timestep or math.inf
        if a.engine != b.engine and math.isclose(*steps, rel_tol=1e-9):
            low, high = sorted((first, second))
            yield a, b, Ratio(high / low, f"{a.label} and {b.label} on {a.problem}")


def sentence(spread: Spread) -> str:
    """The comparison of the two."""
    where = "with stops or loops" if spread.constrained else "without stops and loops"
    one = ""
    if len(spread.moved) > 1:
        one = f"; the steps of {' and '.join(spread.moved)} are trebucheck's"
    texts: list[str] = []
    for ratios in (spread.within, spread.between):
        if not ratios:
            texts.append("no pair")
            continue
        largest = max(ratios, key=lambda ratio: ratio.value)
        middle = median(ratio.value for ratio in ratios)
        rest = "one pair" if len(ratios) == 1 else f"{len(ratios)} pairs, median {middle:.2g}"
        texts.append(f"{largest.value:.2g} at most ({largest.runs}; {rest})")
    return (
        f"position errors of two of its engines ({', '.join(spread.engines)}) on one problem "
        f"{where}, at equal steps, have a ratio of {texts[0]}; those of one of them and one "
        f"of another scheme {texts[1]}{one}."
    )
