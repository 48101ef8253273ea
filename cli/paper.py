"""`trebucheck paper`: the study behind the machine, claim by claim."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from . import options

if TYPE_CHECKING:
    from ..paper.results import Study


def paper_command(
    engines: options.Engines = "",
    sections: Annotated[
        str,
        typer.Option("--sections", help="Further studies: identification,drag,sweep,machines,design; all by default."),
    ] = "",
    timeout: Annotated[
        float, typer.Option("--timeout", help="Longest wait for one run, or one further study (s).")
    ] = 600.0,
    out: Annotated[Path, typer.Option("--out", help="Folder for paper.html and paper.json.")] = Path("paper"),
) -> None:
    """Judge every number and statement of the paper that a solver can reach, by the reference and every engine.

    Writes paper.html (self-contained) and paper.json; prints the verdicts. A verdict follows from stated rules. What
    fails here is a row that says so, never a lost report.

    Examples:
    trebucheck paper --out paper

    trebucheck paper --engines mujoco --sections sweep
    """
    from ..models.errors import InputError
    from ..models.files import refuse_unwritable

    if not timeout > 0:
        raise InputError(f"timeout = {timeout!r} s must be positive.")
    engine_list = options.names(engines, "--engines") if engines else None
    section_list = options.names(sections, "--sections") if sections else None
    refuse_unwritable(out)
    _write(_with_progress(engine_list, section_list, timeout), out)


def _with_progress(engines: list[str] | None, sections: list[str] | None, timeout: float) -> Study:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from ..comparisons.report.terminal import progress_console
    from ..paper.study import study

    columns = (TextColumn("{task.description:<40}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    to = progress_console()
    with Progress(*columns, console=to, transient=True, disable=not to.is_terminal) as bar:
        task = bar.add_task("paper", total=None)

        def show(what: str, done: int, of: int) -> None:
            bar.update(task, description=what, completed=done, total=of)

        return study(engines, sections=sections, timeout=timeout, progress=show)


def _write(study: Study, out: Path) -> None:
    from ..comparisons.report.terminal import console
    from ..models.files import write_text
    from ..paper.report.page import page
    from ..paper.report.terminal import print_study

    html = page(study)  # made before anything is written, so that nothing is left half-written
    write_text(out / "paper.json", study.to_json())
    write_text(out / "paper.html", html)
    print_study(study, console())
    console().print(f"\nReport: {out / 'paper.html'}   Data: {out / 'paper.json'}", soft_wrap=True)
