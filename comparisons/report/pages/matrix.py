"""The page of the matrix: all problems, each quantity, what is missing, causes, schemes."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from itertools import pairwise

from ....engines.supplied import Own, concerned, own, parts
from ....models.problem import StopLaw
from ...matrix import FLOOR, SHOWN, Matrix, MatrixProblem, MatrixRun, sentence, spreads
from ...runs.results import COMPARED, Outcome
from .. import document as doc
from ..document import format_number
from .tables import MARKS, judged_mark

_SHARES = (
    "Own: how much of its runs on a table's problems is the engine's. “all”; “most”: trebucheck "
    "decides when stops open and are met, finds impulses of impacts, or adds or reads forces that "
    "the engine has no element for or does not tell; “steps”: its dynamics and its integrator, but "
    "what stops, loops or springs do is trebucheck's; “dynamics”: its mass matrix, forces, "
    "energies and points, in trebucheck's steps. Agreement speaks for an engine's own parts alone."
)
_UNSTATED = "not stated"
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
    outcomes = Counter(run.outcome for run in matrix.runs)
    listed = ", ".join(f"{outcomes[name]} {name.value}" for name in Outcome if outcomes[name])
    engines = len({run.engine for run in matrix.runs})
    runs = f"{len(matrix.runs)} runs: {listed}"
    line = f"{engines} engines on {len(matrix.problems)} problems, {runs}."
    shares = Counter(_own(matrix, run) for run in matrix.runs if run.outcome is Outcome.AGREES)
    degrees = ", ".join(f"{name} in {shares[name]}" for name in _DEGREES if shares[name])
    blocks: list[doc.Block] = [
        doc.Text(line),
        doc.Heading("Verdicts", 2),
        doc.Note(_READING),
        doc.Text(f"Of {shares.total()} agreements the engine's own is: {degrees or 'none'}."),
        doc.Note(_SHARES),
        *_tables(matrix, _verdict, leading=True),
    ]
    supplied = {run.label: parts(run.supplied) for run in matrix.runs if run.supplied is not None}
    if supplied:
        rows = [(label, text or "nothing") for label, text in sorted(supplied.items())]
        blocks += [
            doc.Heading("What is the engine's own", 2),
            doc.Note("All but what trebucheck supplies, as each adapter says."),
            doc.table((_ENGINE, doc.words("trebucheck supplies")), rows),
        ]
    explained = [doc.Text(sentence(spread), lead=f"{spread.scheme}:") for spread in spreads(matrix)]
    if explained:
        blocks += [
            doc.Heading("Scheme or implementation", 2),
            doc.Note(f"Errors below {FLOOR:g} of the size are rounding, and count as that."),
            doc.Listing(tuple(explained)),
        ]
    blocks += [doc.Heading("By quantity", 2), doc.Note(_QUANTITY)]
    for metric, title in SHOWN.items():
        if any(run.error(metric) for run in matrix.runs):
            blocks.append(doc.Heading(title.capitalize(), 3))
            blocks += _tables(matrix, partial(_quantity, metric=metric))
    blocks += [*_missing(matrix), *_causes(matrix), *_provenance(matrix)]
    return doc.Document("Matrix", tuple(blocks), command=matrix.command or "", verdict=line)


# --- Engines against problems

_DEGREES = (*map(str, Own), _UNSTATED)


def _own(matrix: Matrix, run: MatrixRun) -> str:
    """Share of a run that is the engine's."""
    if run.supplied is None:
        return _UNSTATED
    problem = next(problem for problem in matrix.problems if problem.name == run.problem)
    affected = concerned(
        stops=problem.stops,
        impacts=problem.stop_law == StopLaw.UNILATERAL,
        loops=problem.loops,
        elements=problem.elements,
    )
    return own(run.supplied, affected)


_ENGINE = doc.words("engine", wrap=False)
_LEADING = (doc.words("own"), doc.words("order", wrap=False), doc.words("agrees"))
_WIDEST = 6  # problems in a table, with which it fits a screen of 1280 pixels


_Show = Callable[[MatrixRun], doc.Cell]


def _tables(matrix: Matrix, show: _Show, *, leading: bool = False) -> Iterator[doc.Table]:
    """A table for each kind of problem: engines by scheme against problems.

    Leading columns: the engine's own share, its order, and on how many of its problems it agrees.
    """
    heads = (_ENGINE, *_LEADING) if leading else (_ENGINE,)
    shown = {run.problem for run in matrix.runs if show(run).text}
    for title, belongs in _KINDS:
        problems = [each for each in matrix.problems if each.name in shown and belongs(each)]
        # In parts as wide as a page, about the same number each.
        count = math.ceil(len(problems) / _WIDEST)
        ends = [round(k * len(problems) / count) for k in range(count + 1)] if count else []
        for start, end in pairwise(ends):
            part, caption = problems[start:end], title
            if len(part) < len(problems):
                caption = f"{title}: {part[0].title} to {part[-1].title}"
            columns = (doc.Column(problem.title, align="left", wrap=False) for problem in part)
            rows = _rows(matrix, part, show, leading=leading)
            yield doc.table([*heads, *columns], rows, caption)


def _rows(
    matrix: Matrix, problems: Sequence[MatrixProblem], show: _Show, *, leading: bool
) -> Iterator[doc.Row]:
    absent = doc.Cell("not run", "muted")
    for scheme, labels in matrix.schemes().items():
        rows: list[doc.Row] = []
        for label in labels:
            runs = [matrix.run(label, problem.name) for problem in problems]
            cells = (absent if run is None else show(run) for run in runs)
            if leading:
                compared = [run for run in runs if run and run.outcome in COMPARED]
                shares = (_own(matrix, run) for run in compared)
                least = max(shares, key=_DEGREES.index, default="")
                every = [*matrix.of(label)]
                agreeing = f"{sum(run.outcome is Outcome.AGREES for run in every)} of {len(every)}"
                rows.append(doc.row(label, least, _order(matrix, label), agreeing, *cells))
            elif any(runs):
                rows.append(doc.row(label, *cells))
        if rows:
            yield doc.row(doc.Cell(scheme or _SCHEME_UNSTATED, "strong"))
            yield from rows


def _order(matrix: Matrix, label: str) -> doc.Cell:
    """Order, measured or else as declared, which is said; of an error at a floor, the floor."""
    orders = [order for order in matrix.orders if order.label == label]
    # Where a sweep begins at the floor of rounding it finds no power; another one may.
    orders.sort(key=lambda order: order.exponent is None)
    if not orders:
        declared = next(iter(matrix.of(label))).order
        return doc.Cell("none (declared)" if declared is None else f"{declared:g} (declared)")
    order, what, hint = orders[0], "none", ""
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


def _quantity(run: MatrixRun, metric: str) -> doc.Cell:
    error = run.error(metric)
    if error is None:
        return doc.Cell("")
    if not error.observed:
        return doc.Cell("–", "muted", hint=error.note or "")
    value = f"{format_number(error.value)} {error.unit}, tolerance {format_number(error.tolerance)}"
    text = "missing" if error.part is None else format_number(error.part)
    hint = error.note or " ".join(filter(None, (error.subject, value)))
    return doc.Cell(text, judged_mark(error.holds), hint=hint)


# --- Refusals, causes, versions


def _missing(matrix: Matrix) -> Iterator[doc.Block]:
    """Refusals and failures in their own words, once each."""
    groups = _grouped(
        (run for run in matrix.runs if run.outcome not in COMPARED),
        lambda run: (run.engine, run.outcome.value, run.message or "no reason was given"),
    )
    rows: list[tuple[str, ...]] = []
    for (engine, outcome, message), runs in groups.items():
        rows.append((engine, outcome, _titles(matrix, runs), message))
    if rows:
        yield doc.Heading("What is missing", 2)
        heads = (_ENGINE, *map(doc.words, ("why", "problems", "in its words")))
        yield doc.table(heads, rows)


def _causes(matrix: Matrix) -> Iterator[doc.Block]:
    """Causes of runs that disagree, by engine and preset; the figure farthest off."""
    groups = _grouped(
        (run for run in matrix.runs if run.first_in is not None),
        lambda run: (run.label, " or ".join(run.causes) or "unknown"),
    )
    rows: list[tuple[str, ...]] = []
    for group, runs in groups.items():
        farthest = "before any motion"
        figures = [run.worst for run in runs if run.worst is not None]
        if figures:  # a missing one is farther than all others
            worst = max(figures, key=lambda each: math.inf if each.ratio is None else each.ratio)
            ratio = "missing"
            if worst.ratio is not None:
                ratio = f"{format_number(worst.ratio)} of its tolerance"
            farthest = f"{worst.label}: {ratio}"
        rows.append((*group, _titles(matrix, runs), farthest))
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


def _provenance(matrix: Matrix) -> Iterator[doc.Block]:
    yield doc.Heading("Problems and versions", 2)
    problems: list[tuple[str, ...]] = []
    for p in matrix.problems:
        number, judged_to, digest = p.number or "machine", f"{p.judged_to:.6g}", p.mechanism_hash
        problems.append((number, p.name, judged_to, p.stop_law, digest[:16]))
    yield doc.table("number | problem | judged to [s] | law of the stops | hash", problems)
    by_engine = _grouped(matrix.runs, lambda run: (run.engine, run.engine_version, run.made_by))
    rows: list[tuple[str, ...]] = []
    for made_by, runs in by_engine.items():
        steps: dict[str, list[float]] = {}  # by preset
        for run in runs:
            if run.timestep:
                steps.setdefault(run.preset, []).append(run.timestep)
        spans: list[str] = []
        for preset, values in sorted(steps.items()):
            low, high = f"{min(values):.2g}", f"{max(values):.2g}"
            spans.append(f"{preset} {low}" if low == high else f"{preset} {low} to {high}")
        rows.append((*made_by, ", ".join(sorted({run.date for run in runs})), "; ".join(spans)))
    heads = ["engine", "version", "trebucheck", "date of the runs", doc.words("steps [s]")]
    yield doc.table(heads, rows)
