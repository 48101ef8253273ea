"""The difference of two comparisons as a document, what matters most first."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial

from ...diff.study import Difference, Fate, QuantityChange, RunChange
from ...runs.results import Metric, Run
from ..document import (
    Block,
    Cell,
    Column,
    Document,
    Fold,
    Heading,
    Listing,
    Mark,
    Note,
    Row,
    Table,
    Text,
    Tile,
    Tiles,
    page_only,
    row,
    table,
    terminal_only,
    without_empty_columns,
    words,
)
from ..numbers import format_number, format_step
from .compare import cause, diagnosis

_QUESTION = "What moved from one comparison to the other, and what broke?"
_SHOWN = 20
"""Rows of a table that are shown at once."""
_NAMED = 4
"""Runs whose names are shown with a change of an option."""
_MARKS: dict[Fate, Mark] = {
    Fate.SAME: "plain",
    Fate.BETTER: "good",
    Fate.WORSE: "bad",
    Fate.FAILS: "bad",
    Fate.APPEARED: "warning",
    Fate.VANISHED: "bad",
    Fate.NOT_COMPARED: "warning",
}
_HOW = (
    "Runs belong together by model, engine and preset. An error is the largest difference to the reference. It has "
    "moved if it changed by more than both results leave unknown of it, and by more than a factor {factor:g}. Unknown "
    "is the sum of the reference's uncertainty, of what the samples leave unknown, and of the rounding of the "
    "engine's steps (the root of their number times 2.2e-16 of the scale, carried on by the motion's stretching), of "
    "both results; a smaller error counts as that, and its factor is a bound (over). Tables show errors with "
    "two digits, and a tenth is what their second digit tells: hence 1.1, unless another factor is asked for. "
    "Quantities that follow from others, and wall times, are not judged. A verdict that held and is judged no longer "
    "has got worse, too."
)


def document(difference: Difference) -> Document:
    """All of it; a terminal has the tables in short, and the summary at their end."""
    found = difference
    blocks: tuple[Block, ...] = (
        Text(found.summary, "bad" if not found.passed else "good", medium="page"),
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
        Note(_HOW.format(factor=found.factor)),
        Text(found.summary, "bad" if not found.passed else "good", medium="terminal"),
    )
    return Document(_QUESTION, blocks, "trebucheck diff", verdict=found.summary)


def _tiles(found: Difference) -> Tiles:
    """What changed, counted."""
    lost = len(found.of_fate(Fate.WORSE, Fate.FAILS, Fate.VANISHED))
    return Tiles(
        (
            Tile(str(len(found.broken)), "verdicts broke", "bad" if found.broken else "plain"),
            Tile(str(lost), "runs worse, failing or gone", "bad" if lost else "plain"),
            Tile(str(len(found.mended)), "verdicts mended", "good" if found.mended else "plain"),
            Tile(
                str(len(found.moved)), "further errors moved", detail=f"of {len(found.quantities)}"
            ),
            Tile(str(found.compared), "runs compared", detail=f"of {len(found.runs)}"),
        )
    )


def _versions(found: Difference) -> Block:
    if not found.versions:
        return Text("The versions of engines, trebucheck, Python and platform are the same.")
    rows = [(name, *both) for name, both in found.versions.items()]
    return table(
        [words("version of", wrap=False), words("old"), words("new")], rows, "Versions that changed"
    )


def _reference(found: Difference) -> Iterator[Block]:
    """Figures of the reference that moved: errors are measured from it, so all of them move with it."""
    if not found.references:
        return
    rows = [
        row(
            c.model,
            c.name,
            _digits(c.old),
            Cell(_digits(c.new), "bad"),
            c.unit,
            format_number(c.unknown),
        )
        for c in found.references
    ]
    yield Heading("The reference moved", 2, medium="any")
    yield table("machine | figure | old | new | unit | uncertain by", rows)
    yield Text(
        "Its figures moved by more than they are uncertain by. The mechanism is the same, so the law of its stops is "
        "another one, or one of the two references is wrong; errors that moved may only follow."
    )


def _digits(value: float | None) -> str:
    return "none" if value is None else f"{value:.15g}"


def _runs(found: Difference) -> Iterator[Block]:
    """Runs whose verdict changed, or that have come or gone, and how much of each run changed."""
    fates = sorted((each for each in found.runs if each.fate is not Fate.SAME), key=_urgency)
    heads = ("run | old | new", Column("what", rank=0), words("message"))
    counted = [each for each in map(partial(_count_row, found), found.runs) if each is not None]
    if fates:
        yield Heading(f"Runs that changed ({len(fates)})", 2, medium="any")
        yield without_empty_columns(
            table(_heads(*heads), map(_fate_row, fates), "Verdicts of whole runs, old and new")
        )
    if counted:
        yield Heading("How much changed in each run", 2, medium="any")
        yield table(_heads(_COUNTS, words("largest growth")), counted, "Numbers of quantities")


def _heads(titles: str, *more: Column) -> list[Column | str]:
    return [*map(str.strip, titles.split("|")), *more]


_URGENT = (Fate.VANISHED, Fate.FAILS, Fate.WORSE, Fate.NOT_COMPARED, Fate.BETTER, Fate.APPEARED)


def _urgency(each: RunChange) -> int:
    return _URGENT.index(each.fate)


def _fate_row(each: RunChange) -> Row:
    message = each.reason or (each.new.message if each.new else None) or ""
    verdicts = (_outcome(each.old), _outcome(each.new))
    return row(_name(each), *verdicts, Cell(each.fate.value, _MARKS[each.fate]), message)


def _name(each: RunChange) -> str:
    return f"{each.run.model}, {each.run.label}"


def _outcome(run: Run | None) -> str:
    return "–" if run is None else run.outcome.value


_COUNTS = "run | broke | mended | grew | shrank | compared"


def _count_row(found: Difference, each: RunChange) -> Row | None:
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
    growth = (
        ""
        if worst is None or _known_factor(worst) <= 1
        else f"{_factor(worst)} in {worst.either.label}"
    )
    return row(_name(each), *counts, len(each.quantities), growth)


def _known_factor(change: QuantityChange) -> float:
    return change.factor or 0.0


def _count(changes: Sequence[QuantityChange], mark: Mark = "plain") -> Cell:
    return Cell(str(len(changes)), mark if changes else "plain")


def _quantities(title: str, changes: Sequence[QuantityChange]) -> Iterator[Block]:
    """The first ones in a table, the rest behind a fold."""
    if not changes:
        return
    yield Heading(f"{title} ({len(changes)})", 2, medium="any")
    yield table(_COLUMNS, changes[:_SHOWN], _CAPTION)
    rest = changes[_SHOWN:]
    if rest:
        yield Fold(f"{len(rest)} more", (table(_COLUMNS, rest, _CAPTION),))
        yield terminal_only(Text(f"and {len(rest)} more; --format html has all of them.", "muted"))


def _value(metric: Metric | None) -> Cell:
    """A size, or why there is none."""
    if metric is None:
        return Cell("–")
    return Cell(
        format_number(None if metric.value is None else abs(metric.value)), hint=metric.note or ""
    )


def _factor(change: QuantityChange) -> str:
    """New over old, as a multiple or a part; a bound where one of the errors is below what is unknown."""
    ratio = change.factor
    if ratio is None or ratio == 1:
        return "–"
    bound = "over " if change.bounded else ""
    times = ratio if ratio > 1 else 1 / ratio if ratio else math.inf
    return "from 0" if math.isinf(times) else f"{bound}{'×' if ratio > 1 else '÷'} {_short(times)}"


def _short(value: float) -> str:
    return (
        f"{value:.1f}"
        if value < 9.95
        else f"{value:.0f}"
        if value < 9999.5
        else format_number(value)
    )


def _tolerance(change: QuantityChange) -> str:
    """The tolerance, or both where they read differently."""
    old, new = (None if metric is None else metric.tolerance for metric in (change.old, change.new))
    texts = [format_number(tolerance) for tolerance in (old, new) if tolerance is not None]
    return " → ".join(dict.fromkeys(texts)) or "–"


def _verdict(change: QuantityChange) -> Cell:
    old, new = _judged(change.old), _judged(change.new)
    mark: Mark = "bad" if change.broke or new == "breaks" else "good" if change.mended else "plain"
    why = ", by its tolerance" if change.by_tolerance else ""
    return Cell(new if old == new else f"{old} → {new}{why}", mark)


def _judged(metric: Metric | None) -> str:
    if metric is None:
        return "not there"
    return "not judged" if metric.holds is None else "holds" if metric.holds else "breaks"


_CAPTION = "Errors, those that matter most first"
_COLUMNS = (
    Column("run", of=lambda change: f"{change.model}, {change.run}", wrap=True),
    terminal_only(
        Column(
            "quantity", of=lambda change: f"{change.either.label} [{change.either.unit}]", rank=0
        )
    ),
    page_only(Column("quantity", of=lambda change: change.either.label, wrap=False)),
    page_only(Column("unit", of=lambda change: change.either.unit)),
    Column("old", align="right", of=lambda change: _value(change.old), rank=2),
    Column("new", align="right", of=lambda change: _value(change.new), rank=0),
    Column("factor", align="right", of=_factor, wrap=False),
    Column("tolerance", align="right", of=_tolerance, medium="page"),
    Column(
        "unknown", align="right", of=lambda change: format_number(change.unknown), medium="page"
    ),
    Column("verdict", of=_verdict, rank=0),
)


def _reasons(found: Difference) -> Iterator[Block]:
    """Why runs disagree that did not before."""
    broken = {(change.model, change.run) for change in found.broken}
    runs = [
        each.new for each in found.runs if each.new and (each.run.model, each.run.label) in broken
    ]
    texts = (
        Text(s, "strong", lead=f"{run.model}, {run.label}, why:")
        for run in runs
        for s in diagnosis(run)
    )
    yield Listing(tuple(texts))


def _diagnoses(found: Difference) -> Iterator[Block]:
    """Runs that disagreed before, and do so now in another quantity or for other causes."""
    changed = [(each.run, each.diagnoses) for each in found.runs if each.diagnoses is not None]
    texts = [
        (f"{run.model}, {run.label}:", [cause(each) for each in both])
        for run, both in changed
        if both
    ]
    if texts:
        yield Heading("Diagnoses that changed", 2, medium="any")
        yield Listing(tuple(Text(f"was {old}; is {new}.", lead=lead) for lead, (old, new) in texts))


def _conditions(found: Difference) -> Iterator[Block]:
    """Settings, tolerances asked for and horizons that are others: a change of ours, not of an engine."""
    sentences = [*found.conditions, *_settings(found.runs)]
    loosened = sum(_looser(change, found.factor) for change in found.quantities)
    if loosened:
        number = f"{loosened} of {len(found.quantities)}"
        sentences.append(
            f"Tolerances of {number} quantities are looser now, by more than a factor {found.factor:g}."
        )
    if sentences:
        yield Heading("Conditions that changed", 2, medium="any")
        yield Listing(tuple(map(Text, sentences)))


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
    return (
        "none"
        if value is None
        else format_step(value)
        if isinstance(value, float) and value
        else str(value)
    )


def _looser(change: QuantityChange, factor: float) -> bool:
    old, new = (None if metric is None else metric.tolerance for metric in (change.old, change.new))
    return old is not None and new is not None and new > factor * old


def _times(found: Difference) -> Iterator[Block]:
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
    shown: Table = page_only(table([title for title, _ in columns], rows))
    if rows:
        yield Fold("Wall times and steps, not judged", (shown,))


def _seconds(run: Run | None) -> str:
    return "–" if run is None or run.wall_time is None else f"{run.wall_time:.2f}"
