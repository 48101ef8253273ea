"""Machines of the episodes: one mechanism, or parameters drawn around a named machine's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.random import Generator
from trebucheck.api.mechanics import (
    InputError,
    Mechanism,
    SimulationError,
    Spec,
    model,
    parameters_type,
)

from .best_throw import BestThrow, best_throw

_DRAWS = 20  # until a machine throws forwards
_GRAVITY = "g"  # a parameter that no builder of machines chooses


@dataclass(frozen=True)
class Machine:
    """One machine, what it can throw, and the parameters that it was built from, if it has any."""

    mechanism: Mechanism
    parameters: Mapping[str, float]
    best: BestThrow


@dataclass(frozen=True)
class Machines:
    """Machines around a named one; or a mechanism, which is the only one.

    Raises:
        InputError: nothing has that name, a parameter or the spread is not valid, or a mechanism
            has either.
    """

    given: str | Mechanism
    parameters: Mapping[str, float]
    spread: float
    """Lengths and masses are drawn evenly between 1 - spread and 1 + spread of their values."""

    def __post_init__(self) -> None:
        if not (is_number(self.spread) and 0 <= self.spread < 1):
            raise InputError(f"spread = {self.spread!r} must be at least 0 and less than 1.")
        _refuse_others(self.given)
        if isinstance(self.given, Mechanism) and (self.parameters or self.spread):
            raise InputError(
                f"model = {self.given.name!r} is a mechanism as it is: it needs spread = 0 and no "
                f"parameters, not spread = {self.spread!r} and parameters = "
                f"{dict(self.parameters)!r}."
            )

    def nominal(self) -> Machine:
        """The machine that is not drawn.

        Raises:
            InputError: as :func:`.best_throw.best_throw`.
            SimulationError: the reference cannot move it.
        """
        if isinstance(self.given, Mechanism):
            return Machine(self.given, {}, best_throw(self.given))
        return _built(self.given, parameters_type(self.given)(**self.parameters))

    def draw(self, random: Generator) -> Machine:
        """One that throws forwards, parameters that were given included among those drawn.

        Raises:
            InputError: there is none among many.
        """
        if not self.spread or not isinstance(self.given, str):
            return self.nominal()
        kind = parameters_type(self.given)
        middle, reasons = kind(**self.parameters), list[str]()
        for _ in range(_DRAWS):
            factors = {
                name: random.uniform(1 - self.spread, 1 + self.spread) for name in _sizes(kind)
            }
            drawn = {name: getattr(middle, name) * factor for name, factor in factors.items()}
            try:
                return _built(self.given, kind(**{**dict(middle), **drawn}))
            except (InputError, SimulationError) as error:
                reasons.append(str(error))
        raise InputError(
            f"spread = {self.spread!r}: none of {_DRAWS} machines drawn throws; the last: "
            f"{reasons[-1]}"
        )


def is_number(value: object) -> bool:
    """Tell whether something is a finite number."""
    return (
        isinstance(value, int | float | np.number)
        and not isinstance(value, bool)
        and bool(np.isfinite(value))
    )


def checked_mapping(name: str, given: object) -> dict[str, Any]:
    """Mapping that was given by name, or an empty one.

    Raises:
        InputError: it is no mapping.
    """
    if not isinstance(given, Mapping | None):
        raise InputError(f"{name} = {given!r} must be a mapping of names to values, or None.")
    return dict(cast("Mapping[str, Any]", given or {}))


def _refuse_others(given: object) -> None:
    if not isinstance(given, str | Mechanism):
        raise InputError(f"model = {given!r} must be a machine's name or a mechanism.")


def _built(name: str, parameters: Spec) -> Machine:
    mechanism = model(name, parameters)
    values: dict[str, Any] = dict(parameters)
    return Machine(mechanism, values, best_throw(mechanism))


def _sizes(kind: type[Spec]) -> list[str]:
    """Names of the lengths and masses: what must be positive, but for gravity."""
    return [
        name
        for name, field in kind.model_fields.items()
        if name != _GRAVITY and any(getattr(rule, "gt", None) == 0 for rule in field.metadata)
    ]
