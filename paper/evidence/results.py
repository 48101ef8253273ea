"""What is found about the paper's claims, as data: the content of paper.json and its schema."""

from __future__ import annotations

from enum import StrEnum
from typing import Literal

from pydantic import Field, JsonValue

from ...models.mechanism import Mechanism
from ...models.spec import Real, Spec

FORMAT = "trebucheck-paper-1"


class Verdict(StrEnum):
    """What becomes of a claim; the text is what the table shows."""

    HOLDS = "holds to the printed digits"
    WITHIN_GRID = "holds within its grid"
    FAILS = "does not hold"
    OPEN = "cannot be told"


class Quantity(Spec):
    """A number with what it is known to."""

    value: Real
    uncertainty: Real | None = Field(default=None, description="half width, same unit; None: not a measured number")
    unit: str = Field(description="'' where there is none")


class EngineValue(Spec):
    """What one engine's tuned run says about the same quantity."""

    engine: str
    value: Real | None = Field(description="None where it has none; `note` then says why")
    tolerance: Real | None = Field(default=None, description="its agreement bar: distance from ours that is allowed")
    note: str | None = None

    def agrees(self, ours: Quantity | None) -> bool | None:
        """Whether it lies within its tolerance of ours, which has its own uncertainty; None where that is not asked."""
        if ours is None or self.value is None or self.tolerance is None:
            return None
        return abs(self.value - ours.value) <= self.tolerance + (ours.uncertainty or 0.0)


class Claim(Spec):
    """One number (or order, or fact) of the paper against ours."""

    name: str = Field(description="short, unique")
    where: str = Field(description="section, figure or table of the paper")
    printed: str = Field(description="the number as printed, not the prose around it")
    quantity: str = Field(description="what is compared, in our words")
    machine: str = Field(default="", description="which machine it is about; empty: none or several")
    ours: Quantity | None = Field(description="None where a solver cannot reach it")
    engines: tuple[EngineValue, ...] = ()
    rule: str = Field(description="the rule that gave the verdict, in words")
    verdict: Verdict
    why: str = Field(default="", description="cause of a verdict other than 'holds'")
    departure: Real | None = Field(
        default=None, description="distance of ours from what is claimed, as its share; 1: a claimed fact is not there"
    )


class Unreached(Spec):
    """A number of the paper that has no row of its own."""

    where: str = Field(description="section, figure or table of the paper")
    printed: str = Field(description="as printed")
    why: str


class Series(Spec):
    """Points of a curve of one of the paper's figures."""

    figure: str = Field(description="of the paper, such as 'Fig. 4'")
    name: str
    kind: Literal["line", "points", "printed"] = Field(
        default="line", description="ours: line; engines' and grids' samples: points; the paper's numbers: printed"
    )
    engine: str | None = Field(default=None, description="whose points they are, if an engine's")
    x: tuple[Real, ...]
    y: tuple[Real, ...]
    x_label: str = Field(description="with unit")
    y_label: str = Field(description="with unit")


class Study(Spec):
    """All of it."""

    format: str = FORMAT
    made: str = Field(description="date and time, ISO 8601")
    versions: dict[str, str]
    machines: tuple[Mechanism, ...]
    claims: tuple[Claim, ...]
    unreached: tuple[Unreached, ...] = Field(default=(), description="numbers of the paper that no solver can reach")
    series: tuple[Series, ...] = ()
    sections: dict[str, JsonValue] = Field(
        default_factory=dict, description="identification, drag, sweep, machines, design: each one's own figures"
    )
    seconds: Real = Field(description="wall time of the whole study [s]")
