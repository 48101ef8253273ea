"""Controls of actuators that were recorded over time, in memory and in files."""

from __future__ import annotations

import csv
import io
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Self

import numpy as np

from .arrays import FloatArray, IndexArray
from .errors import InputError
from .files import read_bytes, write_bytes

_LARGEST = 200_000_000  # [B] of a file
SUFFIXES = (".csv", ".npz")
"""Endings of the names of files that hold controls."""
_TIME = "t"


def fault_of_times(times: Sequence[float]) -> str | None:
    """Tell why values cannot be held from each of these times to the next; None: they can."""
    if times[0] != 0.0:
        return f"times begin at {times[0]!r} s, not at 0, from which the first values act"
    for before, after in pairwise(times):
        if not before < after:
            return f"times must ascend; {after!r} s follows {before!r} s"
    return None


@dataclass(frozen=True, eq=False)
class ControlRecord:
    """Controls, each held from its time to the next one (a zero-order hold).

    Raises:
        InputError: times do not ascend from 0, values are not finite or not of their shape, or
            names are not one for each actuator.
    """

    times: FloatArray
    """Shape (m,) [s], ascending from 0."""
    values: FloatArray
    """Shape (m, n_actuators), in the actuators' units."""
    names: tuple[str, ...] = ()
    """Names of the actuators, in the order of the columns; none: as in the model."""
    source: str = "the record of controls"
    """Words with which the sentence of an error begins."""

    def __post_init__(self) -> None:
        for name in ("times", "values"):
            given: Any = getattr(self, name)
            try:
                object.__setattr__(self, name, np.asarray(given, dtype=np.float64))
            except (TypeError, ValueError):
                raise InputError(f"{self.source}: {name} are no numbers.") from None
        times, values = self.times, self.values
        if times.ndim != 1 or values.ndim != 2 or len(times) != len(values) or not len(times):
            raise InputError(
                f"{self.source}: times of shape {times.shape} and values of shape {values.shape}; "
                "needed are (m,) and (m, number of actuators)."
            )
        for name, array in (("times", times), ("values", values)):
            if not np.isfinite(array).all():
                row = int(np.argmin(np.isfinite(array.reshape(len(array), -1)).all(axis=1)))
                raise InputError(f"{self.source}: {name}[{row}] = {array[row]} must be finite.")
        if (fault := fault_of_times(times.tolist())) is not None:
            raise InputError(f"{self.source}: {fault}.")
        if self.names and len(self.names) != values.shape[1]:
            raise InputError(
                f"{self.source}: {len(self.names)} names for {values.shape[1]} columns."
            )

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Read a file.

        A CSV has a line of names, `t` and those of the actuators, and a line of numbers for each
        time. An NPZ has the arrays `t`, of shape (m,), and `ctrl`, of shape (m, number of
        actuators), in the order of the model's actuators.

        Raises:
            InputError: the file cannot be read or is none of these; the sentence names it.
        """
        path = Path(path)
        suffix = path.suffix.lower()
        if suffix not in SUFFIXES:
            raise InputError(f"{path}: controls are read from {' and '.join(SUFFIXES)} files.")
        content = read_bytes(path, _LARGEST)
        return cls._of_csv(content, path) if suffix == ".csv" else cls._of_npz(content, path)

    @classmethod
    def _of_csv(cls, content: bytes, path: Path) -> Self:
        try:
            lines = [line for line in csv.reader(io.StringIO(content.decode("utf-8-sig"))) if line]
        except (UnicodeDecodeError, csv.Error) as error:
            raise InputError(f"{path} is no CSV: {error}.") from None
        names = [name.strip() for name in lines[0]] if lines else []
        if names[:1] != [_TIME] or len(names) < 2:
            raise InputError(
                f"{path}: the first line must be {_TIME} and the names of the actuators; it is "
                f"{','.join(names)[:60]!r}."
            )
        rows = list[list[float]]()
        for number, line in enumerate(lines[1:], start=2):
            if len(line) != len(names):
                raise InputError(f"{path}, row {number}: {len(line)} values for {len(names)}.")
            try:
                rows.append([float(value) for value in line])
            except ValueError as error:
                raise InputError(f"{path}, row {number}: {error}.") from None
        table = np.array(rows, dtype=np.float64).reshape(-1, len(names))
        return cls(table[:, 0], table[:, 1:], tuple(names[1:]), str(path))

    @classmethod
    def _of_npz(cls, content: bytes, path: Path) -> Self:
        try:
            with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
                found = {name: arrays[name] for name in arrays.files}
        except (ValueError, OSError, EOFError, zipfile.BadZipFile) as error:
            raise InputError(f"{path} is no NPZ: {error}.") from None
        missing = [name for name in (_TIME, "ctrl") if name not in found]
        if missing:
            raise InputError(
                f"{path} has no array {missing[0]!r}; it has {', '.join(found) or 'none'}."
            )
        return cls(found[_TIME], found["ctrl"], source=str(path))

    def save(self, path: str | Path) -> None:
        """Write an NPZ that :meth:`read` reads; raises UnwritableError as `files.write_bytes`."""
        content = io.BytesIO()
        np.savez(content, t=self.times, ctrl=self.values)
        write_bytes(path, content.getvalue())

    def rows(self, t: FloatArray) -> IndexArray:
        """Index of the controls that act at times from 0 on [s], shape (n,)."""
        return np.searchsorted(self.times, t, side="right") - 1
