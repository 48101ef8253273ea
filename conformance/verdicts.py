"""Results of a conformance run: a verdict for each check, the file of them, known deviations."""

from __future__ import annotations

import json
import tomllib
from collections import Counter
from collections.abc import Collection, Iterable
from enum import StrEnum
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, StringConstraints

from ..comparisons.runs.results import ResultFile, share_of
from ..engines.registry import engine_class, engine_names
from ..models.errors import InputError
from ..models.files import read_bytes
from ..models.spec import Real, Spec

FORMAT = "trebucheck-conformance-1"
_LARGEST = 1_000_000  # bytes of a file of deviations
_Text = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1)]


class CheckState(StrEnum):
    """State of a check; its text is shown in reports."""

    KEPT = "kept"
    BROKEN = "broken"
    NOT_JUDGED = "not judged"
    """It was compared, and held against no tolerance: that is no success."""
    DEVIATES = "known deviation"
    """It is broken, and the file of deviations says so, with a reason and an owner."""
    SKIPPED = "skipped"


class CheckVerdict(Spec):
    """Verdict on one check of one engine."""

    id: str = Field(description="engine/preset/problem/check")
    state: CheckState
    text: str = Field(default="", description="what is wrong, or why it is skipped")
    subject: str | None = Field(
        default=None, description="marker, coordinate, stop or joint that is worst"
    )
    error: Real | None = Field(default=None, description="largest, of the worst subject")
    unit: str = ""
    tolerance: Real | None = None
    source: str = Field(default="", description="where the tolerance comes from")
    cause: str = Field(default="", description="what accounts for the error, where that is known")
    wall_time: Real | None = Field(
        default=None, description="of the engine's run [s]; of the check 'runs' only"
    )

    @property
    def share(self) -> float | None:
        """Error / tolerance, as of a metric."""
        return share_of(self.error, self.tolerance)

    @property
    def problem(self) -> str:
        """Name of its problem."""
        return self.id.rsplit("/", 2)[1]

    @property
    def check(self) -> str:
        """Name of its check."""
        return self.id.rsplit("/", 1)[1]

    @property
    def failed(self) -> bool:
        """Tell whether it speaks against the engine."""
        return self.state in (CheckState.BROKEN, CheckState.NOT_JUDGED)

    @property
    def complaint(self) -> str:
        """Sentence on the fault, the tolerance and the cause."""
        source = f"tolerance by {self.source}" if self.source else ""
        return "\n".join(filter(None, (self.text, source, self.cause)))

    @property
    def properties(self) -> list[tuple[str, object]]:
        """Properties for a JUnit file."""
        names = ("subject", "error", "unit", "tolerance", "source", "cause", "wall_time")
        values = ((name, getattr(self, name)) for name in names)
        return [(name, value) for name, value in values if value not in (None, "")]


class Conformance(ResultFile):
    """Verdicts on one engine or several."""

    format: Literal["trebucheck-conformance-1"] = FORMAT
    engines: dict[str, str] = Field(description="version by engine/preset")
    supplied: dict[str, dict[str, str] | None] = Field(
        default_factory=dict,
        description="by engine/preset, what trebucheck does in the engine's place; null: it "
        "does not say",
    )
    tier: str
    verdicts: tuple[CheckVerdict, ...]

    @property
    def counts(self) -> Counter[CheckState]:
        """Number of verdicts of each state."""
        return Counter(verdict.state for verdict in self.verdicts)

    @property
    def judged(self) -> int:
        """Number of checks that were not skipped."""
        return len(self.verdicts) - self.counts[CheckState.SKIPPED]

    @property
    def passed(self) -> bool:
        """Tell whether nothing fails and something was kept on a problem."""
        kept = any(v.state is CheckState.KEPT and v.problem != "interface" for v in self.verdicts)
        return kept and not any(verdict.failed for verdict in self.verdicts)


# --- Known deviations


class Deviation(Spec):
    """A row of the file of deviations: checks that are known to fail."""

    id: _Text
    """Id of a check, or a pattern of several: `*`, `?` and `[...]` stand for parts of it."""
    reason: _Text
    owner: _Text

    def covers(self, id: str) -> bool:
        """Tell whether it is about a check."""
        return id == self.id or fnmatchcase(id, self.id)

    @property
    def row_id(self) -> str:
        """Id of the check of this row itself."""
        return f"deviations/file/row/{self.id}"

    def row_verdict(
        self, ids: Iterable[str], verdicts: Iterable[CheckVerdict], labels: Collection[str]
    ) -> CheckVerdict:
        """Verdict on the row: broken if it is about no check, or about none that fails.

        Args:
            ids: of all checks there are of these engines, run or not.
            verdicts: of those that were run, deviations applied.
            labels: engine/preset of these engines; a row of another one says nothing here.
        """
        covered = [verdict for verdict in verdicts if self.covers(verdict.id)]
        state, text = CheckState.KEPT, ""
        if self._is_about_another_engine(labels):
            state, text = CheckState.SKIPPED, ": of an engine that is not run"
        elif not any(map(self.covers, ids)):
            state, text = CheckState.BROKEN, " is about no check that there is"
        elif not covered:
            state, text = CheckState.SKIPPED, ": none of its checks was run"
        elif all(verdict.state is not CheckState.DEVIATES for verdict in covered):
            state, text = CheckState.BROKEN, " is stale: none of its checks fails; take it out"
        text = f"row {self.id!r}{text}" if text else ""
        return CheckVerdict(id=self.row_id, state=state, text=text)

    def _is_about_another_engine(self, labels: Collection[str]) -> bool:
        engine, _, rest = self.id.partition("/")
        preset = rest.partition("/")[0]
        is_run = any(fnmatchcase(label, f"{engine}/{preset}") for label in labels)
        if is_run or engine not in engine_names():
            return False
        try:
            presets = engine_class(engine).presets()
        except Exception:  # of a plug-in that cannot be loaded
            return True
        return any(fnmatchcase(name, preset) for name in presets)


class Deviations(Spec):
    """The whole of a file."""

    deviation: tuple[Deviation, ...] = ()

    @classmethod
    def read(cls, path: Path) -> Deviations:
        """Read TOML (tables [[deviation]]) or JSON ({"deviation": [...]}), by the file's name.

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

    def applied(self, verdict: CheckVerdict) -> CheckVerdict:
        """The verdict; a failure that a row covers becomes a known deviation."""
        row = next((row for row in self.deviation if row.covers(verdict.id)), None)
        if row is None or not verdict.failed:
            return verdict
        text = f"{row.reason} (owner: {row.owner}): {verdict.text}"
        return verdict.model_copy(update={"state": CheckState.DEVIATES, "text": text})
