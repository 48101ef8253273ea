"""The end of every page: software, settings of the runs, and the mechanisms as data."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from ...models.mechanism import Mechanism
from ..runs.results import ResultFile
from .document import Block, Code, Fold, Heading, Note, table
from .numbers import format_settings

Settings = tuple[str, str, str, Mapping[str, object]]
"""Machine, engine (and what else names the run), version, and settings."""


def provenance(
    result: ResultFile, runs: Iterable[Settings], mechanisms: Sequence[tuple[str, Mechanism]]
) -> tuple[Block, ...]:
    """Versions, the settings of each run, and each machine's mechanism."""
    software = f"trebucheck {result.trebucheck_version}, Python {result.python_version}, {result.platform}."
    rows = [(model, label, version, format_settings(settings)) for model, label, version, settings in runs]
    return (
        Heading("Provenance", 2),
        Note(software),
        table("machine | engine | version | settings", rows, "Settings of every run", "page"),
        *(mechanism_as_data(model, mechanism) for model, mechanism in mechanisms),
    )


def mechanism_as_data(model: str, mechanism: Mechanism) -> Fold:
    """A mechanism's JSON behind its hash."""
    title = f"{model}: the mechanism as JSON, hash {mechanism.content_hash[:16]}"
    return Fold(title, (Code("", mechanism.to_json()),))
