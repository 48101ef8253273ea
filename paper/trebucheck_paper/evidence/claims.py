"""Claims as data: the numbers that the paper prints and the findings (paper.json and its schema).

Each printed number is written here once: a value, and the half unit of its last digit.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from decimal import Decimal
from enum import StrEnum
from typing import TYPE_CHECKING, Literal, NamedTuple

from pydantic import Field, JsonValue
from trebucheck.api.mechanics import InputError, Mechanism, Real, Reported, Spec, report_with

if TYPE_CHECKING:
    from trebucheck.api.reports import Document

_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?")


class Printed(NamedTuple):
    """A printed number."""

    text: str
    """Text as printed, with its unit."""
    digits: str
    """The number alone."""
    value: float
    half: float
    """Half a unit of the last printed digit: whatever rounds to the number lies within it."""

    def __str__(self) -> str:
        return self.text


def parse(text: str) -> Printed:
    """First number of a text with its printed digits: '99.4' +- 0.05, '2.42:1' is 2.42 +- 0.005.

    Raises:
        InputError: there is no number in it.
    """
    match = _NUMBER.search(text)
    if match is None:
        raise InputError(
            f"printed = {text!r} holds no number; one with its printed digits is needed, such as "
            "'99.4'."
        )
    number = Decimal(match.group())
    exponent = number.as_tuple().exponent
    assert isinstance(exponent, int)  # a number of the pattern is finite
    return Printed(text, match.group(), float(number), 0.5 * 10.0**exponent)


# Sec. IV: the best release of the fixed machine.
RELEASE_TIME, BEST_ANGLE = parse("2.745 s"), parse("45°")
SLING_ANGLE, SLING_RADIANS = parse("585°"), parse("10.2 rad")
TIME_STEP, CAPTION_STEP = 0.005, 0.01
"""Steps between release times [s]: by the text (Sec. IV), and by the caption of Fig. 4."""

# Sec. V: the fulcrum's position on a beam of fixed length.
LAUNCH_SPEED, LEVER_RATIO, BEAM = parse("99.4 m/s"), parse("2.5:1"), parse("14 m")
BEST_L1, BEST_SPEED, BEST_RATIO = parse("9.91 m"), parse("100.55 m/s"), parse("2.42:1")
TABLE_L1, BACKWARD_L1, ZERO_L1, END_L1 = (
    parse("10 m"),
    parse("9.9 m"),
    parse("10.3 m"),
    parse("12.7 m"),
)
NO_SPEED = parse("0 m/s")

# Secs. VI and VII: rolling against fixed, and the error of the paper's computation.
RATIOS = {"fixed": parse("1.42"), "rolling": parse("1.83")}
"""R, the projectile's kinetic over the total energy, at 45 degrees."""
ENERGY_GAIN, SPEED_GAIN = parse("1.3"), parse("13 m/s")
SWING, WAY = parse("3.3 m"), parse("6.6 m")
ENERGY_ERROR, ENERGY_SHARE, JOULE_SHARE = parse("< 1 J"), parse("< 0.0005 %"), parse("0.0005 %")

FORMAT = "trebucheck-paper-1"


class Verdict(StrEnum):
    """Verdict on a claim; the text is what the table shows."""

    HOLDS = "holds to the printed digits"
    WITHIN_GRID = "holds within its grid"
    FAILS = "does not hold"
    OPEN = "cannot be told"


class Quantity(Spec):
    """A number with what it is known to."""

    value: Real
    uncertainty: Real | None = Field(
        default=None, description="half width, same unit; None: not a measured number"
    )
    unit: str = Field(description="'' where there is none")


class EngineValue(Spec):
    """Value of the same quantity in one engine's assisted run."""

    engine: str
    value: Real | None = Field(description="None where it has none; `note` then says why")
    tolerance: Real | None = Field(
        default=None, description="its agreement bar: distance from ours that is allowed"
    )
    note: str | None = None

    def agrees(self, ours: Quantity | None) -> bool | None:
        """Tell whether it agrees with ours in tolerance and uncertainty; None if not judged."""
        if ours is None or self.value is None or self.tolerance is None:
            return None
        return abs(self.value - ours.value) <= self.tolerance + (ours.uncertainty or 0.0)


class Proved(Spec):
    """Outcome of a claim in ball arithmetic."""

    holds: bool | None = Field(
        default=None, description="whether the claim holds as printed; None: it is not proved"
    )
    value: str | None = Field(
        default=None, description="of the enclosure of the quantity, in its unit; None: it has none"
    )
    radius: str | None = None
    off: Real | None = Field(
        default=None,
        description="least distance from what is claimed, where that does not hold, in its unit",
    )
    why: str = Field(default="", description="why it is not proved")

    def sentence(self, unit: str = "") -> str:
        """Tell what is proved."""
        if self.holds is None:
            return f"not proved: {self.why}"
        if self.holds:
            return "proved to hold as printed"
        return f"proved not to hold as printed (off by {self.off:.3g} {unit}".rstrip() + ")"


class Claim(Spec):
    """One number (or order, or fact) of the paper against ours."""

    name: str = Field(description="short, unique")
    where: str = Field(description="section, figure or table of the paper")
    printed: str = Field(description="the number as printed, not the prose around it")
    quantity: str = Field(description="what is compared, in our words")
    machine: str = Field(
        default="", description="which machine it is about; empty: none or several"
    )
    fact: str = Field(
        default="", description="rows of one fact count once; empty: the row is a fact of its own"
    )
    ours: Quantity | None = Field(description="None where a solver cannot reach it")
    engines: tuple[EngineValue, ...] = ()
    rule: str = Field(description="the rule that gave the verdict, in words")
    verdict: Verdict
    why: str = Field(default="", description="cause of a verdict other than 'holds'")
    departure: Real | None = Field(
        default=None,
        description="distance of ours from what is claimed, as its share; 1: a claimed fact is not "
        "there",
    )
    proved: Proved = Field(
        default=Proved(why="no number of one motion"),
        description="what a proof of the motion says of the claim as it is printed",
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
        default="line",
        description="ours: line; engines' and grids' samples: points; the paper's numbers: printed",
    )
    engine: str | None = Field(default=None, description="whose points they are, if an engine's")
    x: tuple[Real, ...]
    y: tuple[Real, ...]
    x_label: str = Field(description="with unit")
    y_label: str = Field(description="with unit")


class Study(Reported, Spec):
    """Verdicts on all claims, and the further studies."""

    format: str = FORMAT
    made: str = Field(description="date and time, ISO 8601")
    versions: dict[str, str]
    machines: tuple[Mechanism, ...]
    claims: tuple[Claim, ...]
    unreached: tuple[Unreached, ...] = Field(
        default=(), description="numbers of the paper that no solver can reach"
    )
    series: tuple[Series, ...] = ()
    sections: dict[str, JsonValue] = Field(
        default_factory=dict,
        description="identification, drag, sweep, machines, design: each one's own figures",
    )
    seconds: Real = Field(description="wall time of the whole study [s]")

    def headline(self) -> str:
        """Tell how many rows came out how."""
        counts = Counter(claim.verdict.value for claim in self.claims)
        return f"The paper, {len(self.claims)} rows: " + ", ".join(
            f"{number} {v}" for v, number in counts.items()
        )

    def rows(self) -> Iterator[dict[str, object]]:
        """A claim a row."""
        for claim in self.claims:
            ours = claim.ours
            value = {
                "ours": None if ours is None else ours.value,
                "unit": "" if ours is None else ours.unit,
            }
            yield {
                **claim.model_dump(exclude={"ours", "engines", "proved"}),
                **value,
                "verdict": claim.verdict.value,
                "proof": claim.proved.sentence(str(value["unit"])),
            }


def _document(study: Study) -> Document:
    """The report, imported when it is asked for."""
    from ..report import document

    return document(study)


report_with(Study, _document)
