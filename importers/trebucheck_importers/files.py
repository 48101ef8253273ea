"""Stored data of the zoo's models and of the machines, and how the zoo's are computed."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

from trebucheck.api.mechanics import InputError, models, write_dataset, write_text
from trebucheck.api.studies import certified_dataset, content

from .expected import Expected, read_dataset, with_joint_values
from .zoo.machines import machine_model
from .zoo.model import ZooModel, zoo_file
from .zoo.registry import zoo, zoo_model

CHECKSUMS = "SHA256SUMS"


def names() -> tuple[str, ...]:
    """Names of the zoo's models and the machines."""
    return (*(each.name for each in zoo()), *models())


def model(name: str) -> ZooModel:
    """A model of the zoo, or a machine.

    Raises:
        InputError: there is none of that name.
    """
    return machine_model(name) if name in models() else zoo_model(name)


@cache
def expected(name: str) -> Expected:
    """Expected results of importing a model, or a file of one's own by its path.

    Raises:
        InputError: there is none of that name, or its data are not as they were stored.
        TrebucheckError: no mechanism can be read from the file.
    """
    if Path(name).suffix in (".xml", ".urdf"):
        from .own_file import expected_of_file  # loads MuJoCo, which the zoo does not need

        return expected_of_file(name)
    chosen = model(name)
    if name in models():
        return Expected.of(chosen, with_joint_values(chosen, read_dataset(content(name))))
    return Expected.of(chosen, read_dataset(_stored(name)))


def checksums() -> dict[str, str]:
    """SHA-256 by file name, of every file of the zoo."""
    lines = zoo_file(CHECKSUMS).decode().splitlines()
    return {name: digest for digest, name in (line.split() for line in lines)}


def _stored(name: str) -> bytes:
    data = zoo_file(f"{name}.nc")
    if hashlib.sha256(data).hexdigest() != checksums().get(f"{name}.nc"):
        raise InputError(f"the data of the model {name!r} do not have their checksum.")
    return data


def publish(folder: Path, *names: str) -> None:
    """Recompute the data of models of the zoo (all by default) and the list of checksums.

    Raises:
        SimulationError: the reference cannot move one.
    """
    for each in (each for each in zoo() if not names or each.name in names):
        data = with_joint_values(each, certified_dataset(each.problem))
        data.attrs["title"] = f"Certified trajectory of the model {each.name!r}: {each.feature}"
        write_dataset(data, folder / f"{each.name}.nc", compressed=True)
    files = sorted(path for path in folder.iterdir() if path.suffix in (".xml", ".nc"))
    lines = (f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n" for path in files)
    write_text(folder / CHECKSUMS, "".join(lines))
