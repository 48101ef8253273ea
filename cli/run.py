"""`trebucheck run`: one engine, one machine."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from . import completion, options, output

if TYPE_CHECKING:
    from ..comparisons.runs.runner import Farthest, Runner
    from ..models.trajectory import Trajectory


def run_command(
    engine: Annotated[
        str,
        typer.Option(
            "--engine",
            "--engines",
            autocompletion=completion.engines,
            help="One engine; see `trebucheck engines`.",
        ),
    ],
    model: options.Model = "fixed",
    preset: Annotated[
        str, typer.Option("--preset", autocompletion=completion.presets, help="tuned or stock.")
    ] = "tuned",
    timestep: options.Timestep = None,
    duration: options.Duration = None,
    until: options.Until = None,
    assignments: options.Set = None,
    beam: options.Beam = None,
    option: options.EngineOption = None,
    stop_law: options.StopLaw = None,
    reference: Annotated[
        bool,
        typer.Option(
            "--reference/--no-reference", help="Say how far the run is from the reference."
        ),
    ] = True,
    timeout: options.Timeout = 600.0,
    quiet: options.Quiet = False,
    out: Annotated[Path, options.out("NetCDF file to write, or a folder for it.")] = Path("report"),
) -> None:
    """Simulate one machine with one engine; write its trajectory as NetCDF and print a summary.

    It is simulated a little past the launch, or the end that --until names. The summary says how
    far the run is from the reference: the largest distance of any marker up to that end, or to the
    predictability horizon if that is earlier.

    Examples:
    trebucheck run --engine mujoco --model rolling --timestep 5e-4 --duration 2.6 --out rolling.nc

    trebucheck run --engine pymunk --preset stock --option iterations=30
    """
    from ..comparisons.report.pages.run import run_report
    from ..comparisons.runs.process import Worker, simulate
    from ..comparisons.runs.runner import Runner
    from ..comparisons.runs.study import Study, one_end
    from ..models.files import refuse_unwritable
    from ..models.problem import Problem
    from ..models.trajectory import save

    given = options.only(model, assignments, beam, "run")
    own = options.engine_options(option, timestep, [engine])
    study = Study([given], [engine], options=own, stop_law=stop_law, until=one_end(duration, until))
    made = study.engine(engine, preset)
    (mechanism,) = study.mechanisms
    end, law = study.end_of(mechanism), study.law_of(mechanism)
    asked = Problem(mechanism, duration=end.time, stop_law=law) if end.kind == "time" else None
    path = out if out.suffix == ".nc" else out / f"{mechanism.name}-{engine}-{preset}.nc"
    refuse_unwritable(path.parent, path.name)
    with Worker(options.positive(timeout, "--timeout")) as worker:
        runner = Runner(mechanism, worker, end, law)
        trajectory = worker.call(simulate, made, asked or runner.problem(made))
        save(trajectory, path)
        found = _distance(trajectory, runner) if reference else None
    output.show(run_report(trajectory, found), output.Told(quiet), Trajectory=path)


def _distance(trajectory: Trajectory, runner: Runner) -> Farthest | str:
    """From the reference; or why that is not known: a run is not lost with its reference."""
    from ..comparisons.runs.runner import farthest
    from ..models.errors import TrebucheckError

    try:
        return farthest(trajectory, runner)
    except TrebucheckError as error:
        return str(error)
