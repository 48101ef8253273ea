"""`trebucheck recommend`: which settings reach a wanted accuracy."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from . import options

if TYPE_CHECKING:
    from ..comparisons.recommend import Advice, Asked
    from ..models.mechanism import Mechanism

_NEIGHBOURS = 32

Position = Annotated[
    float | None, typer.Option("--position", help="Largest distance of the projectile from the reference (m).")
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
    engines: options.Engines = "",
    assignments: options.Set = None,
    beam: options.Beam = None,
    neighbours: Neighbours = _NEIGHBOURS,
    resume: Annotated[bool, typer.Option("--resume", help="Take finished trials from the folder again.")] = False,
    timeout: Annotated[float, typer.Option("--timeout", help="Longest wait for one run (s).")] = 600.0,
    out: Annotated[Path, typer.Option("--out", help="Folder for recommend.json and the trials.")] = Path("recommend"),
) -> None:
    """Find, for each engine, the cheapest measured settings that reach an accuracy, up to the launch.

    Prints them with the texts to paste into the MJCF, the pymunk or the Exudyn script, or says what stands in the
    way; writes recommend.json. At least one of --position, --torque and --release must be given. Settings must
    reach it on the machine and on the worst of its neighbours, whose lengths, masses and start angles differ.

    Examples:
    trebucheck recommend --model rolling --position 1e-3 --torque 0.01%

    trebucheck recommend --model fixed --set l1=9.5 --engines mujoco --position 1e-6 --release 1e-8
    """
    from ..comparisons.recommend import Asked
    from ..comparisons.recommend.target import read_torque
    from ..comparisons.recommend.terminal import print_advice
    from ..comparisons.report.terminal import console
    from ..models.errors import InputError
    from ..models.files import refuse_unwritable, write_text

    if position is None and torque is None and release is None:
        raise InputError("nothing is asked; give at least one of --position, --torque and --release.")
    asked = Asked(position=position, release=release, **(read_torque(torque) if torque is not None else {}))
    choice = options.parameters(assignments, beam)
    machines = options.machines(model, choice)
    if len(machines) != 1:
        raise InputError(f"--model {model!r} names {len(machines)} machines; `recommend` takes one.")
    chosen = options.names(engines, "--engines") if engines else None
    refuse_unwritable(out)
    own = model.strip().endswith(".json")
    advice = _with_progress(
        machines[0] if own else model.strip(),
        asked,
        engines=chosen,
        parameters=None if own else choice.of(model.strip()),
        neighbours=neighbours,
        folder=out / "trials",
        resume=resume,
        timeout=timeout,
    )
    write_text(out / "recommend.json", advice.to_json())
    print_advice(advice, console())
    console().print(f"\nData: {out / 'recommend.json'}", soft_wrap=True)


def _with_progress(model: str | Mechanism, asked: Asked, **how: Any) -> Advice:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from ..comparisons.recommend import recommend
    from ..comparisons.report.terminal import progress_console

    columns = (TextColumn("{task.description:<30}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    to = progress_console()
    with Progress(*columns, console=to, transient=True, disable=not to.is_terminal) as bar:
        task = bar.add_task("references", total=None)

        def show(what: str, done: int, of: int) -> None:
            bar.update(task, description=what, completed=done, total=of)

        return recommend(model, asked, progress=show, **how)
