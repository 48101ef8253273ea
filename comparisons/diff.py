"""Two comparisons of the same mechanisms: which verdicts broke, and which errors moved.

Runs belong together by model, engine and preset, quantities by name and subject. An error is known
no better than the reference is, and no better than its samples and the rounding of its own steps
allow; less than what both results leave unknown is no movement. A movement beyond that counts from
a factor on.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field, JsonValue

from ..models.errors import InputError
from ..models.shown import Reported
from ..models.spec import Real, Spec
from .compare import Comparison, read_results
from .runs.quantities import QUANTITIES, metric_label
from .runs.results import COMPARED, Diagnosis, Machine, Metric, Outcome, Results, Run
from .runs.tolerances import rounding_floor

__path__: list[str] = []  # names of earlier releases below this module: see renamed.py

RANKS = {
    Outcome.AGREES: 0,
    Outcome.NOT_JUDGED: 1,
    Outcome.DISAGREES: 2,
    Outcome.NOT_EQUIVALENT: 3,
    Outcome.FAILED: 4,
    Outcome.TIMED_OUT: 4,
}
"""Ranks of outcomes of engines that could run, the best first."""


class Fate(StrEnum):
    """Change of a run's verdict; the text is what tables show."""

    SAME = "same verdict"
    BETTER = "better"
    WORSE = "worse"
    FAILS = "fails"  # it did not fail before, or was not there
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
    unknown: float  # part of the difference of both errors, in the quantity's unit
    least: float  # factor by which an error must change to have moved

    @property
    def either(self) -> Metric:
        """The new one, if there is one: for name and unit."""
        metric = self.new or self.old
        assert metric is not None
        return metric

    @property
    def broke(self) -> bool:
        """Tell whether the verdict is worse: its tolerance is broken, or it is not judged now."""
        ranks = {True: 0, None: 1, False: 2}
        old, new = (None if metric is None else metric.holds for metric in (self.old, self.new))
        return ranks[new] > ranks[old]

    @property
    def mended(self) -> bool:
        """It holds its tolerance now, and was there and did not before."""
        if self.old is None or self.new is None:
            return False
        return self.new.holds is True and self.old.holds is not True

    @property
    def by_tolerance(self) -> bool:
        """Tell whether the verdict differs, and would not had the tolerance stayed the same."""
        old, new = self.old, self.new
        if old is None or old.tolerance is None:
            return False
        if new is None or new.holds is None or new.value is None:
            return False
        return new.holds is not old.holds and (abs(new.value) <= old.tolerance) is old.holds

    @property
    def factor(self) -> float | None:
        """New error over old one, each at least what is unknown; None if one has no value."""
        old, new = _size(self.old), _size(self.new)
        if old is None or new is None:
            return None
        old, new = max(old, self.unknown), max(new, self.unknown)
        if old == new:
            return 1.0
        return new / old if old else math.inf

    @property
    def bounded(self) -> bool:
        """Tell whether one error is below what is unknown, so that the factor is a bound."""
        return min(_size(self.old) or 0.0, _size(self.new) or 0.0) < self.unknown

    @property
    def moved(self) -> bool:
        """Tell whether the error moved beyond what is unknown and the factor, or came or went."""
        old, new = _size(self.old), _size(self.new)
        if old is None or new is None:
            return (old is None) != (new is None)
        ratio = self.factor or 0.0
        return abs(new - old) > self.unknown and not 1 / self.least <= ratio <= self.least

    @property
    def distance(self) -> float:
        """Larger of both errors over its tolerance; infinite for a missing event."""
        return max(metric.share or 0.0 for metric in (self.old, self.new) if metric is not None)


def _size(metric: Metric | None) -> float | None:
    return None if metric is None or metric.value is None else abs(metric.value)


@dataclass(frozen=True)
class RunChange:
    """A run in both results; None where it is not among them."""

    old: Run | None
    new: Run | None
    reason: str = ""  # why the two are not of the same motion; '' where they are compared
    quantities: tuple[QuantityChange, ...] = ()

    @property
    def run(self) -> Run:
        """The new one, if there is one: for its names."""
        run = self.new or self.old
        assert run is not None
        return run

    @property
    def ranks(self) -> tuple[int | None, int | None]:
        """Ranks of both outcomes; None for what is missing, not installed or not supported."""
        old, new = (None if run is None else RANKS.get(run.outcome) for run in (self.old, self.new))
        return old, new

    @property
    def fate(self) -> Fate:
        """Change of its verdict."""
        old, new = self.ranks
        if new is None:
            return Fate.SAME if old is None else Fate.VANISHED
        failed = new == RANKS[Outcome.FAILED]
        if old is None:
            return Fate.FAILS if failed else Fate.APPEARED
        if self.reason:
            return Fate.NOT_COMPARED
        if old == new:
            return Fate.SAME
        if new < old:
            return Fate.BETTER
        return Fate.FAILS if failed else Fate.WORSE

    @property
    def diagnoses(self) -> tuple[Diagnosis, Diagnosis] | None:
        """Returns both, where the two name another first quantity or other causes."""
        if self.reason or self.old is None or self.new is None:
            return None
        old, new = self.old.diagnosis, self.new.diagnosis
        if old is None or new is None:
            return None
        first, now = ((d.leads, [cause.name for cause in d.named]) for d in (old, new))
        return (old, new) if first != now else None

    @property
    def settings(self) -> dict[str, tuple[JsonValue, JsonValue]]:
        """Options of the engine whose values differ, old and new."""
        changes: dict[str, tuple[JsonValue, JsonValue]] = {}
        if self.old is not None and self.new is not None:
            for name in self.old.settings | self.new.settings:
                old, new = self.old.settings.get(name), self.new.settings.get(name)
                if old != new:
                    changes[name] = old, new
        return changes


class ReferenceChange(Spec):
    """A figure of the reference that moved by more than both results say it is uncertain by."""

    model: str
    figure: str
    unit: str
    old: Real | None
    new: Real | None
    unknown: Real = Field(description="sum of both uncertainties")


@dataclass(frozen=True, repr=False)
class Difference(Reported):
    """Changes from one comparison to another."""

    factor: float  # least by which an error must change to have moved
    runs: tuple[RunChange, ...] = field(repr=False)
    references: tuple[ReferenceChange, ...] = field(repr=False)
    versions: dict[str, tuple[str, str]]
    """Software whose versions differ, old and new."""
    conditions: tuple[str, ...]
    """Conditions that were asked for or judged otherwise, a sentence each."""

    @cached_property
    def broken(self) -> tuple[QuantityChange, ...]:
        """Verdicts that are worse, the one farthest beyond its tolerance first."""
        broken = [change for change in self.quantities if change.broke]
        return tuple(sorted(broken, key=lambda change: change.distance, reverse=True))

    @cached_property
    def mended(self) -> tuple[QuantityChange, ...]:
        """Verdicts that hold now, the one that was farthest beyond its tolerance first."""
        mended = [change for change in self.quantities if change.mended]
        return tuple(sorted(mended, key=lambda change: change.distance, reverse=True))

    @cached_property
    def moved(self) -> tuple[QuantityChange, ...]:
        """Further errors that moved: first those that came, went or grew, by factor."""

        def growth(change: QuantityChange) -> float:
            return math.inf if change.factor is None else change.factor

        others = [q for q in self.quantities if q.moved and not q.broke and not q.mended]
        return tuple(sorted(others, key=growth, reverse=True))

    @property
    def quantities(self) -> tuple[QuantityChange, ...]:
        """Quantities of all runs that were compared."""
        return tuple(quantity for run in self.runs for quantity in run.quantities)

    def of_fate(self, *fates: Fate) -> tuple[RunChange, ...]:
        """Runs of which one of these became."""
        return tuple(change for change in self.runs if change.fate in fates)

    @property
    def compared(self) -> int:
        """Number of runs that are in both and of the same motion."""
        return sum(None not in change.ranks and not change.reason for change in self.runs)

    @property
    def worse(self) -> bool:
        """Tell whether a verdict, a run or the reference is worse, or a run fails or is gone."""
        return bool(
            self.broken or self.references or self.of_fate(Fate.WORSE, Fate.FAILS, Fate.VANISHED)
        )

    @property
    def passed(self) -> bool:
        """Tell whether nothing broke and something was compared."""
        return not self.worse and self.compared > 0

    @property
    def summary(self) -> str:
        """One line: whether something broke, and how many of what changed."""
        fates = Counter(change.fate for change in self.runs)
        counts = (
            (len(self.references), "figure{s} of the reference moved"),
            (fates[Fate.VANISHED], "run{s} {are} gone"),
            (fates[Fate.FAILS], "run{s} fail{fails}"),
            (fates[Fate.WORSE], "run{s} {are} worse"),
            (len(self.broken), "verdict{s} broke"),
            (len(self.mended), "verdict{s} mended"),
            (fates[Fate.BETTER], "run{s} {are} better"),
            (fates[Fate.APPEARED], "run{s} appeared"),
            (fates[Fate.NOT_COMPARED], "run{s} not compared"),
        )
        shown: list[str] = []
        for number, words in counts:
            if number == 1:
                shown.append("1 " + words.format(s="", are="is", fails="s"))
            elif number:
                shown.append(f"{number} " + words.format(s="s", are="are", fails=""))
        shown.append(
            f"{len(self.moved)} of {len(self.quantities)} errors moved by more than a factor "
            f"{self.factor:g}"
        )
        head = "Nothing could be compared"
        if self.worse:
            head = "Something broke"
        elif self.passed:
            head = "Nothing broke"
        runs = f"{self.compared} run{'' if self.compared == 1 else 's'} compared"
        return f"{head}: {', '.join(shown)}; {runs}."

    def headline(self) -> str:
        """The summary."""
        return self.summary

    def rows(self) -> Iterator[dict[str, object]]:
        """A quantity of a run a row, with its error before and now."""
        for change in self.quantities:
            old, new = (metric and metric.value for metric in (change.old, change.new))
            yield {
                "model": change.model,
                "run": change.run,
                "quantity": change.either.label,
                "unit": change.either.unit,
                "old": old,
                "new": new,
                "factor": change.factor,
                "broke": change.broke,
                "mended": change.mended,
                "moved": change.moved,
            }


class Side(Spec):
    """A quantity of a run in one of the two results."""

    value: Real | None
    tolerance: Real | None
    holds: bool | None = Field(description="whether it holds its tolerance; null: it is not judged")


class QuantityDifference(Spec):
    """One quantity of a run in both results."""

    model: str
    run: str = Field(description="engine and preset")
    quantity: str
    unit: str
    old: Side | None = Field(description="null: that result has no such quantity")
    new: Side | None
    unknown: Real | None = Field(
        description="of the difference, by both results, in the quantity's unit; null: all of it"
    )
    factor: Real | None = Field(
        description="new error over old one, each at least what is unknown; null: one has no "
        "value, or the old one is zero"
    )
    bounded: bool = Field(description="whether an error is below what is unknown: a bound")
    broke: bool
    mended: bool
    moved: bool
    by_tolerance: bool = Field(description="whether the tolerance alone makes another verdict")


class RunFate(Spec):
    """A run in both results."""

    model: str
    run: str = Field(description="engine and preset")
    old: Outcome | None = Field(description="its verdict; null: it is not among those runs")
    new: Outcome | None
    fate: Fate
    reason: str = Field(description="why the two are not of the same motion; empty where they are")
    message: str | None = Field(description="of the new run")
    settings: dict[str, tuple[JsonValue, JsonValue]] = Field(
        description="options that differ, old and new"
    )


class DifferenceData(Spec):
    """Movements and breaks from one comparison to another."""

    format: Literal["trebucheck-diff-1"] = "trebucheck-diff-1"
    passed: bool = Field(description="nothing broke, and something was compared")
    summary: str
    factor: Real = Field(description="least by which an error must change to have moved")
    versions: dict[str, tuple[str, str]] = Field(
        description="software whose versions differ, old and new"
    )
    conditions: tuple[str, ...] = Field(description="what was asked for or judged otherwise")
    references: tuple[ReferenceChange, ...]
    runs: tuple[RunFate, ...]
    quantities: tuple[QuantityDifference, ...]


def data(difference: Difference) -> DifferenceData:
    """Returns the whole difference as data; the order is that of the runs."""
    runs: list[RunFate] = []
    for change in difference.runs:
        runs.append(
            RunFate(
                model=change.run.model,
                run=change.run.label,
                old=change.old and change.old.outcome,
                new=change.new and change.new.outcome,
                fate=change.fate,
                reason=change.reason,
                message=change.new and change.new.message,
                settings=change.settings,
            )
        )

    def side(metric: Metric | None) -> Side | None:
        if metric is None:
            return None
        return Side(value=metric.value, tolerance=metric.tolerance, holds=metric.holds)

    quantities: list[QuantityDifference] = []
    for quantity, row in zip(difference.quantities, difference.rows(), strict=True):
        # JSON has no infinity: a factor from zero, or all of an error unknown, is null.
        unknown, factor = (
            value if value is not None and math.isfinite(value) else None
            for value in (quantity.unknown, quantity.factor)
        )
        fields: dict[str, Any] = row | {"old": side(quantity.old), "new": side(quantity.new)}
        fields |= {"unknown": unknown, "factor": factor, "bounded": quantity.bounded}
        quantities.append(QuantityDifference(**fields, by_tolerance=quantity.by_tolerance))
    return DifferenceData(
        passed=difference.passed,
        summary=difference.summary,
        factor=difference.factor,
        versions=difference.versions,
        conditions=difference.conditions,
        references=difference.references,
        runs=tuple(runs),
        quantities=tuple(quantities),
    )


# Least factor of a movement: tables show errors with two digits, and a tenth is what their second
# digit tells.
FACTOR = 1.1
_EPS = float(np.finfo(np.float64).eps)
_SAME_END = 1e-6  # relative difference of the ends of two motions up to which they are the same


def refuse_no_factor(factor: float) -> None:
    """Raise InputError for a factor by which no error can move."""
    if not (math.isfinite(factor) and factor > 1):
        raise InputError(f"factor = {factor!r} must be a finite number above 1.")


def diff(
    old: Results | Comparison | str | Path,
    new: Results | Comparison | str | Path,
    factor: float = FACTOR,
) -> Difference:
    """Compare two results of `compare`: errors that moved, verdicts that broke.

        >>> import trebucheck as tb
        >>> difference = tb.diff("before", "after/results.json")  # doctest: +SKIP
        >>> difference.passed, difference.to_dataframe().query("moved")  # doctest: +SKIP

    Args:
        old, new: comparisons, their results, or paths of results.json or of the folders that hold
        it.
        factor: least by which an error must change to have moved; above 1.

    Raises:
        InputError: a file is no comparison's of the current format, or the factor is not above 1.
    """
    refuse_no_factor(factor)
    before, after = _Side(old), _Side(new)
    references: list[ReferenceChange] = []
    conditions: list[str] = []
    for model, machine in before.machines.items():
        if model in after.machines:
            now = after.machines[model]
            same = not _unlike(machine, now)
            if machine.needs != now.needs:
                asked, wanted = (
                    ", ".join(f"{name} {text}" for name, text in needs.items()) or "none"
                    for needs in (machine.needs, now.needs)
                )
                conditions.append(f"{model}: tolerances asked for: {asked}, now {wanted}.")
            if same and not math.isclose(machine.judged_to, now.judged_to, rel_tol=_SAME_END):
                conditions.append(
                    f"{model}: predictable, and so judged, to {machine.judged_to:.6g} s, "
                    f"now to {now.judged_to:.6g} s."
                )
            if same:
                references += _reference_changes(machine, now)
    versions: dict[str, tuple[str, str]] = {}
    for name, version in before.versions.items():
        if after.versions.get(name, version) != version:
            versions[name] = version, after.versions[name]
    runs = [_run_change(name, before, after, factor) for name in before.runs | after.runs]
    return Difference(factor, tuple(runs), tuple(references), versions, tuple(conditions))


class _Side:
    """One of the two results: its machines, its runs, and versions of all that it names."""

    def __init__(self, given: Results | Comparison | str | Path) -> None:
        results = given.results if isinstance(given, Comparison) else given
        if not isinstance(results, Results):
            results = read_results(results)
        self.machines = {machine.model: machine for machine in results.machines}
        self.runs: dict[tuple[str, str, str], Run] = {}
        self.versions = {
            "trebucheck": results.trebucheck_version,
            "Python": results.python_version,
            "platform": results.platform,
        }
        for run in results.runs:
            self.runs.setdefault((run.model, run.engine, run.preset), run)
            if run.outcome is not Outcome.ABSENT:
                self.versions[run.engine] = run.engine_version


def _unlike(old: Machine, new: Machine) -> str:
    """Why motions of the two are not the same motion; '' where they are."""
    if old.mechanism_hash != new.mechanism_hash:
        return f"another mechanism: hash {old.mechanism_hash[:12]}, now {new.mechanism_hash[:12]}"
    if old.thrown != new.thrown:
        return f"another marker is launched: {old.thrown}, now {new.thrown}"
    if old.stop_law is not new.stop_law:
        return f"another law of the stops: {old.stop_law.value}, now {new.stop_law.value}"
    if not math.isclose(old.compared_to, new.compared_to, rel_tol=_SAME_END):
        return f"another end of the motion: {old.compared_to:.6g} s, now {new.compared_to:.6g} s"
    return ""


def _run_change(
    name: tuple[str, str, str], before: _Side, after: _Side, factor: float
) -> RunChange:
    old, new = before.runs.get(name), after.runs.get(name)
    machine, now = before.machines.get(name[0]), after.machines.get(name[0])
    if old is None or new is None or machine is None or now is None:
        return RunChange(old, new)
    reason = _unlike(machine, now)
    if reason or old.outcome not in COMPARED or new.outcome not in COMPARED:
        return RunChange(old, new, reason)
    changes: list[QuantityChange] = []
    # The model-equivalence check as a quantity: its largest value, of its tolerance.
    checks = _model_check(old), _model_check(new)
    if any(checks):
        changes.append(QuantityChange(new.model, new.label, *checks, math.inf, factor))
    # Metrics that stand for themselves and were observed.
    for label in dict.fromkeys((m.name, m.subject) for m in (*old.metrics, *new.metrics)):
        metrics = old.metric(*label), new.metric(*label)
        unknown, follows, observed = 0.0, False, False
        for metric, run, side in zip(metrics, (old, new), (machine, now), strict=True):
            if metric is not None:
                unknown += _unknown(metric, run, side)
                follows = follows or metric.follows is not None
                observed = observed or metric.observed
        if observed and not follows:
            changes.append(QuantityChange(new.model, new.label, *metrics, unknown, factor))
    return RunChange(old, new, reason, tuple(changes))


def _model_check(run: Run) -> Metric | None:
    if run.equality is None or not run.equality.checks:
        return None
    largest: float | None = 0.0
    for check in run.equality.checks:
        # Without a number of every check there is no largest one.
        if check.value is None or largest is None:
            largest = None
        else:
            largest = max(largest, check.value / check.tolerance)
    return Metric(name="model equivalence", value=largest, unit="of its tolerance", tolerance=1.0)


def _unknown(metric: Metric, run: Run, machine: Machine) -> float:
    """Unknown part of an error: uncertainty of the reference, sampling, rounding."""
    stated = machine.reference_uncertainty
    unknown = stated.get(metric.label, stated.get(metric.name, 0.0))
    unknown = unknown + (metric.sampling_error or 0.0)
    if metric.name not in QUANTITIES:
        return unknown
    return unknown + rounding_floor(metric, run, machine)


def _reference_changes(old: Machine, new: Machine) -> Iterator[ReferenceChange]:
    """Changes of figures within what both judge."""
    end, model = min(old.judged_to, new.judged_to) * (1 + _SAME_END), old.model

    def figure(machine: Machine, name: str, subject: str | None) -> float | None:
        """Look a figure up; None for an event that is not there by the end."""
        time = machine.launch_time if subject is None else machine.release_times[subject]
        if time is None or time > end:
            return None
        return machine.launch_speed if name == "launch_speed" else time

    figures: list[tuple[str, str | None, str]] = [
        ("launch_time", None, "s"),
        ("launch_speed", None, "m/s"),
    ]
    figures += [("release_time", s, "s") for s in old.release_times if s in new.release_times]
    for name, subject, unit in figures:
        label = metric_label(name, subject)
        before, after = figure(old, name, subject), figure(new, name, subject)
        appeared = (before is None) != (after is None)
        unknown = 0.0
        for machine, value in ((old, before), (new, after)):
            # An event that is not there need not have an uncertainty; a figure without one never
            # moved.
            stated, missing = machine.reference_uncertainty, 0.0 if appeared else math.inf
            uncertainty = stated.get(label, stated.get(name, missing))
            unknown += uncertainty + _EPS * abs(value or 0.0)
        if appeared or (before is not None and after is not None and abs(after - before) > unknown):
            yield ReferenceChange(
                model=model, figure=label, unit=unit, old=before, new=after, unknown=unknown
            )
    if old.impacts != new.impacts and old.compared_to <= end:
        impacts = {"old": old.impacts, "new": new.impacts, "unknown": 0.0}
        yield ReferenceChange(model=model, figure="impacts", unit="1", **impacts)
