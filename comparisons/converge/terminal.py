"""Studies as a person reads them in a terminal."""

from __future__ import annotations

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from ..report.numbers import format_number as figure
from .results import MachineStudies, Studies
from .text import cause, distance, exponent, failures, floor, knob, of_others, of_the_step, span, tuned_pairs


def print_studies(studies: Studies, to: Console) -> None:
    """Orders, laws, limits against each other, and what failed."""
    for machine in studies.machines:
        for table in (_steps(machine), _others(machine), _pairs(machine)):
            if table.row_count:
                to.print(table)
    for sentence in failures(studies):
        to.print(f"[yellow]{sentence}[/]", soft_wrap=True)


def _table(title: str, *columns: str) -> Table:
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for column in columns:
        table.add_column(column, no_wrap=column in ("engine", "knob"))
    return table


def _steps(machine: MachineStudies) -> Table:
    title = f"{machine.model}: order of the position's error in the time step, 95 % confidence"
    table = _table(title, "engine", "order", "range \\[s]", "floor", "set by", "limit to reference \\[m]")
    for study in of_the_step(machine):
        curve = study.curve("position")
        limit = distance(machine.limit(study.label))
        table.add_row(study.label, exponent(curve.law), span(curve.law), floor(curve), cause(curve), limit)
    return table


def _others(machine: MachineStudies) -> Table:
    title = f"{machine.model}: other knobs, exponent of the position's error"
    table = _table(title, "engine", "knob", "expected", "exponent", "range", "what is left", "set by")
    for study in of_others(machine):
        curve = study.curve("position")
        expected = "–" if study.expected is None else f"{study.expected:g}"
        figures = (exponent(curve.law), span(curve.law), floor(curve), cause(curve))
        table.add_row(study.label, knob(study), expected, *figures)
    return table


def _pairs(machine: MachineStudies) -> Table:
    title = f"{machine.model}: Richardson limits against each other"
    table = _table(title, "first", "second", "position \\[m]")
    for pair in tuned_pairs(machine):
        table.add_row(pair.first, pair.second, figure(pair.position))
    return table
