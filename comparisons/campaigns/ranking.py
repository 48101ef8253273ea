"""Parameters by their effect on the disagreement: the PAWN index, from the runs that are there.

The index is the mean Kolmogorov-Smirnov distance between the distribution of an error when a
parameter is within a small interval, and when it is anywhere: 0 without an effect, at most 1. It
needs no design of its own, and no linear or monotonous dependence. F. Pianosi and T. Wagener,
Distribution-based sensitivity analysis from a generic input-output sample, Environmental Modelling
and Software 108 (2018) 197; computed by SALib. Few machines give a random number an index, too,
which is computed beside those of the parameters: an index that is not clearly larger says nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...models.arrays import FloatArray
from .agreement import Layer

LEAST = 64
"""Machines below which a ranking says nothing."""
_FARTHEST = 12.0  # powers of ten of a share, both ways: an infinite one has one, too
# Intervals of a parameter with few and with many machines: powers of two, whose ends are exact (for
# others SALib 1.6 may ask for a quantile beyond 1)
_FEW, _MANY, _MANY_MACHINES = 4, 8, 128


@dataclass(frozen=True)
class Ranking:
    """Indices of the parameters for the error of one layer."""

    layer: Layer
    indices: Mapping[str, float]
    """Indices by parameter, the largest first."""
    chance: float
    """Index of a random number."""


def ranking(layer: Layer, seed: int = 0) -> Ranking | None:
    """Rank the parameters by their effect on a layer's errors in parts of the tolerance.

    Machines whose run failed or was not judged are left out.

    Args:
        layer: of a campaign.
        seed: of the random number that is ranked beside them.

    Returns:
        The indices; None with fewer than :data:`LEAST` machines, or if all have one error.
    """
    judged = ~np.isnan(layer.share) & ~layer.failed
    varying = _varying(layer, judged)
    with np.errstate(divide="ignore"):
        powers = np.clip(np.log10(layer.share[judged]), -_FARTHEST, _FARTHEST)
    if len(powers) < LEAST or not varying or np.ptp(powers) == 0:
        return None
    from SALib.analyze import pawn  # which takes a second to import

    columns = [*varying.values(), np.random.default_rng(seed).random(len(powers))]
    names = [*varying, "a random number"]
    bounds = [[float(column.min()), float(column.max())] for column in columns]
    problem = {"num_vars": len(names), "names": names, "bounds": bounds}
    intervals = _MANY if len(powers) >= _MANY_MACHINES else _FEW
    found: Any = pawn.analyze(problem, np.stack(columns, axis=1), powers, S=intervals, seed=seed)
    *indices, chance = np.asarray(found["mean"], dtype=float).tolist()
    pairs = sorted(zip(varying, indices, strict=True), key=lambda pair: -pair[1])
    return Ranking(layer, dict(pairs), chance)


def _varying(layer: Layer, judged: Any) -> dict[str, FloatArray]:
    """Values of the parameters that differ among the judged machines of a layer, each (n,)."""
    found: dict[str, FloatArray] = {}
    for name in layer.parameters:
        column = layer.rows[name].to_numpy(dtype=float)[judged]
        if len(column) and np.ptp(column) > 0:
            found[name] = column
    return found
