"""Error budgets in a terminal."""

from __future__ import annotations

from collections.abc import Iterator

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from ..report.numbers import format_number as figure
from .results import Budget, Explanation, Figures, Quantity, StockAgainstTuned
from .text import COLUMNS, budgets_of, cells, comparisons_of, explained, leading, main_quantities, percent, verdict


def print_explanation(explanation: Explanation, to: Console) -> None:
    """The budgets in short, what each option buys, what could not be measured, and the verdict."""
    for machine in explanation.machines:
        own = budgets_of(explanation, machine)
        to.print(_budgets(f"{machine.model}: where the errors come from", own))
        for comparison in comparisons_of(explanation, machine):
            to.print(_changes(comparison))
        for sentence in _complaints(own):
            to.print(f"[yellow]{machine.model}, {sentence}[/]", soft_wrap=True)
    to.print(verdict(explanation))


def _table(title: str) -> Table:
    return Table(title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)


def _budgets(title: str, budgets: list[Budget]) -> Table:
    table = _table(title)
    table.add_column("engine", no_wrap=True)
    table.add_column("error of", no_wrap=True)
    for heading in ("rms", "explained"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("causes")
    for budget in budgets:
        for i, quantity in enumerate(main_quantities(budget)):
            size = f"{figure(quantity.rms)} {quantity.unit}"
            label = budget.label if i == 0 else ""
            table.add_row(label, quantity.name, size, explained(quantity), _causes(quantity))
    return table


def _causes(quantity: Quantity) -> str:
    return ", ".join(f"{share.cause} {percent(share.fraction)}" for share in leading(quantity))


def _changes(comparison: StockAgainstTuned) -> Table:
    at = "" if comparison.timestep is None else f", step {comparison.timestep:g} s"
    table = _table(f"{comparison.model}, {comparison.engine}{at}: what each option buys (÷ smaller, × larger)")
    table.add_column("setting", no_wrap=True)
    for column in COLUMNS:
        title, unit = column.heading(comparison)
        table.add_column(f"{title}\n\\[{unit}]", justify="right", no_wrap=True)
    table.add_row("stock", *_values(comparison.stock))
    for change in comparison.changes:
        table.add_row(f"  {change.option} as tuned", *_factors(change.alone, comparison.stock))
    table.add_row("tuned", *_values(comparison.tuned))
    for change in comparison.changes:
        table.add_row(f"  {change.option} as stock", *_factors(change.back, comparison.tuned))
    return table


def _values(figures: Figures) -> list[str]:
    return ["failed"] if figures.message else [value for value, _ in cells(figures, figures)]


def _factors(figures: Figures, against: Figures) -> list[str]:
    return ["failed"] if figures.message else [factor for _, factor in cells(figures, against)]


def _complaints(budgets: list[Budget]) -> Iterator[str]:
    for budget in budgets:
        if budget.message:
            yield f"{budget.label}: {budget.message}"
        for cause in budget.causes:
            if cause.message:
                yield f"{budget.label}, {cause.name}: not measured: {cause.message}"
