"""`trebucheck compare`, `converge`, `explain` and `recommend`: engines measured on machines."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..models.errors import InputError
from . import options, output

if TYPE_CHECKING:
    from ..comparisons.compare.study import Comparison
    from ..comparisons.runs.store import Store

_NEIGHBOURS = 32

Position = Annotated[
    float | None,
    typer.Option("--position", help="Largest distance of any marker from the reference (m)."),
]
Torque = Annotated[
    str | None,
    typer.Option(
        "--torque",
        help="Largest error of any stop's torque: N m (N on points), or a share of the largest: 0.1%.",
    ),
]
Release = Annotated[
    float | None, typer.Option("--release", help="Largest error of any stop's release (s).")
]
Neighbours = Annotated[
    int,
    typer.Option(
        "--neighbours", help="Machines of the same kind the settings are to hold on, too; 0: none."
    ),
]


def compare_command(
    context: typer.Context,
    models: options.Models = "fixed,rolling",
    engines: options.Engines = None,
    preset: options.Preset = "tuned,stock",
    timestep: options.Timestep = None,
    duration: options.Duration = None,
    until: options.Until = None,
    tolerance: options.Tolerance = None,
    tolerances: options.Tolerances = None,
    assignments: options.Set = None,
    beam: options.Beam = None,
    option: options.EngineOption = None,
    stop_law: options.StopLaw = None,
    resume: options.Resume = False,
    jobs: options.Jobs = 1,
    timeout: options.Timeout = 600.0,
    quiet: options.Quiet = False,
    json: options.Json = False,
    out: Annotated[
        Path, options.out("Folder for report, summary.md, results.json and trajectories.")
    ] = Path("report"),
) -> None:
    """Run engines on machines, measure them against the reference and each other, and write the report.

    Writes report.html (self-contained), summary.md (for a pull request), results.json and one
    NetCDF file a run. Ends with exit code 1 if a run disagrees, is not equivalent or failed, or if
    nothing was judged.

    Examples:
    trebucheck compare --out report

    trebucheck compare --models fixed --engines mujoco,pymunk --preset tuned --timestep 1e-3 --set
    l1=9.5
    """
    from ..comparisons.compare.study import compare
    from ..comparisons.runs.store import Store
    from ..models.files import refuse_unwritable

    machines = options.given(models, assignments, beam)
    presets, chosen = options.names(preset, "--preset"), options.chosen_names(engines, "--engines")
    refuse_unwritable(out)
    own = options.engine_options(option, timestep, chosen)
    store = Store(out / "trajectories", resume, out / "runs")
    with output.progress(width=28, told=output.Told(quiet, json)) as show:
        comparison = compare(
            machines,
            chosen,
            presets,
            duration=duration,
            until=until,
            tolerances=options.needs(tolerance, tolerances),
            stop_law=stop_law,
            timeout=timeout,
            jobs=jobs,
            store=store,
            progress=lambda case, done, of: show(f"{case.model}: {case.label}", done, of),
            **own,
        )
    results = comparison.results.made_by(output.command_line(context), store.most_jobs(jobs))
    _publish(replace(comparison, results=results), out, store, output.Told(quiet, json))
    if not comparison.passed:
        raise typer.Exit(1)


def _publish(comparison: Comparison, out: Path, store: Store, told: output.Told) -> None:
    """Data, page and summary of a comparison."""
    from ..comparisons.report import markdown
    from ..comparisons.report.pages.compare import document, summary

    output.publish(
        (out / "results.json", comparison.results.to_json()),
        document(comparison),
        out / "report.html",
        store=store,
        current=comparison.repeated,
        told=told,
        beside={
            "Summary": (out / "summary.md", markdown.text(summary(comparison.results), signs=True))
        },
    )


def converge_command(
    context: typer.Context,
    models: options.Models = "fixed,rolling",
    engines: options.Engines = None,
    knobs: Annotated[
        str | None,
        typer.Option(
            "--knobs",
            "--knob",
            help="Knobs, comma-separated, e.g. timestep,solref; all by default.",
        ),
    ] = None,
    until: options.Until = None,
    assignments: options.Set = None,
    beam: options.Beam = None,
    option: options.EngineOption = None,
    resume: options.Resume = False,
    jobs: options.Jobs = 1,
    timeout: options.Timeout = 600.0,
    quiet: options.Quiet = False,
    json: options.Json = False,
    out: Annotated[
        Path, options.out("Folder for converge.html, converge.json and the runs.")
    ] = Path("converge"),
) -> None:
    """Turn each engine's knobs and see how its error falls: orders, floors and their causes, Richardson limits.

    Writes converge.html (self-contained) and converge.json; prints orders and laws. A run that
    fails is a failed point of its study; a machine whose reference fails is left out with its
    reason, and the exit code is 1.

    Examples:
    trebucheck converge --out converge

    trebucheck converge --models rolling --engines mujoco --knobs timestep,solref --set l1=9.5

    trebucheck converge --engines mujoco --knobs timestep --option mujoco.integrator=implicit

    trebucheck converge --models pendulum.json --until 5
    """
    from ..comparisons.converge.study import converge_study
    from ..comparisons.report.pages.converge import document

    machines = options.given(models, assignments, beam)
    chosen = options.chosen_names(knobs, "--knobs")
    own = options.engine_options(option, None, options.chosen_names(engines, "--engines"))
    study = options.study(machines, engines, out, resume, timeout, jobs, options=own, until=until)
    told = output.Told(quiet, json)
    with output.progress(told=told) as show:
        studies = converge_study(replace(study, progress=show), chosen)
    studies = studies.made_by(output.command_line(context))
    output.publish(
        (out / "converge.json", studies.to_json()),
        document(studies),
        out / "converge.html",
        store=study.store,
        told=told,
    )
    if studies.failures:
        raise typer.Exit(1)


def explain_command(
    context: typer.Context,
    models: options.Models = "fixed,rolling",
    engines: options.Engines = None,
    preset: options.Preset = "tuned,stock",
    timestep: options.Timestep = None,
    until: options.Until = None,
    assignments: options.Set = None,
    beam: options.Beam = None,
    option: options.EngineOption = None,
    resume: options.Resume = False,
    jobs: options.Jobs = 1,
    timeout: options.Timeout = 600.0,
    quiet: options.Quiet = False,
    json: options.Json = False,
    out: Annotated[Path, options.out("Folder for explain.html, explain.json and the runs.")] = Path(
        "explain"
    ),
) -> None:
    """Split each engine's error among its causes, each measured by a run without it.

    Also sets each engine's stock and tuned presets side by side and changes one option at a time.
    Writes explain.html (self-contained) and explain.json; prints a summary. A run that fails is
    shown as such and ends nothing; if it is a machine's reference, the exit code is 1.

    Examples:
    trebucheck explain --models fixed --engines mujoco

    trebucheck explain --preset tuned --timestep 5e-4 --set l1=9.5 --out why
    """
    from ..comparisons.explain.study import explain_study
    from ..comparisons.report.pages.explain import document

    machines = options.given(models, assignments, beam)
    own = options.engine_options(option, timestep, options.chosen_names(engines, "--engines"))
    presets = options.names(preset, "--preset")
    study = options.study(
        machines, engines, out, resume, timeout, jobs, presets=presets, options=own, until=until
    )
    told = output.Told(quiet, json)
    with output.progress(width=44, told=told) as show:
        explanation = explain_study(replace(study, progress=show))
    explanation = explanation.made_by(output.command_line(context))
    data = out / "explain.json", explanation.to_json()
    output.publish(
        data, document(explanation), out / "explain.html", "Page", store=study.store, told=told
    )
    if explanation.failures:
        raise typer.Exit(1)


def recommend_command(
    context: typer.Context,
    model: options.Model = "fixed",
    position: Position = None,
    torque: Torque = None,
    release: Release = None,
    engines: options.Engines = None,
    until: options.Until = None,
    assignments: options.Set = None,
    beam: options.Beam = None,
    neighbours: Neighbours = _NEIGHBOURS,
    resume: Annotated[
        bool, typer.Option("--resume", help="Take finished trials from the folder again.")
    ] = False,
    jobs: options.Jobs = 1,
    timeout: options.Timeout = 600.0,
    quiet: options.Quiet = False,
    json: options.Json = False,
    out: Annotated[
        Path, options.out("Folder for recommend.html, recommend.json, the texts and the trials.")
    ] = Path("recommend"),
) -> None:
    """Find, for each engine, the cheapest measured settings that reach an accuracy, up to the launch or to --until.

    Writes recommend.html (self-contained), recommend.json, and beside them the texts to paste into
    the MJCF, the pymunk or the Exudyn script; says what stands in the way where there are no such
    settings. At least one of --position, --torque and --release must be given. Settings must reach
    it on the machine and on the worst of its neighbours, whose lengths, masses and start angles
    differ.

    Examples:
    trebucheck recommend --model rolling --position 1e-3 --torque 0.01%

    trebucheck recommend --model fixed --set l1=9.5 --engines mujoco --position 1e-6 --release 1e-8

    trebucheck recommend --model pendulum.json --position 1e-4 --until 5
    """
    from ..comparisons.recommend import Asked
    from ..comparisons.recommend.search import read_torque
    from ..comparisons.recommend.study import recommend_study
    from ..comparisons.report.pages.recommend import document, files
    from ..models.files import write_text

    if position is None and torque is None and release is None:
        raise InputError(
            "nothing is asked; give at least one of --position, --torque and --release."
        )
    target = Asked(
        position=position, release=release, **(read_torque(torque) if torque is not None else {})
    )
    chosen = options.parameters(assignments, beam)
    mechanism, own = (
        options.machine(model, assignments, beam, "recommend"),
        model.strip().endswith(".json"),
    )
    parameters = None if own else chosen.of(model.strip())
    study = options.study(
        [mechanism if own else model.strip()],
        engines,
        out,
        resume,
        timeout,
        jobs,
        parameters=parameters,
        until=until,
    )
    told = output.Told(quiet, json)
    with output.progress("references", 30, told) as show:
        advice = recommend_study(replace(study, progress=show), target, neighbours)
    advice = advice.made_by(output.command_line(context))
    for name, text in files(advice).items():
        write_text(out / name, text)
    data = out / "recommend.json", advice.to_json()
    output.publish(
        data, document(advice), out / "recommend.html", "Page", store=study.store, told=told
    )
