"""`trebucheck converge`: how errors fall as an engine's knobs are turned."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from . import options, output


def converge_command(
    models: options.Models = "fixed,rolling",
    engines: options.Engines = "",
    knobs: Annotated[
        str, typer.Option("--knobs", "--knob", help="Knobs, comma-separated, e.g. timestep,solref; all by default.")
    ] = "",
    assignments: options.Set = None,
    beam: options.Beam = None,
    resume: options.Resume = False,
    timeout: options.Timeout = 600.0,
    out: Annotated[Path, typer.Option("--out", help="Folder for converge.html, converge.json and the runs.")] = Path(
        "converge"
    ),
) -> None:
    """Turn each engine's knobs and see how its error falls: orders, floors and their causes, Richardson limits.

    Writes converge.html (self-contained) and converge.json; prints orders and laws. A run that fails is a failed
    point of its study.

    Examples:
    trebucheck converge --out converge

    trebucheck converge --models rolling --engines mujoco --knobs timestep,solref --set l1=9.5
    """
    from ..comparisons.converge.report import document
    from ..comparisons.converge.study import converge

    machines = options.machines(models, options.parameters(assignments, beam))
    chosen = options.names(knobs, "--knobs") if knobs else None
    study = options.study(machines, engines, out, resume, timeout)
    with output.progress() as show:
        studies = converge(replace(study, progress=show), chosen)
    output.publish((out / "converge.json", studies.to_json()), document(studies), out / "converge.html")
