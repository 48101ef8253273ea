"""The page of the difference of two comparisons, what matters most first."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from operator import attrgetter

from ...diff import Difference, Fate, QuantityChange, RunChange
from ...runs.results import Metric, Run
from .. import document as doc
from ..document import format_number, format_step
from .tables import cause_text, diagnosis, verdict_blocks

_QUESTION = "What moved from one comparison to the other, and what broke?"
_SHOWN = 20
"""Rows of a table that are shown at once."""
_NAMED = 4
"""Runs whose names are shown with a change of an option."""
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
    """All of it; a terminal has the tables in short, and the summary at their end."""
    found = difference
    first_verdict, last_verdict = verdict_blocks(found.summary, doc.mark_of(found.passed))
    blocks = (
        first_verdict,
        _tiles(found),
        _versions(found),
        *_reference(found),
        *_runs(found),
        *_quantities("Verdicts that broke", found.broken),
        *_reasons(found),
        *_quantities("Verdicts mended", found.mended),
        *_quantities(f"Errors that moved by more than a factor {found.factor:g}", found.moved),
        *_diagnoses(found),
        *_conditions(found),
        *_times(found),
        doc.Note(_HOW.format(factor=found.factor)),
        last_verdict,
    )
    return doc.Document(_QUESTION, blocks, "trebucheck diff", verdict=found.summary)


def _tiles(found: Difference) -> doc.Tiles:
    """Numbers of changes."""
    lost = len(found.of_fate(Fate.WORSE, Fate.FAILS, Fate.VANISHED))
    counts: tuple[tuple[int, str, doc.Mark, str], ...] = (
        (len(found.broken), "verdicts broke", "bad", ""),
        (lost, "runs worse, failing or gone", "bad", ""),
        (len(found.mended), "verdicts mended", "good", ""),
        (len(found.moved), "further errors moved", "plain", f"of {len(found.quantities)}"),
        (found.compared, "runs compared", "plain", f"of {len(found.runs)}"),
    )
    tiles = [
        doc.Tile(str(number), label, mark if number else "plain", detail)
        for number, label, mark, detail in counts
    ]
    return doc.Tiles(tuple(tiles))


def _versions(found: Difference) -> doc.Block:
    if not found.versions:
        return doc.Text("The versions of engines, trebucheck, Python and platform are the same.")
    heads = (doc.words("version of", wrap=False), doc.words("old"), doc.words("new"))
    rows = [(name, *both) for name, both in found.versions.items()]
    return doc.table(heads, rows, "Versions that changed")


def _reference(found: Difference) -> Iterator[doc.Block]:
    """Figures of the reference that moved: all errors, measured from it, move with it."""
    if not found.references:
        return
    yield doc.Heading("The reference moved", 2, medium="any")
    yield doc.table(_REFERENCE_COLUMNS, found.references)
    yield doc.Text(
        "Its figures moved by more than they are uncertain by. The mechanism is the same, so the "
        "law of its stops is another one, or one of the two references is wrong; errors that moved "
        "may only follow."
    )


def _digits(value: float | None) -> str:
    return "none" if value is None else f"{value:.15g}"


_REFERENCE_COLUMNS = (
    doc.Column("machine", of=attrgetter("model")),
    doc.Column("figure", of=attrgetter("figure")),
    doc.Column("old", of=lambda change: _digits(change.old)),
    doc.Column("new", of=lambda change: doc.Cell(_digits(change.new), "bad")),
    doc.Column("unit", of=attrgetter("unit")),
    doc.Column("uncertain by", of=lambda change: format_number(change.unknown)),
)


def _runs(found: Difference) -> Iterator[doc.Block]:
    """Runs whose verdict changed, or that have come or gone, and how much of each run changed."""
    changed = [each for each in found.runs if each.fate is not Fate.SAME]
    if changed:
        changed.sort(key=lambda each: _URGENT.index(each.fate))
        heads = (*doc.columns("run | old | new"), doc.Column("what", rank=0), doc.words("message"))
        shown = doc.table(heads, map(_fate_row, changed), "Verdicts of whole runs, old and new")
        yield doc.Heading(f"Runs that changed ({len(changed)})", 2, medium="any")
        yield doc.without_empty_columns(shown)
    counted = [row for each in found.runs if (row := _count_row(found, each)) is not None]
    if counted:
        heads = (*doc.columns(_COUNTS), doc.words("largest growth"))
        yield doc.Heading("How much changed in each run", 2, medium="any")
        yield doc.table(heads, counted, "Numbers of quantities")


_URGENT = (Fate.VANISHED, Fate.FAILS, Fate.WORSE, Fate.NOT_COMPARED, Fate.BETTER, Fate.APPEARED)


def _fate_row(each: RunChange) -> doc.Row:
    message = each.reason or (each.new.message if each.new else None) or ""
    verdicts = (_outcome(each.old), _outcome(each.new))
    return doc.row(_name(each), *verdicts, doc.Cell(each.fate.value, _MARKS[each.fate]), message)


def _name(each: RunChange) -> str:
    return f"{each.run.model}, {each.run.label}"


def _outcome(run: Run | None) -> str:
    return "–" if run is None else run.outcome.value


_COUNTS = "run | broke | mended | grew | shrank | compared"


def _count_row(found: Difference, change: RunChange) -> doc.Row | None:
    """How many of its quantities changed in which way; None if none did."""
    own = set(map(id, change.quantities))
    broke, mended, moved = (
        [quantity for quantity in group if id(quantity) in own]
        for group in (found.broken, found.mended, found.moved)
    )
    if not (broke or mended or moved):
        return None
    grew = [quantity for quantity in moved if quantity.factor is None or quantity.factor > 1]
    counts = (len(broke), len(mended), len(grew), len(moved) - len(grew))
    marks: tuple[doc.Mark, ...] = ("bad", "good", "plain", "plain")
    cells = (doc.Cell(str(n), m if n else "plain") for n, m in zip(counts, marks, strict=True))
    worse = [quantity for quantity in change.quantities if quantity in broke or quantity in grew]
    worst = max(worse, key=lambda quantity: quantity.factor or 0.0, default=None)
    growth = ""
    if worst is not None and (worst.factor or 0.0) > 1:
        growth = f"{_factor(worst)} in {worst.either.label}"
    return doc.row(_name(change), *cells, len(change.quantities), growth)


def _quantities(title: str, changes: Sequence[QuantityChange]) -> Iterator[doc.Block]:
    """The first ones in a table, the rest behind a fold."""
    if not changes:
        return
    yield doc.Heading(f"{title} ({len(changes)})", 2, medium="any")
    yield doc.table(_COLUMNS, changes[:_SHOWN], _CAPTION)
    rest = changes[_SHOWN:]
    if rest:
        yield doc.Fold(f"{len(rest)} more", (doc.table(_COLUMNS, rest, _CAPTION),))
        yield doc.terminal_only(
            doc.Text(f"and {len(rest)} more; --format html has all of them.", "muted")
        )


def _value(metric: Metric | None) -> doc.Cell:
    """A size, or why there is none."""
    if metric is None:
        return doc.Cell("–")
    size = None if metric.value is None else abs(metric.value)
    return doc.Cell(format_number(size), hint=metric.note or "")


def _factor(change: QuantityChange) -> str:
    """New over old, as a multiple or a part; a bound where one error is below what is unknown."""
    ratio = change.factor
    if ratio is None or ratio == 1:
        return "–"
    if ratio == 0 or math.isinf(ratio):
        return "from 0"
    bound = "over " if change.bounded else ""
    return f"{bound}× {_short(ratio)}" if ratio > 1 else f"{bound}÷ {_short(1 / ratio)}"


def _short(value: float) -> str:
    if value < 9.95:
        return f"{value:.1f}"
    return f"{value:.0f}" if value < 9999.5 else format_number(value)


def _tolerance(change: QuantityChange) -> str:
    """The tolerance, or both where they read differently."""
    old, new = (None if metric is None else metric.tolerance for metric in (change.old, change.new))
    texts = [format_number(tolerance) for tolerance in (old, new) if tolerance is not None]
    return " → ".join(dict.fromkeys(texts)) or "–"


def _verdict(change: QuantityChange) -> doc.Cell:
    old, new = _judged(change.old), _judged(change.new)
    mark: doc.Mark = "good" if change.mended else "plain"
    if change.broke or new == "breaks":
        mark = "bad"
    why = ", by its tolerance" if change.by_tolerance else ""
    return doc.Cell(new if old == new else f"{old} → {new}{why}", mark)


def _judged(metric: Metric | None) -> str:
    if metric is None:
        return "not there"
    return "not judged" if metric.holds is None else "holds" if metric.holds else "breaks"


_CAPTION = "Errors, those that matter most first"
_COLUMNS = (
    doc.Column("run", of=lambda change: f"{change.model}, {change.run}", wrap=True),
    doc.Column("quantity", of=lambda change: f"{change.either.label} [{change.either.unit}]",
               rank=0, medium="terminal"),
    doc.Column("quantity", of=lambda change: change.either.label, wrap=False, medium="page"),
    doc.Column("unit", of=lambda change: change.either.unit, medium="page"),
    doc.Column("old", align="right", of=lambda change: _value(change.old), rank=2),
    doc.Column("new", align="right", of=lambda change: _value(change.new), rank=0),
    doc.Column("factor", align="right", of=_factor, wrap=False),
    doc.Column("tolerance", align="right", of=_tolerance, medium="page"),
    doc.Column("unknown", align="right", of=lambda change: format_number(change.unknown),
               medium="page"),
    doc.Column("verdict", of=_verdict, rank=0),
)  # fmt: skip


def _reasons(found: Difference) -> Iterator[doc.Block]:
    """Why runs disagree that did not before."""
    broken = {(change.model, change.run) for change in found.broken}
    runs = [change.new for change in found.runs if change.new is not None]
    texts = [
        doc.Text(sentence, "strong", lead=f"{run.model}, {run.label}, why:")
        for run in runs
        if (run.model, run.label) in broken
        for sentence in diagnosis(run)
    ]
    yield doc.Listing(tuple(texts))


def _diagnoses(found: Difference) -> Iterator[doc.Block]:
    """Runs that disagreed before, and do so now in another quantity or for other causes."""
    texts: list[doc.Text] = []
    for change in found.runs:
        if change.diagnoses:
            old, new = map(cause_text, change.diagnoses)
            texts.append(doc.Text(f"was {old}; is {new}.", lead=f"{_name(change)}:"))
    if texts:
        yield doc.Heading("Diagnoses that changed", 2, medium="any")
        yield doc.Listing(tuple(texts))


def _conditions(found: Difference) -> Iterator[doc.Block]:
    """Changed settings, tolerances and horizons: a change of ours, not of an engine."""
    sentences = [*found.conditions, *_settings(found.runs)]
    loosened = sum(_looser(change, found.factor) for change in found.quantities)
    if loosened:
        number = f"{loosened} of {len(found.quantities)}"
        sentences.append(
            f"Tolerances of {number} quantities are looser now, by more than a factor "
            f"{found.factor:g}."
        )
    if sentences:
        yield doc.Heading("Conditions that changed", 2, medium="any")
        yield doc.Listing(tuple(map(doc.Text, sentences)))


def _settings(runs: Iterable[RunChange]) -> Iterator[str]:
    """Each change of an option, with the runs that it is in."""
    changed: dict[str, list[str]] = {}
    for each in runs:
        for name, (old, new) in each.settings.items():
            line = f"{name} {_setting(old)} → {_setting(new)}"
            changed.setdefault(line, []).append(_name(each))
    for line, names in changed.items():
        more = f" and {len(names) - _NAMED} more runs" if len(names) > _NAMED else ""
        yield f"{line}: {'; '.join(names[:_NAMED])}{more}."


def _setting(value: object) -> str:
    if value is None:
        return "none"
    return format_step(value) if isinstance(value, float) and value else str(value)


def _looser(change: QuantityChange, factor: float) -> bool:
    old, new = (None if metric is None else metric.tolerance for metric in (change.old, change.new))
    return old is not None and new is not None and new > factor * old


def _times(found: Difference) -> Iterator[doc.Block]:
    """Wall times beside each other; they depend on what else the machine did."""
    rows: list[tuple[object, ...]] = []
    for change in found.runs:
        old, new = change.old, change.new
        if old and new and old.wall_time and new.wall_time:
            seconds = (f"{run.wall_time:.2f}" for run in (old, new))
            rows.append((_name(change), *seconds, old.steps, new.steps))
    if rows:
        shown = doc.table("run | old [s] | new [s] | old steps | new steps", rows, medium="page")
        yield doc.Fold("Wall times and steps, not judged", (shown,))
