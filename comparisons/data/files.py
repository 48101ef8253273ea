"""The published files: what there is, their checksums, and how they are made."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path
from typing import Literal

from ...models.errors import InputError
from ...models.files import write_text
from ...models.machines.registry import library_problem, model, models
from ...models.problems.registry import benchmarks
from ...models.trajectory import write_dataset
from .certified import certified_dataset

CHECKSUMS = "SHA256SUMS"
State = Literal["good", "changed", "missing"]


def names() -> tuple[str, ...]:
    """Of all machines and problems."""
    return (*models(), *(entry.name for entry in benchmarks()))


def published() -> dict[str, str]:
    """SHA-256 of each published file by the name of its machine or problem, as `sha256sum` writes them."""
    source = files(__package__ or "") / "trajectories" / CHECKSUMS
    lines = source.read_text().splitlines() if source.is_file() else []
    pairs = (line.split() for line in lines)
    return {file.removesuffix(".nc"): digest for digest, file in pairs}


def content(name: str) -> bytes:
    """A published file.

    Raises:
        InputError: there is none of that name, or it is not as it was published.
    """
    known = published()
    if name not in known:
        raise InputError(
            f"there is no published trajectory {name!r}; there are: {', '.join(known)}."
        )
    data = _read(name)
    if data is None or hashlib.sha256(data).hexdigest() != known[name]:
        state = "missing" if data is None else "changed"
        raise InputError(
            f"the published trajectory of {name!r} is {state}: it does not have its checksum."
        )
    return data


def states() -> Iterator[tuple[str, str, int, State]]:
    """Of each published file the name, the SHA-256, the size [B], and whether it is as it was published."""
    for name, digest in published().items():
        data = _read(name)
        if data is None:
            yield name, digest, 0, "missing"
        else:
            yield (
                name,
                digest,
                len(data),
                "good" if hashlib.sha256(data).hexdigest() == digest else "changed",
            )


def _read(name: str) -> bytes | None:
    file = files(__package__ or "") / "trajectories" / f"{name}.nc"
    return file.read_bytes() if file.is_file() else None


def publish(name: str, folder: Path) -> None:
    """Compute a machine's or problem's file anew, and its line in the list of checksums.

    Raises:
        SimulationError: the reference cannot move it.
    """
    path = folder / f"{name}.nc"
    write_dataset(certified_dataset(library_problem(name) or model(name)), path, compressed=True)
    present = (each for each in names() if (folder / f"{each}.nc").is_file())
    lines = (
        f"{hashlib.sha256((folder / f'{n}.nc').read_bytes()).hexdigest()}  {n}.nc" for n in present
    )
    write_text(folder / CHECKSUMS, "\n".join(lines) + "\n")
