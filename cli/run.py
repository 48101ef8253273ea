"""`trebucheck run`: one engine, one machine."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from . import options, output

if TYPE_CHECKING:
    from ..comparisons.runs.runner import Worker
    from ..models.mechanism import Mechanism


def run_command(
    engine: Annotated[str, typer.Option("--engine", "--engines", help="One engine; see `trebucheck engines`.")],
    model: options.Model = "fixed",
    preset: Annotated[str, typer.Option("--preset", help="tuned or stock.")] = "tuned",
    timestep: options.Timestep = None,
    duration: options.Duration = None,
    assignments: options.Set = None,
    beam: options.Beam = None,
    option: options.EngineOption = None,
    stop_law: options.StopLaw = "release-once",
    timeout: options.Timeout = 600.0,
    out: Annotated[Path, options.out("NetCDF file to write, or a folder for it.")] = Path("report"),
) -> None:
    """Simulate one machine with one engine; write its trajectory as NetCDF and print a summary.

    Examples:
    trebucheck run --engine mujoco --model rolling --timestep 5e-4 --duration 2.6 --out rolling.nc

    trebucheck run --engine pymunk --preset stock --option iterations=30
    """
    from ..comparisons.report.sections import run_report
    from ..comparisons.runs.runner import Worker, simulate
    from ..engines.registry import engine as make
    from ..models.files import refuse_unwritable
    from ..models.problem import Problem
    from ..models.trajectory import save

    mechanism = options.machine(model, assignments, beam, "run")
    own = options.engine_options(option, timestep)
    runner = make(engine, preset, **own)
    given = None if duration is None else Problem(mechanism, duration=duration, stop_law=stop_law)
    path = out if out.suffix == ".nc" else out / f"{mechanism.name}-{engine}-{preset}.nc"
    refuse_unwritable(path.parent, path.name)
    with Worker(options.positive(timeout, "--timeout")) as worker:
        problem = given or Problem(mechanism, duration=_to_launch(mechanism, worker), stop_law=stop_law)
        trajectory = worker.call(simulate, runner, problem)
    save(trajectory, path)
    output.show(run_report(trajectory), Trajectory=path)


def _to_launch(mechanism: Mechanism, worker: Worker) -> float:
    """A little past the reference's launch [s]."""
    from ..comparisons.runs.runner import Runner

    launch = Runner(mechanism, worker).solution.launch
    return launch.time + 0.02 if launch else 3.0
