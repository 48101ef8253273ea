"""Results of a conformance run: a verdict for each check, and the file that holds them."""

from __future__ import annotations

from collections import Counter
from enum import StrEnum
from typing import Literal

from pydantic import Field

from ..comparisons.runs.results import ResultFile, share_of
from ..models.spec import Real, Spec

FORMAT = "trebucheck-conformance-1"


class CheckState(StrEnum):
    """State of a check; its text is shown in reports."""

    KEPT = "kept"
    BROKEN = "broken"
    NOT_JUDGED = "not judged"
    """It was compared, and held against no tolerance: that is no success."""
    DEVIATES = "known deviation"
    """It is broken, and the file of deviations says so, with a reason and an owner."""
    SKIPPED = "skipped"


_PROPERTIES = ("subject", "error", "unit", "tolerance", "source", "cause", "wall_time")


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
        """Its problem, from the id."""
        return self.id.rsplit("/", 2)[1]

    @property
    def check(self) -> str:
        """Its check, from the id."""
        return self.id.rsplit("/", 1)[1]

    @property
    def failed(self) -> bool:
        """Whether it speaks against the engine."""
        return self.state in (CheckState.BROKEN, CheckState.NOT_JUDGED)

    @property
    def complaint(self) -> str:
        """Sentence on the fault, the tolerance and the cause."""
        source = f"tolerance by {self.source}" if self.source else ""
        return "\n".join(filter(None, (self.text, source, self.cause)))

    @property
    def properties(self) -> list[tuple[str, object]]:
        """Properties for a JUnit file."""
        given = {name: getattr(self, name) for name in _PROPERTIES}
        return [(name, value) for name, value in given.items() if value not in (None, "")]


class Conformance(ResultFile):
    """All verdicts on one engine or several."""

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
        """How many verdicts of each state."""
        return Counter(verdict.state for verdict in self.verdicts)

    @property
    def passed(self) -> bool:
        """Nothing fails, and something was kept on a problem."""
        kept = any(v.state is CheckState.KEPT and v.problem != "interface" for v in self.verdicts)
        return kept and not any(verdict.failed for verdict in self.verdicts)
