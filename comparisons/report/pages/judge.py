"""What a file's motion comes to, in a table, and what it does not give."""

from __future__ import annotations

from collections.abc import Iterator

from ...judge.study import NOT_GIVEN, Judgement
from ...runs.quantities import QUANTITIES
from ...runs.results import Metric, Outcome
from ..document import Block, Cell, Column, Document, Row, Text, mark_of, row, table, words
from ..numbers import format_number
from ..tables import compared_time
from .compare import why

_HEADS = (
    words("quantity", wrap=False),
    Column("error", align="right", rank=0),
    Column("tolerance", align="right"),
    words("unit", wrap=False),
    Column("verdict", align="left", rank=0),
    words("tolerance from", medium="page"),
)


def headline(found: Judgement) -> str:
    """The verdict in a line; nothing that is not given counts as agreement."""
    judged, held = len(found.judged), len(found.judged) - len(found.broken)
    named = (m for m in found.metrics if m.note == NOT_GIVEN and not m.observed)
    missing = sum(QUANTITIES[metric.name].follows is None for metric in named)
    many = "quantity is" if missing == 1 else "quantities are"
    rest = f"; {missing} {many} not given, and not judged" if missing else ""
    verdict = (
        found.outcome.value if found.outcome is not Outcome.AGREES else "agrees in what it gives"
    )
    return f"{found.file} {verdict} on {found.machine.model!r}: {held} of {judged} judged quantities hold{rest}."


def document(found: Judgement) -> Document:
    """The whole."""
    line = headline(found)
    return Document(
        f"Judgement of {found.file}",
        tuple(_blocks(found, line)),
        command=found.command or "",
        verdict=line,
    )


def _blocks(found: Judgement, line: str) -> Iterator[Block]:
    machine = found.machine
    yield Text(line, "good" if found.outcome is Outcome.AGREES else "bad")
    yield Text(compared_time(machine.launch_time, machine.compared_to, machine.judged_to))
    yield from why(found)
    yield table(
        _HEADS,
        [_row(metric) for metric in found.metrics if metric.observed and metric.follows is None],
    )
    untold: dict[str, list[str]] = {}
    for metric in found.metrics:
        if not metric.observed and QUANTITIES[metric.name].follows is None:
            untold.setdefault(metric.note or "", []).append(metric.label)
    for note, labels in untold.items():
        yield Text(f"{', '.join(labels)}: {note}.", lead="Not judged:")


def _row(metric: Metric) -> Row:
    verdict = "not judged" if metric.holds is None else "holds" if metric.holds else "breaks it"
    mark = "unjudged" if metric.holds is None else mark_of(metric.holds)
    value = format_number(metric.value) if metric.value is not None else metric.note or "none"
    reason = metric.note or "" if metric.tolerance is None else f"{metric.source}: {metric.reason}"
    return row(
        metric.label,
        value,
        format_number(metric.tolerance),
        metric.unit,
        Cell(verdict, mark),
        reason,
    )
