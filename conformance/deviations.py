"""Known deviations: a file in which each row has a reason and an owner, and none may outlive what it is about."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterable, Iterator
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Any

from pydantic import StringConstraints

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
        try:
            return cls(**parsed)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None

    def applied(self, verdict: Verdict) -> Verdict:
        """The verdict; of a failure that a row covers, that it is a known deviation."""
        row = next((row for row in self.deviation if row.covers(verdict.id)), None)
        if row is None or not verdict.failed:
            return verdict
        return verdict.model_copy(update={"state": State.DEVIATES, "text": f"{row.text}: {verdict.text}"})

    def of_rows(self, ids: Iterable[str], verdicts: Iterable[Verdict]) -> Iterator[Verdict]:
        """A verdict on each row: broken if it is about no check, or about none that fails.

        Args:
            ids: of all checks there are of these engines, run or not.
            verdicts: of those that were run, rows applied.
        """
        every, found = tuple(ids), tuple(verdicts)
        for row in self.deviation:
            yield Verdict(id=f"deviations/file/row/{row.id}", **_of_row(row, every, found))


def _of_row(row: Deviation, ids: tuple[str, ...], verdicts: tuple[Verdict, ...]) -> dict[str, Any]:
    if not any(map(row.covers, ids)):
        return {"state": State.BROKEN, "text": f"row {row.id!r} is about no check that there is"}
    own = [verdict for verdict in verdicts if row.covers(verdict.id)]
    if not own:
        return {"state": State.SKIPPED, "text": f"row {row.id!r}: none of its checks was run"}
    if all(verdict.state is not State.DEVIATES for verdict in own):
        return {"state": State.BROKEN, "text": f"row {row.id!r} is stale: none of its checks fails; take it out"}
    return {"state": State.KEPT}
