"""`trebucheck certify`: how far the reference is known."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from . import options

if TYPE_CHECKING:
    from ..models.machines.parameters import TrebuchetParameters
    from ..models.mechanism import Mechanism
    from ..reference.certification.certificate import Certificate


def certify_command(
    models: options.Models = "fixed,rolling",
    assignments: options.Set = None,
    beam: options.Beam = None,
    out: Annotated[Path, typer.Option("--out", help="Folder for one JSON file a machine.")] = Path("certificates"),
) -> None:
    """Compute each machine's figures in every independent way there is; write values and uncertainties.

    Formulations: minimal and redundant coordinates, the paper's equations. Integrators: DOP853 over a ladder of
    tolerances, and Taylor series in double and extended precision where heyoka is installed.

    Examples:
    trebucheck certify --out certificates

    trebucheck certify --models fixed --set l1=9.5
    """
    from ..comparisons.compare.terminal import console
    from ..models.files import refuse_unwritable, write_text

    chosen = options.parameters(assignments, beam)
    machines = options.machines(models, chosen)
    refuse_unwritable(out)
    for name, mechanism in zip(options.names(models, "--models"), machines, strict=True):
        certificate = _with_progress(mechanism, chosen.whipper(name), _command(name, assignments, beam))
        write_text(out / f"{mechanism.name}.json", certificate.to_json() + "\n")
        print_certificate(certificate)
        console().print(f"Certificate: {out / f'{mechanism.name}.json'}\n", soft_wrap=True)


def _command(name: str, assignments: list[str] | None, beam: float | None) -> str:
    """What makes the same figures again."""
    words = ["trebucheck", "certify", "--models", name]
    for text in assignments or []:
        words += ["--set", text]
    return shlex.join([*words, "--beam", repr(beam)] if beam is not None else words)


def _with_progress(mechanism: Mechanism, parameters: TrebuchetParameters | None, command: str) -> Certificate:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from ..comparisons.compare.terminal import progress_console
    from ..reference.certification.certify import certify

    columns = (TextColumn("{task.description:<28}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    to = progress_console()
    with Progress(*columns, console=to, transient=True, disable=not to.is_terminal) as bar:
        task = bar.add_task("reference", total=None)

        def show(name: str, done: int, of: int) -> None:
            bar.update(task, description=f"{mechanism.name}: {name}", completed=done, total=of)

        return certify(mechanism, parameters, command=command, progress=show)


def print_certificate(certificate: Certificate) -> None:
    """One line a figure: value, uncertainty, unit."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    from ..comparisons.compare.terminal import console

    made = sum(computation.independent for computation in certificate.computations)
    title = f"{certificate.model}: {len(certificate.figures)} figures from {made} independent computations"
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("figure")
    table.add_column("value", justify="right", no_wrap=True)
    table.add_column("uncertainty", justify="right", no_wrap=True)
    table.add_column("unit")
    for figure in certificate.figures:
        table.add_row(figure.label, *figure.texts, figure.unit)
    console().print(table)
    for sentence in certificate.absent:
        console().print(f"[yellow]left out[/]: {sentence}", soft_wrap=True)
