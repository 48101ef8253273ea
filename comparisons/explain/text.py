"""How figures of a budget read: one form for the page and the terminal."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from ..report.numbers import format_number as figure
from .results import Budget, Change, Explanation, Figures, Machine, Quantity, Share, StockAgainstTuned

FEW = 1e-3
"""Shares below this are left out where there is little room; the page's tables have them all."""


@dataclass(frozen=True)
class Column:
    """A figure of a setting."""

    title: str
    unit: str
    field: str

    def heading(self, comparison: StockAgainstTuned) -> tuple[str, str]:
        """Title and unit for one machine, whose stops may push with forces."""
        if self.field != "torque":
            return self.title, self.unit
        return "force" if comparison.force_unit == "N" else self.title, comparison.force_unit

    def value(self, figures: Figures) -> float | None:
        """Its value."""
        found = getattr(figures, self.field)
        return None if found is None else float(found)


COLUMNS = (
    Column("position", "m", "position"),
    Column("torque", "N m", "torque"),
    Column("release", "s", "release"),
    Column("wall", "s", "wall_time"),
)


def percent(fraction: float | None) -> str:
    """A signed share in per cent, a dash for none."""
    if fraction is None:
        return "–"
    value = 100.0 * fraction
    if abs(value) >= 10:
        return f"{value:.0f} %"
    return f"{value:.1f} %" if abs(value) >= 0.1 else ("0 %" if value == 0 else "< 0.1 %")


def explained(quantity: Quantity) -> str:
    """How much of the error the causes account for; never rounded up to the whole."""
    return "–" if quantity.explained is None else _downwards(quantity.explained)


def _downwards(fraction: float) -> str:
    return "over 99.9 %" if fraction > 0.999 else f"{math.floor(1000 * max(0.0, fraction)) / 10:.1f} %"


def main_quantities(budget: Budget) -> list[Quantity]:
    """Position and stop torques: functions of time in which an error can be seen to grow."""
    return [
        q for q in budget.quantities if q.rms > 0 and (q.name == "position" or q.name.endswith((" torque", " force")))
    ]


def other_quantities(budget: Budget) -> list[Quantity]:
    """The rest of them."""
    shown = main_quantities(budget)
    return [q for q in budget.quantities if q.rms > 0 and q not in shown]


def shares(quantity: Quantity) -> list[Share]:
    """All shares, the unexplained last."""
    return [*quantity.shares, quantity.rest]


def spread(share: Share, quantity: Quantity) -> float:
    """Half the difference of a share's two measures, as part of the error."""
    return share.interaction / quantity.rms


def leading(quantity: Quantity) -> list[Share]:
    """Shares worth a word, the largest first."""
    return sorted(
        (share for share in quantity.shares if abs(share.fraction or 0.0) >= FEW),
        key=lambda share: -abs(share.fraction or 0.0),
    )


def factor(before: float | None, after: float | None) -> str:
    """How many times smaller a figure became; below 1 it grew."""
    if before is None or after is None or 0.0 in (before, after):
        return ""
    ratio = before / after
    return f"÷ {_two_digits(ratio)}" if ratio >= 1 else f"× {_two_digits(1 / ratio)}"


def _two_digits(value: float) -> str:
    return f"{value:.2g}" if value < 100 else (f"{value:.0f}" if value < 1e4 else figure(value))


def cells(figures: Figures, against: Figures) -> Iterator[tuple[str, str]]:
    """Figures of a setting, each with its factor against another one."""
    for column in COLUMNS:
        value = column.value(figures)
        yield figure(value), factor(column.value(against), value)


def rows(
    comparison: StockAgainstTuned,
) -> Iterator[tuple[str, Figures, Figures]]:
    """What is set, its figures, and what these are measured against."""
    yield "stock", comparison.stock, comparison.stock
    for change in comparison.changes:
        yield f"stock, {named(change)}", change.alone, comparison.stock
    yield "tuned", comparison.tuned, comparison.stock
    for change in comparison.changes:
        yield f"tuned, {named(change, back=True)}", change.back, comparison.tuned


def named(change: Change, back: bool = False) -> str:
    """An option with the value it is given."""
    value = change.stock if back else change.tuned
    return f"{change.option} = {_value(value)}"


def _value(value: object) -> str:
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, list):
        return "(" + ", ".join(_value(part) for part in value) + ")"
    return str(value)


def budgets_of(explanation: Explanation, machine: Machine) -> list[Budget]:
    """Budgets of one machine."""
    return [budget for budget in explanation.budgets if budget.model == machine.model]


def comparisons_of(explanation: Explanation, machine: Machine) -> list[StockAgainstTuned]:
    """Comparisons of one machine."""
    return [comparison for comparison in explanation.comparisons if comparison.model == machine.model]


def verdict(explanation: Explanation) -> str:
    """One line: how much of the errors is accounted for at worst."""
    found = [
        (quantity.explained, f"{quantity.name}, {budget.model} {budget.label}")
        for budget in explanation.budgets
        for quantity in main_quantities(budget)
        if quantity.explained is not None
    ]
    failed = sum(budget.message is not None for budget in explanation.budgets)
    lost = f" {failed} run{'s' if failed != 1 else ''} failed." if failed else ""
    if not found:
        return f"Nothing to explain.{lost}"
    least, where = min(found)
    return f"{_downwards(least)} or more of every error shown is explained (least: {where}).{lost}"
