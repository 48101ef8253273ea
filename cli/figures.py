"""`trebucheck figures`: the plots of a comparison as pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..models.errors import InputError
from . import options

_Folder = Annotated[
    Path, typer.Argument(help="Folder of a comparison, as `trebucheck compare --out` writes it.")
]


def figures_command(
    folder: _Folder = Path("report"),
    formats: Annotated[
        str, typer.Option("--formats", help="Of svg, png and pdf, comma-separated.")
    ] = "svg",
    only: Annotated[
        str | None,
        typer.Option(
            "--only", help="Names of figures, comma-separated, e.g. fixed-distances; else all."
        ),
    ] = None,
    out: Annotated[Path, options.out("Folder for the pictures.")] = Path("figures"),
) -> None:
    """Write the plots of a comparison as SVG, PNG or PDF, for papers and slides; no engine runs.

    Each plot of the report becomes a file by the name that its link in the report has.

    Examples:
    trebucheck figures report --out figures

    trebucheck figures report --formats pdf,png --only fixed-distances,work-precision
    """
    from ..comparisons.compare.study import stored
    from ..comparisons.report.figures import FORMATS, figures_of, picture, write_picture
    from ..comparisons.report.pages.compare import document
    from ..comparisons.report.terminal import console
    from ..models.files import refuse_unwritable

    kinds = options.names(formats, "--formats")
    unknown = [kind for kind in kinds if kind not in FORMATS]
    if unknown:
        raise InputError(f"--formats: {unknown[0]!r} is none of {', '.join(FORMATS)}.")
    found = figures_of(document(stored(folder)))
    chosen = list(found) if only is None else options.names(only, "--only")
    missing = [name for name in chosen if name not in found]
    if missing:
        raise InputError(
            f"--only: there is no figure {missing[0]!r}; there are {', '.join(found)}."
        )
    refuse_unwritable(out)
    for name in chosen:
        block = found[name]
        drawn = picture(block.panels(), block.columns or 3)
        for kind in kinds:
            write_picture(drawn, out / f"{name}.{kind}")
            console().print(str(out / f"{name}.{kind}"), soft_wrap=True, markup=False)
