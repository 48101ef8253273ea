"""`trebucheck paper`: the claims of the paper, judged."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from trebucheck.api.commands import options, output


def paper_command(
    engines: options.Engines = None,
    sections: Annotated[
        str | None,
        typer.Option(
            "--sections",
            help="Further studies: identification,drag,sweep,machines,design; all by default.",
        ),
    ] = None,
    timeout: Annotated[
        float,
        typer.Option(
            "--timeout",
            parser=options.positive_number,
            help="Longest wait for one run, or one further study (s).",
        ),
    ] = 600.0,
    quiet: options.Quiet = False,
    json: options.Json = False,
    out: Annotated[Path, options.out("Folder for paper.html and paper.json.")] = Path("paper"),
) -> None:
    """Judge all numbers and statements of the paper in a solver's reach, by reference and engines.

    Writes paper.html (self-contained) and paper.json; prints the verdicts. A verdict follows from
    stated rules. What fails here is a row that says so, never a lost report.

    Examples:
    trebucheck paper --out paper

    trebucheck paper --engines mujoco --sections sweep
    """
    from trebucheck.api.mechanics import refuse_unwritable

    from .report import document
    from .study import study

    engine_list = options.chosen_names(engines, "--engines")
    section_list = options.chosen_names(sections, "--sections")
    refuse_unwritable(out)
    told = output.Told(quiet, json)
    with output.progress("paper", told=told) as show:
        judged = study(engine_list, sections=section_list, timeout=timeout, progress=show)
    output.publish(
        (out / "paper.json", judged.to_json()), document(judged), out / "paper.html", told=told
    )
