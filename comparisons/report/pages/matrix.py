"""The page of the matrix: one grid of engines and problems; and the page of one engine."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

from jinja2 import Environment, StrictUndefined
from pydantic import JsonValue

from ....engines.presets import ASSISTED, MEANINGS
from ....engines.study import EngineStudy
from ....engines.supplied import Own, parts
from ....models.errors import InputError
from ....models.library.registry import find_benchmark
from ...compare import HOLDS
from ...matrix import (
    FLOOR,
    CostSweep,
    DynamicsCheck,
    Error,
    Matrix,
    MatrixProblem,
    MatrixRun,
    StepCost,
    command_of,
    preset_rank,
    sentence,
    spreads,
)
from ...runs.quantities import QUANTITIES, SYMBOLS, parse_label
from ...runs.results import COMPARED, Check, Outcome, share_of
from .. import document as doc
from ..document import (
    GridCell,
    GridColumn,
    GridRow,
    format_number,
    format_settings,
    format_step,
    format_value,
)

STATES: Mapping[Outcome, doc.VerdictSign] = {
    Outcome.AGREES: doc.VerdictSign("agrees", "✓", "agrees", "agree"),
    Outcome.DISAGREES: doc.VerdictSign("disagrees", "✗", "disagrees", "disagree"),
    Outcome.NOT_JUDGED: doc.VerdictSign("unjudged", "○", "not judged", "not judged"),
    Outcome.NOT_EQUIVALENT: doc.VerdictSign("other", "≠", "another model", "another model"),
    Outcome.FAILED: doc.VerdictSign("failed", "!", "failed", "failed"),
    Outcome.TIMED_OUT: doc.VerdictSign("unfinished", "…", "not finished", "not finished"),
    Outcome.ABSENT: doc.VerdictSign("absent", "?", "not installed", "not installed"),
    Outcome.UNSUPPORTED: doc.VerdictSign(
        "refused", "–", "not built by our adapter", "not built by our adapters"
    ),
}
"""Verdicts with their signs."""
_NOT_RUN = "·"
_NO_ORDER = "–"
_NOT_KEPT = "not kept in this file"
_NOT_MEASURED, _NOT_MEASURED_SHORT = "not measured", "–"
_ABSENT = "(not among these results)"
_UNSTATED = "not stated"
_SCHEME_UNSTATED = "scheme not stated"
_SHARES: Mapping[str, str] = {
    Own.ALL: "all of the run",
    Own.MOST: "most of the run",
    Own.STEPS: "its dynamics and its steps, not what stops, loops or springs do",
    Own.DYNAMICS: "its dynamics alone, in trebucheck's steps",
    _UNSTATED: "not stated by the adapter",
}
_APART = "Dynamics alone: the steps are trebucheck's (not counted)"
_READING = (
    "✓: every judged quantity holds its tolerance. ✗: at least one breaks it, and the letter is "
    f"the one farthest beyond: {', '.join(f'{key} {name}' for key, name in SYMBOLS.items())}. "
    "○: not judged, never counted as agreement. –: our adapter does not build it, which says "
    "nothing of the engine. …: not finished in its limit of time. ≠: the built model is another "
    f"one. {_NOT_RUN}: not run."
)
_OWN = (
    "A cell with a corner: trebucheck decides when stops open and are met, finds impulses of "
    "impacts, or adds or reads forces. A striped one: what stops, loops or springs do is "
    "trebucheck's. Agreement speaks for an engine's own parts alone."
)


def document(matrix: Matrix, links: Mapping[str, str] | None = None) -> doc.Document:
    """The whole.

    Args:
        matrix: the runs.
        links: address of the page of an engine, by its name; none where there are no such pages.
    """
    counted = counted_runs(matrix)
    line = counts_line(matrix, counted)
    blocks: list[doc.Block] = [
        doc.Text(line, medium="terminal"),
        _Grid(matrix, links).block(),
        *_dynamics(matrix),
    ]
    explained = [doc.Text(sentence(spread), lead=f"{spread.scheme}:") for spread in spreads(matrix)]
    rounding = doc.Note(f"Errors below {FLOOR:g} of the scale are rounding, and count as that.")
    for title, parts_of_page in (
        ("Scheme or implementation", (rounding, doc.Listing(tuple(explained)))),
        ("What our adapters do not build, and what did not end", tuple(_missing(matrix))),
        ("Causes", tuple(_causes(matrix))),
        (_CHEAPEST, tuple(_cheapest(matrix))),
        ("Problems and versions", tuple(_provenance(matrix))),
    ):
        shown = [part for part in parts_of_page if not isinstance(part, doc.Note)]
        if any(part != doc.Listing(()) for part in shown):
            blocks.append(doc.Fold(title, parts_of_page))
            blocks += map(doc.terminal_only, shown)
    return doc.Document(
        "Engines and problems",
        tuple(blocks),
        window="trebucheck: engines and problems",
        command=matrix.command or "",
        verdict=line,
        wide=True,
    )


def summary(matrix: Matrix, links: Mapping[str, str]) -> doc.Document:
    """The counts and the grid as tables, for a page that is read without scripts.

    Args:
        matrix: the runs.
        links: address of the page of an engine, by its name.
    """
    grid = _Grid(matrix, links)
    blocks: list[doc.Block] = [
        doc.Text(counts_line(matrix, counted_runs(matrix))),
        doc.Listing(tuple(_counts_by_preset(matrix))),
        doc.Note(f"{_meanings(matrix)}{_READING}"),
        *grid.compact(),
    ]
    apart: dict[str, str] = {}
    for run in matrix.runs:
        if run.is_dynamics:
            apart[run.label] = f"[{run.label}]({links.get(run.engine, '')})"
    if apart:
        text = f"{', '.join(apart.values())}: the steps are trebucheck's, and not counted."
        blocks.append(doc.Text(text, lead="Dynamics alone:"))
    blocks += [*_dynamics(matrix), doc.Heading(_CHEAPEST, 2), *_cheapest(matrix)]
    return doc.Document("", tuple(blocks))


# --- Counts


def counted_runs(matrix: Matrix) -> list[MatrixRun]:
    """Runs that verdicts are counted of: those that engines move themselves."""
    return [run for run in matrix.runs if not run.is_dynamics]


def _counts(runs: Iterable[MatrixRun]) -> str:
    outcomes = Counter(run.outcome for run in runs)
    return ", ".join(
        f"{outcomes[outcome]} {state.counted}"
        for outcome, state in STATES.items()
        if outcomes[outcome]
    )


def counts_line(matrix: Matrix, runs: list[MatrixRun]) -> str:
    """Number of engines, problems, runs and verdicts in a line."""
    engines = len({run.engine for run in runs})
    line = f"{engines} engines on {len(matrix.problems)} problems, {len(runs)} runs: "
    line += f"{_counts(runs)}."
    apart = len(matrix.runs) - len(runs)
    if apart:
        line += f" {apart} runs in trebucheck's steps stand apart."
    return line


def _counts_by_preset(matrix: Matrix) -> Iterator[doc.Text]:
    """Verdicts of each preset, and how much of the agreements is the engine's own."""
    for preset in matrix.presets:
        runs = [run for run in counted_runs(matrix) if run.preset == preset]
        if not runs:
            continue
        problems = {problem.name: problem for problem in matrix.problems}
        own: Counter[str] = Counter()
        for run in runs:
            if run.outcome is Outcome.AGREES:
                own[_own(run, problems[run.problem])] += 1
        shares = ", ".join(f"{name} in {own[name]}" for name in _SHARES if own[name])
        text = f"{_counts(runs)}. The engine's own of the agreements: {shares or 'none'}."
        yield doc.Text(text, lead=f"{preset}:")


def _own(run: MatrixRun, problem: MatrixProblem) -> str:
    """Share of a run that is the engine's."""
    return run.own_on(problem) or _UNSTATED


# --- The grid


@dataclass(frozen=True)
class _Grid:
    """Engines by scheme against problems by class."""

    matrix: Matrix
    links: Mapping[str, str] | None = None

    @cached_property
    def _runs(self) -> Mapping[tuple[str, str], MatrixRun]:
        """Runs by label and problem."""
        return {(run.label, run.problem): run for run in self.matrix.runs}

    def block(self) -> doc.VerdictGrid:
        """The grid for a page, with its tables for other media."""
        rows: list[GridRow] = []
        apart: list[GridRow] = []
        for scheme, labels in self.matrix.schemes().items():
            for label in labels:
                row = self._row(scheme or _SCHEME_UNSTATED, label)
                (apart if row.apart else rows).append(row)
        return doc.VerdictGrid(
            states=tuple(STATES.values()),
            presets=self.matrix.presets,
            rows=(*rows, *apart),
            columns=tuple(map(_column, self.matrix.problems)),
            # The script counts the last one's shown columns.
            leading=("order", "cheapest 1e-3", "agrees"),
            shares=tuple(_SHARES),
            legend=f"{_meanings(self.matrix)}{_READING} {_OWN} {_CHEAPEST_READING}",
            apart=_APART,
            compact=tuple(self.compact()),
        )

    def _row(self, scheme: str, label: str) -> GridRow:
        problems = self.matrix.problems
        runs = [self._runs.get((label, problem.name)) for problem in problems]
        made = [run for run in runs if run is not None]
        cells: list[GridCell | None] = []
        for run, problem in zip(runs, problems, strict=True):
            cells.append(None if run is None else _cell(run, problem))
        agreeing = f"{sum(run.outcome is Outcome.AGREES for run in made)}/{len(made)}"
        order, basis = _order(self.matrix, label)
        first = made[0]
        facts = (
            ("scheme", scheme),
            *((("preset", MEANINGS[first.preset]),) if first.preset in MEANINGS else ()),
            ("order", _order_text(order, basis)),
            *_cheapest_of(self.matrix, label),
            ("agrees", f"on {agreeing.replace('/', ' of ')} problems"),
            ("trebucheck supplies", _supplied(made)),
            *_cost(made),
            ("version", _joined(f"{run.engine} {run.engine_version}" for run in made)),
            ("runs of", _joined(run.date for run in made)),
        )
        return GridRow(
            engine=first.engine,
            preset=first.preset,
            group=scheme,
            cells=tuple(cells),
            leading=(order, _times_cheapest(self.matrix, label), agreeing),
            card=doc.Card(label, facts=facts, link=(self.links or {}).get(first.engine, "")),
            apart=all(run.is_dynamics for run in made),
        )

    def compact(self) -> Iterator[doc.Table]:
        """Signs of all presets of an engine in a cell: problems by class against engines."""
        counted = counted_runs(self.matrix)
        engines = sorted({run.engine for run in counted})
        heads = [doc.words("problem", wrap=False)]
        for engine in engines:
            link = (self.links or {}).get(engine)
            title = f"[{engine}]({link})" if link else engine
            heads.append(doc.Column(title, align="left", wrap=False))
        signs = {(run.engine, run.preset, run.problem): _sign(run) for run in counted}
        rows: list[doc.Row] = []
        group = ""
        for problem in self.matrix.problems:
            if problem.group != group:
                group = problem.group
                rows.append(doc.row(doc.Cell(group, "strong")))
            cells = [problem.name]
            for engine in engines:
                keys = ((engine, preset, problem.name) for preset in self.matrix.presets)
                cells.append(" ".join(signs.get(key, _NOT_RUN) for key in keys))
            rows.append(doc.row(*cells))
        caption = "Verdicts"
        if len(self.matrix.presets) > 1:
            caption += f", in the order {', '.join(self.matrix.presets)}"
        yield doc.table(heads, rows, caption)


def _sign(run: MatrixRun) -> str:
    """Sign of a verdict, with the symbol of the quantity farthest beyond its tolerance."""
    return STATES[run.outcome].sign + _symbol(run)


def _symbol(run: MatrixRun) -> str:
    if run.outcome is not Outcome.DISAGREES or run.worst is None:
        return ""
    return run.worst.kind.symbol


def _meanings(matrix: Matrix) -> str:
    """Meanings of the presets, in sentences."""
    known = [preset for preset in matrix.presets if preset in MEANINGS]
    return "".join(f"{preset.capitalize()}: {MEANINGS[preset]}. " for preset in known)


def _column(problem: MatrixProblem) -> GridColumn:
    entry = find_benchmark(problem.name)
    features = [
        name
        for name, has in (
            ("stops", problem.stops),
            ("loops of joints", problem.loops),
            ("springs, dampers or motors", problem.elements),
        )
        if has
    ]
    elements = _NOT_KEPT
    if problem.features is not None:
        elements = ", ".join(problem.features) or "pins, slots and stops on the ground alone"
    facts = (
        ("class", problem.group),
        ("elements", elements),
        ("judged to", f"{problem.judged_to:.6g} s"),
        ("law of the stops", problem.stop_law if problem.stops else "it has none"),
        ("mechanism's hash", problem.mechanism_hash[:16]),
        *((("source", entry.source),) if entry is not None else ()),
    )
    lead = "" if entry is None else f"{entry.text[:1].upper()}{entry.text[1:]}."
    return GridColumn(
        name=problem.name,
        group=problem.group,
        features=(*features, *(problem.features or ())),
        card=doc.Card(problem.name, lead, facts=facts),
    )


def _cell(run: MatrixRun, problem: MatrixProblem) -> GridCell:
    state, own = STATES[run.outcome], _own(run, problem)
    facts = [
        *_why(run),
        ("the engine's own", _own_text(run, own)),
        ("settings", _NOT_KEPT if run.settings is None else format_settings(run.settings)),
        *_cost([run]),
        ("versions", f"{run.engine} {run.engine_version}, {run.made_text}"),
    ]
    if any(error.judged is None for error in run.errors):
        facts.insert(0, ("quantities", "others are not kept in this file"))
    title, quantities = f"{run.label}: {problem.name}", tuple(_quantities(run))
    card = doc.Card(title, _lead(run), quantities, tuple(facts), command_of(run, problem))
    return GridCell(state.name, card, _symbol(run), _heat(run), own)


def _lead(run: MatrixRun) -> str:
    """The verdict in a sentence."""
    held = f"{run.held} of {run.judged} judged figures hold"
    limit = "its limit of time" if run.time_limit is None else f"{run.time_limit:g} s"
    sentences: Mapping[Outcome, str] = {
        Outcome.AGREES: f"Agrees: {held}; the farthest, {_farthest(run)}.",
        Outcome.DISAGREES: f"Disagrees: {_farthest(run)}; {held}.",
        Outcome.NOT_JUDGED: f"Not judged: a quantity has no tolerance; {held}.",
        Outcome.NOT_EQUIVALENT: "The built model is another one: its motion was not compared.",
        Outcome.FAILED: "The run failed.",
        Outcome.TIMED_OUT: f"Not finished in {limit}, and stopped.",
        Outcome.ABSENT: "The engine is not installed.",
        Outcome.UNSUPPORTED: f"Our adapter of {run.engine} does not build it; the engine may.",
    }
    return sentences[run.outcome]


def _farthest(run: MatrixRun) -> str:
    """The figure farthest beyond its tolerance, or nearest to it, and how far."""
    if run.worst is None:
        return "no figure"
    name = _figure(run.worst.label)
    if run.worst.ratio is None:
        return f"{name} is missing"
    if run.worst.ratio > 1.0:
        return f"{name} is {_size(run.worst.ratio)} times its tolerance"
    return f"{name} is at {_size(run.worst.ratio)} of its tolerance"


def _size(ratio: float | None) -> str:
    """An error over its tolerance; None or infinite: there is no figure."""
    if ratio is None or math.isinf(ratio):
        return "missing"
    return format_number(ratio)


def _figure(label: str) -> str:
    """Title of a metric's label, with its subject."""
    name, subject = parse_label(label)
    title = _title(name) if name in QUANTITIES else name
    return title if subject is None else f"{title} of {subject}"


def _title(metric: str) -> str:
    return QUANTITIES[metric].words


def _why(run: MatrixRun) -> Iterator[tuple[str, str]]:
    """Own words of the adapter or the failure, what broke first, and its cause."""
    if run.message:
        refused = run.outcome is Outcome.UNSUPPORTED
        yield "the adapter's words" if refused else "message", run.message
    if run.first_in is not None:
        when = "before any motion"
        if run.first_at is not None:
            when = f"at {run.first_at:.6g} s"
        elif run.settings is None:
            when = f"when is {_NOT_KEPT}"
        yield "broke first", f"{_figure(run.first_in)}, {when}"
    if run.outcome is Outcome.DISAGREES:
        yield "likeliest cause", _cause(run)


def _cause(run: MatrixRun) -> str:
    if run.first_in is None:
        return "not looked for"
    if not run.causes:
        return "unknown"
    share = ""
    if run.explained is not None:
        share = f", which explains {100 * run.explained:.1f} % of it"
    shown = ", as a run without it shows" if run.confirmed else ""
    return " or ".join(run.causes) + share + shown


def _own_text(run: MatrixRun, own: str) -> str:
    if run.supplied is None:
        return _SHARES[own]
    return f"{_SHARES[own]}; trebucheck supplies: {parts(run.supplied) or 'nothing'}"


def _supplied(runs: Iterable[MatrixRun]) -> str:
    """Parts that trebucheck does in any of the runs."""
    supplied: dict[str, str] = {}
    for run in runs:
        if run.supplied is None:
            return _UNSTATED
        supplied |= run.supplied
    return parts(supplied) or "nothing"


def _cost(runs: list[MatrixRun]) -> Iterator[tuple[str, str]]:
    """Steps and wall time, of several runs from the least to the largest."""
    timed = [run for run in runs if run.wall_time is not None]
    if not timed:
        if any(run.settings is None and run.outcome in COMPARED for run in runs):
            yield "cost", _NOT_KEPT
        return
    steps = _span(((run.steps or 0) for run in timed), "d")
    walls = _span((run.wall_time or 0.0 for run in timed), ".2g")
    costs = [run.cost for run in timed if run.cost is not None]
    processor = f", {_span(costs, '.2g')} s by the processor without reading" if costs else ""
    yield "cost", f"{steps} steps, {walls} s{processor}"


def _span(values: Iterable[float], form: str) -> str:
    ordered = sorted(values)
    low, high = format(ordered[0], form), format(ordered[-1], form)
    return low if low == high else f"{low} to {high}"


def _joined(texts: Iterable[str]) -> str:
    return ", ".join(sorted(set(texts)))


def _quantities(run: MatrixRun) -> Iterator[doc.QuantityRow]:
    """Errors by quantity, the farthest beyond its tolerance first, what is not judged last."""
    errors = [*run.errors]
    if run.worst is not None:
        # Files of earlier releases keep the ratio of the worst figure, and not always its error.
        metric, subject = parse_label(run.worst.label)
        error = run.error(metric)
        if error is None or (error.judged is None and error.subject != subject):
            errors = [each for each in errors if each is not error]
            yield doc.QuantityRow(
                quantity=_title(metric),
                subject=subject or "",
                error=_NOT_KEPT,
                ratio=_size(run.worst.ratio),
                holds=run.worst.ratio is not None and run.worst.ratio <= 1.0,
            )
    yield from map(_quantity, sorted(errors, key=_place))


def _place(error: Error) -> float:
    """Key that puts the farthest beyond its tolerance first, and what is not judged last."""
    return math.inf if error.ratio is None else -error.ratio


def _quantity(error: Error) -> doc.QuantityRow:
    value, ratio, tolerance, part, count = format_number(error.value), "", "", "", ""
    if not error.kept:
        value = ratio = _NOT_KEPT
    elif error.value is None:
        value = error.note or "missing"
    elif error.ratio is not None:
        ratio = format_number(error.ratio)
    if error.tolerance is not None:
        tolerance = format_number(error.tolerance)
    elif error.value is not None and error.note:
        tolerance = f"not judged: {error.note}"
    if error.part is not None and error.observed:
        part = format_number(error.part)
    if error.judged:
        count = f"{error.held} of {error.judged}"
    return doc.QuantityRow(
        quantity=_title(error.metric),
        subject=error.subject or "",
        error=value,
        tolerance=tolerance,
        unit=error.unit if error.unit != "1" else "",
        ratio=ratio,
        holds=error.holds,
        part=part,
        count=count,
        source=_SOURCES.get(error.source or "", ""),
    )


_SOURCES: Mapping[str, str] = {"need": "need", "claim": "claim"}  # the default is every run's
_HEAT = 4.0  # powers of ten beyond a tolerance from which cells are alike


def _heat(run: MatrixRun) -> float:
    """How far beyond its tolerance a run is, from 0 to 1."""
    if run.outcome is not Outcome.DISAGREES or run.worst is None:
        return 0.0
    return min(1.0, math.log10(max(_ratio(run), 1.0)) / _HEAT)


_CHEAPEST = f"Cheapest that holds {HOLDS:.0e}".replace("e-0", "e-")


_CHEAPEST_READING = (
    "Cheapest 1e-3: on how many problems the preset is its engine's cheapest that keeps every "
    "point within a thousandth of the longest way that a point goes, of those on which costs were "
    f"measured; {_NOT_MEASURED_SHORT}: {_NOT_MEASURED}."
)


def _time(seconds: float) -> str:
    return f"{1e3 * seconds:.2g} ms" if seconds < 1.0 else f"{seconds:.3g} s"


def _times_cheapest(matrix: Matrix, label: str) -> str:
    """Number of problems on which a preset is its engine's cheapest, of those measured."""
    swept = [sweep for sweep in matrix.sweeps if sweep.label == label]
    if not swept:
        return _NOT_MEASURED_SHORT
    return f"{len([*_wins(matrix, label)])}/{len(swept)}"


def _wins(matrix: Matrix, label: str) -> Iterator[tuple[CostSweep, StepCost]]:
    """Sweeps of a preset with the step that is its engine's cheapest."""
    for sweep in matrix.sweeps:
        if sweep.label == label:
            cheapest = matrix.cheapest(sweep.engine, sweep.problem)
            if cheapest is not None and cheapest[0] is sweep:
                yield cheapest


def _cheapest_of(matrix: Matrix, label: str) -> Iterator[tuple[str, str]]:
    """Problems on which a preset is its engine's cheapest, with step and cost."""
    texts = [
        f"{sweep.problem} at {format_step(point.timestep)} s, {_time(point.cost)}"
        for sweep, point in _wins(matrix, label)
    ]
    measured = any(sweep.label == label for sweep in matrix.sweeps)
    yield _CHEAPEST.lower(), "; ".join(texts) or ("on no problem" if measured else _NOT_MEASURED)


def _cheapest_text(matrix: Matrix, engine: str, problem: str) -> str:
    """Preset, step and cost of an engine on a problem."""
    found = matrix.cheapest(engine, problem)
    if found is not None:
        sweep, point = found
        return f"{sweep.preset}, {format_step(point.timestep)} s: {_time(point.cost)}"
    tried = any((each.engine, each.problem) == (engine, problem) for each in matrix.sweeps)
    return "none of the steps" if tried else _NOT_MEASURED


def _cheapest(matrix: Matrix) -> Iterator[doc.Block]:
    """Preset, step and cost of each engine that hold a thousandth of the way, by problem."""
    if not matrix.sweeps:
        yield doc.Text(f"{_CHEAPEST}: {_NOT_MEASURED}.")
        return
    engines = sorted({sweep.engine for sweep in matrix.sweeps})
    others = sorted({run.engine for run in matrix.runs} - {*engines})
    rows: list[tuple[str, ...]] = []
    for problem in matrix.problems:
        for engine in engines:
            text = _cheapest_text(matrix, engine, problem.name)
            if text != _NOT_MEASURED:
                rows.append((problem.name, engine, text))
    made = {f"{sweep.engine} {sweep.engine_version}" for sweep in matrix.sweeps}
    on = {sweep.processor or "a processor that is not kept in the file" for sweep in matrix.sweeps}
    yield doc.Note(
        "Preset, step and processor time of the run that keeps every point within a thousandth of "
        "the longest way that a point goes, at the least cost of all steps that were tried; our "
        f"reading is taken out where it is told apart. {_joined(made)}; on {_joined(on)}."
        + (f" {_NOT_MEASURED.capitalize()}: {', '.join(others)}." if others else "")
    )
    heads = (doc.words("problem", wrap=False), "engine", "preset, step and time")
    yield doc.table(heads, rows, _CHEAPEST)


def _order(matrix: Matrix, label: str) -> tuple[str, str]:
    """Order of an engine's error in the step, and where it comes from."""
    orders = [order for order in matrix.orders if order.label == label]
    # Where a sweep begins at the floor of rounding it finds no power; another one may.
    orders.sort(key=lambda order: order.exponent is None)
    if not orders:
        declared = next(iter(matrix.of(label))).order
        return _NO_ORDER if declared is None else f"{declared:g}", "declared, not measured"
    order = orders[0]
    if order.exponent is not None:
        width = order.half_width or 0.0
        return f"{order.exponent:.2f}", f"± {width:.1g}, measured on {order.problem}"
    if order.floor is None:
        return _NO_ORDER, f"no power of the step was found on {order.problem}"
    floor = f"floor of {format_number(order.floor)} m on {order.problem}"
    if order.floor_cause:
        floor += f", set by {order.floor_cause}"
    return _NO_ORDER, floor


def _order_text(order: str, basis: str) -> str:
    """Order and where it comes from; its uncertainty, where there is one, stands first there."""
    return f"{order}{' ' if basis.startswith('±') else ', '}{basis}"


# --- Dynamics, refusals, causes, versions


def _dynamics(matrix: Matrix) -> Iterator[doc.Block]:
    """Mass matrices, forces and accelerations of engines that trebucheck's steps move."""
    found = defaultdict[tuple[str, ...], list[tuple[Check, DynamicsCheck]]](list)
    for each in matrix.dynamics:
        for check in each.checks:
            found[each.label, each.engine_version, check.name].append((check, each))
    rows: list[tuple[object, ...]] = []
    for key, checks in found.items():
        worst, of = max(checks, key=lambda one: share_of(one[0].value, one[0].tolerance) or 0.0)
        value = doc.Cell(format_number(worst.value), doc.mark_of(worst.holds))
        holding = f"{sum(check.holds for check, _ in checks)} of {len(checks)}"
        where = f"{of.problem}, {worst.subject}" if worst.subject else of.problem
        rows.append((*key, holding, value, format_number(worst.tolerance), worst.unit, where))
    if rows:
        yield doc.Heading("Dynamics", 2)
        yield doc.Note(
            "Engines whose steps are trebucheck's: their built model against the reference's "
            "equations in random states. Of each quantity the figure that is farthest towards its "
            "tolerance, of all problems, coordinates and bodies."
        )
        yield doc.table("engine | version | quantity | hold | error | tolerance | unit | of", rows)


_ENGINE = doc.words("engine", wrap=False)


def _missing(matrix: Matrix) -> Iterator[doc.Block]:
    """Refusals of our adapters and failures, once each."""
    groups = _grouped(
        (run for run in matrix.runs if run.outcome not in COMPARED),
        lambda run: (run.engine, STATES[run.outcome].label, run.message or "no reason was given"),
    )
    rows: list[tuple[str, ...]] = []
    for (engine, outcome, message), runs in groups.items():
        rows.append((engine, outcome, _presets(runs), _names(runs), message))
    if rows:
        yield doc.Note("The words are those of adapters and runs; an engine may well do more.")
        heads = (_ENGINE, *map(doc.words, ("verdict", "presets", "problems", "in words")))
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
        figures = [run for run in runs if run.worst is not None]
        if figures:  # a missing one is farther than all others
            farthest = _farthest(max(figures, key=_ratio))
        rows.append((*group, _names(runs), farthest))
    if rows:
        known = [run for run in matrix.runs if run.first_in is not None]
        confirmed = sum(run.confirmed for run in known)
        yield doc.Note(
            "What accounts for the difference: suspects, solved again with the size found, and "
            "causes without which the engine was run again, which takes out a half or more of it. "
            f"Of {len(known)} differences {confirmed} have a cause that a run without it shows, "
            f"{sum(not run.causes for run in known)} have none that is known."
        )
        heads = (_ENGINE, *map(doc.words, ("likeliest cause", "problems", "farthest off")))
        yield doc.table(heads, rows)


def _ratio(run: MatrixRun) -> float:
    ratio = None if run.worst is None else run.worst.ratio
    return math.inf if ratio is None else ratio


def _grouped(
    runs: Iterable[MatrixRun], key: Callable[[MatrixRun], tuple[str, ...]]
) -> dict[tuple[str, ...], list[MatrixRun]]:
    groups: dict[tuple[str, ...], list[MatrixRun]] = {}
    for run in runs:
        groups.setdefault(key(run), []).append(run)
    return dict(sorted(groups.items()))


def _names(runs: Iterable[MatrixRun]) -> str:
    return ", ".join(dict.fromkeys(run.problem for run in runs))


def _presets(runs: Iterable[MatrixRun]) -> str:
    return ", ".join(dict.fromkeys(run.preset for run in runs))


def _provenance(matrix: Matrix) -> Iterator[doc.Block]:
    problems: list[tuple[str, ...]] = []
    for p in matrix.problems:
        problems.append((p.name, p.group, f"{p.judged_to:.6g}", p.stop_law, p.mechanism_hash[:16]))
    yield doc.table("problem | class | judged to [s] | law of the stops | hash", problems)
    by_engine = _grouped(matrix.runs, lambda run: (run.engine, run.engine_version, run.made_by))
    rows: list[tuple[str, ...]] = []
    for made_by, runs in by_engine.items():
        spans: list[str] = []
        for preset in matrix.presets:
            steps = [run.timestep for run in runs if run.preset == preset and run.timestep]
            if steps:
                spans.append(f"{preset} {_span(steps, '.2g')}")
        rows.append((*made_by, _joined(run.date for run in runs), "; ".join(spans)))
    heads = ["engine", "version", "trebucheck", "date of the runs", doc.words("steps [s]")]
    yield doc.table(heads, rows)


# --- The page of one engine


def engine_document(matrix: Matrix, engine: str, study: EngineStudy, dispute: str) -> doc.Document:
    """An engine by its runs alone: what it keeps, breaks and refuses, and its settings.

    Args:
        matrix: runs of all engines.
        engine: its name.
        study: its title, binding and note.
        dispute: where to dispute the page, as a sentence.

    Raises:
        InputError: it has no run.
    """
    runs = [run for run in matrix.runs if run.engine == engine]
    if not runs:
        raise InputError(f"there is no run of {engine!r} among the results.")
    presets = [preset for preset in matrix.presets if any(run.preset == preset for run in runs)]
    sides = [_Side(matrix, engine, preset) for preset in presets]
    title = study.title or engine
    version = _joined(run.engine_version for run in runs)
    binding = f", by {study.binding}" if study.binding else ""
    made = _joined(run.made_text for run in runs)
    processors = [s.processor for s in matrix.sweeps if s.engine == engine and s.processor]
    if processors:
        made += f", costs on {_joined(processors)}"
    blocks: list[doc.Block] = [
        doc.Text(f"{title} {version}{binding}. Runs by {made}."),
        doc.table(
            "preset | scheme | order | agrees | own | cost | cheapest 1e-3 | verdicts",
            map(_short, sides),
        ),
        doc.Heading("What was set, and what would change it", 2),
        *_note(study, sides, version),
        doc.Heading("By problem", 2),
        doc.Note(
            "Sign of the verdict; the figure nearest to its tolerance, or farthest beyond: "
            f"its error over its tolerance. {_CHEAPEST_READING}"
        ),
        doc.table(("problem", *presets, _CHEAPEST.lower()), _by_problem(matrix, sides)),
        doc.Heading("What it keeps and breaks", 2),
        doc.Note("Problems on which a quantity holds, and the worst: error over tolerance."),
        doc.table(("quantity", *presets), _by_quantity(sides)),
        *_refused(matrix, runs),
        doc.Heading("Settings", 2),
        *_settings(sides),
        doc.Heading("What is its own", 2),
        doc.Listing(tuple(side.own for side in sides)),
        doc.Heading("Where to dispute it", 2),
        doc.Text(dispute),
    ]
    heading = f"{title}: what it keeps, breaks and refuses, and the settings to use"
    return doc.Document(heading, tuple(blocks))


@dataclass(frozen=True)
class _Side:
    """Runs of an engine with a preset, whose members a note's template reads.

    There `plain` is the first preset, `best` the last, `alone` the last without assistance.
    """

    matrix: Matrix
    engine: str
    preset: str

    @cached_property
    def runs(self) -> Mapping[str, MatrixRun]:
        """Its runs by problem."""
        return {run.problem: run for run in self.matrix.of(f"{self.engine} {self.preset}")}

    @property
    def agrees(self) -> str:
        """Number of problems on which it agrees."""
        agreeing = sum(run.outcome is Outcome.AGREES for run in self.runs.values())
        return f"{agreeing} of {len(self.runs)}"

    @property
    def order(self) -> str:
        """Order of its error in the step, and where it comes from."""
        order, basis = _order(self.matrix, f"{self.engine} {self.preset}")
        return basis if order == _NO_ORDER else _order_text(order, basis)

    @property
    def own(self) -> doc.Text:
        """Parts of its runs that are trebucheck's."""
        text = _supplied(self.runs.values())
        return doc.Text(f"trebucheck supplies: {text}.", lead=f"{self.preset}:")

    def error(self, problem: str, quantity: str) -> str:
        """Error on a problem in a quantity, with its unit."""
        found = self._found(problem, quantity)
        return _ABSENT if found is None else f"{format_number(found.value)} {found.unit}"

    def ratio(self, problem: str, quantity: str) -> str:
        """The same error over its tolerance."""
        found = self._found(problem, quantity)
        return _ABSENT if found is None else _size(found.ratio)

    def step(self, problem: str) -> str:
        """Time step on a problem."""
        run = self.runs.get(problem)
        return _ABSENT if run is None else f"{format_step(run.timestep)} s"

    def setting(self, option: str) -> str:
        """Value of an option, the same on all problems or from the least to the largest."""
        return dict(_options(self)).get(option, _ABSENT)

    def _found(self, problem: str, quantity: str) -> Error | None:
        run = self.runs.get(problem)
        if run is not None:
            for error in run.errors:
                if _title(error.metric) == quantity and error.kept:
                    return error
        return None


def _short(side: _Side) -> tuple[object, ...]:
    """A preset in a line."""
    runs = [*side.runs.values()]
    problems = {problem.name: problem for problem in side.matrix.problems}
    own = [_own(run, problems[run.problem]) for run in runs if run.outcome in COMPARED]
    least = max(own, key=[*_SHARES].index, default="")
    scheme = runs[0].scheme or _SCHEME_UNSTATED
    cost = dict(_cost(runs)).get("cost", "")
    cheapest = _times_cheapest(side.matrix, runs[0].label).replace("/", " of ")
    if cheapest == _NOT_MEASURED_SHORT:
        cheapest = _NOT_MEASURED
    return side.preset, scheme, side.order, side.agrees, least, cost, cheapest, _counts(runs)


def _note(study: EngineStudy, sides: list[_Side], version: str) -> Iterator[doc.Block]:
    """The maintainers' note, its numbers read from the runs."""
    note = study.maintainers_note
    if note is None:
        yield doc.Text("No note is written yet.")
        return
    unaided = [side for side in sides if preset_rank(side.preset) < preset_rank(ASSISTED)]
    alone = (unaided or sides)[-1]
    values = {"plain": sides[0], "best": sides[-1], "alone": alone, "version": version}
    environment = Environment(undefined=StrictUndefined, autoescape=False)  # it is no HTML
    for lead, template in (
        ("What was set, and why:", note.chosen),
        ("What was not possible:", note.not_possible),
        ("What would change it:", note.would_change),
    ):
        yield doc.Text(environment.from_string(template).render(values), lead=lead)


def _by_problem(matrix: Matrix, sides: list[_Side]) -> Iterator[doc.Row]:
    """The verdict of each preset on each problem, with the figure that decides it."""
    group = ""
    for problem in matrix.problems:
        if problem.group != group:
            group = problem.group
            yield doc.row(doc.Cell(group, "strong"))
        cells: list[str] = [problem.name]
        for side in sides:
            run = side.runs.get(problem.name)
            text = _NOT_RUN
            if run is not None:
                text = STATES[run.outcome].sign
                if run.worst is not None:
                    text += f" {_figure(run.worst.label)}: {_size(run.worst.ratio)}"
                elif run.outcome not in COMPARED:
                    text += f" {STATES[run.outcome].label}"
            cells.append(text)
        yield doc.row(*cells, _cheapest_text(matrix, sides[0].engine, problem.name))


def _by_quantity(sides: list[_Side]) -> Iterator[tuple[str, ...]]:
    """On how many problems each quantity holds, by preset."""
    for name in QUANTITIES:
        cells: list[str] = []
        for side in sides:
            held = [
                (error, run.problem)
                for run in side.runs.values()
                for error in run.errors
                if error.metric == name and error.holds is not None
            ]
            holding = sum(error.holds is True for error, _ in held)
            text = f"{holding} of {len(held)}" if held else ""
            kept = [(error.ratio or 0.0, problem) for error, problem in held if error.kept]
            if kept:
                ratio, problem = max(kept)
                text += f"; {_size(ratio)} on {problem}"
            cells.append(text)
        if any(cells):
            yield _title(name), *cells


def _refused(matrix: Matrix, runs: list[MatrixRun]) -> Iterator[doc.Block]:
    """Refusals of the adapter, and runs that failed or did not end."""
    shown = [run for run in runs if run.outcome not in COMPARED]
    if not shown:
        return
    groups = _grouped(shown, lambda run: (STATES[run.outcome].label, run.message or ""))
    rows: list[tuple[str, ...]] = []
    for (verdict, message), group in groups.items():
        rows.append((_names(group), verdict, _presets(group), message))
    yield doc.Heading("What our adapter does not build, and what did not end", 2)
    yield doc.Note("The words are the adapter's; the engine may well do more.")
    yield doc.table("problem | verdict | presets | in words", rows)


def _settings(sides: list[_Side]) -> Iterator[doc.Block]:
    """Options of each preset, as the runs had them."""
    by_preset = [dict(_options(side)) for side in sides]
    names: dict[str, None] = {}
    for options in by_preset:
        names |= dict.fromkeys(options)
    if not names:
        yield doc.Text(f"They are {_NOT_KEPT}.")
        return
    rows: list[tuple[str, ...]] = []
    for name in names:
        rows.append((f"`{name}`", *(options.get(name, "") for options in by_preset)))
    yield doc.table(("option", *(side.preset for side in sides)), rows)


def _options(side: _Side) -> Iterator[tuple[str, str]]:
    """Values of options; a number that differs between problems from the least to the largest."""
    values: dict[str, list[JsonValue]] = {}
    for run in side.runs.values():
        for name, value in (run.settings or {}).items():
            values.setdefault(name, []).append(value)
    for name, given in values.items():
        numbers = [v for v in given if isinstance(v, int | float) and not isinstance(v, bool)]
        if len(numbers) == len(given):
            yield name, _span(numbers, ".6g")
        else:
            yield name, ", ".join(dict.fromkeys(format_value(value) for value in given))
