"""`trebucheck converge`: how errors fall as an engine's knobs are turned."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from . import options

if TYPE_CHECKING:
    from ..comparisons.converge.results import Studies
    from ..models.mechanism import Mechanism


def converge_command(
    models: options.Models = "fixed,rolling",
    engines: options.Engines = "",
    knobs: Annotated[
        str, typer.Option("--knobs", "--knob", help="Knobs, comma-separated, e.g. timestep,solref; all by default.")
    ] = "",
    assignments: options.Set = None,
    beam: options.Beam = None,
    resume: Annotated[bool, typer.Option("--resume", help="Take finished runs from the folder again.")] = False,
    timeout: Annotated[float, typer.Option("--timeout", help="Longest wait for one run (s).")] = 600.0,
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
    from ..models.files import refuse_unwritable

    machines = options.machines(models, options.parameters(assignments, beam))
    engine_list = options.names(engines, "--engines") if engines else None
    knob_list = options.names(knobs, "--knobs") if knobs else None
    refuse_unwritable(out)
    _write(_with_progress(machines, engine_list, knob_list, out, resume, timeout), out)


def _with_progress(
    machines: list[Mechanism],
    engines: list[str] | None,
    knobs: list[str] | None,
    out: Path,
    resume: bool,
    timeout: float,
) -> Studies:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from ..comparisons.converge.study import converge
    from ..comparisons.report.terminal import progress_console

    columns = (TextColumn("{task.description:<40}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    to = progress_console()
    with Progress(*columns, console=to, transient=True, disable=not to.is_terminal) as bar:
        task = bar.add_task("reference", total=None)

        def show(what: str, done: int, of: int) -> None:
            bar.update(task, description=what, completed=done, total=of)

        return converge(machines, engines, knobs, folder=out / "trials", resume=resume, timeout=timeout, progress=show)


def _write(studies: Studies, out: Path) -> None:
    from ..comparisons.converge.page import page
    from ..comparisons.converge.terminal import print_studies
    from ..comparisons.report.terminal import console
    from ..models.files import write_text

    write_text(out / "converge.json", studies.to_json())
    write_text(out / "converge.html", page(studies))
    print_studies(studies, console())
    console().print(f"\nReport: {out / 'converge.html'}   Data: {out / 'converge.json'}", soft_wrap=True)
