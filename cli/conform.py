"""`trebucheck conform`: the suite on one engine, without pytest."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from . import completion, options, output


def conform_command(
    context: typer.Context,
    engine: Annotated[
        str,
        typer.Argument(
            autocompletion=completion.engines,
            help="NAME, NAME/PRESET, or package.module:Class of an engine that is not installed.",
        ),
    ],
    tier: Annotated[
        str, typer.Option("--tier", help="How many problems: quick, standard or full.")
    ] = "standard",
    problem: Annotated[
        list[str] | None,
        typer.Option(
            "--problem",
            autocompletion=completion.machines,
            help="Only these problems, comma-separated; repeatable.",
        ),
    ] = None,
    deviations: Annotated[
        Path | None,
        typer.Option(
            "--deviations", help="TOML or JSON: known failures, with id, reason and owner."
        ),
    ] = None,
    timeout: Annotated[
        float, typer.Option("--timeout", help="Longest wait for one run (s).")
    ] = 120.0,
    quiet: options.Quiet = False,
    json: options.Json = False,
    out: Annotated[
        Path, options.out("Folder for certificate.html, badge.svg and conformance.json.")
    ] = Path("conformance"),
) -> None:
    """Say what an engine keeps of what it declares, what is missing, and what to do next; write a certificate.

    Exit codes: 0 everything that was judged is kept, 1 something is broken or could not be judged,
    or nothing was judged (an engine that is not installed), 2 wrong input.

    Examples:
    trebucheck conform mujoco --problem catapult

    trebucheck conform my_package:MyEngine --tier quick
    """
    from ..conformance.certificate import badge, certificate
    from ..conformance.session import Session
    from ..models.files import refuse_unwritable

    given = {"tier": tier, "problem": problem or [], "timeout": timeout, "json": None}
    session = Session.of([engine], {**given, "deviations": deviations}, Path.cwd())
    refuse_unwritable(out)
    told = output.Told(quiet, json)
    try:
        with output.progress("reference", told=told) as progress:
            for done, id in enumerate(session.ids):
                progress(id.rpartition("/")[0], done, len(session.ids))
                session.judged(id)
    finally:
        session.close()
    results = session.results.made_by(output.command_line(context))
    beside = {"Badge": (out / "badge.svg", badge(results))}
    data = (out / "conformance.json", results.to_json())
    output.publish(
        data,
        certificate(results),
        out / "certificate.html",
        "Certificate",
        beside=beside,
        told=told,
    )
    if not results.passed:
        raise typer.Exit(1)
