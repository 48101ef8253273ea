"""The most efficient machine of each kind within bounds: fulcrum and sling chosen, and the start where it is not given.

The paper cites machines without their lengths. What it says of them can only be held against all such machines
within stated bounds, at the paper's masses and length of arm.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ...models.arrays import FloatArray
from ...models.errors import EngineNotInstalledError
from ...models.machines.registry import model, parameters_type
from ...models.mechanism import Mechanism
from .energy import available_energy, kinetic_energy, potential_energy, thrown_mass
from .slings import SLINGS, Launched, launches

BOUNDS: dict[str, tuple[float, float]] = {"l1": (7.0, 13.0), "r": SLINGS, "theta0": (1.7, 2.6)}
"""Arm on the sling's side [m], sling [m], start of an arm that begins backward [rad]: 30 to 82 deg below level."""

_FIRST = {"l1": 7, "r": 9, "theta0": 5}  # places at first: a metre, 1.5 m and 13 deg apart
_LOOKS = 3  # closer ones, a place to each side of the best: spacings become 4 cm, 6 cm and 0.5 deg
_BESIDE, _CLOSER = 1, 3.0
_DURATION = 5.0  # [s] in which machines of this size launch
_BACKWARD = 1.0  # [rad] a start beyond this is one of an arm that begins backward


@dataclass(frozen=True)
class Widest:
    """The most efficient machine that was found."""

    chosen: dict[str, float]
    """By the names of :data:`BOUNDS`."""
    mechanism: Mechanism
    thrown: Launched
    efficiency: float


def most_efficient(name: str) -> Widest | None:
    """Of all named machines within the bounds; None where none launches, or there is no integrator for so many."""
    grid = {key: np.linspace(*BOUNDS[key], _FIRST[key]) for key in _free(name)}
    spacing = {key: float(values[1] - values[0]) for key, values in grid.items()}
    lowest: dict[float, float] = {}
    try:
        best = _best(name, grid, lowest)
        for _ in range(_LOOKS):
            if best is None:
                return None
            spacing = {key: step / _CLOSER for key, step in spacing.items()}
            closer = _best(name, {key: _around(key, best.chosen[key], step) for key, step in spacing.items()}, lowest)
            best = max((best, closer or best), key=lambda each: each.efficiency)
    except EngineNotInstalledError:
        return None
    return best


def _free(name: str) -> list[str]:
    """What may be chosen: the start only of machines whose arm begins backward, which the paper does not describe."""
    fields = parameters_type(name).model_fields
    start = fields["theta0"].default
    return [key for key in BOUNDS if key in fields and (key != "theta0" or start > _BACKWARD)]


def _around(key: str, middle: float, step: float) -> FloatArray:
    places = middle + step * np.arange(-_BESIDE, _BESIDE + 1, dtype=np.float64)
    return np.unique(np.clip(places, *BOUNDS[key]))


def _best(name: str, grid: dict[str, FloatArray], lowest: dict[float, float]) -> Widest | None:
    places = [
        dict(zip(grid, values, strict=True)) for values in itertools.product(*(g.tolist() for g in grid.values()))
    ]
    machines = [_machine(name, place) for place in places]
    throws = launches(machines, _DURATION, alone=False)
    found = list(_rated(places, machines, throws, lowest))
    return max(found, key=lambda each: each.efficiency, default=None)


def _machine(name: str, place: dict[str, float]) -> Mechanism:
    """At the given machine's length of arm."""
    kind = parameters_type(name)
    beam = kind.model_fields["l1"].default + kind.model_fields["l2"].default
    return model(name, kind(**place, l2=beam - place["l1"]))


def _rated(
    places: Sequence[dict[str, float]],
    machines: Sequence[Mechanism],
    throws: Iterable[Launched],
    lowest: dict[float, float],
) -> Iterable[Widest]:
    """Efficiencies of those that launch.

    The lowest position of all does not depend on the start, and a sling hangs straight down in it: one search serves
    all machines of one l1, and `lowest` keeps what it found.
    """
    for place, machine, thrown in zip(places, machines, throws, strict=True):
        if not thrown.speed > 0:
            continue
        top, hanging = potential_energy(machine), thrown_mass(machine) * machine.gravity * place.get("r", 0.0)
        l1 = place["l1"]
        if l1 not in lowest:
            lowest[l1] = top - available_energy(machine) + hanging
        available = top - (lowest[l1] - hanging)
        yield Widest(place, machine, thrown, kinetic_energy(machine, thrown.speed) / available)
