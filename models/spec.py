"""The base of all descriptions: frozen, validated at birth, exact in JSON, with a content hash."""

from __future__ import annotations

import codecs
import hashlib
import json
import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self, get_args

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError
from pydantic_core import ErrorDetails

from .errors import InputError
from .files import read_bytes


def _refuse_truth_values(value: object) -> object:
    if isinstance(value, bool):
        raise ValueError("must be a number, not true or false")
    return value


Real = Annotated[float, BeforeValidator(_refuse_truth_values)]
"""A finite float64; integers are taken, truth values, NaN and infinities are not."""

Positive = Annotated[Real, Field(gt=0)]
NonNegative = Annotated[Real, Field(ge=0)]
Vector = tuple[Real, Real]
"""Two components (x, y)."""


def as_complex(vector: Vector) -> complex:
    """Its components as x + i y; an array where they are arrays (:mod:`.stacked`)."""
    return vector[0] + 1j * vector[1]


Name = Annotated[str, Field(min_length=1, max_length=80, pattern=r"^[A-Za-z][A-Za-z0-9_ \-]*$")]
"""A name for MJCF, NetCDF and files too: a letter, then letters, digits, space, _ or -."""


# Tags of unions, which pydantic puts into the path of a complaint: of stops, which have no kind,
# and of each class whose `kind` has one value.
_TAGS = {"stop", "point stop"}


class SpecError(InputError):
    """A description that cannot be built, with its complaints as a list for an outer one."""

    def __init__(self, subject: str, complaints: list[tuple[str, str]]) -> None:
        self.subject, self.complaints = subject, complaints
        texts = [f"{field}{text}" for field, text in complaints]
        super().__init__(f"{subject} cannot be built: {'; '.join(texts)}.")

    def __reduce__(self) -> tuple[type[SpecError], tuple[str, list[tuple[str, str]]]]:
        """Travel between processes: the default would call the class with the finished sentence."""
        return type(self), (self.subject, self.complaints)

    @classmethod
    def of(cls, error: ValidationError, subject: str) -> SpecError:
        """Word pydantic's list: each field, its value and what would be valid."""
        complaints: list[tuple[str, str]] = []
        rows = error.errors(include_url=False)
        for row in rows:
            # Items that are refused are not counted: a list of them is not "too short" as well.
            place = row["loc"]
            inside = [r for r in rows if r["loc"] != place and r["loc"][: len(place)] == place]
            if row["type"] == "too_short" and inside:
                continue
            field = ".".join(str(step) for step in place if step not in _TAGS)
            inner = row.get("ctx", {}).get("error")
            if not isinstance(inner, SpecError):
                complaints.append((field, _complaint(row, field)))
                continue
            # Complaints of an inner description have the outer field in front of their place.
            for name, text in inner.complaints:
                if field and not name:
                    complaints.append((field, f": {text}"))
                else:
                    complaints.append((f"{field}.{name}" if field else name, text))
        return cls(subject, complaints)


def _complaint(row: ErrorDetails, field: str) -> str:
    if row["type"] == "missing":
        return " is missing"
    if row["type"] == "extra_forbidden":
        return " is not a field it has"
    reason = row["msg"].removeprefix("Value error, ")
    if not field:
        return reason
    try:
        value = repr(row["input"])
    except ValueError:  # Python refuses to print an integer of more than 4300 digits
        value = "a number of thousands of digits"
    if len(value) > 60:
        value = value[:57] + "..."
    return f" = {value}: {reason[:1].lower()}{reason[1:]}"


def _refuse_twice(pairs: list[tuple[str, object]]) -> None:
    """Refuse two values under one name, of which JSON readers take one or the other."""
    names: set[str] = set()
    for name, _ in pairs:
        if name in names:
            raise InputError(f"the field {name!r} is there twice; once is needed.")
        names.add(name)


class Spec(BaseModel):
    """A frozen value object whose JSON round trip keeps every float to the last bit.

    Raises:
        InputError: a field is missing, unknown, not finite or outside its range.
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, ser_json_inf_nan="constants"
    )
    largest_file: ClassVar[int] = 200_000_000
    """Size of a file that is read [B]."""
    not_content: ClassVar[frozenset[str]] = frozenset()
    """Fields that are no part of what is described."""

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        super().__pydantic_init_subclass__(**kwargs)
        kind = cls.model_fields.get("kind")
        if kind is not None and get_args(kind.annotation) == (kind.default,):
            _TAGS.add(kind.default)

    def __init__(self, /, **fields: Any) -> None:
        try:
            super().__init__(**fields)
        except ValidationError as error:
            raise SpecError.of(error, type(self).__name__) from None

    def to_json(self) -> str:
        """JSON text; floats are the shortest decimals that read back to the same bits."""
        return self.model_dump_json(indent=2)

    @classmethod
    def from_json(cls, text: str | bytes) -> Self:
        """Build from JSON text.

        Raises:
            InputError: the text is not JSON, names a field twice, or does not describe a valid
                object.
        """
        try:
            spec = cls.model_validate_json(text)
        except ValidationError as error:
            raise SpecError.of(error, cls.__name__) from None
        json.loads(text, object_pairs_hook=_refuse_twice, parse_int=str, parse_float=str)
        return spec

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a JSON file.

        Raises:
            InputError: the file cannot be read, is no regular file, is too large, or is not a valid
                description; the sentence names it.
        """
        # Editors of Windows begin a file with a byte order mark.
        text = read_bytes(path, cls.largest_file).removeprefix(codecs.BOM_UTF8)
        try:
            return cls.from_json(text)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None

    @property
    def content_hash(self) -> str:
        """SHA-256 of the canonical JSON: equal for equal content in any order.

        What is None is left out: a description keeps its hash when a field that it does not use
        comes into being. So are :attr:`not_content`, which say where it came from.
        """
        content = self.model_dump(mode="json", exclude_none=True, exclude=set(self.not_content))
        canonical = json.dumps(content, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(canonical.encode()).hexdigest()


@cache
def number_units(kind: type[BaseModel]) -> Mapping[str, str]:
    """Units of the fields of a description that are numbers or vectors, by name of the field.

    The unit stands in brackets in the field's description, such as "k [N m/rad]"; it is '' where
    there is none.
    """
    units: dict[str, str] = {}
    for name, field in kind.model_fields.items():
        if _holds_floats(field.annotation):
            unit = re.search(r"\[(.+)\]", field.description or "")
            units[name] = unit[1] if unit else ""
    return units


def _holds_floats(annotation: object) -> bool:
    return annotation is float or any(_holds_floats(part) for part in get_args(annotation))


def schema_text(model: type[BaseModel]) -> str:
    """JSON schema (draft 2020-12) of a described type, in the form the repository publishes."""
    draft = {"$schema": "https://json-schema.org/draft/2020-12/schema"}
    return json.dumps(draft | model.model_json_schema(), indent=2) + "\n"
