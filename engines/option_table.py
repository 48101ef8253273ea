"""An engine's options as a table: defaults of each preset, meaning and range, all from the fields of its class."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from pydantic import JsonValue
from pydantic.fields import FieldInfo

from ..models.spec import Spec
from .registry import engine, engine_class, option_names


@dataclass(frozen=True)
class OptionRow:
    """An option of an engine."""

    name: str
    defaults: Mapping[str, JsonValue]
    """By preset; a preset whose settings do not tell the option is left out."""
    values: str = ""
    """What it can be, in words; empty where the engine's class does not say."""
    meaning: str = ""
    """Empty where the engine's class does not say."""


def option_table(name: str) -> tuple[OptionRow, ...]:
    """Every option of an engine, a plug-in's among them.

    Fields of a `Spec` and of a dataclass tell their ranges and, by `description` (in a dataclass in
    the field's metadata), their meanings. Of any other class only the settings of its presets are
    known.

    Raises:
        InputError: there is no such engine, or its plug-in cannot be loaded.
    """
    settings = {preset: engine(name, preset).settings for preset in engine_class(name).presets()}
    known = option_names(name) or tuple(
        dict.fromkeys(option for own in settings.values() for option in own)
    )
    described = {
        option: (values, meaning) for option, values, meaning in _described(engine_class(name))
    }
    return tuple(
        OptionRow(
            option,
            {preset: own[option] for preset, own in settings.items() if option in own},
            *described.get(option, ()),
        )
        for option in known
    )


def _described(cls: object) -> Iterator[tuple[str, str, str]]:
    """Name, values and meaning of each field."""
    if not isinstance(cls, type):
        return
    if issubclass(cls, Spec):
        for name, field in cls.model_fields.items():
            yield name, _values(field.annotation, field.metadata), field.description or ""
    elif dataclasses.is_dataclass(cls):
        hints = get_type_hints(cls, include_extras=True)
        for field in dataclasses.fields(cls):
            yield field.name, _values(hints[field.name]), str(field.metadata.get("description", ""))


def _values(annotation: Any, metadata: Sequence[object] = ()) -> str:
    """What an annotation allows, in words; empty for types that have none here.

    Args:
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
    words = {bool: "true or false", int: "integer", float: "number", str: "text", NoneType: "null"}
    bounds = _bounds(metadata) if annotation in (int, float) else ""
    return f"{words.get(annotation, '')} {bounds}".strip()


_BOUNDS = {"ge": "at least", "gt": "above", "le": "at most", "lt": "below"}


def _bounds(metadata: Sequence[object]) -> str:
    """Of a number; empty where there are none."""
    flat = [each for m in metadata for each in (m.metadata if isinstance(m, FieldInfo) else (m,))]
    found = {
        kind: value
        for each in flat
        for kind in _BOUNDS
        if (value := getattr(each, kind, None)) is not None
    }
    if found.get("ge", -math.inf) > found.get("gt", math.inf):  # one of the type, one of the field
        del found["gt"]
    if found.keys() == {"ge", "le"}:
        return f"from {found['ge']:g} to {found['le']:g}"
    return " and ".join(
        f"{word} {found[kind]:g}" for kind, word in _BOUNDS.items() if kind in found
    )


def default_text(value: JsonValue) -> str:
    """A default as it can be given on the command line, floats to six digits."""
    if isinstance(value, list):
        return ",".join(map(default_text, value))
    if isinstance(value, bool) or value is None:
        return {True: "true", False: "false", None: "null"}[value]
    return f"{value:.6g}" if isinstance(value, float) else str(value)
