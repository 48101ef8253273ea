"""Engine x problem x quantity, from results of `compare` and `converge` and from older matrices."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import combinations
from pathlib import Path
from statistics import median
from typing import Annotated, Any, Literal, TypeVar

from pydantic import Field, model_validator

from ..engines.supplied import Own, own
from ..models.errors import InputError
from ..models.files import read_bytes
from ..models.library.registry import find_benchmark
from ..models.spec import Positive, Real, Spec
from .compare.study import read_results
from .converge import FORMAT as CONVERGE
from .converge import Studies
from .runs.quantities import QUANTITIES
from .runs.results import FORMAT as COMPARE
from .runs.results import Machine, Metric, Outcome, ResultFile, Results, Run, with_time_limit
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
    subject: str | None = Field(
        default=None, description="marker, stop or joint it is of; None: the mechanism, or none"
    )
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
    ratio: Real | None = Field(
        description="of the error to its tolerance; None: there is no figure"
    )


class MatrixRun(Spec):
    """An engine and preset on a problem."""

    problem: str
    engine: str
    preset: str
    engine_version: str
    scheme: str = Field(default="", description="as its study names it; '': not stated")
    order: Real | None = Field(
        default=None, description="that its study declares; None: no power of the step"
    )
    supplied: dict[str, str] | None = Field(
        default=None,
        description="what trebucheck does in the engine's place, by part, and of what; None: "
        "not stated",
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
    explained: Real | None = Field(
        default=None, description="share of the error that the first cause accounts for"
    )
    date: str = Field(description="of the file of runs, YYYY-MM-DD")
    made_by: str = Field(description="version of trebucheck")

    @model_validator(mode="before")
    @classmethod
    def _read_old_outcome(cls, given: Any) -> Any:
        return with_time_limit(given)

    @property
    def label(self) -> str:
        """Engine and preset in one."""
        return f"{self.engine} {self.preset}"

    def error(self, metric: str) -> Error | None:
        """Error of a quantity; None if the run has none."""
        return next((error for error in self.errors if error.metric == metric), None)


class MatrixProblem(Spec):
    """A problem as compared."""

    name: str
    number: str = Field(
        default="", description="of the library; '' for machines and for mechanisms of one's own"
    )
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


class MeasuredOrder(Spec):
    """Convergence of an engine's position error with the time step, by `trebucheck converge`."""

    engine: str
    preset: str
    problem: str
    exponent: Real | None = Field(description="None: no power of the step was found")
    half_width: Real | None = Field(default=None, description="of its 95 % confidence interval")
    floor: Real | None = Field(
        default=None, description="error that no smaller step lowers [m]; None: not reached"
    )
    floor_cause: str = Field(default="", description="what sets it")

    @property
    def label(self) -> str:
        """Engine and preset in one."""
        return f"{self.engine} {self.preset}"


class Matrix(ResultFile):
    """Runs of several comparisons side by side."""

    format: Literal["trebucheck-matrix-1"] = FORMAT
    problems: tuple[MatrixProblem, ...]
    runs: tuple[MatrixRun, ...]
    orders: tuple[MeasuredOrder, ...] = ()

    def run(self, label: str, problem: str) -> MatrixRun | None:
        """The run of an engine and preset on a problem; None if it was not made."""
        return next(
            (run for run in self.runs if (run.label, run.problem) == (label, problem)), None
        )

    def schemes(self) -> dict[str, list[str]]:
        """Engines with their presets by scheme, alphabetically; those without one last."""
        found: dict[str, set[str]] = {}
        for run in self.runs:
            found.setdefault(run.scheme, set()).add(run.label)
        return {
            name: sorted(found[name])
            for name in sorted(found, key=lambda name: (not name, name.lower()))
        }

    def of(self, label: str) -> Iterable[MatrixRun]:
        """All runs of an engine and preset."""
        return (run for run in self.runs if run.label == label)


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
    found = [(path, _one(path)) for path in paths]
    runs = _once(found, lambda matrix: matrix.runs, "the run")
    orders = _once(found, lambda matrix: matrix.orders, "the order of")
    if not runs:
        raise InputError(f"{', '.join(map(str, paths))}: there is no run of any engine.")
    return Matrix.made_here(problems=_problems(found), runs=runs, orders=orders)


_Found = Sequence[tuple[Path, Matrix]]


def _once(
    found: _Found, parts: Callable[[Matrix], tuple[_Part, ...]], what: str
) -> tuple[_Part, ...]:
    """Parts of all files; none may be there twice."""
    merged: dict[tuple[str, str], tuple[Path, _Part]] = {}
    for path, matrix in found:
        for part in parts(matrix):
            before, _ = merged.setdefault((part.label, part.problem), (path, part))
            if merged[part.label, part.problem][1] is not part:
                raise InputError(
                    f"{what} {part.label} on {part.problem} is in {before} and in {path}; once "
                    f"is needed."
                )
    return tuple(part for _, part in merged.values())


def _problems(found: _Found) -> tuple[MatrixProblem, ...]:
    """Problems in the order of the library, others last; one name is one mechanism and motion."""
    merged: dict[str, tuple[Path, MatrixProblem]] = {}
    for path, matrix in found:
        for problem in matrix.problems:
            before, other = merged.setdefault(problem.name, (path, problem))
            if not _same(problem, other):
                raise InputError(
                    f"{problem.name!r} is another mechanism or motion in {path} than in "
                    f"{before}; a matrix compares "
                    "engines on the same."
                )
    return tuple(
        sorted((problem for _, problem in merged.values()), key=lambda problem: problem.number)
    )


def _same(a: MatrixProblem, b: MatrixProblem) -> bool:
    same = (a.mechanism_hash, a.stop_law) == (b.mechanism_hash, b.stop_law)
    return same and math.isclose(a.judged_to, b.judged_to, rel_tol=_SAME_END)


_SAME_END = 1e-6
"""Tolerance of the end: horizons are computed, and other libraries round otherwise."""


def _one(path: Path) -> Matrix:
    """A file as a matrix."""
    path = _file(path)
    format = _format(path)
    if format == FORMAT:
        return Matrix.load(path)
    if format == COMPARE:
        date = datetime.fromtimestamp(path.stat().st_mtime, UTC).date().isoformat()
        return distilled(read_results(path), date)
    if format == CONVERGE:
        return Matrix.made_here(problems=(), runs=(), orders=tuple(orders_of(Studies.load(path))))
    has = "no format" if format is None else f"format {str(format)[:60]!r}"
    raise InputError(f"{path} has {has}; needed is one of {COMPARE}, {CONVERGE}, {FORMAT}.")


def _file(path: Path) -> Path:
    if not path.is_dir():
        return path
    inside = [
        path / name
        for name in ("results.json", "converge.json", "matrix.json")
        if (path / name).is_file()
    ]
    if len(inside) != 1:
        raise InputError(
            f"{path} holds {len(inside)} of results.json, converge.json and matrix.json; name "
            f"one file."
        )
    return inside[0]


def _format(path: Path) -> object:
    try:
        content = json.loads(read_bytes(path, Results.largest_file))
    except (ValueError, RecursionError):
        raise InputError(
            f"{path} is not JSON; the results.json of `trebucheck compare` is needed."
        ) from None
    return content.get("format") if isinstance(content, dict) else None


def orders_of(studies: Studies) -> Iterator[MeasuredOrder]:
    """Orders of the sweeps of the time step in which something moved."""
    for machine in studies.machines:
        for study in machine.studies:
            curve = study.curve("position")
            law, floor = curve.law, curve.floor
            if study.knob == "timestep" and any(
                point.position is not None for point in study.points
            ):
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
    runs = [run for run in results.runs if run.engine != REFERENCE]
    return Matrix.made_here(
        problems=tuple(map(_problem, results.machines)),
        runs=tuple(
            _run(run, machines.get(run.model), date, results.trebucheck_version) for run in runs
        ),
    )


def _problem(machine: Machine) -> MatrixProblem:
    mechanism, entry = machine.mechanism, find_benchmark(machine.model)
    return MatrixProblem(
        name=machine.model,
        number="" if entry is None else entry.number,
        mechanism_hash=machine.mechanism_hash,
        stop_law=machine.stop_law,
        judged_to=machine.judged_to,
        stops=bool(mechanism.stops),
        loops=bool(mechanism.loop_joints),
        elements=bool(mechanism.force_elements),
    )


def _run(run: Run, machine: Machine | None, date: str, version: str) -> MatrixRun:
    found, step = run.diagnosis, run.settings.get("timestep")
    named = () if found is None else found.named
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
        worst=_worst(run.judged),
        errors=() if machine is None else tuple(_errors(run, machine)),
        first_in=None if found is None or found.note else found.leads,
        causes=tuple(cause.name for cause in named),
        explained=named[0].explained if named else None,
        date=date,
        made_by=version,
    )


def _worst(judged: Sequence[Metric]) -> Breach | None:
    ratios = {metric.label: _ratio(metric) for metric in judged}
    label = max(ratios, key=ratios.__getitem__, default=None)
    return None if label is None else Breach(label=label, ratio=_finite(ratios[label]))


def _ratio(metric: Metric) -> float:
    """Ratio of the error to its tolerance; infinite for a missing value."""
    if metric.value is None:
        return math.inf
    if metric.tolerance:
        return abs(metric.value) / metric.tolerance
    return math.inf if metric.value else 0.0


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _errors(run: Run, machine: Machine) -> Iterator[Error]:
    """The largest of each quantity's figures; one that is missing counts as the largest."""
    for name in SHOWN:
        of = [metric for metric in run.metrics if metric.name == name]
        if not of:
            continue
        shown = [metric for metric in of if metric.observed] or of
        worst = max(shown, key=lambda m: math.inf if m.value is None else _part(m, machine) or 0.0)
        verdicts = [metric.holds for metric in of if metric.holds is not None]
        holds = None
        if not all(verdicts):
            holds = False
        elif verdicts and not any(metric.unjudged for metric in of):
            holds = True
        yield Error(
            metric=name,
            subject=worst.subject,
            value=worst.value,
            unit=worst.unit,
            part=_part(worst, machine),
            observed=worst.observed,
            tolerance=worst.tolerance,
            note=worst.note,
            holds=holds,
        )


def _part(metric: Metric, machine: Machine) -> float | None:
    if metric.value is None:
        return None
    quantity = QUANTITIES[metric.name]
    scales = machine.whole_scales if quantity.invariant and machine.whole_scales else machine.scales
    return abs(metric.value) / quantity.scale_of(scales, metric.subject, machine.mechanism)


FLOOR = 1e-12
"""Part of the scale: smaller errors are rounding over thousands of steps, and count as this."""
_METRIC = "position_max"


@dataclass(frozen=True)
class Ratio:
    """Ratio of two errors, the larger by the smaller."""

    value: float
    runs: str
    """Which two, and on which problem."""


@dataclass(frozen=True)
class Ratios:
    """Ratios of errors of pairs of runs on one problem."""

    found: tuple[Ratio, ...]

    def __str__(self) -> str:
        if not self.found:
            return "no pair"
        largest = max(self.found, key=lambda each: each.value)
        count, middle = len(self.found), median(each.value for each in self.found)
        rest = "one pair" if count == 1 else f"{count} pairs, median {middle:.2g}"
        return f"{largest.value:.2g} at most ({largest.runs}; {rest})"


@dataclass(frozen=True)
class Spread:
    """Spread of one scheme, on problems with stops or loops or on those without."""

    scheme: str
    constrained: bool
    engines: tuple[str, ...]
    moved: tuple[str, ...]
    """Those of them whose steps are trebucheck's: one implementation."""
    within: Ratios
    """Ratio of two engines of the scheme."""
    between: Ratios
    """Ratio of one of them and one of another scheme."""


def spreads(matrix: Matrix) -> Iterator[Spread]:
    """Spread of every scheme that two engines have, where there are pairs."""
    for scheme, labels in matrix.schemes().items():
        engines = sorted({run.engine for label in labels for run in matrix.of(label)})
        if not scheme or len(engines) < 2:
            continue
        runs = (run for label in labels for run in matrix.of(label))
        moved = tuple(
            sorted({run.engine for run in runs if own(run.supplied or {}) is Own.DYNAMICS})
        )
        for constrained in (False, True):
            problems = [
                each for each in matrix.problems if (each.stops or each.loops) == constrained
            ]
            found = _spread(matrix, problems, scheme)
            if found[0].found:
                yield Spread(scheme, constrained, tuple(engines), moved, *found)


def _spread(
    matrix: Matrix, problems: Iterable[MatrixProblem], scheme: str
) -> tuple[Ratios, Ratios]:
    within: list[Ratio] = []
    between: list[Ratio] = []
    for problem in problems:
        for a, b in _pairs(
            [run for run in matrix.runs if run.problem == problem.name and run.scheme]
        ):
            if a.scheme == b.scheme == scheme:
                within.append(_ratio_spread(a, b))
            elif scheme in (a.scheme, b.scheme):
                between.append(_ratio_spread(a, b))
    return Ratios(tuple(within)), Ratios(tuple(between))


def _pairs(runs: Sequence[MatrixRun]) -> Iterator[tuple[MatrixRun, MatrixRun]]:
    """Two runs of different engines with equal steps, both with an error."""
    moved = [run for run in runs if _error(run) is not None]
    for a, b in combinations(moved, 2):
        if a.engine != b.engine and math.isclose(
            a.timestep or 0.0, b.timestep or math.inf, rel_tol=1e-9
        ):
            yield a, b


def _ratio_spread(a: MatrixRun, b: MatrixRun) -> Ratio:
    low, high = sorted(max(_error(run) or 0.0, FLOOR) for run in (a, b))
    return Ratio(high / low, f"{a.label} and {b.label} on {a.problem}")


def _error(run: MatrixRun) -> float | None:
    error = run.error(_METRIC)
    return None if error is None or not error.observed else error.part


def sentence(spread: Spread) -> str:
    """The comparison of the two."""
    where = "with stops or loops" if spread.constrained else "without stops and loops"
    one = (
        f"; the steps of {' and '.join(spread.moved)} are trebucheck's"
        if len(spread.moved) > 1
        else ""
    )
    return (
        f"position errors of two of its engines ({', '.join(spread.engines)}) on one problem "
        f"{where}, at equal steps, "
        f"have a ratio of {spread.within}; those of one of them and one of another scheme "
        f"{spread.between}{one}."
    )
