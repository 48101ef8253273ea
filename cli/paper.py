"""`trebucheck paper`: the study behind the machine, claim by claim."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..models.errors import InputError
from . import options, output


def paper_command(
    engines: options.Engines = None,
    sections: Annotated[
        str | None,
        typer.Option("--sections", help="Further studies: identification,drag,sweep,machines,design; all by default."),
    ] = None,
    timeout: Annotated[
        float, typer.Option("--timeout", help="Longest wait for one run, or one further study (s).")
    ] = 600.0,
    out: Annotated[Path, options.out("Folder for paper.html and paper.json.")] = Path("paper"),
) -> None:
    """Judge every number and statement of the paper that a solver can reach, by the reference and every engine.

    Writes paper.html (self-contained) and paper.json; prints the verdicts. A verdict follows from stated rules. What
    fails here is a row that says so, never a lost report.

    Examples:
    trebucheck paper --out paper

    trebucheck paper --engines mujoco --sections sweep
    """
    from ..models.files import refuse_unwritable
    from ..paper.report import document
    from ..paper.study import study

    if not timeout > 0:
        raise InputError(f"timeout = {timeout!r} s must be positive.")
    engine_list = options.chosen_names(engines, "--engines")
    section_list = options.chosen_names(sections, "--sections")
    refuse_unwritable(out)
    with output.progress("paper") as show:
        judged = study(engine_list, sections=section_list, timeout=timeout, progress=show)
    output.publish((out / "paper.json", judged.to_json()), document(judged), out / "paper.html")
