"""Engine x problem x quantity, from results of `compare` and `converge` and from older matrices."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import combinations
from pathlib import Path
from statistics import median
from typing import Annotated, Any, Literal, TypeVar

from pydantic import Field, model_validator

from ..engines.supplied import Own, own
from ..models.errors import InputError
from ..models.library.registry import find_benchmark
from ..models.spec import Positive, Real, Spec
from .compare import format_of, read_results
from .converge import FORMAT as CONVERGE
from .converge import Studies
from .runs.quantities import QUANTITIES
from .runs.results import FORMAT as COMPARE
from .runs.results import (
    Machine,
    OfEngine,
    Outcome,
    ResultFile,
    Results,
    Run,
    verdict_on,
    with_time_limit,
)
from .runs.study import REFERENCE

__path__: list[str] = []  # names of earlier releases below this module: see renamed.py

FORMAT = "trebucheck-matrix-1"
SHOWN = {
    "position_max": "position",
    "velocity_max": "speed",
    "release_time": "release time",
    "stop_torque_max": "stop torque",
    "joint_reaction_max": "joint force",
    "energy_balance": "energy",
}
"""Title of each quantity that has a table of its own, by the metric's name."""


class Error(Spec):
    """The largest error of a run in one quantity."""

    metric: str
    subject: str | None = Field(default=None, description="marker, stop or joint, if it is of one")
    value: Real | None = Field(description="None where a figure is missing; `note` says why")
    unit: str
    part: Real | None = Field(description="of the quantity's scale, the same for all engines")
    observed: bool = Field(
        default=True, description="false: the engine does not tell it, or it is not determined"
    )
    tolerance: Real | None = None
    holds: bool | None = Field(
        default=None, description="all of the quantity's figures; None: not judged"
    )
    note: str | None = None


class Breach(Spec):
    """The figure of a run that is the farthest beyond its tolerance, or the nearest to it."""

    label: str
    ratio: Real | None = Field(description="of the error to its tolerance; None: no figure")


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
    message: str | None = Field(default=None, description="the refusal's or the failure's sentence")
    time_limit: Real | None = Field(default=None, description="of a run that timed out [s]")
    judged: Annotated[int, Field(ge=0)] = 0
    held: Annotated[int, Field(ge=0)] = 0
    worst: Breach | None = None
    errors: tuple[Error, ...] = ()
    first_in: str | None = Field(default=None, description="figure that leaves its tolerance first")
    causes: tuple[str, ...] = Field(
        default=(), description="likeliest causes; empty where unknown or not looked for"
    )
    explained: Real | None = Field(default=None, description="share, by the first cause")
    date: str = Field(description="of the file of runs, YYYY-MM-DD")
    made_by: str = Field(description="version of trebucheck")

    @model_validator(mode="before")
    @classmethod
    def _read_old_outcome(cls, given: Any) -> Any:
        return with_time_limit(given)

    def error(self, metric: str) -> Error | None:
        """Error of a quantity; None if the run has none."""
        return next((error for error in self.errors if error.metric == metric), None)


class MatrixProblem(Spec):
    """A problem as compared."""

    name: str
    number: str = Field(default="", description="of the library; '' where it is not from there")
    mechanism_hash: str
    stop_law: str
    judged_to: Real = Field(description="[s]")
    stops: bool
    loops: bool
    elements: bool = Field(default=False, description="springs, dampers or motors")

    @property
    def title(self) -> str:
        """Title of a column."""
        return self.number or self.name


class MeasuredOrder(OfEngine, Spec):
    """Convergence of an engine's position error with the time step, by `trebucheck converge`."""

    engine: str
    preset: str
    problem: str
    exponent: Real | None = Field(description="None: no power of the step was found")
    half_width: Real | None = Field(default=None, description="of its 95 % confidence interval")
    floor: Real | None = Field(default=None, description="[m]; None: not reached")
    floor_cause: str = Field(default="", description="what sets it")


class Matrix(ResultFile):
    """Runs of several comparisons side by side."""

    format: Literal["trebucheck-matrix-1"] = FORMAT
    problems: tuple[MatrixProblem, ...]
    runs: tuple[MatrixRun, ...]
    orders: tuple[MeasuredOrder, ...] = ()

    def run(self, label: str, problem: str) -> MatrixRun | None:
        """The run of an engine and preset on a problem; None if it was not made."""
        return next((run for run in self.of(label) if run.problem == problem), None)

    def schemes(self) -> dict[str, list[str]]:
        """Engines with their presets by scheme, alphabetically; those without one last."""
        schemes: dict[str, set[str]] = {}
        for run in self.runs:
            schemes.setdefault(run.scheme, set()).add(run.label)
        names = sorted(schemes, key=lambda name: (not name, name.lower()))
        return {name: sorted(schemes[name]) for name in names}

    def of(self, label: str) -> Iterable[MatrixRun]:
        """Runs of an engine and preset."""
        return (run for run in self.runs if run.label == label)


_SAME_END = 1e-6  # of the end: horizons are computed, and other libraries round otherwise
_Part = TypeVar("_Part", MatrixRun, MeasuredOrder)


def matrix(files: str | Path | Iterable[str | Path]) -> Matrix:
    """Put results of several comparisons together: engine x problem x quantity.

        >>> import trebucheck as tb
        >>> found = tb.matrix(["report", "converge/converge.json"])  # doctest: +SKIP
        >>> [(order.engine, order.exponent) for order in found.orders]  # doctest: +SKIP

    Args:
        files: one or several paths: of results.json of `compare`, converge.json of `converge` and
            data of `matrix`, or of folders with one.

    Raises:
        InputError: there is no file, a file is of another kind or broken, two files have the same
            run, or they mean different mechanisms or motions by one name.
    """
    paths = [Path(files)] if isinstance(files, str | Path) else [Path(file) for file in files]
    if not paths:
        raise InputError("no file: the results.json of one comparison at least is needed.")
    parts = [(path, _read(path)) for path in paths]
    runs = _once("the run", [(path, run) for path, part in parts for run in part.runs])
    orders = _once("the order of", [(path, order) for path, part in parts for order in part.orders])
    if not runs:
        raise InputError(f"{', '.join(map(str, paths))}: there is no run of any engine.")
    # One name is one mechanism and motion; problems of the library come first, in its order.
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
    ordered = sorted((problem for _, problem in problems.values()), key=lambda p: p.number)
    return Matrix.made_here(problems=tuple(ordered), runs=runs, orders=orders)


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
        return Matrix.made_here(problems=(), runs=(), orders=tuple(orders_of(Studies.load(path))))
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
            elements=bool(mechanism.force_elements),
        )
        problems.append(problem)
    runs = [
        _run(run, machines.get(run.model), date, results.trebucheck_version)
        for run in results.runs
        if run.engine != REFERENCE
    ]
    return Matrix.made_here(problems=tuple(problems), runs=tuple(runs))


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
        causes=tuple(cause.name for cause in causes),
        explained=causes[0].explained if causes else None,
        date=date,
        made_by=version,
    )


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


_HOLDS = {Outcome.AGREES: True, Outcome.DISAGREES: False, Outcome.NOT_JUDGED: None}


def _errors(run: Run, machine: Machine) -> Iterator[Error]:
    """The largest of each quantity's figures; one that is missing counts as the largest."""
    for name in SHOWN:
        metrics = [metric for metric in run.metrics if metric.name == name]
        if not metrics:
            continue
        quantity = QUANTITIES[name]
        scales = machine.scales_for(invariant=quantity.invariant)
        # Errors as parts of the quantity's scale; infinite where there is no value
        parts: dict[str, float] = {}
        for metric in metrics:
            size = math.inf if metric.value is None else abs(metric.value)
            scale = quantity.scale_of(scales, metric.subject, machine.mechanism)
            parts[metric.label] = size / scale
        observed = [metric for metric in metrics if metric.observed] or metrics
        worst = max(observed, key=lambda metric: parts[metric.label])
        yield Error(
            metric=name,
            subject=worst.subject,
            value=worst.value,
            unit=worst.unit,
            part=_finite(parts[worst.label]),
            observed=worst.observed,
            tolerance=worst.tolerance,
            note=worst.note,
            holds=_HOLDS[verdict_on(tuple(metrics))],
        )


# Spread of engines of one scheme

FLOOR = 1e-12  # part of the scale: smaller errors are rounding over thousands of steps, count as it
_METRIC = "position_max"


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
        error = run.error(_METRIC)
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
