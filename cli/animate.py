"""`trebucheck animate` and `trebucheck view`: the motion itself."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..models.errors import InputError, TrebucheckError
from . import options, output

if TYPE_CHECKING:
    from ..comparisons.report.drawing.scene import Scene
    from ..comparisons.runs.process import Worker
    from ..comparisons.runs.study import Study
    from ..models.mechanism import Mechanism
    from ..models.trajectory import Trajectory

_Named = Annotated[
    str | None,
    typer.Argument(metavar="[MODEL]", help=f"Machine; several for a page: {options.MACHINES}."),
]
_Engines = Annotated[
    str | None,
    typer.Option(
        "--engines",
        "--engine",
        help="Engines drawn over the reference, comma-separated; none by default.",
    ),
]
_From = Annotated[
    Path | None,
    typer.Option(
        "--from",
        metavar="PATH",
        help="Draw these trajectories (NetCDF, or a folder of them) instead of new runs.",
    ),
]
_Magnify = Annotated[
    float | None,
    typer.Option(
        "--magnify", help="Times that deviations are magnified; chosen to be seen by default."
    ),
]


def animate_command(
    model: _Named = None,
    engines: _Engines = None,
    preset: options.Preset = "tuned",
    trajectories: _From = None,
    magnify: _Magnify = None,
    width: Annotated[int, typer.Option("--width", help="Of the picture (px).")] = 640,
    at: Annotated[
        str | None,
        typer.Option(
            "--at",
            metavar="TIMES",
            help="Instant of a still picture, .svg (s); several in one: 0,1.2,2.",
        ),
    ] = None,
    timestep: options.Timestep = None,
    duration: options.Duration = None,
    until: options.Until = None,
    assignments: options.Set = None,
    beam: options.Beam = None,
    stop_law: options.StopLaw = None,
    timeout: options.Timeout = 600.0,
    out: Annotated[Path, options.out("File to write: .gif, .mp4, .svg or .html.")] = Path(
        "motion.html"
    ),
) -> None:
    """Write the motion of a machine: a page to play it in, or a GIF, MP4 or SVG that plays by itself.

    The reference is drawn from the machine's description; runs of engines are drawn over it in
    their colours, their deviations magnified.

    Examples:
    trebucheck animate rolling --out rolling.gif

    trebucheck animate fixed --engines mujoco,pymunk --magnify 100 --out fixed.html

    trebucheck animate --from report --out report.html

    trebucheck animate fixed --at 0,1.5,2.74 --out fixed.svg
    """
    from ..comparisons.report.drawing.animation import Animation, refuse_other_files
    from ..comparisons.report.drawing.scene import refuse_magnification
    from ..comparisons.runs.process import Worker
    from ..comparisons.runs.study import Study, one_end

    instants = (
        [] if at is None else [options.number(text, "--at") for text in options.names(at, "--at")]
    )
    refuse_other_files(out, width, instants)
    refuse_magnification(magnify)
    end = one_end(duration, until)
    with Worker(options.positive(timeout, "--timeout")) as worker:
        if trajectories is not None:
            scenes = _from_files(trajectories, model, end, worker, magnify)
        else:
            given = options.given(model or "fixed", assignments, beam)
            named = options.chosen_names(engines, "--engines") or []
            presets, steps = (
                options.names(preset, "--preset"),
                options.engine_options(None, timestep),
            )
            study = Study(
                given, named, presets, options=steps, stop_law=stop_law, until=end, timeout=timeout
            )
            _refuse_several(study, out)
            scenes = [
                _from_runs(study, mechanism, worker, magnify) for mechanism in study.mechanisms
            ]
    title = ", ".join(scene.mechanism_title for scene in scenes)
    Animation(scenes, f"{title}: the motion").save(out, width, instants)
    typer.echo(f"Wrote {output.printable(str(out))}")


def _refuse_several(study: Study, out: Path) -> None:
    """Before anything runs.

    Raises:
        InputError: there are several machines, and the file is no page.
    """
    if len(study.mechanisms) > 1 and out.suffix.lower() != ".html":
        raise InputError(
            f"{out} can show one machine, not {len(study.mechanisms)}; a page (.html) shows "
            "several."
        )


def _from_runs(study: Study, mechanism: Mechanism, worker: Worker, magnify: float | None) -> Scene:
    """The reference's motion, and runs made now; engines that cannot make one are named below it."""
    from ..comparisons.report.plots import motion_scene
    from ..comparisons.runs.runner import Runner

    engines = {
        f"{name} {preset}": study.engine(name, preset)
        for name in study.every_engine
        for preset in study.presets
    }
    runner = Runner(mechanism, worker, study.end_of(mechanism), study.law_of(mechanism))
    runs: dict[str, Trajectory] = {}
    failures: dict[str, TrebucheckError] = {}
    for label, made in engines.items():
        try:
            time = runner.scales.time if made.timestep else 1.0
            runs[label] = runner.simulate(study.engine_for(mechanism.name, time, made))
        except TrebucheckError as error:
            failures[label] = error
    if failures and not runs:
        raise next(iter(failures.values()))
    notes = " ".join(f"{label} is missing: {error}" for label, error in failures.items())
    how = {"end": runner.end, "thrown": runner.until.thrown, "launch": runner.launch_time}
    return motion_scene(
        runner.solution.trajectory, runs, **how, name=mechanism.name, notes=notes, magnify=magnify
    )


def _from_files(
    path: Path, model: str | None, end: str | float | None, worker: Worker, magnify: float | None
) -> list[Scene]:
    """The reference's motion, and runs that were made before, by machine.

    Raises:
        InputError: there are none, or a file is not one.
    """
    from ..models.trajectory import load

    files = sorted(path.rglob("*.nc")) if path.is_dir() else [path]
    if not files:
        raise InputError(
            f"{path} holds no trajectories (.nc); `trebucheck compare --out {path}` writes some "
            "there."
        )
    groups: dict[str, list[Trajectory]] = {}
    for file in files:
        trajectory = load(file)
        groups.setdefault(trajectory.mechanism.name, []).append(trajectory)
    chosen = list(groups) if model is None else options.names(model, "MODEL")
    for name in chosen:
        if name not in groups:
            raise InputError(
                f"{path} holds no trajectory of {name!r}; it holds those of: {', '.join(groups)}."
            )
    return [_of_one(groups[name], end, worker, magnify) for name in chosen]


def _of_one(
    trajectories: Sequence[Trajectory],
    until: str | float | None,
    worker: Worker,
    magnify: float | None,
) -> Scene:
    from ..comparisons.report.plots import motion_scene
    from ..comparisons.runs.runner import Runner
    from ..comparisons.runs.study import Until
    from ..models.problem import StopLaw

    first = trajectories[0]
    if len({trajectory.mechanism.content_hash for trajectory in trajectories}) > 1:
        raise InputError(
            f"the trajectories of {first.mechanism.name!r} are of several machines of that name."
        )
    shortest = min(float(trajectory.t[-1]) for trajectory in trajectories)
    law = StopLaw(first.provenance.stop_law)
    runner = Runner(first.mechanism, worker, Until.of(shortest if until is None else until), law)
    runs: dict[str, Trajectory] = {}
    for run in trajectories:
        label = f"{run.provenance.engine} {run.provenance.preset}"
        runs[f"{label}, {run.provenance.steps} steps" if label in runs else label] = run
    launch = runner.launch_time
    # What engines ran on after the launch for is not part of the comparison.
    end = (
        min(runner.end, shortest) if until is not None or launch is None else min(launch, shortest)
    )
    return motion_scene(runner.solution.trajectory, runs, end=end, launch=launch, magnify=magnify)


def view_command(
    model: Annotated[str, typer.Argument(help=f"Machine: {options.MACHINES}.")] = "fixed",
    engine: Annotated[
        str | None, typer.Option("--engine", help="Whose viewer; the first that has one.")
    ] = None,
    assignments: options.Set = None,
    beam: options.Beam = None,
) -> None:
    """Open a machine in an engine's own interactive viewer (MuJoCo has one); it needs a display.

    Example: trebucheck view rolling
    """
    from ..engines.registry import engine as make
    from ..engines.registry import engine_names, has_viewer, view

    mechanism = options.machine(model, assignments, beam, "view")
    name = engine or next((name for name in engine_names() if has_viewer(name)), None)
    if name is None:
        raise InputError(
            "no engine here has a viewer of its own; `trebucheck animate` writes a page to play."
        )
    view(make(name), mechanism)
