"""Mechanisms of one kind as one, whose numbers are arrays.

A *number* of a mechanism has a name: the path of its field, such as "bodies.arm.mass", "start.1",
"joints.sling pin.parent_point.0" or "gravity". A stacked mechanism has an array over the
mechanisms, shape (n,), in the place of each of its numbers. It is not validated, and for
:class:`.kinematics.Kinematics` alone, whose arrays then have a first axis more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from functools import lru_cache
from operator import itemgetter
from typing import Any, cast, overload

import numpy as np
from numpy.typing import ArrayLike

from .arrays import BoolArray, FloatArray, IndexArray
from .elements.base import UNIT_VECTORS, BaseForceElement
from .errors import InputError
from .kinematics import Kinematics, initial_state
from .mechanism import Mechanism
from .problem import Problem
from .spec import Spec, number_units

_PARTS = ("bodies", "joints", "stops", "markers", "force_elements", "couplers")
# Conditions on several numbers hold for certain where they hold by this margin: the limits of the
# mechanism's own validation are 1e-12 and 1e-9, of lengths of 1 m at least.
_ROUNDING, _CLEAR = 1e-13, 1e-6
_LONGEST = 60  # characters of a value that is shown


def numbers(mechanism: Mechanism) -> dict[str, float]:
    """Numbers of a mechanism by name, its start speeds included where it rests."""
    found: dict[str, float] = {}

    def note(path: str, value: float) -> float:
        found[path] = value
        return value

    with_numbers(mechanism, note)
    return found


def with_numbers(mechanism: Mechanism, number: Callable[[str, Any], Any]) -> Mechanism:
    """The mechanism with each number replaced by a function of its name and value.

    It is not validated.
    """

    def replaced(value: object, path: str) -> object:
        if isinstance(value, float | np.ndarray):
            return number(path, value)
        parts: dict[str, object] = {}
        for name, part in _parts(value):
            parts[name] = replaced(part, f"{path}.{name}" if path else name)
        if isinstance(value, Spec):
            return value.model_copy(update=parts)
        return tuple(parts.values()) if isinstance(value, tuple) else value

    speeds = mechanism.start_speeds or (0.0,) * len(mechanism.start)
    moving = mechanism.model_copy(update={"start_speeds": speeds})
    return cast("Mechanism", replaced(moving, ""))


def _parts(value: object) -> Iterator[tuple[str, Any]]:
    """Fields of a description by their names; items of a tuple by theirs, or by number."""
    if isinstance(value, Spec):
        for field in type(value).model_fields:
            yield field, getattr(value, field)
    elif isinstance(value, tuple):
        for i, item in enumerate(cast("tuple[object, ...]", value)):
            yield str(getattr(item, "name", i)), item


class Stack(Sequence[Mechanism]):
    """Machines that differ from one in some numbers; a slice of them is a stack again.

    Args:
        example: one of the kind; its other numbers are those of all.
        values: what makes the difference, by name, each of shape (n,).
        build: builds a machine of its own from its values.
        columns: numbers of the mechanism, by name, that follow from the values, each of shape (n,);
            the values themselves if left out.
    """

    def __init__(
        self,
        example: Mechanism,
        values: Mapping[str, FloatArray],
        build: Callable[[dict[str, float]], Mechanism],
        columns: Mapping[str, FloatArray] | None = None,
    ) -> None:
        self._example, self._values, self._build = example, values, build
        self._columns = values if columns is None else columns
        self._n = len(next(iter(values.values())))

        def column(name: str, value: float) -> FloatArray:
            return self._columns.get(name, np.broadcast_to(np.float64(value), (self._n,)))

        self.mechanism = with_numbers(example, column)
        """The stacked mechanism."""

    def __len__(self) -> int:
        return self._n

    @overload
    def __getitem__(self, index: int) -> Mechanism: ...

    @overload
    def __getitem__(self, index: slice) -> Stack: ...

    def __getitem__(self, index: int | slice) -> Mechanism | Stack:
        if isinstance(index, slice):
            values = {name: column[index] for name, column in self._values.items()}
            columns = {name: column[index] for name, column in self._columns.items()}
            return Stack(self._example, values, self._build, columns)
        return build_one(self._build, self._values, index)

    def refuse(self) -> None:
        """Refuse machines that cannot be built.

        Those are built alone that have the least or the largest of some value, for a field takes
        the values of an interval, and those whose numbers may not fit together.

        Raises:
            InputError: a value is not finite, or a machine cannot be built; the sentence says
                which one, and its values.
        """
        suspect = np.zeros(self._n, dtype=bool)
        for name, column in self._values.items():
            if not np.all(np.isfinite(column)):
                i = int(np.argmin(np.isfinite(column)))
                raise InputError(f"{name}[{i}] = {column[i]!s}: it must be a finite number.")
            suspect[[np.argmin(column), np.argmax(column)]] = True
        for i in np.flatnonzero(suspect | self._may_not_fit()).tolist():
            build_one(self._build, self._values, i)

    def _may_not_fit(self) -> BoolArray:
        """Mark machines that may be refused for what their numbers are together, shape (n,)."""
        mechanism, kinematics = self.mechanism, Kinematics(self.mechanism)
        if mechanism.couplers:
            return np.ones(self._n, dtype=bool)
        q, _ = initial_state(mechanism)
        fits = np.ones(self._n, dtype=bool)  # not where something is no number
        for column in self._columns.values():
            fits &= np.isfinite(column)
        for owner in (mechanism, *mechanism.elements):
            for field in UNIT_VECTORS:
                x, y = getattr(owner, field, (1.0, 0.0))
                fits &= np.abs(x**2 + y**2 - 1.0) <= _ROUNDING
        for stop in mechanism.stops:
            gap = kinematics.gap(stop.name, q)
            fits &= np.abs(gap) <= _ROUNDING if stop.closed else gap > _CLEAR
        for element in mechanism.force_elements:
            if type(element).refuse_start is BaseForceElement.refuse_start:
                continue
            if element.acts_along != "vector":
                fits[:] = False
                continue
            between: Any = element.direction(kinematics)
            fits &= np.abs(kinematics.vector(between, q)) > _CLEAR
        return ~fits | ~np.all(np.abs(kinematics.loop_residual(q)) <= _ROUNDING, axis=-1)


def build_one(
    build: Callable[[dict[str, float]], Mechanism], values: Mapping[str, FloatArray], i: int
) -> Mechanism:
    """Build one machine from its values.

    Raises:
        InputError: it cannot be built, or its loops are open at the start; the sentence says which
            one it is, and its values.
    """
    row = {name: float(column[i]) for name, column in values.items()}
    try:
        return Problem(build(row)).mechanism
    except InputError as error:
        shown = ", ".join(f"{name} = {value!r}" for name, value in row.items())
        raise InputError(f"machine {i} ({shown}): {error}") from None


def stack_of(example: Mechanism, values: Mapping[str, FloatArray]) -> Stack:
    """A mechanism with other numbers, n times; see :meth:`Stack.refuse`.

    Args:
        example: the mechanism.
        values: numbers by name, each of shape (n,).

    Raises:
        InputError: a name is none of a number; the sentence lists the names there are.
    """
    known = numbers(example)
    for name in values:
        if name not in known:
            close = get_close_matches(name, known, n=1)
            hint = f" (did you mean {close[0]!r}?)" if close else ""
            raise InputError(
                f"there is no number {name!r} in {example.name!r}{hint}; there is: "
                f"{', '.join(known)}."
            )
    moves = bool(example.start_speeds) or any(name.startswith("start_speeds") for name in values)

    def build(row: dict[str, float]) -> Mechanism:
        fields: dict[str, Any] = with_numbers(example, row.get).model_dump()
        if not moves:
            del fields["start_speeds"]
        return Mechanism(**fields)

    return Stack(example, values, build)


def columns_of(values: Mapping[str, ArrayLike]) -> dict[str, FloatArray]:
    """Values by name as arrays of one length; a single number stands for all.

    Raises:
        InputError: there are none, or something is no array of real numbers of that length.
    """
    columns: dict[str, FloatArray] = {}
    for name, given in values.items():
        column = np.asarray(given)
        if column.dtype.kind not in "iuf" or column.ndim > 1 or column.size == 0:
            text = " ".join(repr(given).split())
            text = text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}..."
            raise InputError(f"{name} = {text}: it must be a number or a sequence of numbers.")
        columns[name] = column.astype(np.float64)
    if not columns:
        raise InputError("values is empty; at least one array of numbers is needed.")
    lengths = {name: len(column) for name, column in columns.items() if column.ndim}
    if len(set(lengths.values())) > 1:
        shown = ", ".join(f"{n} of {name}" for name, n in lengths.items())
        raise InputError(f"there are {shown}; each name needs as many values as the others.")
    n = max(lengths.values(), default=1)
    return {name: np.broadcast_to(column, (n,)) for name, column in columns.items()}


def stacked(mechanisms: Sequence[Mechanism]) -> Iterator[tuple[IndexArray, Mechanism]]:
    """Indices of the mechanisms of each kind, and these mechanisms as one.

    Mechanisms are of one kind if they differ in their numbers and in their own name alone.
    """
    if isinstance(mechanisms, Stack):
        yield np.arange(len(mechanisms)), mechanisms.mechanism
        return
    kinds: dict[tuple[object, ...], list[int]] = {}
    for i, mechanism in enumerate(mechanisms):
        fields = mechanism.__dict__
        kind: list[object] = [len(fields["start"]), len(fields["start_speeds"])]
        for name in _PARTS:
            kind.append(name)
            kind += map(kind_of, fields[name])
        kinds.setdefault(tuple(kind), []).append(i)
    for indices in kinds.values():
        alike = [mechanisms[i] for i in indices]
        columns = _columns(alike)
        for name in _PARTS:
            parts = zip(*(getattr(mechanism, name) for mechanism in alike), strict=True)
            columns[name] = tuple(part[0].model_copy(update=_columns(part)) for part in parts)
        yield np.array(indices), alike[0].model_copy(update=columns)


def _columns(specs: Sequence[Spec]) -> dict[str, Any]:
    """Numbers of objects of a class as arrays over them; of vectors each component."""
    columns: dict[str, Any] = {}
    for name in number_units(type(specs[0])):
        column = np.array([getattr(spec, name) for spec in specs], dtype=np.float64)
        columns[name] = column if column.ndim == 1 else tuple(np.ascontiguousarray(column.T))
    return columns


def kind_of(part: Spec) -> tuple[object, ...]:
    """Class of a part, and its fields that hold no numbers."""
    return type(part), _reader(type(part))(vars(part))


@lru_cache
def _reader(cls: type[Spec]) -> Callable[[dict[str, Any]], object]:
    """Reader of the fields that hold no numbers."""
    return itemgetter(*(name for name in cls.model_fields if name not in number_units(cls)))
