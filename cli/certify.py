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
    from ..comparisons.report import terminal
    from ..comparisons.report.certificate import document
    from ..models.files import refuse_unwritable, write_text

    chosen = options.parameters(assignments, beam)
    machines = options.machines(models, chosen)
    refuse_unwritable(out)
    for name, mechanism in zip(options.names(models, "--models"), machines, strict=True):
        certificate = _with_progress(mechanism, chosen.whipper(name), _command(name, assignments, beam))
        write_text(out / f"{mechanism.name}.json", certificate.to_json() + "\n")
        terminal.show(document(certificate), terminal.console())
        terminal.console().print(f"Certificate: {out / f'{mechanism.name}.json'}\n", soft_wrap=True)


def _command(name: str, assignments: list[str] | None, beam: float | None) -> str:
    """What makes the same figures again."""
    words = ["trebucheck", "certify", "--models", name]
    for text in assignments or []:
        words += ["--set", text]
    return shlex.join([*words, "--beam", repr(beam)] if beam is not None else words)


def _with_progress(mechanism: Mechanism, parameters: TrebuchetParameters | None, command: str) -> Certificate:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from ..comparisons.report.terminal import progress_console
    from ..reference.certification.certify import certify

    columns = (TextColumn("{task.description:<28}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    to = progress_console()
    with Progress(*columns, console=to, transient=True, disable=not to.is_terminal) as bar:
        task = bar.add_task("reference", total=None)

        def show(name: str, done: int, of: int) -> None:
            bar.update(task, description=f"{mechanism.name}: {name}", completed=done, total=of)

        return certify(mechanism, parameters, command=command, progress=show)
