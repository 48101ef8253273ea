"""`trebucheck run`: one engine, one machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from . import options, output


def run_command(
    engine: Annotated[str, typer.Option("--engine", "--engines", help="One engine; see `trebucheck engines`.")],
    model: options.Model = "fixed",
    preset: Annotated[str, typer.Option("--preset", help="tuned or stock.")] = "tuned",
    timestep: options.Timestep = None,
    duration: options.Duration = None,
    until: options.Until = None,
    assignments: options.Set = None,
    beam: options.Beam = None,
    option: options.EngineOption = None,
    stop_law: options.StopLaw = None,
    timeout: options.Timeout = 600.0,
    out: Annotated[Path, options.out("NetCDF file to write, or a folder for it.")] = Path("report"),
) -> None:
    """Simulate one machine with one engine; write its trajectory as NetCDF and print a summary.

    It is simulated a little past the launch, or the end that --until names.

    Examples:
    trebucheck run --engine mujoco --model rolling --timestep 5e-4 --duration 2.6 --out rolling.nc

    trebucheck run --engine pymunk --preset stock --option iterations=30
    """
    from ..comparisons.report.sections import run_report
    from ..comparisons.runs.runner import Runner, Worker, simulate
    from ..comparisons.runs.study import Study, one_end
    from ..models.files import refuse_unwritable
    from ..models.problem import Problem
    from ..models.trajectory import save

    given = options.only(model, assignments, beam, "run")
    asked_options = options.engine_options(option, timestep)
    study = Study([given], [engine], options=asked_options, stop_law=stop_law, until=one_end(duration, until))
    made = study.engine(engine, preset)
    (mechanism,) = study.mechanisms
    end, law = study.end_of(mechanism), study.law_of(mechanism)
    asked = Problem(mechanism, duration=end.time, stop_law=law) if end.kind == "time" else None
    path = out if out.suffix == ".nc" else out / f"{mechanism.name}-{engine}-{preset}.nc"
    refuse_unwritable(path.parent, path.name)
    with Worker(options.positive(timeout, "--timeout")) as worker:
        problem = asked or Runner(mechanism, worker, end, law).problem(made)
        trajectory = worker.call(simulate, made, problem)
    save(trajectory, path)
    output.show(run_report(trajectory), Trajectory=path)
