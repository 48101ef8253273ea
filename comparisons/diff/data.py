"""A difference as data: the content of the JSON that `trebucheck diff` prints or writes."""

from __future__ import annotations

import math
from typing import Literal

from pydantic import Field, JsonValue

from ...models.spec import Real, Spec
from ..runs.results import Metric, Outcome
from .changes import Difference, Fate, QuantityChange, ReferenceChange, RunChange


class Side(Spec):
    """A quantity of a run in one of the two results."""

    value: Real | None
    tolerance: Real | None
    holds: bool | None = Field(description="whether it holds its tolerance; null: it is not judged")


class Quantity(Spec):
    """One quantity of a run in both results."""

    model: str
    run: str = Field(description="engine and preset")
    quantity: str
    unit: str
    old: Side | None = Field(description="null: that result has no such quantity")
    new: Side | None
    unknown: Real | None = Field(
        description="what both results leave unknown of the difference, in the quantity's unit; null: all of it"
    )
    factor: Real | None = Field(
        description="new error over old one, errors below what is unknown taken as that; null: one has no value, or "
        "the old one is zero"
    )
    bounded: bool = Field(
        description="whether an error is below what is unknown, so that the factor is a bound"
    )
    broke: bool
    mended: bool
    moved: bool
    by_tolerance: bool = Field(
        description="whether the verdict is another one by its tolerance alone"
    )


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


class Reference(Spec):
    """A figure of the reference that moved by more than both results say it is uncertain by."""

    model: str
    figure: str
    unit: str
    old: Real | None
    new: Real | None
    unknown: Real = Field(description="sum of both uncertainties")


class DifferenceData(Spec):
    """What moved and what broke from one comparison to another."""

    format: Literal["trebucheck-diff-1"] = "trebucheck-diff-1"
    passed: bool = Field(description="nothing broke, and something was compared")
    summary: str
    factor: Real = Field(description="least by which an error must change to have moved")
    versions: dict[str, tuple[str, str]] = Field(
        description="software whose versions differ, old and new"
    )
    conditions: tuple[str, ...] = Field(description="what was asked for or judged otherwise")
    references: tuple[Reference, ...]
    runs: tuple[RunFate, ...]
    quantities: tuple[Quantity, ...]


def data(found: Difference) -> DifferenceData:
    """All of a difference; the order is that of the runs."""
    return DifferenceData(
        passed=found.passed,
        summary=found.summary,
        factor=found.factor,
        versions=found.versions,
        conditions=found.conditions,
        references=tuple(map(_reference, found.references)),
        runs=tuple(map(_run, found.runs)),
        quantities=tuple(_quantity(each, found.factor) for each in found.quantities),
    )


def _reference(each: ReferenceChange) -> Reference:
    return Reference(
        model=each.model,
        figure=each.name,
        unit=each.unit,
        old=each.old,
        new=each.new,
        unknown=each.unknown,
    )


def _run(each: RunChange) -> RunFate:
    old, new = (None if run is None else run.outcome for run in (each.old, each.new))
    message = None if each.new is None else each.new.message
    return RunFate(
        model=each.run.model, run=each.run.label, old=old, new=new, fate=each.fate, reason=each.reason,
        message=message, settings=each.settings,
    )  # fmt: skip


def _quantity(each: QuantityChange, factor: float) -> Quantity:
    return Quantity(
        model=each.model,
        run=each.run,
        quantity=each.either.label,
        unit=each.either.unit,
        old=_side(each.old),
        new=_side(each.new),
        unknown=_finite(each.unknown),
        factor=_finite(each.factor),
        bounded=each.bounded,
        broke=each.broke,
        mended=each.mended,
        moved=each.moved(factor),
        by_tolerance=each.by_tolerance,
    )


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _side(metric: Metric | None) -> Side | None:
    return (
        None
        if metric is None
        else Side(value=metric.value, tolerance=metric.tolerance, holds=metric.holds)
    )
