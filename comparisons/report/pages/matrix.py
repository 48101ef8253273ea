"""The page of the matrix: all problems, each quantity, what is missing, causes, schemes."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from itertools import pairwise

from ....engines.supplied import Own, concerned, own, parts
from ....models.problem import StopLaw
from ...matrix import (
    FLOOR,
    SHOWN,
    Error,
    Matrix,
    MatrixProblem,
    MatrixRun,
    MeasuredOrder,
    sentence,
    spreads,
)
from ...runs.results import COMPARED, Outcome
from .. import document as doc
from ..document import format_number
from .tables import MARKS

READING = (
    "Own: how much of its runs on a table's problems is the engine's. “all”; “most”: trebucheck "
    "decides when stops open and are met, finds impulses of impacts, or adds or reads forces that "
    "the engine has no element for or does not tell; “steps”: its dynamics and its integrator, but "
    "what stops, loops or springs do is trebucheck's; “dynamics”: its mass matrix, forces, "
    "energies and points, in trebucheck's steps. Agreement speaks for an engine's own parts alone."
)
_UNSTATED = "not stated"


def own_on(matrix: Matrix, label: str, problems: Sequence[MatrixProblem]) -> str:
    """The least that is an engine's in its runs on some problems; '' if it has none."""
    runs = [matrix.run(label, problem.name) for problem in problems]
    found = [_own(matrix, run) for run in runs if run is not None and run.outcome in COMPARED]
    return max(found, key=_DEGREES.index, default="")


_DEGREES = (*map(str, Own), _UNSTATED)


def _own(matrix: Matrix, run: MatrixRun) -> str:
    if run.supplied is None:
        return _UNSTATED
    problem = next(each for each in matrix.problems if each.name == run.problem)
    affected = concerned(
        stops=problem.stops,
        impacts=problem.stop_law == StopLaw.UNILATERAL,
        loops=problem.loops,
        elements=problem.elements,
    )
    return own(run.supplied, affected)


def agreements(matrix: Matrix) -> doc.Text:
    """How many agreements there are of each degree."""
    counts = Counter(_own(matrix, run) for run in matrix.runs if run.outcome is Outcome.AGREES)
    said = ", ".join(f"{name} in {counts[name]}" for name in _DEGREES if counts[name])
    return doc.Text(f"Of {counts.total()} agreements the engine's own is: {said or 'none'}.")


def table_of_parts(matrix: Matrix) -> Iterator[doc.Block]:
    """A row an engine and preset: what trebucheck supplies."""
    stated = {run.label: run.supplied for run in matrix.runs if run.supplied is not None}
    if stated:
        yield doc.Heading("What is the engine's own", 2)
        yield doc.Note("All but what trebucheck supplies, as each adapter says.")
        rows = [(label, parts(given) or "nothing") for label, given in sorted(stated.items())]
        yield doc.table((_ENGINE, doc.words("trebucheck supplies")), rows)


_SCHEME_UNSTATED = "scheme not stated"
_WORDS: dict[Outcome, str] = {
    Outcome.NOT_EQUIVALENT: "another model",
    Outcome.FAILED: "failed",
    Outcome.TIMED_OUT: "not finished",
    Outcome.ABSENT: "not installed",
    Outcome.UNSUPPORTED: "refused",
}
_READING = (
    "✓ every judged quantity holds its tolerance, ✗ at least one breaks it, ○ not judged (never "
    "counted as agreement), refused: the engine cannot, in its own words below, not finished: a "
    "run had so much time and no more. The number is the largest error of a marker's position in "
    "parts of the mechanism's size, which is the same for all engines; tolerances are not: an "
    "engine's own claims, or a thousandth of each scale."
)
_QUANTITY = (
    "Largest error in parts of the quantity's scale; ✓ and ✗ by the tolerances, ○ not judged, "
    "– not told."
)
_KINDS: tuple[tuple[str, Callable[[MatrixProblem], bool]], ...] = (
    ("Without stops and loops", lambda problem: not problem.stops and not problem.loops),
    ("With loops", lambda problem: problem.loops and not problem.stops),
    ("With stops", lambda problem: problem.stops),
)


def document(matrix: Matrix) -> doc.Document:
    """The whole."""
    line = headline(matrix)
    blocks = tuple(_blocks(matrix, line))
    return doc.Document("Matrix", blocks, command=matrix.command or "", verdict=line)


def headline(matrix: Matrix) -> str:
    """How many engines, problems and verdicts."""
    counts = Counter(run.outcome for run in matrix.runs)
    outcomes = ", ".join(f"{counts[each]} {each.value}" for each in Outcome if counts[each])
    engines = len({run.engine for run in matrix.runs})
    runs = f"{len(matrix.runs)} runs: {outcomes}"
    return f"{engines} engines on {len(matrix.problems)} problems, {runs}."


def _blocks(matrix: Matrix, line: str) -> Iterator[doc.Block]:
    yield doc.Text(line)
    yield doc.Heading("Verdicts", 2)
    yield doc.Note(_READING)
    yield agreements(matrix)
    yield doc.Note(READING)
    yield from _tables(matrix, _verdict, partial(_leading, matrix))
    yield from table_of_parts(matrix)
    yield from _explained(matrix)
    yield doc.Heading("By quantity", 2)
    yield doc.Note(_QUANTITY)
    for metric, title in SHOWN.items():
        if any(run.error(metric) for run in matrix.runs):
            yield doc.Heading(title.capitalize(), 3)
            yield from _tables(matrix, _quantity(metric))
    yield from _missing(matrix)
    yield from _causes(matrix)
    yield from _provenance(matrix)


_Show = Callable[[MatrixRun], doc.Cell]
_Leading = Callable[[str, Sequence[MatrixProblem]], Sequence[object]]
_ENGINE = doc.words("engine", wrap=False)
_LEADING = (doc.words("own"), doc.words("order", wrap=False), doc.words("agrees"))
_WIDEST = 6  # problems in a table, with which it fits a screen of 1280 pixels


def _tables(matrix: Matrix, show: _Show, leading: _Leading | None = None) -> Iterator[doc.Table]:
    """A table for each kind of problem: engines by scheme against problems."""
    heads = (_ENGINE, *(_LEADING if leading else ()))
    shown = {run.problem for run in matrix.runs if show(run).text}
    for title, belongs in _KINDS:
        problems = [each for each in matrix.problems if each.name in shown and belongs(each)]
        for part in _parts(problems):
            columns = (doc.Column(each.title, align="left", wrap=False) for each in part)
            caption = title
            if len(part) < len(problems):
                caption = f"{title}: {part[0].title} to {part[-1].title}"
            yield doc.table([*heads, *columns], _rows(matrix, part, show, leading), caption)


def _parts(problems: Sequence[MatrixProblem]) -> Iterator[Sequence[MatrixProblem]]:
    """Problems in parts as wide as a page, about the same number each."""
    count = math.ceil(len(problems) / _WIDEST)
    ends = [round(k * len(problems) / count) for k in range(count + 1)] if count else []
    return (problems[start:end] for start, end in pairwise(ends))


def _rows(
    matrix: Matrix, problems: Sequence[MatrixProblem], show: _Show, leading: _Leading | None
) -> Iterator[doc.Row]:
    for scheme, labels in matrix.schemes().items():
        rows: list[doc.Row] = []
        for label in labels:
            runs = [matrix.run(label, problem.name) for problem in problems]
            if leading or any(runs):
                first = leading(label, problems) if leading else ()
                cells = (doc.Cell("not run", "muted") if run is None else show(run) for run in runs)
                rows.append(doc.row(label, *first, *cells))
        if rows:
            yield doc.row(doc.Cell(scheme or _SCHEME_UNSTATED, "strong"))
            yield from rows


def _leading(matrix: Matrix, label: str, problems: Sequence[MatrixProblem]) -> Sequence[object]:
    """The engine's own share, its order, and on how many of all its problems it agrees."""
    runs = [*matrix.of(label)]
    agreeing = sum(run.outcome is Outcome.AGREES for run in runs)
    return own_on(matrix, label, problems), _order(matrix, label), f"{agreeing} of {len(runs)}"


def _order(matrix: Matrix, label: str) -> doc.Cell:
    """Measured, or else as declared, which is said."""
    found = [order for order in matrix.orders if order.label == label]
    # Where a sweep begins at the floor of rounding it finds no power; another one may.
    measured = [order for order in found if order.exponent is not None] or found
    if measured:
        return _measured(measured[0])
    declared = next(iter(matrix.of(label))).order
    return doc.Cell("none (declared)" if declared is None else f"{declared:g} (declared)")


def _measured(order: MeasuredOrder) -> doc.Cell:
    """Measured order with its problem; where the error keeps to a floor, the floor."""
    what, hint = "none", ""
    if order.exponent is not None:
        what = f"{order.exponent:.3f} ± {order.half_width or 0.0:.3f}"
    elif order.floor is not None:
        what, hint = f"none: floor {format_number(order.floor)} m", f"set by: {order.floor_cause}"
    return doc.Cell(f"{what} ({order.problem})", hint=hint)


def _verdict(run: MatrixRun) -> doc.Cell:
    if run.outcome not in COMPARED:
        limit = "" if run.time_limit is None else f" in {run.time_limit:g} s"
        return doc.Cell(_WORDS[run.outcome] + limit, MARKS[run.outcome], hint=run.message or "")
    error = run.error("position_max")
    text = format_number(None if error is None else error.part)
    hint = f"{run.held} of {run.judged} hold; farthest "
    if run.worst is not None:
        hint += f"{run.worst.label}: {format_number(run.worst.ratio)} of its tolerance"
    if run.first_in is not None:
        hint += f"; likeliest cause: {' or '.join(run.causes) or 'unknown'}"
    mark: doc.Mark = "unjudged" if run.outcome is Outcome.NOT_JUDGED else MARKS[run.outcome]
    return doc.Cell(text, mark, hint=hint)


def _quantity(metric: str) -> _Show:
    def show(run: MatrixRun) -> doc.Cell:
        error = run.error(metric)
        return doc.Cell("") if error is None else _error(error)

    return show


def _error(error: Error) -> doc.Cell:
    if not error.observed:
        return doc.Cell("–", "muted", hint=error.note or "")
    mark: doc.Mark = "unjudged" if error.holds is None else doc.mark_of(error.holds)
    value = f"{format_number(error.value)} {error.unit}, tolerance {format_number(error.tolerance)}"
    text = "missing" if error.part is None else format_number(error.part)
    return doc.Cell(text, mark, hint=error.note or " ".join(filter(None, (error.subject, value))))


def _explained(matrix: Matrix) -> Iterator[doc.Block]:
    """Differences by scheme and by implementation."""
    items = [doc.Text(sentence(each), lead=f"{each.scheme}:") for each in spreads(matrix)]
    if items:
        yield doc.Heading("Scheme or implementation", 2)
        yield doc.Note(f"Errors below {FLOOR:g} of the size are rounding, and count as that.")
        yield doc.Listing(tuple(items))


def _missing(matrix: Matrix) -> Iterator[doc.Block]:
    """Refusals and failures in their own words, once each."""
    groups = _grouped(
        (run for run in matrix.runs if run.outcome not in COMPARED),
        lambda run: (run.engine, run.outcome.value, run.message or "no reason was given"),
    )
    rows = [
        (engine, outcome, _titles(matrix, runs), message)
        for (engine, outcome, message), runs in groups.items()
    ]
    if rows:
        yield doc.Heading("What is missing", 2)
        heads = (_ENGINE, *map(doc.words, ("why", "problems", "in its words")))
        yield doc.table(heads, rows)


def _causes(matrix: Matrix) -> Iterator[doc.Block]:
    """Causes of runs that disagree, by engine and preset."""
    groups = _grouped(
        (run for run in matrix.runs if run.first_in is not None),
        lambda run: (run.label, " or ".join(run.causes) or "unknown"),
    )
    rows = [(*group, _titles(matrix, runs), _farthest(runs)) for group, runs in groups.items()]
    if rows:
        yield doc.Heading("Causes", 2)
        yield doc.Note(
            "The suspects that account for the difference, solved again with the size found; or "
            "unknown."
        )
        heads = (_ENGINE, *map(doc.words, ("likeliest cause", "problems", "farthest off")))
        yield doc.table(heads, rows)


def _grouped(
    runs: Iterable[MatrixRun], key: Callable[[MatrixRun], tuple[str, ...]]
) -> dict[tuple[str, ...], list[MatrixRun]]:
    groups: dict[tuple[str, ...], list[MatrixRun]] = {}
    for run in runs:
        groups.setdefault(key(run), []).append(run)
    return dict(sorted(groups.items()))


def _titles(matrix: Matrix, runs: Iterable[MatrixRun]) -> str:
    titles = {problem.name: problem.title for problem in matrix.problems}
    return ", ".join(dict.fromkeys(titles.get(run.problem, run.problem) for run in runs))


def _farthest(runs: Iterable[MatrixRun]) -> str:
    """The figure farthest beyond its tolerance, and how far; a missing one before all others."""
    found = [run.worst for run in runs if run.worst is not None]
    if not found:
        return "before any motion"
    worst = max(found, key=lambda each: math.inf if each.ratio is None else each.ratio)
    if worst.ratio is None:
        return f"{worst.label}: missing"
    return f"{worst.label}: {format_number(worst.ratio)} of its tolerance"


def _provenance(matrix: Matrix) -> Iterator[doc.Block]:
    yield doc.Heading("Problems and versions", 2)
    problems = [
        (p.number or "machine", p.name, f"{p.judged_to:.6g}", p.stop_law, p.mechanism_hash[:16])
        for p in matrix.problems
    ]
    yield doc.table("number | problem | judged to [s] | law of the stops | hash", problems)
    by_engine = _grouped(matrix.runs, lambda run: (run.engine, run.engine_version, run.made_by))
    rows = [
        (*made_by, ", ".join(sorted({run.date for run in runs})), _steps(runs))
        for made_by, runs in by_engine.items()
    ]
    yield doc.table(
        ["engine", "version", "trebucheck", "date of the runs", doc.words("steps [s]")], rows
    )


def _steps(runs: Iterable[MatrixRun]) -> str:
    """The shortest and the longest step, by preset."""
    steps: dict[str, list[float]] = {}
    for run in runs:
        if run.timestep:
            steps.setdefault(run.preset, []).append(run.timestep)
    return "; ".join(f"{preset} {_range(steps[preset])}" for preset in sorted(steps))


def _range(values: Sequence[float]) -> str:
    low, high = f"{min(values):.2g}", f"{max(values):.2g}"
    return low if low == high else f"{low} to {high}"
