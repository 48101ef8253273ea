"""What a file may give of a motion: quantities by name, with the units they may be in."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches

from ...models.errors import InputError
from ...models.mechanism import Mechanism

_ANGLE = {"rad": 1.0, "deg": math.pi / 180}
_LENGTH = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "km": 1e3}
_TIME = {"s": 1.0, "ms": 1e-3}
_FORCE = {"N": 1.0, "kN": 1e3}
_TORQUE = {"N m": 1.0, "kN m": 1e3}
_ENERGY = {"J": 1.0, "kJ": 1e3}
TIME = "t"


def _rates(units: Mapping[str, float]) -> dict[str, float]:
    return {f"{unit}/s": value for unit, value in units.items()}


@dataclass(frozen=True)
class Kind:
    """A column that a file may have."""

    name: str
    units: Mapping[str, float]
    """SI value of each unit it may be in."""

    def factor(self, unit: str) -> float:
        """SI value of a unit.

        Raises:
            InputError: it is not one of its units.
        """
        if unit not in self.units:
            given = f"the unit [{unit[:30]}]" if unit else "no unit"
            raise InputError(
                f"column {self.name!r} has {given}; there are: {', '.join(f'[{u}]' for u in self.units)}"
            )
        return self.units[unit]


def columns_of(mechanism: Mechanism) -> dict[str, Kind]:
    """Every column that a file on a mechanism may have, by name; those of a data frame of a trajectory, and no more."""
    kinds = [Kind(TIME, _TIME), Kind("kinetic energy", _ENERGY), Kind("potential energy", _ENERGY)]
    for name in mechanism.coordinates:
        units = _ANGLE if name in mechanism.angles else _LENGTH
        kinds += [Kind(f"q {name}", units), Kind(f"u {name}", _rates(units))]
    for marker in mechanism.markers:
        for axis in "xy":
            kinds += [
                Kind(f"{marker.name} {axis}", _LENGTH),
                Kind(f"{marker.name} v{axis}", _rates(_LENGTH)),
            ]
    for stop in mechanism.stops:
        kinds.append(Kind(f"stop {stop.name}", _TORQUE if stop.effort == "torque" else _FORCE))
    for joint in mechanism.joints:
        kinds += [
            Kind(f"joint {joint.name} {axis}", _FORCE) for axis in "xy" if joint.held_directions
        ]
    return {kind.name: kind for kind in kinds}


def split_heading(heading: str) -> tuple[str, str]:
    """Name and unit of 'q theta [rad]'; without brackets no unit."""
    name, bracket, rest = heading.strip().partition("[")
    return " ".join(name.split()), rest.partition("]")[0].strip() if bracket else ""


def known(name: str, columns: Mapping[str, Kind]) -> Kind:
    """The column of that name.

    Raises:
        InputError: there is none; the sentence lists those there are.
    """
    if name in columns:
        return columns[name]
    close = get_close_matches(name, columns, n=1)
    hint = f" (did you mean {close[0]!r}?)" if close else ""
    raise InputError(f"there is no column {name[:60]!r}{hint}; there are: {', '.join(columns)}")
