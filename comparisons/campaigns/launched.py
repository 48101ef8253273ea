"""Launches of a campaign's machines: thrown by the batch integrator, with their table.

A process that makes these imports what they need and no engine, nor pandas: a hundred thousand
machines are thrown in the time of a few imports.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import accumulate
from typing import Any

import numpy as np
import pyarrow as pa

from ...models.arrays import FloatArray, IndexArray
from ...models.errors import InputError, SimulationError, UnsupportedProblemError
from ...models.library.registry import Model, model, varied
from ...reference.taylor.batch import BatchLaunches, launch_batch
from ...reference.taylor.expressions import import_without_sympy
from .design import DesignPart
from .spec import Campaign, Launches
from .table import DIGITS, Chunk, as_parquet, schema_of, stop_names

ThrownPart = tuple[IndexArray, BatchLaunches]
"""Places of some machines of a chunk, (m,), and their launches."""


def prepare_process() -> None:
    """Import what machines are thrown with, in a process that does nothing else."""
    import_without_sympy()


def launch_rows(described: Campaign, machines: DesignPart) -> Chunk:
    """Throw some machines; a row for each, with a message where it cannot be built or thrown."""
    asked, given = described.launches, described.machines.model
    assert asked is not None
    assert given is not None
    messages: dict[int, str] = {}
    parts: list[ThrownPart] = []
    if len(machines):
        parts += _thrown(given, asked, machines.values, np.arange(len(machines)), messages)
    return Chunk(as_parquet(_table(described, machines, parts, messages)))


def failed_launch(described: Campaign, machine: DesignPart, reason: str) -> Chunk:
    """Row of one machine whose process ended again and again."""
    return Chunk(as_parquet(_table(described, machine, [], {0: reason})))


def _thrown(
    given: Model,
    asked: Launches,
    values: Mapping[str, FloatArray],
    places: IndexArray,
    messages: dict[int, str],
) -> Iterator[ThrownPart]:
    """Launches of the machines at some places, in parts without those that cannot be thrown.

    Those are found by halving, and have a message then.
    """
    try:
        machines = varied(given, {name: column[places] for name, column in values.items()})
        thrown = launch_batch(machines, asked.duration, asked.tolerance)
    except (InputError, UnsupportedProblemError, SimulationError) as error:
        if len(places) == 1:
            messages[int(places[0])] = str(error)
            return
        for half in np.array_split(places, 2):
            yield from _thrown(given, asked, values, half, messages)
        return
    messages |= {int(places[i]): text for i, text in thrown.failures.items()}
    yield places, thrown


def _table(
    campaign: Campaign,
    machines: DesignPart,
    thrown: Iterable[ThrownPart],
    messages: Mapping[int, str],
) -> Any:
    """Table of launches: a `pyarrow.Table` with a row a machine.

    Args:
        campaign: that asks for them.
        machines: their numbers in the design, n of them, and their values.
        thrown: launches of those that could be built, in parts.
        messages: why machines could not be built or launched, by their place.
    """
    n, parts = len(machines), list(thrown)

    def spread(read: Callable[[BatchLaunches], FloatArray]) -> FloatArray:
        full = np.full(n, np.nan)
        for places, launches in parts:
            full[places] = read(launches)
        return full

    found: dict[str, Any] = {
        "machine": np.asarray(machines.numbers, dtype=np.int64),
        "mechanism": _hashes(campaign, machines.values),
        **machines.values,
        "launch_time": spread(lambda launch: launch.time),
        "launch_speed": spread(lambda launch: launch.speed),
        "launch_vx": spread(lambda launch: launch.velocity[:, 0]),
        "launch_vy": spread(lambda launch: launch.velocity[:, 1]),
        "message": [messages.get(i) for i in range(n)],
    }
    found["launched"] = np.isfinite(found["launch_time"])
    for name in stop_names(campaign):
        found[f"release {name}"] = spread(lambda launch, name=name: launch.release_times[name])
    schema = schema_of(campaign)
    arrays = [_array(found[field.name], field.type) for field in schema]
    return pa.Table.from_arrays(arrays, schema=schema)


def _hashes(campaign: Campaign, values: Mapping[str, FloatArray]) -> list[str]:
    """SHA-256 of the model and the values of each machine.

    The mechanisms themselves are not made: that would take longer than their motion.
    """
    given = campaign.machines.model
    assert given is not None
    common = hashlib.sha256(model(given).content_hash.encode())
    common.update("\n".join(values).encode())
    rows = np.ascontiguousarray(np.stack(list(values.values()), axis=1), dtype="<f8")
    found: list[str] = []
    for row in rows:
        of_row = common.copy()
        of_row.update(row.tobytes())
        found.append(of_row.hexdigest()[:DIGITS])
    return found


def _array(values: Any, kind: Any) -> Any:
    """An array of Arrow from its buffers; NaN and None are null.

    `pyarrow.array` imports pandas first, which takes half a second in each process.
    """
    if kind == pa.string():
        return _texts(values)
    numbers = np.asarray(values)
    present = ~np.isnan(numbers) if numbers.dtype == np.float64 else np.ones(len(numbers), bool)
    if kind == pa.bool_():
        data = np.packbits(numbers, bitorder="little")
    elif kind in (pa.float64(), pa.int64()):
        data = np.ascontiguousarray(numbers, dtype=kind.to_pandas_dtype())
    else:
        raise TypeError(f"a column of {kind} is not made here")
    return pa.Array.from_buffers(kind, len(numbers), [_bits(present), pa.py_buffer(data)])


def _texts(values: Sequence[str | None]) -> Any:
    encoded = [(text or "").encode() for text in values]
    offsets = np.fromiter(accumulate(map(len, encoded), initial=0), np.int32, len(encoded) + 1)
    present = np.array([text is not None for text in values], dtype=bool)
    buffers = [_bits(present), pa.py_buffer(offsets), pa.py_buffer(b"".join(encoded))]
    return pa.Array.from_buffers(pa.string(), len(encoded), buffers)


def _bits(present: Any) -> Any:
    return pa.py_buffer(np.packbits(present, bitorder="little"))
