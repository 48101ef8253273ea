"""`trebucheck throw`: one machine, all the figures a builder wants."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..models.errors import InputError
from . import options, output

if TYPE_CHECKING:
    from ..comparisons.runs.process import Worker
    from ..reference.throw.throw import Performance, Throw

ReleaseAngle = Annotated[
    float | None,
    typer.Option(
        "--release-angle",
        help="Let go at this angle of the velocity above level (deg); 45 if no other.",
    ),
]
ReleaseTime = Annotated[
    float | None, typer.Option("--release-time", help="Let go at this time (s).")
]
SlingAngle = Annotated[
    float | None,
    typer.Option("--sling-angle", help="Let go at this angle of the sling from the arm (deg)."),
]
Best = Annotated[bool, typer.Option("--best", help="Let go for the longest range.")]
Density = Annotated[
    float | None, typer.Option("--density", help="Of the air (kg/m^3); with --drag-area.")
]
DragArea = Annotated[
    float | None,
    typer.Option(
        "--drag-area", help="Drag coefficient times area (m^2); with --density or --body."
    ),
]
Body = Annotated[
    str | None,
    typer.Option(
        "--body", help="moon, mars, earth or venus: gravity and air of the paper's Table II."
    ),
]
Height = Annotated[
    float, typer.Option("--height", help="Of the landing above the fulcrum or wheel (m).")
]
WithSensitivities = Annotated[
    bool,
    typer.Option(
        "--sensitivities",
        help="Also differentiate time, speed, angle and range by every number of the machine.",
    ),
]
Out = Annotated[Path, options.out("Folder for throw.html and throw.json.")]


def throw_command(
    model: options.Model = "fixed",
    assignments: options.Set = None,
    beam: options.Beam = None,
    release_angle: ReleaseAngle = None,
    release_time: ReleaseTime = None,
    sling_angle: SlingAngle = None,
    best: Best = False,
    density: Density = None,
    drag_area: DragArea = None,
    body: Body = None,
    height: Height = 0.0,
    sensitivities: WithSensitivities = False,
    timeout: options.Timeout = 600.0,
    quiet: options.Quiet = False,
    json: options.Json = False,
    out: Out = Path("report"),
) -> None:
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
    from ..comparisons.runs.process import Worker
    from ..models.files import refuse_unwritable
    from ..reference.throw.throw import perform

    chosen = options.parameters(assignments, beam)
    mechanism = options.machine(model, assignments, beam, "throw")
    if body is not None and "g" in options.assignments(assignments, "--set"):
        raise InputError(f"--body {body} brings its own gravity; leave out --set g, or --body.")
    refuse_unwritable(out)
    release = {
        "release_angle": None if release_angle is None else math.radians(release_angle),
        "release_time": release_time,
        "sling_angle": None if sling_angle is None else math.radians(sling_angle),
    }
    more = {
        "best": best,
        "density": density,
        "drag_area": drag_area,
        "body": body,
        "height": height,
    }
    with Worker(options.positive(timeout, "--timeout")) as worker:
        performance = worker.compute(partial(perform, mechanism, release, **more))
        throw = performance.throw
        if sensitivities:
            throw = _with_sensitivities(performance, model.strip(), chosen, worker)
    data = out / "throw.json", throw.to_json()
    output.publish(
        data,
        document(performance, throw),
        out / "throw.html",
        "Page",
        told=output.Told(quiet, json),
    )


def _with_sensitivities(
    performance: Performance, model: str, chosen: options.Chosen, worker: Worker
) -> Throw:
    """Of the two whippers by Table I's parameters, of others by their physical numbers."""
    from ..models.library.trebuchet import TrebuchetParameters
    from ..reference.sensitivity.release import sensitivities_of

    throw = performance.throw
    whipper = model if model in ("fixed", "rolling") else None
    parameters = (whipper and chosen.whipper(whipper)) or TrebuchetParameters()
    parameters = parameters.model_copy(update={"g": throw.gravity})
    found, sentences = worker.compute(partial(sensitivities_of, performance, whipper, parameters))
    return throw.model_copy(
        update={"sensitivities": found, "warnings": (*throw.warnings, *sentences)}
    )
