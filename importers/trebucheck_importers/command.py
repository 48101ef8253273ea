"""`trebucheck importer`: a reader of MJCF files against models whose motion is certified."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from trebucheck.api.commands import options, output

if TYPE_CHECKING:
    from .results import ImporterResults


def importer_command(
    context: typer.Context,
    loader: Annotated[
        str,
        typer.Argument(
            help="Function that loads a file: my_package:load, or path/to/my_file.py:load."
        ),
    ],
    python: Annotated[
        Path | None,
        typer.Option(
            "--python", help="Python that has the importer, and NumPy; this one by default."
        ),
    ] = None,
    models: Annotated[
        str | None,
        typer.Option(
            "--models",
            "--model",
            help="Models of the zoo, machines, or paths of .xml and .urdf files; by default all of "
            "the zoo and the machines.",
        ),
    ] = None,
    timestep: Annotated[
        float,
        typer.Option(
            "--timestep",
            parser=options.positive_number,
            help="Longest step of the coarser of two runs of each motion (s).",
        ),
    ] = 1e-3,
    timeout: Annotated[
        float,
        typer.Option(
            "--timeout",
            parser=options.positive_number,
            help="Longest wait for an answer of the importer (s).",
        ),
    ] = 60.0,
    out: Annotated[
        Path | None,
        options.out("Folder for importer.json, importer.md with reports of faults, and models."),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Take finished models from the folder again.")
    ] = False,
    quiet: options.Quiet = False,
    json: options.Json = False,
) -> None:
    """Check an importer of MJCF against small models of one feature each, and against the machines.

    Total mass, mass matrix and accelerations at three states, ranges, the start, the motion up to
    the first event and after it, and the force at rest are held against certified values. A machine
    whose file is refused or misread is tried without sensors and with finite inertia too. The
    importer runs in a process of its own, which may crash. What its loader returns is described in
    docs/importers.md; what it does not offer is not judged. Of a file of your own the mechanism is
    what `trebucheck audit` reads, and its motion is judged until a limit or contact acts. The exit
    code is 1 if anything is wrong.

    Examples:
    trebucheck importer my_package:load --python ../other/.venv/bin/python --out findings

    trebucheck importer load.py:load --models hinge,armature,connect

    trebucheck importer load.py:load --models acrobot.xml --python ../drake/.venv/bin/python
    """
    from trebucheck.api.mechanics import InputError, refuse_unwritable
    from trebucheck.api.studies import Store

    from . import report
    from .study import check_importer

    told = output.Told(quiet, json)
    if resume and out is None:
        raise InputError("--resume needs --out, the folder where finished models are kept.")
    if out is not None:
        refuse_unwritable(out, "importer.json")
    store = None if out is None else Store(out / "models", resume, out / "models")
    with output.progress("importer", told=told) as progress:
        results = check_importer(
            loader,
            python=python or Path(sys.executable),
            models=options.names(models, "--models") if models else (),
            timestep=timestep,
            timeout=timeout,
            progress=progress,
            store=store,
        ).made_by(output.command_line(context))
    written = {} if out is None else _written(results, loader, out)
    if json:
        typer.echo(results.to_json())
    else:
        output.show(report.document(results), told, **written)
    if not results.holds:
        raise typer.Exit(1)


def _written(results: ImporterResults, loader: str, out: Path) -> dict[str, Path]:
    """The files of a check, by what they are called."""
    from trebucheck.api.mechanics import write_text
    from trebucheck.api.reports import markdown

    from . import report

    files = {"Report": out / "importer.md", "Data": out / "importer.json"}
    write_text(files["Report"], markdown.text(report.page(results, loader)))
    write_text(files["Data"], results.to_json())
    return files
