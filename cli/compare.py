"""`trebucheck compare`: the main job."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from . import options, output


def compare_command(
    models: options.Models = "fixed,rolling",
    engines: options.Engines = "",
    preset: options.Preset = "tuned,stock",
    timestep: options.Timestep = None,
    duration: options.Duration = None,
    assignments: options.Set = None,
    beam: options.Beam = None,
    stop_law: options.StopLaw = "release-once",
    resume: options.Resume = False,
    timeout: options.Timeout = 600.0,
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
    from ..comparisons.compare.report import document
    from ..comparisons.compare.study import compare
    from ..comparisons.runs.store import Store
    from ..models.files import refuse_unwritable

    machines = options.machines(models, options.parameters(assignments, beam))
    presets = options.names(preset, "--preset")
    chosen = options.engine_names(engines)
    refuse_unwritable(out)
    with output.progress(width=28) as show:
        comparison = compare(
            machines,
            chosen,
            presets,
            timestep=timestep,
            duration=duration,
            stop_law=stop_law,
            timeout=timeout,
            store=Store(out / "trajectories", resume, out / "runs"),
            progress=lambda case, done, of: show(f"{case.model}: {case.label}", done, of),
        )
    data = out / "results.json", comparison.results.to_json()
    output.publish(data, document(comparison), out / "report.html", current=comparison.repeated)
    if not comparison.passed:
        raise typer.Exit(1)
