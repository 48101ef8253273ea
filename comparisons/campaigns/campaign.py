"""Campaigns as functions: run one, open one, compare two."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...models.errors import InputError
from ..runs.study import Progress
from .spec import Campaign

if TYPE_CHECKING:
    from .store import CampaignStore


def campaign(
    given: Campaign | Mapping[str, Any] | str | Path,
    out: str | Path,
    *,
    jobs: int | None = None,
    cluster: Any = None,
    progress: Progress | None = None,
    command: str | None = None,
) -> CampaignStore:
    """Run a campaign, or what is missing of it, into a folder.

    Args:
        given: path of a TOML file, its fields, or a :class:`.spec.Campaign`.
        out: folder of the store; one that holds a part of the same campaign is completed.
        jobs: chunks that are made at once, each in a process; as many as cores are idle by default.
        cluster: Dask cluster that makes them instead, as :func:`.cluster` takes it.
        progress: called with what was made, the number of chunks done, and of all.
        command: command line that makes it again.

    Returns:
        The store; `to_pandas()` reads its rows.

    Raises:
        InputError: the description is not valid, or the folder holds another campaign or one of
            other versions, or pyarrow is not installed. A run that fails raises nothing: it is a
            failed row.
        StudyEndedError: the folder cannot be written to, or the cluster is lost; what was finished
            is kept.
    """
    _refuse_without_arrow()
    from .run import run

    if isinstance(given, str | Path):
        given = Campaign.read(given)
    elif not isinstance(given, Campaign):
        given = Campaign.of(given)
    return run(given, Path(out), jobs=jobs, cluster=cluster, progress=progress, command=command)


def open_campaign(folder: str | Path) -> CampaignStore:
    """Open the store of a campaign, which may still be growing.

    Raises:
        InputError: the folder holds none, or pyarrow is not installed.
    """
    _refuse_without_arrow()
    from .store import CampaignStore

    return CampaignStore.open(folder)


def _refuse_without_arrow() -> None:
    if importlib.util.find_spec("pyarrow") is None:
        raise InputError(
            "a campaign needs pyarrow, which is not installed here; "
            "`pip install trebucheck[campaign]` brings it."
        )
