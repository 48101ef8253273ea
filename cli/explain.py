"""`trebucheck explain`: where each engine's error comes from."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from . import options, output


def explain_command(
    models: options.Models = "fixed,rolling",
    engines: options.Engines = "",
    preset: options.Preset = "tuned,stock",
    timestep: options.Timestep = None,
    assignments: options.Set = None,
    beam: options.Beam = None,
    resume: options.Resume = False,
    timeout: options.Timeout = 600.0,
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
    from ..comparisons.explain.report import document
    from ..comparisons.explain.study import explain

    machines = options.machines(models, options.parameters(assignments, beam))
    own = {} if timestep is None else {"timestep": timestep}
    presets = options.names(preset, "--preset")
    study = options.study(machines, engines, out, resume, timeout, presets=presets, options=own)
    with output.progress(width=44) as show:
        explanation = explain(replace(study, progress=show))
    data = out / "explain.json", explanation.to_json()
    output.publish(data, document(explanation), out / "explain.html", "Page")
