"""The page of a judged file: its errors in a table, and what it does not give."""

from __future__ import annotations

from ...judge import FAR_APART, NOT_GIVEN, Judgement
from ...runs.quantities import QUANTITIES
from ...runs.results import Outcome
from .. import document as doc
from ..document import format_number
from .tables import compared_time, judged_mark, why

_HEADS = (
    doc.words("quantity", wrap=False),
    doc.Column("error", align="right", rank=0),
    doc.Column("tolerance", align="right"),
    doc.words("unit", wrap=False),
    doc.Column("verdict", align="left", rank=0),
    doc.words("tolerance from", medium="page"),
)


def headline(judgement: Judgement) -> str:
    """The verdict in a line; nothing that is not given counts as agreement."""
    judged, broken = len(judgement.judged), len(judgement.broken)
    absent = (m for m in judgement.metrics if m.note == NOT_GIVEN and not m.observed)
    missing = sum(QUANTITIES[metric.name].follows is None for metric in absent)
    rest = ""
    if missing:
        many = "quantity is" if missing == 1 else "quantities are"
        rest = f"; {missing} {many} not given, and not judged"
    unseen = next((m.value for m in judgement.metrics if m.note == FAR_APART), None)
    if unseen is not None:
        rest += f"; {unseen:.3g} s between samples that are far apart is not seen"
    verdict = judgement.outcome.value
    if judgement.outcome is Outcome.AGREES:
        verdict = "agrees in what it gives"
    counts = f"{judged - broken} of {judged} judged quantities hold{rest}"
    return f"{judgement.file} {verdict} on {judgement.machine.model!r}: {counts}."


def document(judgement: Judgement) -> doc.Document:
    """The whole."""
    line, machine = headline(judgement), judgement.machine
    rows: list[doc.Row] = []
    absent: dict[str, list[str]] = {}
    for metric in judgement.metrics:
        note, tolerance = metric.note or "", metric.tolerance
        if metric.observed and metric.follows is None:
            texts = {None: "not judged", True: "holds", False: "breaks it"}
            verdict = doc.Cell(texts[metric.holds], judged_mark(metric.holds))
            value = note or "none"
            if metric.value is not None:
                value = format_number(metric.value)
            reason = note if tolerance is None else f"{metric.source}: {metric.reason}"
            limit = format_number(tolerance)
            rows.append(doc.row(metric.label, value, limit, metric.unit, verdict, reason))
        elif not metric.observed and QUANTITIES[metric.name].follows is None:
            absent.setdefault(note, []).append(metric.label)
    blocks: list[doc.Block] = [
        doc.Text(line, "good" if judgement.outcome is Outcome.AGREES else "bad"),
        doc.Text(compared_time(machine.launch_time, machine.compared_to, machine.judged_to)),
        *why(judgement),
        doc.table(_HEADS, rows),
    ]
    for note, labels in absent.items():
        blocks.append(doc.Text(f"{', '.join(labels)}: {note}.", lead="Not judged:"))
    title, command = f"Judgement of {judgement.file}", judgement.command or ""
    return doc.Document(title, tuple(blocks), command=command, verdict=line)
