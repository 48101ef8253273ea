"""The few figures of a run that a table shows: one list, read by the terminal, the report and the README."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ..runs.results import Cause, Equality, Metric, Outcome, Run


@dataclass(frozen=True)
class Column:
    """A column of the agreement table."""

    title: str
    unit: str
    metrics: Callable[[Run], list[Metric]]
    """Those it stands for; the largest is shown."""
    short: str = ""
    """Title where there is little room; '' leaves the column out there."""

    def cell(self, run: Run) -> Cell:
        """What the table shows for a run."""
        found = self.metrics(run)
        values = [abs(m.value) for m in found if m.value is not None]
        broken = any(m.holds is False for m in found)
        judged = any(m.holds is not None for m in found)
        missing = any(m.value is None for m in found)
        largest = max(values) if values and not missing else None
        other = {m.unit for m in found} - {self.unit}
        text = figure(largest) if found else ""
        return Cell(f"{text} {other.pop()}" if other and largest is not None else text, largest, broken, judged)


@dataclass(frozen=True)
class Cell:
    """A shown figure, and how it stands to its tolerances."""

    text: str
    value: float | None
    broken: bool
    judged: bool


def _named(name: str, subject: str | None = None) -> Callable[[Run], list[Metric]]:
    def pick(run: Run) -> list[Metric]:
        return [m for m in run.metrics if m.name == name and subject in (None, m.subject)]

    return pick


COLUMNS: tuple[Column, ...] = (
    Column("projectile", "m", _named("position_max", "projectile"), short="position"),
    Column("counterweight", "m", _named("position_max", "counterweight")),
    Column("release", "s", _named("release_time"), short="release"),
    Column("launch time", "s", _named("launch_time")),
    Column("launch speed", "m/s", _named("launch_speed"), short="speed"),
    Column("stop torque", "N m", _named("stop_torque_max"), short="torque"),
    Column("joint force", "1", _named("joint_reaction_relative")),
    Column("energy", "1", _named("energy_drift"), short="energy"),
)


def figure(value: float | None) -> str:
    """A figure with two significant digits; a dash for none."""
    if value is None:
        return "–"
    return "0" if value == 0 else _scientific(value, digits=1)


def _scientific(value: float, digits: int) -> str:
    mantissa, exponent = f"{value:.{digits}e}".split("e")
    return f"{mantissa}e{int(exponent)}"


def cost(run: Run) -> str:
    """Wall time [s]."""
    return "–" if run.wall_time is None else f"{run.wall_time:.2f}"


def step(run: Run) -> str:
    """The step, as set, with as many digits as it needs."""
    value = run.settings.get("timestep")
    if not isinstance(value, float):
        return "–"
    digits = next(n for n in range(17) if float(_scientific(value, n)) == value or n == 3)
    return _scientific(value, digits)


def headline(run: Run) -> str:
    """Outcome in words."""
    return run.outcome.value if run.outcome in (Outcome.OK, Outcome.BROKEN) else f"{run.outcome.value}: {run.message}"


GATE_KINDS = (
    "total mass", "start", "centre of mass", "stop position", "mass matrix", "force", "acceleration", "stop torque",
)  # fmt: skip
"""Checks of the gate of equality, in the order of a table."""


@dataclass(frozen=True)
class GateCell:
    """A figure of the gate, and how it stands."""

    text: str
    mark: str


def gate_cell(equality: Equality, kind: str) -> GateCell:
    """The worst of a kind of checks; a dash where the engine does not show it."""
    checks = [check for check in equality.checks if check.name == kind]
    if not checks:
        return GateCell("–", "")
    values = [check.value for check in checks]
    worst = None if None in values else max(value for value in values if value is not None)
    return GateCell(figure(worst), "good" if all(check.holds for check in checks) else "bad")


def suspicion(cause: Cause) -> str:
    """A suspect in a line: what, how much of it, and how much of the deviation that accounts for."""
    amount = f" ({cause.amount})" if cause.amount else ""
    return f"{cause.name}{amount}: {100 * cause.explained:.1f} % of it"


def diagnosis(run: Run) -> list[str]:
    """When the run parts from the reference and why, in sentences; none for a run that agrees."""
    found = run.diagnosis
    if found is None:
        return []
    holding = ", ".join(found.holding) or "no stop"
    when = (
        "before any motion"
        if found.parts_at is None
        else f"at t = {found.parts_at:.6g} s, while {holding} held in the reference"
    )
    likely = "; ".join(suspicion(cause) for cause in found.causes[:3]) or "no suspect accounts for it"
    return [f"parts from the reference {when}; {found.leads} leads. Likeliest: {likely}."]


def complaints(run: Run) -> list[str]:
    """One sentence for each tolerance that does not hold."""
    sentences: list[str] = []
    for metric in run.metrics:
        if metric.holds is False:
            found = metric.note or f"{figure(metric.value)} {metric.unit}"
            allowed = f"tolerance {figure(metric.tolerance)} {metric.unit} ({metric.reason})"
            sentences.append(f"{metric.label}: {found}, {allowed}")
    return sentences
