"""The page of the difference of two comparisons, what matters most first."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from ...diff import Difference, Fate, QuantityChange, RunChange
from ...runs.results import Metric
from .. import document as doc
from ..document import format_number, format_step
from .tables import cause_text, diagnosis, verdict_blocks

_QUESTION = "What moved from one comparison to the other, and what broke?"
_SHOWN = 20  # rows of a table that are shown at once
_NAMED = 4  # runs whose names are shown with a change of an option
_MARKS: dict[Fate, doc.Mark] = {
    Fate.SAME: "plain",
    Fate.BETTER: "good",
    Fate.WORSE: "bad",
    Fate.FAILS: "bad",
    Fate.APPEARED: "warning",
    Fate.VANISHED: "bad",
    Fate.NOT_COMPARED: "warning",
}
_HOW = (
    "Runs belong together by model, engine and preset. An error is the largest difference to the "
    "reference. It has moved if it changed by more than both results leave unknown of it, and by "
    "more than a factor {factor:g}. Unknown is the sum of the reference's uncertainty, of what the "
    "samples leave unknown, and of the rounding of the engine's steps (the root of their number "
    "times 2.2e-16 of the scale, carried on by the motion's stretching), of both results; a "
    "smaller error counts as that, and its factor is a bound (over). Tables show errors with two "
    "digits, and a tenth is what their second digit tells: hence 1.1, unless another factor is "
    "asked for. Quantities that follow from others, and wall times, are not judged. A verdict that "
    "held and is judged no longer has got worse, too."
)


def document(difference: Difference) -> doc.Document:
    """Report of a difference; a terminal has the tables in short, and the summary at their end."""
    summary, factor = difference.summary, difference.factor
    first_verdict, last_verdict = verdict_blocks(summary, doc.mark_of(difference.passed))
    broken = {(change.model, change.run) for change in difference.broken}
    why: list[doc.Text] = []
    for change in difference.runs:
        if change.new is not None and (change.new.model, change.new.label) in broken:
            lead = f"{_name(change)}, why:"
            why += [doc.Text(sentence, "strong", lead) for sentence in diagnosis(change.new)]
    blocks = (
        first_verdict,
        _tiles(difference),
        *_conditions_of_all(difference),
        *_runs(difference),
        *_quantities("Verdicts that broke", difference.broken),
        doc.Listing(tuple(why)),
        *_quantities("Verdicts mended", difference.mended),
        *_quantities(f"Errors that moved by more than a factor {factor:g}", difference.moved),
        *_changes_by_run(difference),
        doc.Note(_HOW.format(factor=factor)),
        last_verdict,
    )
    return doc.Document(_QUESTION, blocks, "trebucheck diff", verdict=summary)


def _tiles(difference: Difference) -> doc.Tiles:
    """Numbers of changes."""
    lost = len(difference.of_fate(Fate.WORSE, Fate.FAILS, Fate.VANISHED))
    quantities, runs = len(difference.quantities), len(difference.runs)
    counts: tuple[tuple[int, str, doc.Mark, str], ...] = (
        (len(difference.broken), "verdicts broke", "bad", ""),
        (lost, "runs worse, failing or gone", "bad", ""),
        (len(difference.mended), "verdicts mended", "good", ""),
        (len(difference.moved), "further errors moved", "plain", f"of {quantities}"),
        (difference.compared, "runs compared", "plain", f"of {runs}"),
    )
    tiles: list[doc.Tile] = []
    for number, label, mark, detail in counts:
        tiles.append(doc.Tile(str(number), label, mark if number else "plain", detail))
    return doc.Tiles(tuple(tiles))


def _conditions_of_all(difference: Difference) -> Iterator[doc.Block]:
    """Versions, and figures of the reference that moved: all errors are measured from it."""
    if difference.versions:
        heads = (doc.words("version of", wrap=False), doc.words("old"), doc.words("new"))
        rows = [(name, *both) for name, both in difference.versions.items()]
        yield doc.table(heads, rows, "Versions that changed")
    else:
        yield doc.Text("The versions of engines, trebucheck, Python and platform are the same.")
    if difference.references:
        yield doc.Heading("The reference moved", 2, medium="any")
        moved: list[tuple[object, ...]] = []
        for change in difference.references:
            values = (change.old, change.new)
            old, new = ("none" if value is None else f"{value:.15g}" for value in values)
            uncertain = format_number(change.unknown)
            figure = change.model, change.figure, old, doc.Cell(new, "bad")
            moved.append((*figure, change.unit, uncertain))
        yield doc.table("machine | figure | old | new | unit | uncertain by", moved)
        yield doc.Text(
            "Its figures moved by more than they are uncertain by. The mechanism is the same, so "
            "the law of its stops is another one, or one of the two references is wrong; errors "
            "that moved may only follow."
        )


# --- Runs

_URGENT = (Fate.VANISHED, Fate.FAILS, Fate.WORSE, Fate.NOT_COMPARED, Fate.BETTER, Fate.APPEARED)


def _runs(difference: Difference) -> Iterator[doc.Block]:
    """Runs whose verdict changed, or that have come or gone, and how much of each run changed."""
    changed = [change for change in difference.runs if change.fate is not Fate.SAME]
    changed.sort(key=lambda change: _URGENT.index(change.fate))
    rows: list[doc.Row] = []
    for change in changed:
        message = change.reason or (change.new.message if change.new else None) or ""
        old, new = (run.outcome.value if run else "–" for run in (change.old, change.new))
        fate = doc.Cell(change.fate.value, _MARKS[change.fate])
        rows.append(doc.row(_name(change), old, new, fate, message))
    if rows:
        heads = (*doc.columns("run | old | new"), doc.Column("what", rank=0), doc.words("message"))
        shown = doc.table(heads, rows, "Verdicts of whole runs, old and new")
        yield doc.Heading(f"Runs that changed ({len(changed)})", 2, medium="any")
        yield doc.without_empty_columns(shown)
    counts = [row for change in difference.runs for row in _counts(difference, change)]
    if counts:
        heads = doc.columns("run | broke | mended | grew | shrank | compared")
        yield doc.Heading("How much changed in each run", 2, medium="any")
        yield doc.table((*heads, doc.words("largest growth")), counts, "Numbers of quantities")


def _name(change: RunChange) -> str:
    return f"{change.run.model}, {change.run.label}"


def _counts(difference: Difference, change: RunChange) -> Iterator[doc.Row]:
    """Tell how many of a run's quantities changed in which way; nothing if none did."""
    in_run = set(map(id, change.quantities))
    broke, mended, moved = (
        [quantity for quantity in group if id(quantity) in in_run]
        for group in (difference.broken, difference.mended, difference.moved)
    )
    if not (broke or mended or moved):
        return
    grew = [quantity for quantity in moved if quantity.factor is None or quantity.factor > 1]
    counts: tuple[tuple[int, doc.Mark], ...] = (
        (len(broke), "bad"),
        (len(mended), "good"),
        (len(grew), "plain"),
        (len(moved) - len(grew), "plain"),
    )
    cells = (doc.Cell(str(number), mark if number else "plain") for number, mark in counts)
    worse = [quantity for quantity in change.quantities if quantity in broke or quantity in grew]
    worst = max(worse, key=lambda quantity: quantity.factor or 0.0, default=None)
    growth = ""
    if worst is not None and (worst.factor or 0.0) > 1:
        growth = f"{_factor(worst)} in {worst.either.label}"
    yield doc.row(_name(change), *cells, len(change.quantities), growth)


def _changes_by_run(difference: Difference) -> Iterator[doc.Block]:
    """Changed causes and conditions, and wall times, which depend on what else the machine did."""
    diagnoses: list[doc.Text] = []
    settings: dict[str, list[str]] = {}  # runs of each change of an option
    times: list[tuple[object, ...]] = []
    for change in difference.runs:
        name, old, new = _name(change), change.old, change.new
        if change.diagnoses:
            was, is_now = map(cause_text, change.diagnoses)
            diagnoses.append(doc.Text(f"was {was}; is {is_now}.", lead=f"{name}:"))
        for option, (before, after) in change.settings.items():
            line = f"{option} {_setting(before)} → {_setting(after)}"
            settings.setdefault(line, []).append(name)
        if old and new and old.wall_time and new.wall_time:
            seconds = f"{old.wall_time:.2f}", f"{new.wall_time:.2f}"
            times.append((name, *seconds, old.steps, new.steps))
    if diagnoses:
        yield doc.Heading("Diagnoses that changed", 2, medium="any")
        yield doc.Listing(tuple(diagnoses))
    # Changed settings, tolerances and horizons: a change of ours, not of an engine.
    sentences = [*difference.conditions]
    for line, names in settings.items():
        more = f" and {len(names) - _NAMED} more runs" if len(names) > _NAMED else ""
        sentences.append(f"{line}: {'; '.join(names[:_NAMED])}{more}.")
    loosened = 0
    for quantity in difference.quantities:
        old, new = _tolerances(quantity)
        loosened += old is not None and new is not None and new > difference.factor * old
    if loosened:
        number = f"{loosened} of {len(difference.quantities)}"
        factor = f"more than a factor {difference.factor:g}"
        sentences.append(f"Tolerances of {number} quantities are looser now, by {factor}.")
    if sentences:
        yield doc.Heading("Conditions that changed", 2, medium="any")
        yield doc.Listing(tuple(map(doc.Text, sentences)))
    if times:
        heads = "run | old [s] | new [s] | old steps | new steps"
        shown = doc.table(heads, times, medium="page")
        yield doc.Fold("Wall times and steps, not judged", (shown,))


def _setting(value: object) -> str:
    if value is None:
        return "none"
    return format_step(value) if isinstance(value, float) and value else str(value)


# --- Quantities


def _quantities(title: str, changes: Sequence[QuantityChange]) -> Iterator[doc.Block]:
    """The first ones in a table, the rest behind a fold."""
    if not changes:
        return
    yield doc.Heading(f"{title} ({len(changes)})", 2, medium="any")
    yield _table(changes[:_SHOWN])
    rest = changes[_SHOWN:]
    if rest:
        yield doc.Fold(f"{len(rest)} more", (_table(rest),))
        text = f"and {len(rest)} more; --format html has all of them."
        yield doc.Text(text, "muted", medium="terminal")


def _factor(change: QuantityChange) -> str:
    """New over old, as a multiple or a part; a bound where one error is below what is unknown."""
    ratio = change.factor
    if ratio is None or ratio == 1:
        return "–"
    if ratio == 0 or math.isinf(ratio):
        return "from 0"
    size, sign = (ratio, "×") if ratio > 1 else (1 / ratio, "÷")
    digits = format_number(size)
    if size < 9.95:
        digits = f"{size:.1f}"
    elif size < 9999.5:
        digits = f"{size:.0f}"
    return f"{'over ' if change.bounded else ''}{sign} {digits}"


def _tolerances(change: QuantityChange) -> tuple[float | None, float | None]:
    """Tolerances of the old and the new run; None where a metric or its tolerance is missing."""
    old, new = (metric.tolerance if metric else None for metric in (change.old, change.new))
    return old, new


def _judged(metric: Metric | None) -> str:
    if metric is None:
        return "not there"
    return {None: "not judged", True: "holds", False: "breaks"}[metric.holds]


_COLUMNS = (
    doc.Column("run", wrap=True),
    doc.Column("quantity", rank=0, medium="terminal"),
    doc.Column("quantity", wrap=False, medium="page"),
    doc.Column("unit", medium="page"),
    doc.Column("old", align="right", rank=2),
    doc.Column("new", align="right", rank=0),
    doc.Column("factor", align="right", wrap=False),
    doc.Column("tolerance", align="right", medium="page"),
    doc.Column("unknown", align="right", medium="page"),
    doc.Column("verdict", rank=0),
)


def _table(changes: Sequence[QuantityChange]) -> doc.Table:
    rows: list[doc.Row] = []
    for change in changes:
        label, unit = change.either.label, change.either.unit
        sizes: list[doc.Cell] = []
        for metric in (change.old, change.new):
            cell = doc.Cell("–")
            if metric is not None and metric.value is not None:
                cell = doc.Cell(format_number(abs(metric.value)), hint=metric.note or "")
            elif metric is not None:
                cell = doc.Cell("–", hint=metric.note or "")  # why there is none
            sizes.append(cell)
        # Both tolerances, where they read differently.
        limits = [format_number(limit) for limit in _tolerances(change) if limit is not None]
        tolerance = " → ".join(dict.fromkeys(limits)) or "–"
        old, new = _judged(change.old), _judged(change.new)
        mark: doc.Mark = "good" if change.mended else "plain"
        if change.broke or new == "breaks":
            mark = "bad"
        verdict = new
        if old != new:
            verdict = f"{old} → {new}{', by its tolerance' if change.by_tolerance else ''}"
        names = f"{change.model}, {change.run}", f"{label} [{unit}]", label, unit
        end = _factor(change), tolerance, format_number(change.unknown), doc.Cell(verdict, mark)
        rows.append(doc.row(*names, *sizes, *end))
    return doc.table(_COLUMNS, rows, "Errors, those that matter most first")
