"""Results as a person reads them in a terminal."""

from __future__ import annotations

from functools import cache

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from ...models.trajectory import Trajectory
from ..runs.results import Machine, Outcome, Pair, Results, Run
from .summary import COLUMNS, complaints, cost, diagnosis, figure, step

_SHORT = {
    Outcome.OK: "ok",
    Outcome.BROKEN: "broken",
    Outcome.UNEQUAL: "unequal",
    Outcome.FAILED: "failed",
    Outcome.ABSENT: "absent",
    Outcome.UNSUPPORTED: "cannot",
}
_STYLES = {Outcome.OK: "green", **dict.fromkeys((Outcome.BROKEN, Outcome.UNEQUAL, Outcome.FAILED), "bold red")}


@cache
def console() -> Console:
    """Standard output."""
    return Console(highlight=False)


def progress_console() -> Console:
    """Standard error, so that a progress bar never gets between the results."""
    return Console(stderr=True)


def print_results(results: Results, to: Console) -> None:
    """The agreement tables, the pairs, what broke, and the verdict."""
    for machine in results.machines:
        runs = [run for run in results.runs if run.model == machine.model]
        to.print(_agreement(machine, runs))
        pairs = _pairs([pair for pair in results.pairs if pair.model == machine.model])
        if pairs.row_count:
            to.print(pairs)
    for run in results.runs:
        for sentence in complaints(run):
            to.print(f"[bold red]{run.model}, {run.label}[/]: {sentence}", soft_wrap=True)
        if run.message:
            to.print(f"[yellow]{run.model}, {run.label}[/]: {run.message}", soft_wrap=True)
        for sentence in diagnosis(run):
            to.print(f"  [bold]why[/]: {sentence}", soft_wrap=True)
    to.print(verdict(results))


def verdict(results: Results) -> str:
    """One line: what was compared and whether it holds."""
    ran = [run for run in results.runs if run.outcome in (Outcome.OK, Outcome.BROKEN)]
    judged = [metric for run in ran for metric in run.metrics if metric.holds is not None]
    broken = [metric for metric in judged if not metric.holds]
    gates = [run.equality for run in results.runs if run.equality is not None and run.equality.exposed]
    equal = sum(gate.holds for gate in gates)
    counts = (
        f"{equal} of {len(gates)} built models equal, {len(ran)} of {len(results.runs)} runs compared, "
        f"{len(judged)} tolerances checked, {len(broken)} broken"
    )
    return f"{'Agreement holds' if results.passed else 'Agreement does not hold'}: {counts}."


def _agreement(machine: Machine, runs: list[Run]) -> Table:
    columns = [column for column in COLUMNS if column.short]
    table = Table(title=_title(machine), title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column("engine", no_wrap=True, min_width=15)
    for title, unit in [("step", "s"), *((c.short, c.unit) for c in columns), ("wall", "s")]:
        table.add_column(f"{title}\n\\[{unit}]", justify="right", no_wrap=True)
    table.add_column("")
    for run in runs:
        cells = [column.cell(run) for column in columns]
        shown = [f"[bold red]{cell.text}[/]" if cell.broken else cell.text for cell in cells]
        outcome = f"[{_STYLES.get(run.outcome, 'yellow')}]{_SHORT[run.outcome]}[/]"
        table.add_row(run.label, step(run), *shown, cost(run), outcome)
    return table


def _title(machine: Machine) -> str:
    if machine.launch_time is None or machine.launch_speed is None:
        what = "no launch"
    else:
        what = f"launch {machine.launch_time:.4f} s, {machine.launch_speed:.3f} m/s"
    return f"{machine.model}: largest differences to the reference ({what})"


def _pairs(pairs: list[Pair]) -> Table:
    title = "engine against engine (tuned; the report has all)"
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for name in ("first", "second"):
        table.add_column(name, no_wrap=True)
    for name in ("position\n\\[m]", "release\n\\[s]", "speed\n\\[m/s]"):
        table.add_column(name, justify="right")
    for pair in pairs:
        if pair.first.endswith("tuned") and pair.second.endswith("tuned"):
            speed = None if pair.launch_speed is None else abs(pair.launch_speed)
            figures = (figure(pair.position_max), figure(pair.release_time_max), figure(speed))
            table.add_row(pair.first, pair.second, *figures)
    return table


def print_summary(trajectory: Trajectory, to: Console) -> None:
    """What one run found."""
    provenance = trajectory.provenance
    title = f"{trajectory.mechanism.name}, {provenance.engine} {provenance.preset} ({provenance.engine_version})"
    table = Table(title=title, title_justify="left", show_header=False)
    table.add_column("what")
    table.add_column("value", justify="right")
    for what, value in _figures(trajectory):
        table.add_row(what, value)
    to.print(table)


def _figures(trajectory: Trajectory) -> list[tuple[str, str]]:
    rows = [("simulated", f"{trajectory.t[-1]:.6g} s in {trajectory.provenance.steps} steps")]
    rows.append(("wall time", f"{trajectory.provenance.wall_time:.3f} s"))
    for name, time in trajectory.release_times.items():
        if trajectory.mechanism.stop(name).closed:
            rows.append((f"{name} opens", "not" if time is None else f"{time:.9f} s"))
    for name, torque in trajectory.stop_torques.items():
        stop = trajectory.mechanism.stop(name)
        rows.append((f"{name}, largest {stop.effort}", f"{torque.max():.6g} {stop.force_unit}"))
    launch = trajectory.launch() if "projectile" in trajectory.markers else None
    if launch is not None:
        rows.append(("launch (velocity at 45 deg)", f"{launch.time:.9f} s"))
        rows.append(("launch speed", f"{launch.speed:.8f} m/s"))
    drift = np.abs(trajectory.total_energy - trajectory.total_energy[0]).max()
    rows.append(("energy drift", f"{drift:.3g} J of {trajectory.total_energy[0]:.6g} J"))
    return rows
