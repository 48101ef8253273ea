"""Agreement over the parameters: how far each run is within or beyond its tolerance, by quantity.

A share is an error in parts of its tolerance; it is shown by its power of ten, so that the colours
of engines can be set beside each other. What was not judged has no share, and says why.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...models.arrays import FloatArray, IndexArray
from ..runs.quantities import MetricKind
from ..runs.results import COMPARED
from .store import CampaignStore
from .table import column_name, kept_quantities

ALL = "all quantities"
HORIZON = "predictability horizon"
LEVELS = (
    "within 1/100 of its tolerance",
    "within 1/10",
    "within its tolerance",
    "up to 10 times beyond",
    "up to 100 times beyond",
    "farther beyond",
)
"""Levels of a share, in powers of ten: up to 0.01, 0.1, 1, 10, 100, and more."""
HOLDING = 3
"""Number of levels within the tolerance."""
NOT_JUDGED, FAILED = "not judged", "failed or not built"


@dataclass(frozen=True)
class Layer:
    """One quantity of one engine, preset and step over the machines."""

    engine: str
    preset: str
    timestep: float | None  # [s], where several are compared
    quantity: str
    share: FloatArray
    """Error in parts of the tolerance, (n,); NaN where it was not judged."""
    failed: Any
    """Whether the run failed, or was not built, (n,)."""
    rows: Any
    """Rows of the table, n of them, as a `pandas.DataFrame`."""
    parameters: tuple[str, ...] = ()
    """Columns that hold the machines' values."""

    @property
    def levels(self) -> IndexArray:
        """Places in :data:`LEVELS`, (n,); -1 where it was not judged, -2 where the run failed."""
        with np.errstate(divide="ignore", invalid="ignore"):
            level = np.clip(np.ceil(np.log10(self.share)) + 2, 0, len(LEVELS) - 1)
        found = np.where(np.isnan(self.share), -1, np.nan_to_num(level)).astype(np.int64)
        return np.where(self.failed, -2, found)


def layers(store: CampaignStore) -> Iterator[Layer]:
    """Shares of each engine, preset and step: of all quantities together, and then of each."""
    runs = store.campaign.runs
    assert runs is not None
    table = store.to_pandas()
    kept = [kind for kind in kept_quantities(store.campaign) if _is_judged(table, kind)]
    names = tuple(store.campaign.machines.values)
    compared = [outcome.value for outcome in COMPARED]
    steps: list[float | None] = list(runs.timesteps) or [None]
    for engine in runs.engines:
        of_engine = table[table["engine"] == engine]
        for preset in dict.fromkeys(of_engine["preset"]):
            for step in steps:
                chosen = of_engine["preset"] == preset
                if step is not None:
                    chosen &= of_engine["timestep"] == step
                rows = of_engine[chosen]
                if not len(rows):
                    continue
                failed = ~rows["outcome"].isin(compared).to_numpy(dtype=bool)
                place = engine, preset, step
                whole = rows["share"].to_numpy(dtype=float)
                yield Layer(*place, ALL, whole, failed, rows, names)
                for kind in kept:
                    yield Layer(*place, kind.words, _share(rows, kind), failed, rows, names)


def _is_judged(table: Any, kind: MetricKind) -> bool:
    return bool(table[column_name(kind, "tolerance")].notna().any())


def _share(rows: Any, kind: MetricKind) -> FloatArray:
    error = rows[column_name(kind, "error")].to_numpy(dtype=float)
    tolerance = rows[column_name(kind, "tolerance")].to_numpy(dtype=float)
    missing = np.isnan(error) & ~np.isnan(tolerance)
    return np.where(missing, np.inf, np.abs(error) / tolerance)
