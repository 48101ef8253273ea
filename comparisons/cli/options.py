"""Options that several commands share, and how their texts are read."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from ...models.mechanism import Mechanism
    from ...models.parameters import TrebuchetParameters

Models = Annotated[
    str,
    typer.Option("--models", "--model", help="Machines, comma-separated: fixed, rolling, or a mechanism's .json file."),
]
Model = Annotated[
    str, typer.Option("--model", "--models", help="Machine: fixed, rolling, or a mechanism's .json file.")
]
Engines = Annotated[str, typer.Option("--engines", "--engine", help="Engines, comma-separated; all by default.")]
Preset = Annotated[str, typer.Option("--preset", "--presets", help="tuned, stock, or both: tuned,stock.")]
Timestep = Annotated[float | None, typer.Option("--timestep", help="Step of every engine (s); else the preset's own.")]
Duration = Annotated[
    float | None, typer.Option("--duration", help="Compared or simulated time (s); to the launch by default.")
]
Set = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help="A parameter of the machine, SI units; repeatable."),
]
Beam = Annotated[
    float | None, typer.Option("--beam", help="Keep l1 + l2 at this length (m): l2 follows from l1 (paper: 14).")
]
EngineOption = Annotated[
    list[str] | None,
    typer.Option("--option", metavar="NAME=VALUE", help="A numerical option of the engine; repeatable."),
]


def names(text: str, what: str) -> list[str]:
    """Split a comma list.

    Raises:
        InputError: the list is empty.
    """
    from ...models.errors import InputError

    found = [part.strip() for part in text.split(",") if part.strip()]
    if not found:
        raise InputError(f"{what} is empty; at least one name is needed.")
    return found


def assignments(texts: list[str] | None, option: str) -> dict[str, str]:
    """NAME=VALUE texts as a mapping.

    Raises:
        InputError: a text has no '=', or a name stands twice.
    """
    from ...models.errors import InputError

    found: dict[str, str] = {}
    for text in texts or []:
        name, separator, value = text.partition("=")
        if not separator or not name.strip() or not value.strip():
            raise InputError(f"{option} {text!r} must have the form NAME=VALUE.")
        if name.strip() in found:
            raise InputError(f"{option} names {name.strip()!r} twice.")
        found[name.strip()] = value.strip()
    return found


def parameters(texts: list[str] | None, beam: float | None) -> TrebuchetParameters | None:
    """Parameters from --set and --beam; None where neither was given.

    Raises:
        InputError: a name is unknown or a value not valid.
    """
    from ...models.errors import InputError
    from ...models.parameters import TrebuchetParameters

    given = assignments(texts, "--set")
    known = list(TrebuchetParameters.model_fields)
    for name in given:
        if name not in known:
            raise InputError(f"--set {name}: there is no such parameter; there are: {', '.join(known)}.")
    numbers = {name: _number(name, value) for name, value in given.items()}
    if beam is None:
        return TrebuchetParameters(**numbers) if numbers else None
    if "l2" in numbers:
        raise InputError("--beam chooses l2 itself; leave out --set l2, or --beam.")
    return TrebuchetParameters.with_beam(numbers.pop("l1", 10.0), beam, **numbers)


def _number(name: str, text: str) -> float:
    from ...models.errors import InputError

    try:
        return float(text)
    except ValueError:
        raise InputError(f"--set {name} = {text!r} is not a number.") from None


def machines(text: str, chosen: TrebuchetParameters | None) -> list[Mechanism]:
    """Mechanisms by name or from files.

    Raises:
        InputError: a name is unknown, or a file cannot be read or is not a mechanism.
    """
    from ...models.errors import InputError
    from ...models.mechanism import Mechanism
    from ...models.registry import model

    found: list[Mechanism] = []
    for name in names(text, "--models"):
        if name.endswith(".json") and chosen is not None:
            raise InputError(f"--set and --beam are for named machines; {name} holds its own values.")
        found.append(Mechanism.load(Path(name)) if name.endswith(".json") else model(name, chosen))
    return found


def engine_options(texts: list[str] | None) -> dict[str, Any]:
    """--option values as JSON where they are JSON, else as text: the engine itself validates them."""
    import json

    options: dict[str, Any] = {}
    for name, value in assignments(texts, "--option").items():
        try:
            options[name] = json.loads(value)
        except json.JSONDecodeError:
            options[name] = value
    return options
