"""Two campaigns of the same machines: which verdicts changed, and which errors moved.

Runs belong together by mechanism, engine, preset and step; versions may differ, which is what it is
for. An error has moved if it changed by more than a factor and is not below the rounding that both
tolerances are far above.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from ...models.errors import InputError
from ...models.shown import Reported
from ..diff import FACTOR, RANKS, refuse_no_factor
from ..runs.quantities import MetricKind
from ..runs.results import Outcome
from .store import CampaignStore
from .table import column_name, kept_quantities

_NEGLIGIBLE = 1e-6  # of its tolerance: an error below says nothing of the engine
_KEYS = ["mechanism", "engine", "preset", "timestep"]
_NOT_BUILT = 3.5  # rank: worse than another model, better than a failure
_RANKS = {outcome.value: RANKS.get(outcome, _NOT_BUILT) for outcome in Outcome}


@dataclass(frozen=True, repr=False)
class CampaignDifference(Reported):
    """Runs of two campaigns beside each other."""

    old: CampaignStore
    new: CampaignStore
    factor: float
    runs: Any
    """A `pandas.DataFrame` with a row a run that is in both: its keys, `outcome_old` and
    `outcome_new`, `worse` (1 worse, 0 the same, -1 better), and for each quantity its factor."""
    only_old: int
    """Runs that are in the old campaign alone."""
    only_new: int
    quantities: tuple[MetricKind, ...]

    def headline(self) -> str:
        """Tell how many verdicts changed."""
        return (
            f"{len(self.runs)} runs are in both: {len(self.worse)} verdicts are worse, "
            f"{len(self.better)} better; {self.only_old} runs are missing in the new campaign, "
            f"{self.only_new} are new"
        )

    def rows(self) -> Iterator[dict[str, object]]:
        """Runs that are in both."""
        yield from self.runs.to_dict("records")

    @property
    def worse(self) -> Any:
        """Runs whose verdict is worse."""
        return self.runs[self.runs["worse"] > 0]

    @property
    def better(self) -> Any:
        """Runs whose verdict is better."""
        return self.runs[self.runs["worse"] < 0]

    @property
    def passed(self) -> bool:
        """No verdict is worse, and no run is missing."""
        return not len(self.worse) and not self.only_old and len(self.runs) > 0

    def moved(self, kind: MetricKind) -> tuple[int, int]:
        """Numbers of runs in which a quantity's error has grown, and has fallen."""
        factors = self.runs[kind.title].to_numpy(dtype=float)
        with np.errstate(invalid="ignore"):
            return int(np.sum(factors > self.factor)), int(np.sum(factors < 1 / self.factor))


def difference(
    old: CampaignStore, new: CampaignStore, factor: float = FACTOR
) -> CampaignDifference:
    """Compare two campaigns run by run.

    Args:
        old: the campaign of before.
        new: the campaign of now.
        factor: by which an error must change to have moved.

    Raises:
        InputError: one has no runs of engines, or they have no machine in common.
    """
    for store in (old, new):
        if store.campaign.runs is None:
            raise InputError(f"{store.folder} holds launches, not runs of engines.")
    refuse_no_factor(factor)
    kept = {kind.title: kind for kind in kept_quantities(old.campaign)}
    others = {kind.title for kind in kept_quantities(new.campaign)}
    quantities = tuple(kind for title, kind in kept.items() if title in others)
    tables = [_read(store, quantities) for store in (old, new)]
    joined: Any = pd.merge(
        *tables, on=_KEYS, how="outer", suffixes=("_old", "_new"), indicator="where"
    )
    both: Any = joined[joined["where"] == "both"]
    if not len(both):
        raise InputError(f"{old.folder} and {new.folder} have no run in common.")
    found: Any = both[[*_KEYS, "outcome_old", "outcome_new"]].copy()
    ranks = [both[f"outcome_{which}"].map(_RANKS).to_numpy() for which in ("old", "new")]
    found["worse"] = np.sign(ranks[1] - ranks[0]).astype(int)
    for kind in quantities:
        found[kind.title] = _factors(both, kind)
    where: list[str] = joined["where"].tolist()
    return CampaignDifference(
        old,
        new,
        factor,
        found.reset_index(drop=True),
        where.count("left_only"),
        where.count("right_only"),
        quantities,
    )


def _read(store: CampaignStore, quantities: tuple[MetricKind, ...]) -> Any:
    """Rows of a campaign, each run once: a design may have the same machine several times."""
    values = list(store.campaign.machines.values)
    columns = [*_KEYS, "outcome", "machine", *values]
    for kind in quantities:
        columns += [column_name(kind, "error"), column_name(kind, "tolerance")]
    table = store.to_pandas(columns).astype({"engine": str, "preset": str, "outcome": str})
    # One that could not be built has no hash: it is known by what it would be built of
    machines = store.campaign.machines
    of_family = f"family of seed {store.campaign.seed}, machine " + table["machine"].astype(str)
    named: Any = of_family if machines.family is not None else _texts(table, values)
    table["mechanism"] = table["mechanism"].where(table["mechanism"].notna(), named)
    return table.drop(columns=["machine", *values]).drop_duplicates(_KEYS)


def _texts(table: Any, values: Sequence[str]) -> Any:
    """Values of the machines, each as a text."""
    return pd.Series(
        [
            ", ".join(f"{name} = {value!r}" for name, value in zip(values, row, strict=True))
            for row in table[values].itertuples(index=False)
        ],
        index=table.index,
    )


def _factors(both: Any, kind: MetricKind) -> Any:
    """New error over old one, each at least negligible; NaN where one has none."""
    error, tolerance = column_name(kind, "error"), column_name(kind, "tolerance")
    sizes: list[Any] = []
    for which in ("old", "new"):
        least = _NEGLIGIBLE * both[f"{tolerance}_{which}"].fillna(0.0)
        sizes.append(np.maximum(both[f"{error}_{which}"].abs(), least))
    with np.errstate(divide="ignore", invalid="ignore"):
        return sizes[1] / sizes[0]
