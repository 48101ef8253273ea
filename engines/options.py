"""Options of an engine's class: their names, what they can be, and their values in an engine.

Fields of a `Spec` and of a dataclass tell their ranges and, by `description` (in a dataclass in the
field's metadata), their meanings. Any other class of a plug-in tells nothing before it is made.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from pydantic import JsonValue
from pydantic.fields import FieldInfo
from pydantic_core import to_jsonable_python

from ..models.errors import InputError
from ..models.spec import Spec

RENAMED_OPTIONS: Mapping[str, str] = {"located_releases": "locate_releases"}
"""Options by the names that they had in an earlier release, which are still read."""
_RESERVED = ("name", "preset")


@dataclass(frozen=True)
class OptionField:
    """One option as the class of an engine declares it."""

    name: str
    values: str = ""
    """Values it can have, in words; this and the meaning are empty where the class is silent."""
    meaning: str = ""


@dataclass(frozen=True)
class OptionRow:
    """One option of an engine, with its default in each preset."""

    name: str
    defaults: Mapping[str, JsonValue]
    """By preset; a preset whose settings do not tell the option is left out."""
    values: str = ""
    meaning: str = ""


def option_fields(cls: object) -> tuple[OptionField, ...] | None:
    """The options that an engine's class declares; None of one that does not tell them."""
    if not isinstance(cls, type):
        return None
    if issubclass(cls, Spec):
        fields = [
            OptionField(name, _values(field.annotation, field.metadata), field.description or "")
            for name, field in cls.__pydantic_fields__.items()
        ]
    elif dataclasses.is_dataclass(cls):
        hints = get_type_hints(cls, include_extras=True)
        fields = [
            OptionField(f.name, _values(hints[f.name]), str(f.metadata.get("description", "")))
            for f in dataclasses.fields(cls)
            if f.init
        ]
    else:
        return None
    return tuple(field for field in fields if field.name not in _RESERVED)


def current_name(option: str, known: Collection[str] | None) -> str:
    """The present name of an option that had another one, of an engine with these options."""
    new = RENAMED_OPTIONS.get(option, option)
    return new if known is not None and option not in known and new in known else option


def settings_of(engine: object, options: Mapping[str, Any]) -> dict[str, JsonValue]:
    """Values of an engine's options, as JSON.

    Args:
        engine: as a plug-in makes it.
        options: those it was made with: all that is known where its class does not tell them.
    """
    fields = option_fields(type(engine))
    if isinstance(engine, Spec):
        return engine.model_dump(mode="json", exclude={"preset"})
    values = options if fields is None else {f.name: getattr(engine, f.name) for f in fields}
    return {
        name: to_jsonable_python(value, fallback=repr)
        for name, value in values.items()
        if name != "preset"
    }


def refuse_reserved(options: Mapping[str, Any]) -> None:
    """Refuse what chooses an engine among its options.

    Raises:
        InputError: the engine's name or its preset is one of them.
    """
    for name in _RESERVED:
        if name in options:
            raise InputError(
                f"{name} = {options[name]!r} is no option of an engine: "
                "it chooses which engine is made."
            )


def unknown_option(engine: str, option: str, known: Sequence[str]) -> InputError:
    """The error for an option that an engine does not have, with the nearest name that it has."""
    close = get_close_matches(option, known, n=1)
    hint = f" (did you mean {close[0]!r}?)" if close else ""
    return InputError(
        f"{engine}: {option} is not a field it has{hint}; its options are: {', '.join(known)}."
    )


def default_text(value: JsonValue) -> str:
    """A default as it can be given on the command line, floats to six digits."""
    if isinstance(value, list):
        return ",".join(map(default_text, value))
    if isinstance(value, bool) or value is None:
        return {True: "true", False: "false", None: "null"}[value]
    return f"{value:.6g}" if isinstance(value, float) else str(value)


_TYPES = {bool: "true or false", int: "integer", float: "number", str: "text", NoneType: "null"}
_BOUNDS = {"ge": "at least", "gt": "above", "le": "at most", "lt": "below"}


def _values(annotation: Any, metadata: Sequence[object] = ()) -> str:
    """Values that an annotation allows, in words; empty for types that have none here.

    Args:
        annotation: of a field.
        metadata: of the annotation, bounds among them.
    """
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _values(parts[0], [*parts[1:], *metadata])
    if origin is Literal:
        return ", ".join(map(str, parts))
    if origin in (Union, UnionType):
        return " or ".join(filter(None, (_values(part, metadata) for part in parts)))
    if origin is tuple and Ellipsis not in parts:
        return f"{len(parts)} values ({'; '.join(map(_values, parts))})"
    bounds = _bounds(metadata) if annotation in (int, float) else ""
    return f"{_TYPES.get(annotation, '')} {bounds}".strip()


def _bounds(metadata: Sequence[object]) -> str:
    """Bounds of a number; empty where there are none."""
    bounds: dict[str, float] = {}
    for entry in metadata:
        for part in entry.metadata if isinstance(entry, FieldInfo) else (entry,):
            for kind in _BOUNDS:
                if getattr(part, kind, None) is not None:
                    bounds[kind] = getattr(part, kind)
    if bounds.get("ge", -math.inf) > bounds.get("gt", math.inf):  # of the type, and of the field
        del bounds["gt"]
    if bounds.keys() == {"ge", "le"}:
        return f"from {bounds['ge']:g} to {bounds['le']:g}"
    return " and ".join(f"{_BOUNDS[kind]} {bounds[kind]:g}" for kind in _BOUNDS if kind in bounds)
