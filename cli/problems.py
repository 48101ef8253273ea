"""`trebucheck problems`: the problem library."""

from __future__ import annotations

from functools import partial
from typing import Annotated

import typer

from ..models.errors import InputError
from . import completion, options, output

_Name = Annotated[
    str | None,
    typer.Argument(
        autocompletion=completion.problems,
        help="Name or number of one problem, to see its figures.",
    ),
]


def problems_command(
    name: _Name = None,
    tag: Annotated[
        str | None, typer.Option("--tag", help="List only problems with this tag, e.g. loop.")
    ] = None,
    assignments: options.Set = None,
    timeout: options.Timeout = 600.0,
) -> None:
    """List the benchmark problems, or show one: its source, its figures beside the reference's, and its conditions.

    A problem's name stands wherever a machine's does; it brings its own duration and stop law. Of
    one problem, the exit code is 1 if the reference misses a figure or a condition.

    Examples:
    trebucheck problems --tag loop

    trebucheck problems pendulum --set length=2

    trebucheck compare --model slider-crank
    """
    from ..comparisons.problems.study import check
    from ..comparisons.report.pages.problems import document, listing
    from ..comparisons.runs.process import Worker
    from ..models.library.registry import benchmark, benchmarks

    if name is None:
        if assignments:
            raise InputError(
                "--set is for one problem; name it, e.g. trebucheck problems pendulum --set length=2."
            )
        output.show(listing(benchmarks(tag)))
        return
    if tag is not None:
        raise InputError(f"--tag {tag} selects from the list; leave it out, or the name {name}.")
    chosen = benchmark(name)
    parameters = options.parameters(assignments, None).of(chosen.name)
    with Worker(options.positive(timeout, "--timeout"), isolate=False) as worker:
        checked = worker.compute(partial(check, chosen, parameters))
    output.show(document(checked))
    if not checked.holds:
        raise typer.Exit(1)
