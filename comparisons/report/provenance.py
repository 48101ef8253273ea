"""The end of every page: software, settings of the runs, and the mechanisms as data."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Protocol

from ...models.mechanism import Mechanism
from .document import Block, Code, Fold, Heading, Note, page_only, table, words
from .numbers import format_settings


class _Result(Protocol):
    @property
    def trebucheck_version(self) -> str: ...
    @property
    def python_version(self) -> str: ...
    @property
    def platform(self) -> str: ...


class _Run(Protocol):
    @property
    def label(self) -> str: ...
    @property
    def engine_version(self) -> str: ...
    @property
    def settings(self) -> Mapping[str, object]: ...


def provenance(
    result: _Result, runs: Iterable[tuple[str, _Run]], mechanisms: Sequence[tuple[str, Mechanism]]
) -> tuple[Block, ...]:
    """Versions, the settings of each run with the name of its machine, and each machine's mechanism."""
    software = f"trebucheck {result.trebucheck_version}, Python {result.python_version}, {result.platform}."
    rows = [(model, run.label, run.engine_version, format_settings(run.settings)) for model, run in runs]
    columns = (words("machine", wrap=False), words("engine", wrap=False), words("version"), words("settings"))
    return (
        Heading("Provenance", 2),
        Note(software),
        page_only(table(columns, rows, "Settings of every run")),
        *(mechanism_as_data(model, mechanism) for model, mechanism in mechanisms),
    )


def mechanism_as_data(model: str, mechanism: Mechanism) -> Fold:
    """A mechanism's JSON behind its hash."""
    title = f"{model}: the mechanism as JSON, hash {mechanism.content_hash[:16]}"
    return Fold(title, (Code("", mechanism.to_json()),))
