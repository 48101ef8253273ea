"""Known deviations: a file in which each row has a reason and an owner, and none may outlive what it is about."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Collection, Iterable, Iterator
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Any

from pydantic import StringConstraints

from ..engines.registry import engine_class, engine_names
from ..models.errors import InputError
from ..models.files import read_bytes
from ..models.spec import Spec
from .verdicts import State, Verdict

_Told = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1)]
_LARGEST = 1_000_000


class Deviation(Spec):
    """A row: checks that are known to fail."""

    id: _Told
    """Of a check, or a pattern of several: `*`, `?` and `[...]` stand for parts of it."""
    reason: _Told
    owner: _Told

    def covers(self, id: str) -> bool:
        """Whether a check is among its own."""
        return id == self.id or fnmatchcase(id, self.id)

    def of_another_engine(self, labels: Collection[str]) -> str:
        """Why it is not about these engines (engine/preset), if it is about another one that there is."""
        engine, _, rest = self.id.partition("/")
        preset = rest.partition("/")[0]
        if (
            any(fnmatchcase(label, f"{engine}/{preset}") for label in labels)
            or engine not in engine_names()
        ):
            return ""
        try:
            presets = engine_class(engine).presets()
        except Exception:  # of a plug-in that cannot be loaded
            return "of an engine that is not run"
        return (
            "of an engine that is not run"
            if any(fnmatchcase(each, preset) for each in presets)
            else ""
        )

    @property
    def text(self) -> str:
        """Reason and owner."""
        return f"{self.reason} (owner: {self.owner})"


class Deviations(Spec):
    """The whole of a file."""

    deviation: tuple[Deviation, ...] = ()

    @classmethod
    def read(cls, path: Path) -> Deviations:
        """From TOML (tables [[deviation]]) or JSON ({"deviation": [...]}), by the file's name.

        Raises:
            InputError: it cannot be read, or a row lacks its id, reason or owner.
        """
        content = read_bytes(path, _LARGEST).decode(errors="replace")
        try:
            parsed: Any = json.loads(content) if path.suffix == ".json" else tomllib.loads(content)
        except (ValueError, RecursionError) as error:
            raise InputError(f"{path} cannot be read: {error}.") from None
        if not isinstance(parsed, dict):
            raise InputError(f"{path} must hold rows 'deviation', each with id, reason and owner.")
        if isinstance(parsed.get("deviation"), dict):
            raise InputError(
                f"{path}: deviation is one table; a list of them is needed: [[deviation]] in TOML."
            )
        try:
            return cls(**parsed)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None

    def applied(self, verdict: Verdict) -> Verdict:
        """The verdict; of a failure that a row covers, that it is a known deviation."""
        row = next((row for row in self.deviation if row.covers(verdict.id)), None)
        if row is None or not verdict.failed:
            return verdict
        return verdict.model_copy(
            update={"state": State.DEVIATES, "text": f"{row.text}: {verdict.text}"}
        )

    def of_rows(
        self, ids: Iterable[str], verdicts: Iterable[Verdict], labels: Collection[str]
    ) -> Iterator[Verdict]:
        """A verdict on each row: broken if it is about no check, or about none that fails.

        Args:
            ids: of all checks there are of these engines, run or not.
            verdicts: of those that were run, rows applied.
            labels: engine/preset of these engines; rows of others that there are say nothing here.
        """
        every, found = tuple(ids), tuple(verdicts)
        for row in self.deviation:
            other = row.of_another_engine(labels)
            skipped = {"state": State.SKIPPED, "text": f"row {row.id!r}: {other}"}
            state: dict[str, Any] = skipped if other else _of_row(row, every, found)
            yield Verdict(id=f"deviations/file/row/{row.id}", **state)


def _of_row(row: Deviation, ids: tuple[str, ...], verdicts: tuple[Verdict, ...]) -> dict[str, Any]:
    if not any(map(row.covers, ids)):
        return {"state": State.BROKEN, "text": f"row {row.id!r} is about no check that there is"}
    own = [verdict for verdict in verdicts if row.covers(verdict.id)]
    if not own:
        return {"state": State.SKIPPED, "text": f"row {row.id!r}: none of its checks was run"}
    if all(verdict.state is not State.DEVIATES for verdict in own):
        return {
            "state": State.BROKEN,
            "text": f"row {row.id!r} is stale: none of its checks fails; take it out",
        }
    return {"state": State.KEPT}
