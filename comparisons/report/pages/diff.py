"""The page of the difference of two comparisons, what matters most first."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial

from ...diff import Difference, Fate, QuantityChange, RunChange
from ...runs.results import Metric, Run
from .. import document as doc
from ..numbers import format_number, format_step
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
    blocks: tuple[doc.Block, ...] = (
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
    return doc.Tiles(
        (
            doc.Tile(str(len(found.broken)), "verdicts broke", "bad" if found.broken else "plain"),
            doc.Tile(str(lost), "runs worse, failing or gone", "bad" if lost else "plain"),
            doc.Tile(
                str(len(found.mended)), "verdicts mended", "good" if found.mended else "plain"
            ),
            doc.Tile(
                str(len(found.moved)), "further errors moved", detail=f"of {len(found.quantities)}"
            ),
            doc.Tile(str(found.compared), "runs compared", detail=f"of {len(found.runs)}"),
        )
    )


def _versions(found: Difference) -> doc.Block:
    if not found.versions:
        return doc.Text("The versions of engines, trebucheck, Python and platform are the same.")
    rows = [(name, *both) for name, both in found.versions.items()]
    return doc.table(
        [doc.words("version of", wrap=False), doc.words("old"), doc.words("new")],
        rows,
        "Versions that changed",
    )


def _reference(found: Difference) -> Iterator[doc.Block]:
    """Figures of the reference that moved: all errors, measured from it, move with it."""
    if not found.references:
        return
    rows = [
        doc.row(
            c.model,
            c.name,
            _digits(c.old),
            doc.Cell(_digits(c.new), "bad"),
            c.unit,
            format_number(c.unknown),
        )
        for c in found.references
    ]
    yield doc.Heading("The reference moved", 2, medium="any")
    yield doc.table("machine | figure | old | new | unit | uncertain by", rows)
    yield doc.Text(
        "Its figures moved by more than they are uncertain by. The mechanism is the same, so the "
        "law of its stops is another one, or one of the two references is wrong; errors that moved "
        "may only follow."
    )


def _digits(value: float | None) -> str:
    return "none" if value is None else f"{value:.15g}"


def _runs(found: Difference) -> Iterator[doc.Block]:
    """Runs whose verdict changed, or that have come or gone, and how much of each run changed."""
    fates = sorted((each for each in found.runs if each.fate is not Fate.SAME), key=_urgency)
    heads = ("run | old | new", doc.Column("what", rank=0), doc.words("message"))
    counted = [each for each in map(partial(_count_row, found), found.runs) if each is not None]
    if fates:
        yield doc.Heading(f"Runs that changed ({len(fates)})", 2, medium="any")
        yield doc.without_empty_columns(
            doc.table(_heads(*heads), map(_fate_row, fates), "Verdicts of whole runs, old and new")
        )
    if counted:
        yield doc.Heading("How much changed in each run", 2, medium="any")
        yield doc.table(
            _heads(_COUNTS, doc.words("largest growth")), counted, "Numbers of quantities"
        )


def _heads(titles: str, *more: doc.Column) -> list[doc.Column | str]:
    return [*map(str.strip, titles.split("|")), *more]


_URGENT = (Fate.VANISHED, Fate.FAILS, Fate.WORSE, Fate.NOT_COMPARED, Fate.BETTER, Fate.APPEARED)


def _urgency(each: RunChange) -> int:
    return _URGENT.index(each.fate)


def _fate_row(each: RunChange) -> doc.Row:
    message = each.reason or (each.new.message if each.new else None) or ""
    verdicts = (_outcome(each.old), _outcome(each.new))
    return doc.row(_name(each), *verdicts, doc.Cell(each.fate.value, _MARKS[each.fate]), message)


def _name(each: RunChange) -> str:
    return f"{each.run.model}, {each.run.label}"


def _outcome(run: Run | None) -> str:
    return "–" if run is None else run.outcome.value


_COUNTS = "run | broke | mended | grew | shrank | compared"


def _count_row(found: Difference, each: RunChange) -> doc.Row | None:
    """How many of its quantities changed in which way; None if none did."""
    own = set(map(id, each.quantities))
    broke, mended, moved = (
        [q for q in of if id(q) in own] for of in (found.broken, found.mended, found.moved)
    )
    if not (broke or mended or moved):
        return None
    grew = [q for q in moved if q.factor is None or q.factor > 1]
    counts = [
        _count(broke, "bad"),
        _count(mended, "good"),
        _count(grew),
        _count(moved[len(grew) :]),
    ]
    worst = max(
        (q for q in each.quantities if q in broke or q in grew), key=_known_factor, default=None
    )
    growth = ""
    if worst is not None and _known_factor(worst) > 1:
        growth = f"{_factor(worst)} in {worst.either.label}"
    return doc.row(_name(each), *counts, len(each.quantities), growth)


def _known_factor(change: QuantityChange) -> float:
    return change.factor or 0.0


def _count(changes: Sequence[QuantityChange], mark: doc.Mark = "plain") -> doc.Cell:
    return doc.Cell(str(len(changes)), mark if changes else "plain")


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
    return doc.Cell(
        format_number(None if metric.value is None else abs(metric.value)), hint=metric.note or ""
    )


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
    doc.terminal_only(
        doc.Column(
            "quantity", of=lambda change: f"{change.either.label} [{change.either.unit}]", rank=0
        )
    ),
    doc.page_only(doc.Column("quantity", of=lambda change: change.either.label, wrap=False)),
    doc.page_only(doc.Column("unit", of=lambda change: change.either.unit)),
    doc.Column("old", align="right", of=lambda change: _value(change.old), rank=2),
    doc.Column("new", align="right", of=lambda change: _value(change.new), rank=0),
    doc.Column("factor", align="right", of=_factor, wrap=False),
    doc.Column("tolerance", align="right", of=_tolerance, medium="page"),
    doc.Column(
        "unknown", align="right", of=lambda change: format_number(change.unknown), medium="page"
    ),
    doc.Column("verdict", of=_verdict, rank=0),
)


def _reasons(found: Difference) -> Iterator[doc.Block]:
    """Why runs disagree that did not before."""
    broken = {(change.model, change.run) for change in found.broken}
    runs = [
        each.new for each in found.runs if each.new and (each.run.model, each.run.label) in broken
    ]
    texts = (
        doc.Text(s, "strong", lead=f"{run.model}, {run.label}, why:")
        for run in runs
        for s in diagnosis(run)
    )
    yield doc.Listing(tuple(texts))


def _diagnoses(found: Difference) -> Iterator[doc.Block]:
    """Runs that disagreed before, and do so now in another quantity or for other causes."""
    changed = [(each.run, each.diagnoses) for each in found.runs if each.diagnoses is not None]
    texts = [
        (f"{run.model}, {run.label}:", [cause_text(each) for each in both])
        for run, both in changed
        if both
    ]
    if texts:
        yield doc.Heading("Diagnoses that changed", 2, medium="any")
        yield doc.Listing(
            tuple(doc.Text(f"was {old}; is {new}.", lead=lead) for lead, (old, new) in texts)
        )


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
    timed = [
        each
        for each in found.runs
        if each.old and each.new and each.old.wall_time and each.new.wall_time
    ]
    columns: tuple[tuple[str, Callable[[RunChange], object]], ...] = (
        ("run", _name),
        ("old [s]", lambda each: _seconds(each.old)),
        ("new [s]", lambda each: _seconds(each.new)),
        ("old steps", lambda each: each.old.steps if each.old else None),
        ("new steps", lambda each: each.new.steps if each.new else None),
    )
    rows = [tuple(of(each) for _, of in columns) for each in timed]
    shown: doc.Table = doc.page_only(doc.table([title for title, _ in columns], rows))
    if rows:
        yield doc.Fold("Wall times and steps, not judged", (shown,))


def _seconds(run: Run | None) -> str:
    return "–" if run is None or run.wall_time is None else f"{run.wall_time:.2f}"
