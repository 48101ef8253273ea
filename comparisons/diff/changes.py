"""What changed from one comparison to another: of a quantity, a run, the reference, and all of it."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property

from pydantic import JsonValue

from ...models.shown import Reported
from ..runs.results import Diagnosis, Metric, Outcome, Run

_RANKS = {
    Outcome.AGREES: 0,
    Outcome.NOT_JUDGED: 1,
    Outcome.DISAGREES: 2,
    Outcome.NOT_EQUIVALENT: 3,
    Outcome.FAILED: 4,
}
"""Of outcomes of engines that could run, the best first."""


class Fate(StrEnum):
    """What became of a run; the text is what tables show."""

    SAME = "same verdict"
    BETTER = "better"
    WORSE = "worse"
    FAILS = "fails"
    """It did not fail before, or was not there."""
    APPEARED = "appeared"
    VANISHED = "vanished"
    NOT_COMPARED = "not compared"


@dataclass(frozen=True)
class QuantityChange:
    """One quantity of a run in both results; None where it has no such quantity."""

    model: str
    run: str
    old: Metric | None
    new: Metric | None
    unknown: float
    """What both results leave unknown of the difference of their errors, in the quantity's unit."""

    @property
    def either(self) -> Metric:
        """The new one, if there is one: for name and unit."""
        metric = self.new or self.old
        assert metric is not None
        return metric

    @property
    def broke(self) -> bool:
        """A verdict that is worse now: it breaks its tolerance, or it held it and is judged no longer."""
        return _verdict_rank(self.new) > _verdict_rank(self.old)

    @property
    def mended(self) -> bool:
        """It holds its tolerance now, and was there and did not before."""
        return (
            self.old is not None
            and self.old.holds is not True
            and self.new is not None
            and self.new.holds is True
        )

    @property
    def by_tolerance(self) -> bool:
        """Whether the verdict is another one, and would be the old one had the tolerance not changed."""
        old, size = self.old, _size(self.new)
        if (
            old is None
            or old.tolerance is None
            or size is None
            or self.new is None
            or self.new.holds is None
        ):
            return False
        return self.new.holds is not old.holds and (size <= old.tolerance) is old.holds

    @property
    def factor(self) -> float | None:
        """New error over old one, errors below what is unknown taken as that; None where one of them has no value."""
        old, new = _size(self.old), _size(self.new)
        if old is None or new is None:
            return None
        least = max(old, self.unknown), max(new, self.unknown)
        return 1.0 if least[0] == least[1] else least[1] / least[0] if least[0] else math.inf

    @property
    def bounded(self) -> bool:
        """Whether one of the errors is below what is unknown, so that the factor is at least as far from one."""
        return any((size or 0.0) < self.unknown for size in (_size(self.old), _size(self.new)))

    def moved(self, factor: float) -> bool:
        """Whether the error changed by more than what is unknown and by more than the factor, or has come or gone."""
        old, new = _size(self.old), _size(self.new)
        if old is None or new is None:
            return (old is None) != (new is None)
        ratio = self.factor or 0.0
        return abs(new - old) > self.unknown and not 1 / factor <= ratio <= factor

    @property
    def distance(self) -> float:
        """How far the worse of both errors is beyond its tolerance, as a factor; infinite for a missing event."""
        return max(_excess(self.old), _excess(self.new))


def _verdict_rank(metric: Metric | None) -> int:
    return 1 if metric is None or metric.holds is None else 0 if metric.holds else 2


def _size(metric: Metric | None) -> float | None:
    return None if metric is None or metric.value is None else abs(metric.value)


def _excess(metric: Metric | None) -> float:
    if metric is None or metric.holds is None:
        return 0.0
    size = _size(metric)
    return math.inf if size is None else size / metric.tolerance if metric.tolerance else math.inf


@dataclass(frozen=True)
class RunChange:
    """A run in both results; None where it is not among them."""

    old: Run | None
    new: Run | None
    reason: str = ""
    """Why the two are not of the same motion, so that they are not compared; '' where they are."""
    quantities: tuple[QuantityChange, ...] = ()

    @property
    def run(self) -> Run:
        """The new one, if there is one: for its names."""
        run = self.new or self.old
        assert run is not None
        return run

    @property
    def fate(self) -> Fate:
        """What became of it."""
        old, new = _rank(self.old), _rank(self.new)
        if new is None:
            return Fate.SAME if old is None else Fate.VANISHED
        failed = new == _RANKS[Outcome.FAILED]
        if old is None:
            return Fate.FAILS if failed else Fate.APPEARED
        if self.reason:
            return Fate.NOT_COMPARED
        if old == new:
            return Fate.SAME
        return Fate.BETTER if new < old else Fate.FAILS if failed else Fate.WORSE

    @property
    def diagnoses(self) -> tuple[Diagnosis, Diagnosis] | None:
        """Both, where the two name another first quantity or other causes."""
        if self.reason or self.old is None or self.new is None:
            return None
        old, new = self.old.diagnosis, self.new.diagnosis
        return (old, new) if old and new and _named(old) != _named(new) else None

    @property
    def settings(self) -> dict[str, tuple[JsonValue, JsonValue]]:
        """Options of the engine whose values differ, old and new."""
        if self.old is None or self.new is None:
            return {}
        old, new = self.old.settings, self.new.settings
        return {
            name: (old.get(name), new.get(name))
            for name in {**old, **new}
            if old.get(name) != new.get(name)
        }


def _rank(run: Run | None) -> int | None:
    """Of its outcome; None for a run that is not there, or whose engine is not installed or not able to."""
    return None if run is None else _RANKS.get(run.outcome)


def _named(diagnosis: Diagnosis) -> tuple[str, ...]:
    return diagnosis.leads, *(cause.name for cause in diagnosis.named)


@dataclass(frozen=True)
class ReferenceChange:
    """A figure of the reference that moved by more than both results say it is uncertain by."""

    model: str
    name: str
    unit: str
    old: float | None
    new: float | None
    unknown: float
    """Sum of both uncertainties."""


@dataclass(frozen=True, repr=False)
class Difference(Reported):
    """What changed from one comparison to another."""

    factor: float
    """Least by which an error must change to have moved."""
    runs: tuple[RunChange, ...] = field(repr=False)
    references: tuple[ReferenceChange, ...] = field(repr=False)
    versions: dict[str, tuple[str, str]]
    """Software whose versions differ, old and new."""
    conditions: tuple[str, ...]
    """What was asked for and judged otherwise, a sentence each."""

    @cached_property
    def broken(self) -> tuple[QuantityChange, ...]:
        """Verdicts that are worse, the one farthest beyond its tolerance first."""
        return self._sorted([each for each in self.quantities if each.broke])

    @cached_property
    def mended(self) -> tuple[QuantityChange, ...]:
        """Verdicts that hold now, the one that was farthest beyond its tolerance first."""
        return self._sorted([each for each in self.quantities if each.mended])

    @cached_property
    def moved(self) -> tuple[QuantityChange, ...]:
        """Further errors that moved; first those that came, went or grew, the largest factor first."""
        others = [
            q for q in self.quantities if q.moved(self.factor) and not q.broke and not q.mended
        ]
        return tuple(sorted(others, key=_growth, reverse=True))

    @property
    def quantities(self) -> tuple[QuantityChange, ...]:
        """All that were compared."""
        return tuple(quantity for run in self.runs for quantity in run.quantities)

    def of_fate(self, *fates: Fate) -> tuple[RunChange, ...]:
        """Runs of which one of these became."""
        return tuple(each for each in self.runs if each.fate in fates)

    @property
    def compared(self) -> int:
        """Number of runs that are in both and of the same motion."""
        return sum(
            _rank(r.old) is not None and _rank(r.new) is not None and not r.reason
            for r in self.runs
        )

    @property
    def worse(self) -> bool:
        """Something broke: a verdict, a run that is worse, fails or is gone, or the reference itself."""
        return bool(
            self.broken or self.references or self.of_fate(Fate.WORSE, Fate.FAILS, Fate.VANISHED)
        )

    @property
    def passed(self) -> bool:
        """Nothing broke, and something was compared."""
        return not self.worse and self.compared > 0

    @property
    def summary(self) -> str:
        """One line: whether something broke, and how many of what changed."""
        fates = Counter(each.fate for each in self.runs)
        counts = [
            (
                len(self.references),
                "figure of the reference moved",
                "figures of the reference moved",
            ),
            (fates[Fate.VANISHED], "run is gone", "runs are gone"),
            (fates[Fate.FAILS], "run fails", "runs fail"),
            (fates[Fate.WORSE], "run is worse", "runs are worse"),
            (len(self.broken), "verdict broke", "verdicts broke"),
            (len(self.mended), "verdict mended", "verdicts mended"),
            (fates[Fate.BETTER], "run is better", "runs are better"),
            (fates[Fate.APPEARED], "run appeared", "runs appeared"),
            (fates[Fate.NOT_COMPARED], "run not compared", "runs not compared"),
        ]
        shown = [
            f"{number} {one if number == 1 else more}" for number, one, more in counts if number
        ]
        moved = f"{len(self.moved)} of {len(self.quantities)} errors moved by more than a factor {self.factor:g}"
        head = (
            "Something broke"
            if self.worse
            else "Nothing broke"
            if self.passed
            else "Nothing could be compared"
        )
        runs = f"{self.compared} run{'' if self.compared == 1 else 's'} compared"
        return f"{head}: {', '.join([*shown, moved])}; {runs}."

    def headline(self) -> str:
        """The summary."""
        return self.summary

    def rows(self) -> Iterator[dict[str, object]]:
        """A quantity of a run a row, with its error before and now."""
        for each in self.quantities:
            values = [None if metric is None else metric.value for metric in (each.old, each.new)]
            found = {"broke": each.broke, "mended": each.mended, "moved": each.moved(self.factor)}
            quantity = {
                "quantity": each.either.label,
                "unit": each.either.unit,
                "old": values[0],
                "new": values[1],
            }
            yield {"model": each.model, "run": each.run, **quantity, "factor": each.factor, **found}

    @staticmethod
    def _sorted(changes: Sequence[QuantityChange]) -> tuple[QuantityChange, ...]:
        return tuple(sorted(changes, key=lambda each: each.distance, reverse=True))


def _growth(change: QuantityChange) -> float:
    return math.inf if change.factor is None else change.factor
