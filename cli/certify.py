"""`trebucheck certify`: how far the reference is known."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypedDict

import typer

from . import options, output

if TYPE_CHECKING:
    from ..comparisons.runs.process import Worker
    from ..comparisons.runs.study import Progress
    from ..models.library.trebuchet import TrebuchetParameters
    from ..models.mechanism import Mechanism
    from ..models.problem import Problem, StopLaw
    from ..reference.certification.certificate import Certificate


def certify_command(
    models: options.Models = "fixed,rolling",
    assignments: options.Set = None,
    beam: options.Beam = None,
    duration: options.Duration = None,
    timeout: options.Timeout = 600.0,
    quiet: options.Quiet = False,
    json: Annotated[
        bool,
        typer.Option("--json", help="Print the certificates as a JSON array, and nothing else."),
    ] = False,
    out: Annotated[Path, options.out("Folder for one JSON file and one page a machine.")] = Path(
        "certificates"
    ),
) -> None:
    """Compute each machine's figures in every independent way there is; write values and uncertainties.

    Formulations: minimal and redundant coordinates, the paper's equations. Integrators: DOP853 over
    a ladder of tolerances, and Taylor series in double and extended precision where heyoka is
    installed. Motions go to the launch, or as long as a problem of the library asks for. Ends with
    exit code 1 if a machine's motion could not be computed.

    Examples:
    trebucheck certify --out certificates

    trebucheck certify --models fixed --set l1=9.5

    trebucheck certify --models squeezer
    """
    from ..comparisons.runs.process import Worker
    from ..models.errors import SimulationError
    from ..models.files import refuse_unwritable

    chosen = options.parameters(assignments, beam)
    machines = options.given(models, assignments, beam)
    if duration is not None:
        options.positive(duration, "--duration")
    refuse_unwritable(out)
    failed = False
    told = output.Told(quiet, json)
    certificates: list[str] = []
    with Worker(options.positive(timeout, "--timeout")) as worker:
        for name, machine in zip(options.names(models, "--models"), machines, strict=True):
            command = _command(name, assignments, beam, duration)
            mechanism, asked = _asked(machine, duration)
            try:
                made = _certified(mechanism, chosen.whipper(name), asked, command, worker, told)
                certificates.append(made.to_json())
                _publish(made, out / f"{mechanism.name}.json", told)
            except SimulationError as error:  # the others must not be lost with it
                failed = True
                print(f"error: {mechanism.name}: {error}", file=sys.stderr)
    if json:
        typer.echo(f"[{','.join(certificates)}]")
    if failed:
        raise typer.Exit(1)


class _Asked(TypedDict, total=False):
    duration: float | None
    stop_law: StopLaw


def _asked(machine: Mechanism | Problem, duration: float | None) -> tuple[Mechanism, _Asked]:
    """The mechanism, and how long and under which law of its stops it is to move."""
    from ..models.problem import Problem

    if isinstance(machine, Problem):
        return machine.mechanism, {
            "duration": duration or machine.duration,
            "stop_law": machine.stop_law,
        }
    return machine, {"duration": duration}


def _certified(
    mechanism: Mechanism,
    parameters: TrebuchetParameters | None,
    asked: _Asked,
    command: str,
    worker: Worker,
    told: output.Told,
) -> Certificate:
    from ..reference.certification.certify import certify

    with output.progress(width=28, told=told) as show:
        named = _named(mechanism, show)
        return certify(
            mechanism, parameters, command=command, progress=named, call=worker.compute, **asked
        )


def _publish(certificate: Certificate, path: Path, told: output.Told) -> None:
    """One machine's certificate, written and, unless all are printed as data at the end, shown."""
    from ..comparisons.report import html
    from ..comparisons.report.pages.run import certificate_report
    from ..models.files import write_text

    write_text(path, certificate.to_json() + "\n")
    report, page = certificate_report(certificate), path.with_suffix(".html")
    write_text(page, html.page(report))
    if not told.json:
        output.show(report, told, Certificate=path, Page=page)


def _command(
    name: str, assignments: list[str] | None, beam: float | None, duration: float | None
) -> str:
    """What makes the same figures again."""
    words = ["trebucheck", "certify", "--models", name]
    for text in assignments or []:
        words += ["--set", text]
    for option, value in (("--beam", beam), ("--duration", duration)):
        words += [option, repr(value)] if value is not None else []
    return shlex.join(words)


def _named(mechanism: Mechanism, show: Progress) -> Progress:
    return lambda what, done, of: show(f"{mechanism.name}: {what}", done, of)
