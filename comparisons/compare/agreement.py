"""The agreement tables: every run against the quantities in which it is measured."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from ..report.document import (
    Cell,
    Column,
    Row,
    Table,
    mark_of,
    page_only,
    row,
    table,
    terminal_only,
    without_empty_columns,
)
from ..report.numbers import format_number, format_step
from ..runs.results import COMPARED, Machine, Metric, Outcome, Results, Run
from . import plots
from .sentences import MARKS, why_anchor


@dataclass(frozen=True)
class Quantity:
    """A quantity of the agreement table: the largest of the metrics of one name."""

    title: str
    unit: str
    metric: str
    subject: str | None = None
    judged: str = ""
    """Metric that has the verdict, if that is another one."""
    otherwise: str = ""
    """Metric in the place of one that the run has not."""
    short: str = ""
    """Title in a terminal; '' leaves the column out there."""
    rank: int = 1
    """As that of its column."""
    plot: str = ""
    """Name of the figure that shows it over time."""

    @property
    def column(self) -> Column:
        """Its column in a table of runs."""
        medium = "any" if self.short else "page"
        return Column(
            self.title, self.unit, short=self.short, of=self.cell, rank=self.rank, medium=medium
        )

    def metrics(self, run: Run) -> list[Metric]:
        """Those it stands for."""
        of = [m for m in run.metrics if m.observed and self.subject in (None, m.subject)]
        return [m for m in of if m.name == self.metric] or [
            m for m in of if m.name == self.otherwise
        ]

    def value(self, run: Run) -> float | None:
        """The largest; None if one is missing, or the run has none."""
        return largest(m.value for m in self.metrics(run))

    def cell(self, run: Run) -> Cell:
        """The value, with its unit where that is not the column's, marked by its tolerances."""
        metrics, value = self.metrics(run), self.value(run)
        if not metrics:
            return Cell("")
        other = (
            "" if value is None else "".join({f" {m.unit}" for m in metrics} - {f" {self.unit}"})
        )
        named = [
            m
            for m in run.metrics
            if m.name == (self.judged or self.metric) and self.subject in (None, m.subject)
        ]
        text = format_number(value) + other
        if all(metric.holds is None for metric in named):
            return Cell(text, "unjudged", hint="compared, but held against no tolerance")
        return Cell(
            text,
            mark_of(all(m.holds is not False for m in named)),
            hint=_hint(named),
            heat=_heat(named),
        )

    def linked(self, run: Run) -> Cell:
        """The cell with a link to its plot, for a page; what the engine does not tell is said to be so."""
        cell = self.cell(run)
        if not cell.text:
            return Cell(
                "–" if run.metrics else "",
                hint="not observed, or not part of this motion" if run.metrics else "",
            )
        return replace(cell, link=plots.anchor(run.model, self.plot) if self.plot else "")


def _hint(judged: Sequence[Metric]) -> str:
    """Each metric with its tolerance."""
    return "; ".join(
        f"{m.label}: {format_number(m.value)} {m.unit}, tolerance {format_number(m.tolerance)}"
        for m in judged[:_HINTS]
    )


_HINTS = 6


def _heat(judged: Sequence[Metric]) -> float | None:
    """How far the worst lies within (negative) or beyond (positive) its tolerance: 8 and 3 decades are the ends."""
    shares = [metric.share for metric in judged if metric.share is not None]
    if not shares:
        return None
    worst = max(shares)
    if worst > 1:
        return min(1.0, 0.3 + 0.7 * math.log10(worst) / 3)
    return -min(1.0, 0.1 - 0.9 * math.log10(worst) / 8) if worst > 0 else -1.0


def largest(values: Iterable[float | None]) -> float | None:
    """Magnitude of the largest; None if one is missing, or all are."""
    sizes = [None if value is None else abs(value) for value in values]
    return (
        None if None in sizes else max((size for size in sizes if size is not None), default=None)
    )


_POSITION = Quantity("position", "m", "position_max", short="position", plot=plots.DISTANCES)
_QUANTITIES = (
    Quantity("release", "s", "release_time", short="release", rank=2, plot=plots.DISTANCES),
    Quantity("launch time", "s", "launch_time", plot=plots.DISTANCES),
    Quantity("launch speed", "m/s", "launch_speed", short="speed", rank=4, plot=plots.DISTANCES),
    Quantity("stop torque", "N m", "stop_torque_max", short="torque", rank=2, plot=plots.TORQUES),
    Quantity(
        "joint force",
        "1",
        "joint_reaction_relative",
        judged="joint_reaction_max",
        plot=plots.JOINT_FORCES,
    ),
    Quantity(
        "energy",
        "1",
        "energy_drift",
        judged="energy_balance",
        otherwise="energy_drift_kinetic",
        short="energy",
        rank=3,
        plot=plots.ENERGY,
    ),
)
OVERVIEW = (_POSITION, *_QUANTITIES)
"""One value of each quantity, whatever markers the mechanism has."""


def quantities(machine: Machine) -> tuple[Quantity, ...]:
    """Quantities of the agreement table: the position of each marker, then what every mechanism has."""
    positions = (
        Quantity(marker.name, "m", "position_max", marker.name)
        for marker in machine.mechanism.markers
    )
    return (*positions, *_QUANTITIES)


def differences(machine: Machine) -> tuple[Column, ...]:
    """Columns of a table of its runs: engine, step, and the quantities."""
    return (
        Column("engine", of=lambda run: run.label),
        Column("step", "s", of=lambda run: format_step(run.settings.get("timestep")), rank=5),
        replace(_POSITION.column, medium="terminal"),
        *(quantity.column for quantity in quantities(machine)),
    )


def agreement(machine: Machine, runs: Iterable[Run]) -> Table:
    """Of one machine, for a terminal."""
    heads = (*differences(machine), _WALL, Column("verdict", of=verdict_cell, wrap=False, rank=0))
    launch = "no launch"
    if machine.launch_time is not None and machine.launch_speed is not None:
        launch = f"launch {machine.launch_time:.4f} s, {machine.launch_speed:.3f} m/s"
    caption = f"{machine.model}: largest differences to the reference ({launch})"
    return terminal_only(without_empty_columns(table(heads, runs, caption)))


_WALL = Column(
    "wall", "s", of=lambda run: "–" if run.wall_time is None else f"{run.wall_time:.2f}", rank=6
)


def overview(results: Results) -> Table:
    """Every run of every machine against every quantity, for a page."""
    quantities = [q for q in OVERVIEW if any(q.metrics(run) for run in results.runs)]
    heads = [
        Column("engine", of=lambda run: run.label),
        Column("verdict", align="left", wrap=False, of=verdict_cell),
        *(Column(quantity.title, quantity.unit) for quantity in quantities),
        Column("further", align="left"),
        Column("step", "s"),
        _WALL,
    ]
    several = len(results.machines) > 1
    rows: list[Row] = []
    for machine in results.machines:
        rows += [row(f"{machine.model} machine")] if several else []
        rows += [
            _overview_row(machine, run, quantities)
            for run in results.runs
            if run.model == machine.model
        ]
    return page_only(without_empty_columns(table(heads, rows, _CAPTION)))


_CAPTION = (
    "Largest errors of every run. ✓ holds its tolerance, ✗ breaks it, ○ compared but not judged, – not observed; the "
    "darker a cell, the further within (blue) or beyond (orange) its tolerance. Each number leads to its plot."
)


def _overview_row(machine: Machine, run: Run, quantities: Sequence[Quantity]) -> Row:
    anchors = plots.anchors(machine)
    cells = (quantity.linked(run) for quantity in quantities)
    linked = [cell if cell.link in anchors else replace(cell, link="") for cell in cells]
    agrees = run.outcome is Outcome.AGREES
    verdict = replace(verdict_cell(run), link=metrics_anchor(run) if agrees else why_anchor(run))
    step, wall = Cell(format_step(run.settings.get("timestep"))), Cell(str(_WALL.of(run)))
    own = plots.anchor(run.model, run.label)
    return Row((Cell(run.label), verdict, *linked, _further(run, quantities), step, wall), own)


def metrics_anchor(run: Run) -> str:
    """Anchor of the table of all metrics of a run."""
    return plots.anchor(run.model, f"metrics {run.label}")


def _further(run: Run, quantities: Sequence[Quantity]) -> Cell:
    """How many of the judged metrics that have no column hold."""
    named = {quantity.judged or quantity.metric for quantity in quantities}
    rest = [metric for metric in run.judged if metric.name not in named]
    if not rest:
        return Cell("")
    held = sum(metric.holds is True for metric in rest)
    broken = ", ".join(metric.label for metric in rest if metric.holds is False)
    return Cell(
        f"{held}/{len(rest)}", mark_of(held == len(rest)), hint=broken, link=metrics_anchor(run)
    )


def verdict_cell(run: Run) -> Cell:
    """The outcome, with how many of the judged quantities hold."""
    judged, held = len(run.judged), len(run.judged) - len(run.broken)
    counts = f" {held}/{judged}" if run.outcome in COMPARED else ""
    return Cell(f"{run.outcome.value}{counts}", MARKS[run.outcome])


def ranking(results: Results) -> list[tuple[Run, float]]:
    """Runs from the nearest to the reference to the farthest, with their largest distance of a marker [m].

    Runs of one engine and preset on several machines count by their worst.
    """
    worst: dict[str, tuple[Run, float]] = {}
    for run in results.ran:
        distance = _POSITION.value(run)
        if (
            run.engine != "reference"
            and distance is not None
            and distance >= worst.get(run.label, (run, -1.0))[1]
        ):
            worst[run.label] = (run, distance)
    return sorted(worst.values(), key=lambda each: each[1])
