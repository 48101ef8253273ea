"""Pages of the problem library: the list, and one problem with its figures."""

from __future__ import annotations

from collections.abc import Iterable

from ....models.library.benchmark import Benchmark
from ....models.spec import Spec
from ...problems import CheckedFigure, ProblemCheck
from .. import document as doc
from ..document import format_number

_TITLES = "figure | unit | expected | reference | error | tolerance | basis"


def listing(benchmarks: Iterable[Benchmark]) -> doc.Document:
    """Number, name, tags, a line and the source of each."""
    heads = [
        doc.words("no.", wrap=False),
        doc.words("name", wrap=False),
        *map(doc.words, ("tags", "problem", "source")),
    ]
    rows = [
        (each.number, each.name, ", ".join(each.tags), each.text, each.source)
        for each in benchmarks
    ]
    return doc.Document("Problems", (doc.table(heads, rows),))


def document(check: ProblemCheck) -> doc.Document:
    """One problem: its parameters, figures beside the reference's, and its source's conditions."""
    return doc.Document(f"{check.benchmark.number} {check.benchmark.name}", tuple(_blocks(check)))


def library(checks: Iterable[ProblemCheck]) -> doc.Document:
    """All problems with their figures."""
    blocks: list[doc.Block] = []
    for each in checks:
        blocks += [
            doc.Heading(f"{each.benchmark.number} {each.benchmark.name}", 2, medium="any"),
            *_blocks(each),
        ]
    return doc.Document("", tuple(blocks))


def _blocks(check: ProblemCheck) -> list[doc.Block]:
    conditions = [
        doc.row(each.condition.text, each.condition.unit, format_number(each.condition.limit),
            doc.Cell(format_number(each.error), doc.mark_of(each.holds)))
        for each in check.conditions
    ]  # fmt: skip
    return [
        *_description(check.benchmark),
        doc.table("parameter | value | meaning", _parameters(check.parameters)),
        doc.table(
            doc.ranked(doc.columns(_TITLES), reference=0, error=0, unit=2, tolerance=2, basis=3),
            map(_row, check.figures),
        ),
        doc.table(
            "condition of the source | unit | largest allowed | error of the reference", conditions
        ),
    ]


def _description(benchmark: Benchmark) -> list[doc.Block]:
    text = benchmark.text[:1].upper() + benchmark.text[1:]
    tags = ", ".join(benchmark.tags)
    law = f"stops: {benchmark.stop_law.value}"
    return [
        doc.Text(f"{text}."),
        doc.Text(benchmark.source, lead="Source:"),
        doc.Text(f"{tags}; {law}.", lead="Tags:"),
    ]


def _parameters(parameters: Spec) -> list[tuple[str, object, str]]:
    described = type(parameters).model_fields
    return [
        (name, value, described[name].description or "")
        for name, value in parameters.model_dump().items()
    ]


def _row(each: CheckedFigure) -> doc.Row:
    figure = each.figure
    return doc.row(
        figure.name,
        figure.unit,
        f"{figure.value:.15g}",
        f"{each.measured:.15g}" if figure.value else format_number(each.measured),
        doc.Cell(format_number(each.error), doc.mark_of(each.holds)),
        format_number(figure.tolerance),
        figure.basis,
    )
