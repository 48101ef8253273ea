"""The page of a judged file: its errors in a table, and what it does not give."""

from __future__ import annotations

from collections.abc import Iterator

from ...judge import NOT_GIVEN, Judgement
from ...runs.quantities import QUANTITIES
from ...runs.results import Metric, Outcome
from .. import document as doc
from ..document import format_number
from .tables import compared_time, why

_HEADS = (
    doc.words("quantity", wrap=False),
    doc.Column("error", align="right", rank=0),
    doc.Column("tolerance", align="right"),
    doc.words("unit", wrap=False),
    doc.Column("verdict", align="left", rank=0),
    doc.words("tolerance from", medium="page"),
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
    counts = f"{held} of {judged} judged quantities hold{rest}"
    return f"{found.file} {verdict} on {found.machine.model!r}: {counts}."


def document(found: Judgement) -> doc.Document:
    """The whole."""
    line = headline(found)
    return doc.Document(
        f"Judgement of {found.file}",
        tuple(_blocks(found, line)),
        command=found.command or "",
        verdict=line,
    )


def _blocks(found: Judgement, line: str) -> Iterator[doc.Block]:
    machine = found.machine
    yield doc.Text(line, "good" if found.outcome is Outcome.AGREES else "bad")
    yield doc.Text(compared_time(machine.launch_time, machine.compared_to, machine.judged_to))
    yield from why(found)
    yield doc.table(
        _HEADS,
        [_row(metric) for metric in found.metrics if metric.observed and metric.follows is None],
    )
    untold: dict[str, list[str]] = {}
    for metric in found.metrics:
        if not metric.observed and QUANTITIES[metric.name].follows is None:
            untold.setdefault(metric.note or "", []).append(metric.label)
    for note, labels in untold.items():
        yield doc.Text(f"{', '.join(labels)}: {note}.", lead="Not judged:")


def _row(metric: Metric) -> doc.Row:
    verdict = "not judged" if metric.holds is None else "holds" if metric.holds else "breaks it"
    mark = "unjudged" if metric.holds is None else doc.mark_of(metric.holds)
    value = format_number(metric.value) if metric.value is not None else metric.note or "none"
    reason = metric.note or "" if metric.tolerance is None else f"{metric.source}: {metric.reason}"
    return doc.row(
        metric.label,
        value,
        format_number(metric.tolerance),
        metric.unit,
        doc.Cell(verdict, mark),
        reason,
    )
