"""Mechanisms alike but for their numbers as one mechanism whose numbers are arrays.

A stacked mechanism is for :class:`.kinematics.Kinematics` alone, whose arrays then have a first
axis more: each of its numbers (lengths, masses, the start) is an array over the mechanisms, shape
(n,). It is not validated.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from operator import itemgetter
from typing import Any, get_args

import numpy as np

from .arrays import IndexArray
from .mechanism import Mechanism
from .spec import Spec

_PARTS = ("bodies", "joints", "stops", "markers", "force_elements")


def stacked(mechanisms: Sequence[Mechanism]) -> Iterator[tuple[IndexArray, Mechanism]]:
    """Indices of the mechanisms of each kind, and these mechanisms as one; in the order of the first of each kind.

    Mechanisms are of one kind if they differ in their numbers and in their own name alone.
    """
    kinds: dict[tuple[object, ...], list[int]] = {}
    for i, mechanism in enumerate(mechanisms):
        kinds.setdefault(_kind(mechanism), []).append(i)
    for indices in kinds.values():
        alike = [mechanisms[i] for i in indices]
        fields = _columns(alike)
        for name in _PARTS:
            columns = zip(*(getattr(mechanism, name) for mechanism in alike), strict=True)
            fields[name] = tuple(_stacked(parts) for parts in columns)
        yield np.array(indices), alike[0].model_copy(update=fields)


def _kind(mechanism: Mechanism) -> tuple[object, ...]:
    fields = mechanism.__dict__
    kind: list[object] = [len(fields["start"]), len(fields["start_speeds"])]
    for name in _PARTS:
        kind.append(name)
        for part in fields[name]:
            kind += (type(part), _reader(type(part))(part.__dict__))
    return tuple(kind)


def _stacked(parts: Sequence[Spec]) -> Spec:
    """Bodies, or joints, stops, ... of one kind as one."""
    return parts[0].model_copy(update=_columns(parts))


def _columns(specs: Sequence[Spec]) -> dict[str, Any]:
    """Each number of objects of a class as an array over them, NaN where there is none; of vectors each component."""
    columns: dict[str, Any] = {}
    for name in _numbers(type(specs[0])):
        column = np.array([getattr(spec, name) for spec in specs], dtype=np.float64)
        columns[name] = column if column.ndim == 1 else tuple(np.ascontiguousarray(column.T))
    return columns


@lru_cache
def _numbers(cls: type[Spec]) -> tuple[str, ...]:
    """Names of the fields that hold numbers, or vectors of them."""
    return tuple(
        name for name, field in cls.model_fields.items() if _holds_floats(field.annotation)
    )


def _holds_floats(annotation: object) -> bool:
    return annotation is float or any(_holds_floats(part) for part in get_args(annotation))


@lru_cache
def _reader(cls: type[Spec]) -> Callable[[dict[str, Any]], object]:
    """Reads the fields that hold no numbers."""
    return itemgetter(*(name for name in cls.model_fields if name not in _numbers(cls)))
