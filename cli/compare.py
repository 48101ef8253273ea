"""`trebucheck compare`: the main job."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from . import options

if TYPE_CHECKING:
    from ..comparisons.compare.study import Comparison
    from ..comparisons.runs.store import Store
    from ..models.mechanism import Mechanism


def compare_command(
    models: options.Models = "fixed,rolling",
    engines: options.Engines = "",
    preset: options.Preset = "tuned,stock",
    timestep: options.Timestep = None,
    duration: options.Duration = None,
    assignments: options.Set = None,
    beam: options.Beam = None,
    stop_law: Annotated[str, typer.Option("--stop-law", help="release-once or unilateral.")] = "release-once",
    resume: Annotated[bool, typer.Option("--resume", help="Take finished runs from the folder again.")] = False,
    timeout: Annotated[float, typer.Option("--timeout", help="Longest wait for one run (s).")] = 600.0,
    out: Annotated[Path, typer.Option("--out", help="Folder for report.html, results.json and trajectories.")] = Path(
        "report"
    ),
) -> None:
    """Run engines on machines, measure them against the reference and each other, and write the report.

    Writes report.html (self-contained), results.json and one NetCDF file a run; prints the agreement table.
    Ends with exit code 1 if a tolerance is broken or a run failed.

    Examples:
    trebucheck compare --out report

    trebucheck compare --models fixed --engines mujoco,pymunk --preset tuned --timestep 1e-3 --set l1=9.5
    """
    from ..comparisons.runs.store import Store
    from ..models.files import refuse_unwritable

    machines = options.machines(models, options.parameters(assignments, beam))
    presets = options.names(preset, "--preset")
    chosen = options.names(engines, "--engines") if engines else None
    refuse_unwritable(out)
    comparison = _with_progress(
        machines, chosen, presets, timestep, duration, stop_law, timeout, Store(out / "trajectories", resume)
    )
    _write(comparison, out)
    if not comparison.passed:
        raise typer.Exit(1)


def _with_progress(
    machines: list[Mechanism],
    engines: list[str] | None,
    presets: list[str],
    timestep: float | None,
    duration: float | None,
    stop_law: str,
    timeout: float,
    store: Store,
) -> Comparison:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from ..comparisons.compare.study import Case, compare
    from ..comparisons.report.terminal import progress_console

    columns = (TextColumn("{task.description:<28}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    to = progress_console()
    with Progress(*columns, console=to, transient=True, disable=not to.is_terminal) as bar:
        task = bar.add_task("reference", total=None)

        def show(case: Case, done: int, of: int) -> None:
            bar.update(task, description=f"{case.model}: {case.label}", completed=done, total=of)

        return compare(
            machines,
            engines,
            presets,
            timestep=timestep,
            duration=duration,
            stop_law=stop_law,
            timeout=timeout,
            store=store,
            progress=show,
        )


def _write(comparison: Comparison, out: Path) -> None:
    from ..comparisons.compare.report import document
    from ..comparisons.report import html, terminal
    from ..models.files import write_text

    write_text(out / "results.json", comparison.results.to_json())
    report = document(comparison)
    write_text(out / "report.html", html.page(report))
    terminal.show(report, terminal.console())
    terminal.console().print(f"\nReport: {out / 'report.html'}   Data: {out / 'results.json'}", soft_wrap=True)
