"""`trebucheck data`: certified trajectories, to be used without anything of ours."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from ..models.errors import InputError
from . import completion, options, output

_Name = Annotated[
    str | None,
    typer.Argument(
        autocompletion=completion.machines,
        help=f"{options.MACHINES}; all are listed where left out.",
    ),
]


def data_command(
    name: _Name = None,
    assignments: options.Set = None,
    check: Annotated[
        bool, typer.Option("--check", help="Verify the checksums of all published files.")
    ] = False,
    timeout: options.Timeout = 600.0,
    out: Annotated[Path | None, options.out("NetCDF file to write; NAME.nc by default.")] = None,
) -> None:
    """List the published certified trajectories, write one as NetCDF, or verify their checksums.

    Every value has its uncertainty beside it; releases, impacts, rests, the launch and the
    predictability horizon are in the file, too, which xarray.open_dataset reads. With --set, or of
    a mechanism of your own, it is computed now. --check ends with exit code 1 if a file is missing
    or changed.

    Examples:
    trebucheck data squeezer --out squeezer.nc

    trebucheck data pendulum --set length=2

    trebucheck data --check
    """
    if name is None or check:
        if name is not None or assignments or out is not None:
            raise InputError(
                "a name, --set and --out are for one trajectory; --check and the list are of all of them."
            )
        _list(check)
        return
    path = out or Path(f"{Path(name).stem}.nc")
    _write(name, assignments, path, timeout)
    typer.echo(f"Wrote {output.printable(str(path))}")


def _write(name: str, assignments: list[str] | None, path: Path, timeout: float) -> None:
    from ..comparisons.data.certified import certified_dataset, content, published
    from ..comparisons.runs.process import Worker
    from ..models.files import refuse_unwritable, write_bytes
    from ..models.problem import Problem
    from ..models.trajectory import write_dataset

    given = options.only(name, assignments, None, "data")
    refuse_unwritable(path.parent, path.name)
    own = given.mechanism.name if isinstance(given, Problem) else given.name
    if not assignments and not name.endswith(".json") and own in published():
        write_bytes(path, content(own))
        return
    with Worker(options.positive(timeout, "--timeout"), isolate=False) as worker:
        write_dataset(worker.compute(partial(certified_dataset, given)), path, compressed=True)


def _list(check: bool) -> None:
    from ..comparisons.data.certified import states
    from ..comparisons.report.document import Cell, Column, Document, ranked, table, words

    rows = [(name, f"{size / 1024:.0f}", digest, Cell(state, "good" if state == "good" else "bad"))
            for name, digest, size, state in states()]  # fmt: skip
    heads = [
        words("name", wrap=False),
        Column("size", "kB"),
        words("SHA-256", wrap=False),
        words("checksum"),
    ]
    output.show(Document("Published trajectories", (table(ranked(heads, checksum=0), rows),)))
    if check and any(state != "good" for *_, state in states()):
        raise typer.Exit(1)
