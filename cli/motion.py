"""`trebucheck throw`, `run`, `animate` and `view`: what does a machine do?"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from ..models.errors import InputError, TrebucheckError
from . import options, output
from .call import Call, command
from .options import argument, folder, option

if TYPE_CHECKING:
    from ..comparisons.report.drawing.scene import Scene
    from ..comparisons.runs.process import Worker
    from ..comparisons.runs.runner import Farthest
    from ..comparisons.runs.study import Study
    from ..models.mechanism import Mechanism
    from ..models.trajectory import Trajectory


@command(
    "model set beam release_angle release_time sling_angle best density drag_area body height "
    "sensitivities timeout quiet json",
    folder("report", "Folder for throw.html and throw.json."),
    release_angle=option(
        "--release-angle",
        "Let go at this angle of the velocity above level (deg); 45 if no other.",
        float | None,
    ),
    release_time=option("--release-time", "Let go at this time (s).", float | None),
    sling_angle=option(
        "--sling-angle", "Let go at this angle of the sling from the arm (deg).", float | None
    ),
    best=option("--best", "Let go for the longest range.", bool, False),
    density=option("--density", "Of the air (kg/m^3); with --drag-area.", float | None),
    drag_area=option(
        "--drag-area", "Drag coefficient times area (m^2); with --density or --body.", float | None
    ),
    body=option("--body", "moon, mars, earth or venus: gravity and air of the paper's Table II."),
    height=option("--height", "Of the landing above the fulcrum or wheel (m).", float, 0.0),
    sensitivities=option(
        "--sensitivities",
        "Also differentiate time, speed, angle and range by every number of the machine.",
        bool,
        False,
    ),
)
def throw_command(call: Call) -> None:
    """Throw with one machine: launch, flight, best release and the forces in its members.

    Prints a table and writes throw.html (self-contained, with pictures) and throw.json.

    Examples:
    trebucheck throw --model rolling --best --out my-throw

    trebucheck throw --set l1=9.5 --release-angle 40 --density 1.2 --drag-area 0.05

    trebucheck throw --body mars --drag-area 0.05 --sling-angle 350

    trebucheck throw --model rolling --sensitivities

    trebucheck throw --model my-machine.json --sensitivities
    """
    from ..comparisons.report.pages.throw import document
    from ..models.files import refuse_unwritable
    from ..models.library.trebuchet import TrebuchetParameters
    from ..reference.sensitivity.release import sensitivities_of
    from ..reference.throw.throw import perform

    mechanism = call.only_mechanism()
    if call.body is not None and "g" in call.numbers:
        raise InputError(
            f"--body {call.body} brings its own gravity; leave out --set g, or --body."
        )
    refuse_unwritable(call.out)
    release = {"release_time": call.release_time}
    for angle in ("release_angle", "sling_angle"):
        degrees: float | None = call.values[angle]
        release[angle] = None if degrees is None else math.radians(degrees)
    names = ("best", "density", "drag_area", "body", "height")
    more = {name: call.values[name] for name in names}
    with call.worker() as worker:
        performance = worker.compute(partial(perform, mechanism, release, **more))
        throw = performance.throw
        if call.sensitivities:
            # By Table I's parameters for the two whippers, else by every number of the machine.
            name: str = call.model.strip()
            whipper = name if name in ("fixed", "rolling") else None
            parameters = (call.whipper(name) if whipper else None) or TrebuchetParameters()
            parameters = parameters.model_copy(update={"g": throw.gravity})
            derivatives, warnings = worker.compute(
                partial(sensitivities_of, performance, whipper, parameters)
            )
            warnings = (*throw.warnings, *warnings)
            throw = throw.model_copy(update={"sensitivities": derivatives, "warnings": warnings})
    page = document(performance, throw)
    call.publish("throw.json", throw.to_json(), page, "throw.html", "Page")


@command(
    "engine model preset timestep duration until set beam keyframe qpos qvel ctrl without option "
    "stop_law reference script timeout quiet",
    folder("report", "NetCDF file to write, or a folder for it."),
    engine=option(
        "--engine --engines",
        "One engine; see `trebucheck engines`.",
        str,
        ...,
        names=options.engine_names,
    ),
    preset=option(
        "--preset", "default, settings or assisted.", str, "assisted", names=options.preset_names
    ),
    reference=option(
        "--reference/--no-reference", "Say how far the run is from the reference.", bool, True
    ),
    script=option(
        "--script",
        "Python file for the same run as a program of the engine alone (default, settings).",
        Path | None,
        metavar="FILE",
    ),
)
def run_command(call: Call) -> None:
    """Simulate one machine with one engine; write its trajectory as NetCDF and print a summary.

    It is simulated a little past the launch, or the end that --until names. The summary says how
    far the run is from the reference: the largest distance of any marker up to that end, or to the
    predictability horizon if that is earlier.

    Examples:
    trebucheck run --engine mujoco --model rolling --timestep 5e-4 --duration 2.6 --out rolling.nc

    trebucheck run --engine pymunk --preset settings --option iterations=30

    trebucheck run --engine mujoco --preset default --script fixed.py
    """
    from ..comparisons.report.pages.run import run_report
    from ..comparisons.runs.process import simulate
    from ..comparisons.runs.runner import Runner, farthest
    from ..comparisons.runs.study import Study, one_end
    from ..engines.registry import script_of
    from ..models.files import refuse_unwritable, write_text
    from ..models.problem import Problem
    from ..models.trajectory import save

    given, engine = call.only_model(), call.engine
    study = Study(
        [given],
        [engine],
        options=options.engine_options(call.option, call.timestep, [engine]),
        stop_law=call.stop_law,
        until=one_end(call.duration, call.until),
    )
    made = study.engine(engine, call.preset)
    (mechanism,) = study.mechanisms
    end, law = study.end_of(mechanism), study.law_of(mechanism)
    asked = Problem(mechanism, duration=end.time, stop_law=law) if end.kind == "time" else None
    path: Path = call.out
    if path.suffix != ".nc":
        path /= f"{mechanism.name}-{engine}-{call.preset}.nc"
    refuse_unwritable(path.parent, path.name)
    with call.worker() as worker:
        runner = Runner(mechanism, worker, end, law)
        problem = asked or runner.problem(made)
        written = {"Trajectory": path}
        if call.script is not None:
            write_text(call.script, script_of(made, problem))
            written["Program"] = call.script
        trajectory = worker.call(simulate, made, problem)
        save(trajectory, path)
        distance: Farthest | str | None = None
        if call.reference:
            try:
                distance = farthest(trajectory, runner)
            except TrebucheckError as error:  # a run is not lost with its reference
                distance = str(error)
    output.show(run_report(trajectory, distance), call.told, **written)


@command(
    "model engines preset trajectories magnify width at timestep duration until set beam keyframe "
    "qpos qvel ctrl without stop_law "
    "timeout",
    folder("motion.html", "File to write: .gif, .mp4, .svg or .html."),
    model=argument(
        f"Machine; several for a page: {options.MACHINES}.", str | None, None, metavar="[MODEL]"
    ),
    engines=option(
        "--engines --engine", "Engines drawn over the reference, comma-separated; none by default."
    ),
    preset="assisted",
    trajectories=option(
        "--from",
        "Draw these trajectories (NetCDF, or a folder of them) instead of new runs.",
        Path | None,
        metavar="PATH",
    ),
    magnify=option(
        "--magnify",
        "Times that deviations are magnified; chosen to be seen by default.",
        float | None,
    ),
    width=option("--width", "Of the picture (px).", int, 640),
    at=option(
        "--at", "Instant of a still picture, .svg (s); several in one: 0,1.2,2.", metavar="TIMES"
    ),
)
def animate_command(call: Call) -> None:
    """Write the motion of a machine: a page to play it in, or a GIF, MP4 or SVG.

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
    from ..comparisons.runs.study import Study, one_end

    instants = [options.number(text, "--at") for text in call.names("at") or ()]
    refuse_other_files(call.out, call.width, instants)
    refuse_magnification(call.magnify)
    end = one_end(call.duration, call.until)
    with call.worker() as worker:
        if call.trajectories is not None:
            scenes = [*_from_files(call.trajectories, call.model, end, worker, call.magnify)]
        else:
            study = Study(
                call.models(call.model or "fixed"),
                call.names("engines") or [],
                options.names(call.preset, "--preset"),
                options=options.engine_options(None, call.timestep),
                stop_law=call.stop_law,
                until=end,
                timeout=call.timeout,
            )
            if len(study.mechanisms) > 1 and call.out.suffix.lower() != ".html":
                raise InputError(
                    f"{call.out} can show one machine, not {len(study.mechanisms)}; a page (.html) "
                    "shows several."
                )
            scenes = [_from_runs(study, m, worker, call.magnify) for m in study.mechanisms]
    title = ", ".join(scene.mechanism_title for scene in scenes)
    Animation(scenes, f"{title}: the motion").save(call.out, call.width, instants)
    typer.echo(f"Wrote {output.printable(str(call.out))}")


def _from_runs(study: Study, mechanism: Mechanism, worker: Worker, magnify: float | None) -> Scene:
    """Collect the reference's motion and runs made now; engines that refuse are named below it."""
    from ..comparisons.report.plots import motion_scene
    from ..comparisons.runs.runner import Runner

    engines = {
        f"{name} {preset}": study.engine(name, preset)
        for name in study.every_engine
        for preset in study.presets_of(name)
    }
    runner = Runner(mechanism, worker, study.end_of(mechanism), study.law_of(mechanism))
    runs: dict[str, Trajectory] = {}
    failures: dict[str, TrebucheckError] = {}
    for label, made in engines.items():
        try:
            # Without a step there is nothing to scale, and the reference need not be solved.
            stepped = made.timestep is not None
            runs[label] = runner.simulate(
                study.engine_for(mechanism.name, runner.scales, made) if stepped else made
            )
        except TrebucheckError as error:
            failures[label] = error
    if failures and not runs:
        raise next(iter(failures.values()))
    notes = " ".join(f"{label} is missing: {error}" for label, error in failures.items())
    how = {"end": runner.end, "thrown": runner.until.thrown, "launch": runner.launch_time}
    how |= {"name": mechanism.name, "notes": notes, "magnify": magnify}
    return motion_scene(runner.solution.trajectory, runs, **how, horizon=runner.judged_to)


def _from_files(
    path: Path, model: str | None, until: str | float | None, worker: Worker, magnify: float | None
) -> Iterator[Scene]:
    """The reference's motion, and runs that were made before, by machine: to the shortest's end.

    Of runs from several starts the reference has that of the first file.

    Raises:
        InputError: there are none, or a file is not one.
    """
    from ..comparisons.report.plots import motion_scene
    from ..comparisons.runs.runner import Runner, horizon_of
    from ..comparisons.runs.study import Until
    from ..models.problem import StopLaw
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
    for name in chosen:
        mechanism, law = groups[name][0].mechanism, groups[name][0].provenance.stop_law
        start = {"start": mechanism.start, "start_speeds": mechanism.start_speeds}
        if any(run.mechanism.model_copy(update=start) != mechanism for run in groups[name]):
            raise InputError(f"the trajectories of {name!r} are of several machines of that name.")
        shortest = min(float(trajectory.t[-1]) for trajectory in groups[name])
        end = Until.of(shortest if until is None else until)
        runner = Runner(mechanism, worker, end, StopLaw(law))
        runs: dict[str, Trajectory] = {}
        for run in groups[name]:
            label = f"{run.provenance.engine} {run.provenance.preset}"
            if label in runs:
                label += f", {run.provenance.steps} steps"
            runs[label] = run
        launch, last = runner.launch_time, min(runner.end, shortest)
        if until is None and launch is not None:
            # Engines ran on after the launch; that is not part of the comparison.
            last = min(launch, shortest)
        elsewhere = horizon_of([run for run in groups[name] if run.mechanism != mechanism])
        horizon = min(runner.judged_to, elsewhere or math.inf)
        how = {"end": last, "launch": launch, "magnify": magnify, "horizon": horizon}
        yield motion_scene(runner.solution.trajectory, runs, **how)


@command(
    "model engine set beam keyframe qpos qvel ctrl without",
    model=argument(f"Machine: {options.MACHINES}.", str, "fixed"),
    engine=option("--engine", "Whose viewer; the first that has one."),
)
def view_command(call: Call) -> None:
    """Open a machine in an engine's own interactive viewer (MuJoCo has one); it needs a display.

    Example: trebucheck view rolling
    """
    from ..engines.registry import engine as make
    from ..engines.registry import engine_names, has_viewer, view

    mechanism = call.only_mechanism()
    name = call.engine or next((name for name in engine_names() if has_viewer(name)), None)
    if name is None:
        raise InputError(
            "no engine here has a viewer of its own; `trebucheck animate` writes a page to play."
        )
    view(make(name), mechanism)
