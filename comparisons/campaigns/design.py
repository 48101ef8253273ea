"""Designs: the values of a campaign's parameters, made in parts of any size.

Designs are those of :mod:`scipy.stats.qmc`. The values of machine k are the same in whatever parts
they are asked for, so that a campaign can be cut into chunks and taken up again.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ...models.arrays import BoolArray, FloatArray, IndexArray
from ...models.errors import InputError
from .spec import Campaign, Interval, Machines

_BLOCK = 4096
"""Points that are made together; a power of two, as Sobol's sequence asks for."""


@dataclass(frozen=True)
class DesignPart:
    """Machines of a design, and their values."""

    numbers: IndexArray
    """(n,)"""
    values: Mapping[str, FloatArray]
    """Values of each parameter, (n,)."""

    def __len__(self) -> int:
        """Number of machines."""
        return len(self.numbers)

    def rows(self) -> list[dict[str, Any]]:
        """Number and values of each machine."""
        columns = {name: column.tolist() for name, column in self.values.items()}
        return [
            {"machine": int(number)} | {name: column[k] for name, column in columns.items()}
            for k, number in enumerate(self.numbers)
        ]

    def each(self) -> Iterator[DesignPart]:
        """Each machine alone."""
        for k in range(len(self)):
            at = slice(k, k + 1)
            yield DesignPart(self.numbers[at], {name: c[at] for name, c in self.values.items()})


class Design:
    """Values of the parameters of a campaign's machines, by the number of the machine.

    Raises:
        InputError: a condition of `where` cannot be read, or is not one of the values.
    """

    def __init__(self, campaign: Campaign) -> None:
        self._machines: Machines = campaign.machines
        self._seed = campaign.seed
        self._kept = (-1, np.zeros((0, 0)))
        if self._machines.where:
            self.columns(0, 1)

    @cached_property
    def size(self) -> int:
        """Number of machines, those that `where` leaves out among them."""
        if self._machines.number is not None:
            return self._machines.number
        return math.prod(self._sizes)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters that are given a value."""
        return tuple(self._machines.values)

    @cached_property
    def _sizes(self) -> tuple[int, ...]:
        """Numbers of values of each parameter on a grid."""
        sizes: list[int] = []
        for value in self._machines.values.values():
            if isinstance(value, Interval):
                sizes.append(value.steps or 1)
            else:
                sizes.append(len(value) if isinstance(value, tuple) else 1)
        return tuple(sizes)

    def part(self, first: int, last: int) -> DesignPart:
        """Machines first, ..., last - 1, without those that `where` leaves out.

        Raises:
            InputError: as :meth:`columns`.
        """
        columns, kept = self.columns(first, last)
        numbers = np.arange(first, first + len(kept))[kept]
        return DesignPart(numbers, {name: column[kept] for name, column in columns.items()})

    def columns(self, first: int, last: int) -> tuple[Mapping[str, FloatArray], BoolArray]:
        """Values of machines first, ..., last - 1, and whether `where` keeps each.

        Raises:
            InputError: a condition of `where` cannot be read.
        """
        last = min(last, self.size)
        if not self.names:
            return {}, np.ones(last - first, dtype=bool)
        shares = self._shares(first, last)
        columns: dict[str, FloatArray] = {}
        for (name, value), share in zip(self._machines.values.items(), shares.T, strict=True):
            if isinstance(value, Interval):
                columns[name] = _within(value, share)
            else:
                choices = np.atleast_1d(np.asarray(value, dtype=np.float64))
                places = np.minimum(share * len(choices), len(choices) - 1).astype(int)
                columns[name] = choices[places]
        kept = np.ones(last - first, dtype=bool)
        for condition in self._machines.where:
            kept &= _holds(condition, columns)
        return columns, kept

    def _shares(self, first: int, last: int) -> FloatArray:
        """Places within the intervals, from 0 to 1, of machines first to last - 1."""
        if self._machines.design == "grid":
            places = np.unravel_index(np.arange(first, last), self._sizes)
            columns: list[FloatArray] = []
            for place, size, value in zip(
                places, self._sizes, self._machines.values.values(), strict=True
            ):
                # The ends of an interval are values of a grid, and the middles of a list's parts
                spread = max(size - 1, 1) if isinstance(value, Interval) else size
                offset = 0.0 if isinstance(value, Interval) else 0.5
                columns.append((place + offset) / spread)
            return np.stack(columns, axis=1)
        if self._machines.design == "latin-hypercube":
            return self._hypercube[first:last]
        parts: list[FloatArray] = []
        for block in range(first // _BLOCK, -(-last // _BLOCK)):
            low, high = max(first - block * _BLOCK, 0), min(last - block * _BLOCK, _BLOCK)
            parts.append(self._block(block)[low:high])
        return np.concatenate(parts)

    # scipy.stats takes three quarters of a second to import, of which the processes that are sent
    # their machines have no need.

    @cached_property
    def _hypercube(self) -> FloatArray:
        from scipy.stats import qmc

        return qmc.LatinHypercube(len(self.names), rng=self._seed).random(self.size)

    def _block(self, block: int) -> FloatArray:
        """A block of points, kept until another one is asked for."""
        if self._kept[0] != block:
            self._kept = block, self._new_block(block)
        return self._kept[1]

    def _new_block(self, block: int) -> FloatArray:
        if self._machines.design == "random":
            return np.random.default_rng([self._seed, block]).random((_BLOCK, len(self.names)))
        from scipy.stats import qmc

        sequence = qmc.Sobol(len(self.names), rng=self._seed)
        if block:
            sequence.fast_forward(block * _BLOCK)
        return sequence.random(_BLOCK)


def _within(interval: Interval, share: FloatArray) -> FloatArray:
    """Values at places from 0 to 1 within an interval; its ends are met exactly."""
    low, high = interval.min, interval.max
    values = low + (high - low) * share
    if interval.scale == "log":
        values = low * (high / low) ** share
    return np.where(share == 0, low, np.where(share == 1, high, values))


def _holds(condition: str, columns: Mapping[str, FloatArray]) -> BoolArray:
    """Tell for each machine whether a condition on its values holds.

    Names with a dot or a space stand in backticks, as pandas reads them.

    Raises:
        InputError: it cannot be read, names what is no value, or is neither true nor false.
    """
    import pandas as pd

    table = pd.DataFrame(dict(columns))
    try:
        holds = np.asarray(table.eval(condition, engine="python"))
    except Exception as error:  # pandas raises what Python does, and errors of its own
        raise InputError(
            f"machines.where = {condition!r} cannot be read ({error}); a condition on "
            f"{', '.join(columns)} is needed, such as '{next(iter(columns))} > 1'."
        ) from None
    if holds.dtype != bool:
        raise InputError(f"machines.where = {condition!r} is neither true nor false.")
    return np.broadcast_to(holds, (len(table),))
