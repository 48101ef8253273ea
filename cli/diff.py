"""`trebucheck diff`: what moved and what broke from one comparison to another."""

from __future__ import annotations

import io
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from . import options, output

if TYPE_CHECKING:
    from ..comparisons.diff.study import Difference
    from ..comparisons.report.document import Document

FACTOR = 1.1
"""As in the study, which is imported when the command runs."""
_WIDTH = 120
"""Of a text file, in characters."""


class Format(StrEnum):
    """How a difference is shown."""

    TEXT = "text"
    MARKDOWN = "markdown"
    HTML = "html"
    JSON = "json"


_SUFFIXES = {
    ".html": Format.HTML,
    ".htm": Format.HTML,
    ".md": Format.MARKDOWN,
    ".json": Format.JSON,
}
_File = Annotated[
    Path, typer.Argument(help="results.json of compare, or the folder that holds it.")
]


def diff_command(
    old: _File,
    new: _File,
    factor: Annotated[
        float,
        typer.Option(
            "--factor", help="An error has moved if it changed by more than this factor; above 1."
        ),
    ] = FACTOR,
    format: Annotated[
        Format | None, typer.Option("--format", help="Else by the name of --out; text by default.")
    ] = None,
    json: options.Json = False,
    out: Annotated[Path | None, options.out("File to write; standard output by default.")] = None,
) -> None:
    """Compare two results of compare: which verdicts broke, what moved, which runs have come or gone.

    For upgrades of engines, of trebucheck, of a machine. Changes below what the reference's
    uncertainty, samples and rounding leave unknown are none. Exit codes: 0 nothing broke, 1 a
    verdict got worse, a run is gone or fails, or nothing could be compared, 2 wrong input.

    Examples:
    trebucheck diff before/results.json after/results.json

    trebucheck diff before after --format html --out diff.html

    trebucheck diff before after --json
    """
    from ..comparisons.diff.study import diff
    from ..comparisons.report.pages.diff import document
    from ..models.files import write_text

    difference = diff(old, new, factor)
    chosen = format or (_SUFFIXES.get(out.suffix.lower()) if out else None) or Format.TEXT
    if out is not None:
        write_text(out, _text(difference, chosen))
    if json:
        print(_text(difference, Format.JSON), end="")
    elif out is not None:
        print(f"{difference.summary}\n\nDifference: {output.printable(str(out))}")
    elif chosen is Format.TEXT:
        output.show(document(difference))
    else:
        print(_text(difference, chosen), end="")
    if not difference.passed:
        raise typer.Exit(1)


def _text(difference: Difference, format: Format) -> str:
    """The difference in a format, whole."""
    from ..comparisons.diff.study import data
    from ..comparisons.report.pages.diff import document

    return (
        data(difference).to_json() + "\n"
        if format is Format.JSON
        else _rendered(document(difference), format)
    )


def _rendered(document: Document, format: Format) -> str:
    """The document in a format, whole."""
    if format is Format.HTML:
        from ..comparisons.report import html

        return html.page(document)
    if format is Format.MARKDOWN:
        from ..comparisons.report import markdown

        return markdown.text(document, signs=True)
    from rich.console import Console

    from ..comparisons.report import terminal

    to = Console(file=io.StringIO(), width=_WIDTH, highlight=False, record=True)
    terminal.show(document, to)
    return to.export_text()
