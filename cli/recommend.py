"""`trebucheck recommend`: which settings reach a wanted accuracy."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from ..models.errors import InputError
from . import options, output

_NEIGHBOURS = 32

Position = Annotated[
    float | None, typer.Option("--position", help="Largest distance of any marker from the reference (m).")
]
Torque = Annotated[
    str | None,
    typer.Option(
        "--torque", help="Largest error of any stop's torque: N m (N on points), or a share of the largest: 0.1%."
    ),
]
Release = Annotated[float | None, typer.Option("--release", help="Largest error of any stop's release (s).")]
Neighbours = Annotated[
    int, typer.Option("--neighbours", help="Machines of the same kind the settings are to hold on, too; 0: none.")
]


def recommend_command(
    model: options.Model = "fixed",
    position: Position = None,
    torque: Torque = None,
    release: Release = None,
    engines: options.Engines = None,
    until: options.Until = None,
    assignments: options.Set = None,
    beam: options.Beam = None,
    neighbours: Neighbours = _NEIGHBOURS,
    resume: Annotated[bool, typer.Option("--resume", help="Take finished trials from the folder again.")] = False,
    timeout: options.Timeout = 600.0,
    out: Annotated[Path, options.out("Folder for recommend.json and the trials.")] = Path("recommend"),
) -> None:
    """Find, for each engine, the cheapest measured settings that reach an accuracy, up to the launch or to --until.

    Prints them with the texts to paste into the MJCF, the pymunk or the Exudyn script, or says what stands in the
    way; writes recommend.json. At least one of --position, --torque and --release must be given. Settings must
    reach it on the machine and on the worst of its neighbours, whose lengths, masses and start angles differ.

    Examples:
    trebucheck recommend --model rolling --position 1e-3 --torque 0.01%

    trebucheck recommend --model fixed --set l1=9.5 --engines mujoco --position 1e-6 --release 1e-8

    trebucheck recommend --model pendulum.json --position 1e-4 --until 5
    """
    from ..comparisons.recommend import Asked, recommend
    from ..comparisons.recommend.cases import read_torque
    from ..comparisons.recommend.report import document

    if position is None and torque is None and release is None:
        raise InputError("nothing is asked; give at least one of --position, --torque and --release.")
    target = Asked(position=position, release=release, **(read_torque(torque) if torque is not None else {}))
    chosen = options.parameters(assignments, beam)
    mechanism, own = options.machine(model, assignments, beam, "recommend"), model.strip().endswith(".json")
    parameters = None if own else chosen.of(model.strip())
    study = options.study(
        [mechanism if own else model.strip()], engines, out, resume, timeout, parameters=parameters, until=until
    )
    with output.progress("references", 30) as show:
        advice = recommend(replace(study, progress=show), target, neighbours)
    output.publish((out / "recommend.json", advice.to_json()), document(advice), store=study.store)
