"""From results of `compare` and `converge`, and from matrices made before, to one matrix."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TypeVar

from ...models.errors import InputError
from ...models.files import read_bytes
from ...models.problems.registry import find_benchmark
from ..compare.stored import read_results
from ..converge.results import FORMAT as CONVERGE
from ..converge.results import Studies
from ..runs.quantities import QUANTITIES
from ..runs.results import FORMAT as COMPARE
from ..runs.results import Machine, Metric, Results, Run
from ..runs.study import REFERENCE
from .results import FORMAT, SHOWN, Breach, Error, Matrix, MatrixProblem, MatrixRun, MeasuredOrder

_Part = TypeVar("_Part", MatrixRun, MeasuredOrder)


def read(paths: Sequence[Path]) -> Matrix:
    """One matrix of all files.

    Args:
        paths: of results.json of `compare`, converge.json of `converge` and data of `matrix`, or of
            folders with one.

    Raises:
        InputError: there is no file, a file is of another kind or broken, two files have the same
            run, or they mean different mechanisms or motions by one name.
    """
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
                    f"{what} {part.label} on {part.problem} is in {before} and in {path}; once is needed."
                )
    return tuple(part for _, part in merged.values())


def _problems(found: _Found) -> tuple[MatrixProblem, ...]:
    """In the order of the library, others first; one name stands for one mechanism and motion."""
    merged: dict[str, tuple[Path, MatrixProblem]] = {}
    for path, matrix in found:
        for problem in matrix.problems:
            before, other = merged.setdefault(problem.name, (path, problem))
            if not _same(problem, other):
                raise InputError(
                    f"{problem.name!r} is another mechanism or motion in {path} than in {before}; a matrix compares "
                    "engines on the same."
                )
    return tuple(
        sorted((problem for _, problem in merged.values()), key=lambda problem: problem.number)
    )


def _same(a: MatrixProblem, b: MatrixProblem) -> bool:
    same = (a.mechanism_hash, a.stop_law) == (b.mechanism_hash, b.stop_law)
    return same and math.isclose(a.judged_to, b.judged_to, rel_tol=_SAME_END)


_SAME_END = 1e-6
"""Of the end: the horizon follows from variational equations, which other versions of libraries round otherwise."""


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
            f"{path} holds {len(inside)} of results.json, converge.json and matrix.json; name one file."
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
    """Of the sweeps of the time step in which something moved."""
    for machine in studies.machines:
        for study in machine.studies:
            curve = study.curve("position")
            law, floor = curve.law, curve.floor
            if study.knob == "timestep" and any(
                point.position is not None for point in study.points
            ):
                yield MeasuredOrder(
                    engine=study.engine, preset=study.preset, problem=machine.model,
                    exponent=None if law is None else law.exponent,
                    half_width=None if law is None else law.half_width,
                    floor=None if floor is None else floor.error, floor_cause="" if floor is None else floor.cause,
                )  # fmt: skip


def distilled(results: Results, date: str) -> Matrix:
    """What a matrix needs of a comparison; the reference against itself is left out."""
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
        name=machine.model, number="" if entry is None else entry.number, mechanism_hash=machine.mechanism_hash,
        stop_law=machine.stop_law, judged_to=machine.judged_to, stops=bool(mechanism.stops),
        loops=bool(mechanism.loop_joints), elements=bool(mechanism.force_elements),
    )  # fmt: skip


def _run(run: Run, machine: Machine | None, date: str, version: str) -> MatrixRun:
    found, step = run.diagnosis, run.settings.get("timestep")
    named = () if found is None else found.named
    return MatrixRun(
        problem=run.model, engine=run.engine, preset=run.preset, engine_version=run.engine_version, scheme=run.scheme,
        order=run.order, supplied=run.supplied, timestep=step if isinstance(step, float) else None, outcome=run.outcome,
        message=run.message, judged=len(run.judged), held=len(run.judged) - len(run.broken), worst=_worst(run.judged),
        errors=() if machine is None else tuple(_errors(run, machine)),
        first_in=None if found is None or found.note else found.leads, causes=tuple(cause.name for cause in named),
        explained=named[0].explained if named else None, date=date, made_by=version,
    )  # fmt: skip


def _worst(judged: Sequence[Metric]) -> Breach | None:
    ratios = {metric.label: _ratio(metric) for metric in judged}
    label = max(ratios, key=ratios.__getitem__, default=None)
    return None if label is None else Breach(label=label, ratio=_finite(ratios[label]))


def _ratio(metric: Metric) -> float:
    """Of the error to its tolerance: a figure that is missing is farther beyond than any other."""
    if metric.value is None:
        return math.inf
    return (
        abs(metric.value) / metric.tolerance
        if metric.tolerance
        else math.inf
        if metric.value
        else 0.0
    )


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
        undecided = any(metric.unjudged for metric in of)
        yield Error(
            metric=name, subject=worst.subject, value=worst.value, unit=worst.unit, part=_part(worst, machine),
            observed=worst.observed, tolerance=worst.tolerance, note=worst.note,
            holds=False if not all(verdicts) else True if verdicts and not undecided else None,
        )  # fmt: skip


def _part(metric: Metric, machine: Machine) -> float | None:
    if metric.value is None:
        return None
    quantity = QUANTITIES[metric.name]
    scales = machine.whole_scales if quantity.invariant and machine.whole_scales else machine.scales
    return abs(metric.value) / quantity.scale_of(scales, metric.subject, machine.mechanism)
