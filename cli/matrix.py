"""`trebucheck matrix`: engine x problem x quantity, from results of several comparisons."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from . import options, output

if TYPE_CHECKING:
    from ..comparisons.matrix.study import Matrix

_SUFFIXES = (".html", ".md", ".json")


def matrix_command(
    context: typer.Context,
    files: Annotated[
        list[Path],
        typer.Argument(
            help="results.json of compare, converge.json of converge, .json of matrix; or their folders."
        ),
    ],
    quiet: options.Quiet = False,
    json: options.Json = False,
    out: Annotated[
        Path | None,
        options.out(
            "File to write: .html, .md, or .json, which matrix reads again; none by default."
        ),
    ] = None,
) -> None:
    """Show engine x problem x quantity of several comparisons: verdicts, errors, orders, causes, refusals.

    Engines of one scheme stand together, and ratios of their errors say what differs by scheme and
    what by implementation. Nothing is run: engines that need environments of their own are compared
    there, and put together here. Orders are measured where a converge.json is given, else as the
    engine declares them. Exit codes: 0 shown, 2 a file is of another kind, a run is there twice, or
    a name means two mechanisms.

    Examples:
    trebucheck matrix report drake/results.json pinocchio/results.json --out matrix.html

    trebucheck matrix report/results.json converge/converge.json --out engines.json
    """
    from ..comparisons.matrix.study import matrix as matrix_of
    from ..comparisons.report.pages.matrix import document
    from ..models.errors import InputError
    from ..models.files import refuse_unwritable, write_text

    if out is not None and out.suffix not in _SUFFIXES:
        raise InputError(
            f"--out {output.printable(str(out))} must end in {', '.join(_SUFFIXES[:-1])} or .json."
        )
    if out is not None:
        refuse_unwritable(out.parent, out.name)
    matrix = matrix_of(files).made_by(output.command_line(context))
    if out is not None:
        write_text(out, _text(matrix, out.suffix))
    if json:
        typer.echo(matrix.to_json())
    else:
        output.show(
            document(matrix), output.Told(quiet), **({} if out is None else {"Matrix": out})
        )


def _text(matrix: Matrix, suffix: str) -> str:
    """In the format of the file's name."""
    from ..comparisons.report import html, markdown
    from ..comparisons.report.pages.matrix import document

    if suffix == ".json":
        return matrix.to_json() + "\n"
    return (
        html.page(document(matrix))
        if suffix == ".html"
        else markdown.text(document(matrix), signs=True)
    )
