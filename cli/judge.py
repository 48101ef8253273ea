"""`trebucheck judge`: somebody else's motion, from a file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from . import options, output


def judge_command(
    context: typer.Context,
    file: Annotated[
        Path, typer.Argument(help="CSV with names and units in its first line, or NetCDF (.nc).")
    ],
    model: options.Model = "fixed",
    duration: options.Duration = None,
    until: options.Until = None,
    assignments: options.Set = None,
    beam: options.Beam = None,
    tolerance: options.Tolerance = None,
    tolerances: options.Tolerances = None,
    stop_law: options.StopLaw = None,
    quiet: options.Quiet = False,
    json: options.Json = False,
    out: Annotated[Path, options.out("Folder for judgement.html and judgement.json.")] = Path(
        "judgement"
    ),
) -> None:
    r"""Judge a motion from a file against the reference, in every quantity that it gives; nothing else is believed.

    Columns are those of `Trajectory.to_dataframe`, each with its unit: t \[s], q theta \[rad], u
    theta \[rad/s], projectile x \[m], projectile vx \[m/s], stop hanger rest [N m], joint fulcrum x
    [N], kinetic energy [J]. Releases stand in comments: # release hanger rest \[s] = 0.8167;
    impacts, too: # impact floor \[s] = 0.4515, impulse [N s] = 13.29. Two samples at the time of an
    impact give the speeds before and after it. Coordinates or a marker's position are needed. Exit
    codes: 0 what is given agrees, 1 it does not or could not be judged, 2 the file is broken.

    Examples:
    trebucheck judge my.csv --model rolling

    trebucheck judge my.csv --model pendulum --tolerance angle=1e-6
    """
    from ..comparisons.judge.study import judge_file
    from ..comparisons.report.pages.judge import document
    from ..comparisons.runs.results import Outcome
    from ..comparisons.runs.study import Study, one_end
    from ..models.files import refuse_unwritable

    given = options.only(model, assignments, beam, "judge")
    needs = options.needs(tolerance, tolerances)
    study = Study(
        [given], [], (), stop_law=stop_law, until=one_end(duration, until), tolerances=needs
    )
    refuse_unwritable(out)
    told = output.Told(quiet, json)
    with output.progress(told=told) as progress:
        found = judge_file(file, replace(study, progress=progress)).made_by(
            output.command_line(context)
        )
    data = (out / "judgement.json", found.to_json())
    output.publish(data, document(found), out / "judgement.html", "Judgement", told=told)
    if found.outcome is not Outcome.AGREES:
        raise typer.Exit(1)
