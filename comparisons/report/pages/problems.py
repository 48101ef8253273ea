"""Pages of the problem library: the list, and one problem with its figures."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from ...problems import ProblemCheck
from .. import document as doc
from ..document import format_number
from .tables import capital

_TITLES = "figure | unit | expected | reference | error | tolerance | basis"


def document(check: ProblemCheck) -> doc.Document:
    """One problem: its parameters, figures beside the reference's, and its source's conditions."""
    return doc.Document(check.benchmark.name, tuple(_blocks(check)))


def library(checks: Iterable[ProblemCheck]) -> doc.Document:
    """Problems with their figures."""
    blocks: list[doc.Block] = []
    for check in checks:
        blocks += [doc.Heading(check.benchmark.name, 2, medium="any"), *_blocks(check)]
    return doc.Document("", tuple(blocks))


def _blocks(check: ProblemCheck) -> Iterator[doc.Block]:
    benchmark, parameters = check.benchmark, check.parameters
    yield doc.Text(f"{capital(benchmark.text)}.")
    yield doc.Text(benchmark.source, lead="Source:")
    law = f"stops: {benchmark.stop_law.value}"
    yield doc.Text(f"{', '.join(benchmark.tags)}; {law}.", lead="Tags:")
    described = type(parameters).model_fields
    rows: list[tuple[object, ...]] = [
        (name, value, described[name].description or "")
        for name, value in parameters.model_dump().items()
    ]
    yield doc.table("parameter | value | meaning", rows)
    rows = []
    for checked in check.figures:
        figure, measured = checked.figure, f"{checked.measured:.15g}"
        if not figure.value:
            measured = format_number(checked.measured)
        error = doc.Cell(format_number(checked.error), doc.mark_of(checked.holds))
        tolerance, expected = format_number(figure.tolerance), f"{figure.value:.15g}"
        numbers = (expected, measured, error, tolerance)
        rows.append((figure.name, figure.unit, *numbers, figure.basis))
    ranks = {"reference": 0, "error": 0, "unit": 2, "tolerance": 2, "basis": 3}
    yield doc.table(doc.ranked(doc.columns(_TITLES), **ranks), rows)
    rows = []
    for each in check.conditions:
        error = doc.Cell(format_number(each.error), doc.mark_of(each.holds))
        limit = format_number(each.condition.limit)
        rows.append((each.condition.text, each.condition.unit, limit, error))
    heads = "condition of the source | unit | largest allowed | error of the reference"
    yield doc.table(heads, rows)
