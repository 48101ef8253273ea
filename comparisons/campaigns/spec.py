"""The description of a campaign: which machines, which engines, and what is asked of them.

It is read from a TOML file; a complaint names the line and the field.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self, cast

from pydantic import BeforeValidator, Field, JsonValue, model_validator

from ...engines.presets import DEFAULT
from ...models.errors import InputError
from ...models.files import read_bytes
from ...models.library.registry import is_file, model_of, read_file
from ...models.mechanism import Mechanism
from ...models.spec import Name, Positive, Real, Spec, SpecError
from ..runs.quantities import judged_quantity
from .random_mechanisms import Family

_FEWEST_RUN, _MOST_RUN = 1, 16  # machines of a chunk by default that engines are run on
_FEWEST_LAUNCHED, _MOST_LAUNCHED = 256, 8192  # that the reference launches
_CHUNKS = 16  # of a small campaign by default: several processes have work to its end
_LONGEST_SEQUENCE = 2**30  # points of Sobol's sequence in 30 bits, as SciPy makes it
_LARGEST_FILE = 10_000_000  # [B]


class Interval(Spec):
    """Values from the least to the largest of a parameter."""

    min: Real
    max: Real
    steps: Annotated[int, Field(ge=2)] | None = None
    """Number of values of a grid, both ends among them; other designs fill the interval."""
    scale: Literal["linear", "log"] = "linear"

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.min < self.max:
            raise ValueError(f"min = {self.min!r} must be less than max = {self.max!r}")
        if self.scale == "log" and self.min <= 0:
            raise ValueError(f"min = {self.min!r} must be positive where the scale is 'log'")
        return self


Choices = Annotated[tuple[Real, ...], Field(min_length=1)]


class _List(Spec):
    """Values of a list, each checked."""

    value: Choices


class _Single(Spec):
    """One value, checked."""

    value: Real


def _values(given: Any) -> object:
    """Values of a parameter from a number, a list or an interval, with complaints of that kind."""
    if isinstance(given, Mapping):
        return Interval(**cast("Mapping[str, Any]", given))
    if isinstance(given, list | tuple):
        return _List(value=cast("Any", given)).value
    return given if isinstance(given, Interval) else _Single(value=given).value


def _with_paths(given: object) -> object:
    """Values by dotted path, where TOML has made tables of what was written without quotes."""
    if not isinstance(given, Mapping):
        return given
    found: dict[str, object] = {}
    for name, value in cast("Mapping[str, object]", given).items():
        if isinstance(value, Mapping) and not value.keys() & Interval.model_fields.keys():
            inner = cast("Mapping[str, object]", _with_paths(cast("object", value)))
            found |= {f"{name}.{rest}": each for rest, each in inner.items()}
        else:
            found[name] = value
    return found


def _model(given: object) -> object:
    """A mechanism from its fields; a name as it is."""
    return Mechanism(**cast("Mapping[str, Any]", given)) if isinstance(given, Mapping) else given


Values = Annotated[Real | Choices | Interval, BeforeValidator(_values)]


class Machines(Spec):
    """Machines of a campaign: one model with other values, or random mechanisms of a family."""

    model: Annotated[Mechanism | str | None, BeforeValidator(_model)] = None
    """Name of a machine or of a problem, path of a mechanism's .json file, or the mechanism."""
    family: Family | None = None
    """Limits of random mechanisms; mechanism k has the seed of the campaign plus k."""
    design: Literal["grid", "random", "latin-hypercube", "sobol"] = "grid"
    number: Annotated[int, Field(ge=1)] | None = None
    """Machines of every design but the grid, before `where`."""
    values: Annotated[dict[str, Values], BeforeValidator(_with_paths)] = Field(
        default_factory=dict[str, Any]
    )
    """Values by parameter of a named machine, or by path of a number, such as 'bodies.arm.mass'."""
    where: tuple[str, ...] = ()
    """Conditions on the values, such as 'l1 > 3 * l2'; machines that break one are left out."""

    @model_validator(mode="after")
    def _is_complete(self) -> Self:
        if (self.model is None) is (self.family is None):
            raise ValueError("needs either model or family, and not both")
        if self.family is not None:
            if self.values or self.where:
                raise ValueError("family has no values and no where: its mechanisms are random")
            if self.number is None:
                raise ValueError("number is missing; a family has as many mechanisms as it says")
            return self
        if not self.values:
            raise ValueError("values is missing; at least one parameter is to be varied")
        if self.design == "grid":
            if self.number is not None:
                raise ValueError("number is given; the size of a grid follows from its steps")
            for name, value in self.values.items():
                if isinstance(value, Interval) and value.steps is None:
                    raise ValueError(f"values.{name}.steps is missing; a grid needs it")
        elif self.number is None:
            raise ValueError(f"number is missing; the design {self.design!r} needs it")
        elif self.design == "sobol" and self.number > _LONGEST_SEQUENCE:
            raise ValueError(f"number = {self.number}: Sobol's sequence ends at 2^30")
        return self


class Runs(Spec):
    """Engines that run on each machine, and how they are judged: as :func:`.compare` takes it."""

    engines: Annotated[tuple[str, ...], Field(min_length=1)]
    presets: Annotated[tuple[str, ...], Field(min_length=1)] = (DEFAULT,)
    timesteps: tuple[Positive, ...] = ()
    """Steps of every engine [s], each a run; the preset's own where left out."""
    options: dict[str, JsonValue] = Field(default_factory=dict)
    until: Real | str | None = None
    stop_law: Literal["release-once", "unilateral"] | None = None
    tolerances: dict[str, Real | str] = Field(default_factory=dict)
    quantities: tuple[str, ...] = ()
    """Quantities that are kept; all that are judged where left out."""
    diagnose: bool = False
    """Whether causes of disagreements are looked for."""
    trajectories: bool = False
    """Whether motions are kept, each in a NetCDF file."""
    timeout: Positive = 60.0
    """Longest wait for one run [s]."""

    @model_validator(mode="after")
    def _names_quantities(self) -> Self:
        for title in self.quantities:
            judged_quantity(title)
        return self


class Launches(Spec):
    """Launches of the reference alone, in a batch, without engines."""

    duration: Positive = 4.0
    """The launch is searched up to here [s]."""
    tolerance: Annotated[Real, Field(ge=2.3e-16, le=1e-2)] = 1e-10
    """Relative local error of a step of the integrator."""


class Campaign(Spec):
    """Description of a campaign: a name, machines, and either `runs` or `launches`.

    Raises:
        InputError: a field is missing, unknown or not valid.
    """

    name: Name
    seed: Annotated[int, Field(ge=0)] = 0
    machines: Machines
    runs: Runs | None = None
    launches: Launches | None = None
    chunk: Annotated[int, Field(ge=1, le=1_000_000)] | None = None
    """Machines of a chunk, which is written whole or not at all.

    By default a sixteenth of all, but at most 16 that engines are run on, and 256 to 8192 that are
    launched.
    """

    @model_validator(mode="after")
    def _asks_something(self) -> Self:
        if (self.runs is None) is (self.launches is None):
            raise ValueError("needs either the table runs or the table launches, and not both")
        if self.launches is not None and self.machines.family is not None:
            raise ValueError("launches need a model: random mechanisms of a family are not alike")
        return self

    def chunk_size(self, machines: int) -> int:
        """Machines of a chunk of a campaign of so many."""
        if self.chunk is not None:
            return self.chunk
        if self.launches is None:
            fewest, most = _FEWEST_RUN, _MOST_RUN
        else:
            fewest, most = _FEWEST_LAUNCHED, _MOST_LAUNCHED
        return min(max(-(-machines // _CHUNKS), fewest), most)

    def axes(self, x: str | None = None, y: str | None = None) -> tuple[str, str | None]:
        """Choose the columns over which a map is drawn: by default the first two that vary.

        Of one parameter the second is None; of none the first is the number of the machine.

        Raises:
            InputError: there is no such parameter, or both are the same.
        """
        values = self.machines.values
        for name in (x, y):
            if name is not None and name not in values:
                known = ", ".join(values) or "none: its machines are random"
                raise InputError(
                    f"{name[:60]!r} is no parameter of {self.name!r}; there are: {known}."
                )
        if x is not None and x == y:
            raise InputError(f"{x!r} stands for both axes of the map; one of them must be another.")
        rest = [name for name, value in values.items() if _varies(value)]
        rest = [name for name in rest if name not in (x, y)]
        chosen = [rest.pop(0) if name is None and rest else name for name in (x, y)]
        return chosen[0] or "machine", chosen[1]

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Read a campaign from a TOML file; a mechanism's file that it names is taken in.

        Raises:
            InputError: the file cannot be read, or is no valid description; the sentence names the
                line and the field.
        """
        try:
            text = read_bytes(path, _LARGEST_FILE).decode()
        except UnicodeDecodeError as error:
            raise InputError(f"{path}: it is no UTF-8 text ({error.reason}).") from None
        try:
            fields = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise InputError(f"{path} is no TOML: {error}.") from None
        except RecursionError:
            raise InputError(f"{path} is no TOML: it is nested too deep.") from None
        try:
            return cls.of(fields, Path(path).parent)
        except SpecError as error:
            shown = [f"{_place(text, field)}{field}{what}" for field, what in error.complaints]
            raise InputError(f"{path}: {'; '.join(shown)}.") from None
        except InputError as error:
            raise InputError(f"{path}: {error}") from None

    @classmethod
    def of(cls, given: Mapping[str, Any], folder: Path = Path()) -> Self:
        """Build a campaign from its fields; a mechanism's file that it names is taken in.

        Args:
            given: fields, as a TOML file has them.
            folder: in which a mechanism's file is looked for.

        Raises:
            InputError: a field is missing, unknown or not valid, or the file is not.
        """
        campaign = cls(**dict(given))
        named = campaign.machines.model
        if isinstance(named, str) and is_file(named):
            mechanism = read_file(folder / named)
            machines = campaign.machines.model_copy(update={"model": mechanism})
            return campaign.model_copy(update={"machines": machines})
        if named is not None:
            model_of(named)  # which refuses a name that there is not
        return campaign


def _varies(value: Values) -> bool:
    """Tell whether machines differ in a parameter."""
    return isinstance(value, Interval) or (isinstance(value, tuple) and len(set(value)) > 1)


def _place(text: str, field: str) -> str:
    """Tell the line of a field in a TOML text, as the beginning of a sentence.

    It is where the field is complete: the first line with which the text so far has it. A field
    that is missing is reported at the line of the table that lacks it.
    """
    lines, steps = text.splitlines(keepends=True), field.split(".")
    while steps:
        for number in range(1, len(lines) + 1):
            if _has("".join(lines[:number]), steps):
                return f"line {number}: "
        steps.pop()
    return ""


def _has(text: str, steps: list[str]) -> bool:
    """Tell whether a TOML text is one, and has the field of this path."""
    try:
        value: object = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return False
    for step in steps:
        if isinstance(value, dict) and step in value:
            value = cast("dict[str, object]", value)[step]
        elif isinstance(value, list) and step.isdigit() and int(step) < len(value):
            value = cast("list[object]", value)[int(step)]
        else:
            return False
    return True
