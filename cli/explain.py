"""`trebucheck explain`: where each engine's error comes from."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from . import options

if TYPE_CHECKING:
    from ..comparisons.explain.results import Explanation
    from ..comparisons.explain.study import Study


def explain_command(
    models: options.Models = "fixed,rolling",
    engines: options.Engines = "",
    preset: options.Preset = "tuned,stock",
    timestep: options.Timestep = None,
    assignments: options.Set = None,
    beam: options.Beam = None,
    resume: Annotated[bool, typer.Option("--resume", help="Take finished runs from the folder again.")] = False,
    timeout: Annotated[float, typer.Option("--timeout", help="Longest wait for one run (s).")] = 600.0,
    out: Annotated[Path, typer.Option("--out", help="Folder for explain.html, explain.json and the runs.")] = Path(
        "explain"
    ),
) -> None:
    """Split each engine's error among its causes, each measured by a run without it.

    Also sets each engine's stock and tuned presets side by side and changes one option at a time. Writes explain.html
    (self-contained) and explain.json; prints a summary. A run that fails is shown as such and ends nothing.

    Examples:
    trebucheck explain --models fixed --engines mujoco

    trebucheck explain --preset tuned --timestep 5e-4 --set l1=9.5 --out why
    """
    from ..comparisons.explain.page import explain_html
    from ..comparisons.explain.study import Study
    from ..comparisons.explain.terminal import print_explanation
    from ..comparisons.report.terminal import console
    from ..models.files import refuse_unwritable, write_text

    study = Study(
        machines=options.machines(models, options.parameters(assignments, beam)),
        engines=options.names(engines, "--engines") if engines else None,
        presets=options.names(preset, "--preset"),
        timestep=timestep,
        folder=out / "trials",
        resume=resume,
        timeout=timeout,
    )
    refuse_unwritable(out)
    explanation = _with_progress(study)
    write_text(out / "explain.json", explanation.to_json())
    write_text(out / "explain.html", explain_html(explanation))
    print_explanation(explanation, console())
    console().print(f"\nPage: {out / 'explain.html'}   Data: {out / 'explain.json'}", soft_wrap=True)


def _with_progress(study: Study) -> Explanation:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from ..comparisons.report.terminal import progress_console

    columns = (TextColumn("{task.description:<44}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    to = progress_console()
    with Progress(*columns, console=to, transient=True, disable=not to.is_terminal) as bar:
        task = bar.add_task("reference", total=None)

        def show(what: str, done: int, of: int) -> None:
            bar.update(task, description=what, completed=done, total=of)

        return study.explain(started=show)
