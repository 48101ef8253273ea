"""`trebucheck models`: list, show, export."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from . import options

app = typer.Typer(help="The machines: list them, show one as JSON, export its MJCF.", no_args_is_help=True)

_Name = Annotated[str, typer.Argument(help=options.MACHINES)]


@app.command("list")
def list_command() -> None:
    """List the machines there are."""
    from ..models.machines.registry import models

    width = max(map(len, models()))
    for name, text in models().items():
        typer.echo(f"{name:<{width}}  {text}")


@app.command("show")
def show_command(name: _Name, assignments: options.Set = None, beam: options.Beam = None) -> None:
    """Print a machine as JSON, with other parameters if asked.

    Example: trebucheck models show rolling --set l1=9.5
    """
    for mechanism in options.machines(name, options.parameters(assignments, beam)):
        typer.echo(mechanism.to_json())


@app.command("schema")
def schema_command() -> None:
    """Print the JSON schema of a mechanism."""
    from ..models.mechanism import mechanism_schema

    typer.echo(mechanism_schema(), nl=False)


@app.command("export")
def export_command(
    name: _Name,
    assignments: options.Set = None,
    beam: options.Beam = None,
    timestep: Annotated[float, typer.Option("--timestep", help="Step written into the MJCF (s).")] = 1e-3,
    out: Annotated[Path | None, typer.Option("--out", help="Folder to write; the machine's name by default.")] = None,
) -> None:
    """Write a machine's MJCF: trebuchet.xml, and scene.xml with light, floor and camera to open it in the viewer.

    Example: trebucheck models export rolling --set r=7 --out my-rolling
    """
    from ..models.mjcf.writer import write_model_folder

    for mechanism in options.machines(name, options.parameters(assignments, beam)):
        folder = out or Path(mechanism.name)
        write_model_folder(mechanism, folder, timestep=timestep)
        typer.echo(f"Wrote {folder}")
