"""`trebucheck plugin`: a distribution for an engine of one's own."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from . import options, output

plugin_app = typer.Typer(
    help="Engines of your own: write the skeleton of a plug-in.", no_args_is_help=True
)


@plugin_app.command("new")
def new_command(
    name: Annotated[str, typer.Argument(help="Of the engine: small letters, digits and hyphens.")],
    out: Annotated[Path | None, options.out("New folder; trebucheck-NAME by default.")] = None,
) -> None:
    """Write a new folder with pyproject.toml, an engine to fill in, and its tests; an existing one is refused.

    Example: trebucheck plugin new my-engine
    """
    from ..conformance.skeleton import write_skeleton

    folder = out or Path(f"trebucheck-{name}")
    for path in write_skeleton(name, folder):
        typer.echo(f"Wrote {output.printable(str(path))}")
    typer.echo(
        f"\nNext: cd {output.printable(str(folder))}, pip install -e .[test], pytest; then fill in engine.py."
    )
