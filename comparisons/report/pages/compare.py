"""The page of a comparison: verdicts, agreement, plots over time, causes, evidence; its summary."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import pairwise
from operator import attrgetter, methodcaller

import numpy as np

from ....engines.supplied import sentence as supplied_sentence
from ....models.arrays import FloatArray
from ....models.library.trebuchet import parameters_of
from ....models.problem import StopLaw
from ....models.trajectory import Trajectory
from ....reference.certification.certificate import load_certificate
from ....reference.solution import Solution
from ...compare import Comparison
from ...runs.balance import sampled_balance
from ...runs.metrics import LEAST_START
from ...runs.results import (
    COMPARED,
    FAILURES,
    Equality,
    Machine,
    Metric,
    Outcome,
    Pair,
    Results,
    Run,
)
from ...runs.study import REFERENCE as REFERENCE_ENGINE
from .. import document as doc
from ..drawing.scene import Scene
from ..numbers import format_number, format_settings, format_step, sentence
from ..plots import REFERENCE, Axis, Panels, Plot, Rule, Series, Style, motion_scene, run_style
from .tables import (
    MARKS,
    capital,
    cause_text,
    certified_figures,
    chapter,
    complaints,
    diagnosis,
    is_tuned,
    partings,
    predictable,
    provenance,
    verdict_blocks,
    why,
)

_QUESTION = "How far can you trust a multibody engine, and why does it differ?"
_INTRODUCTION = (
    "Each engine builds the same mechanism from its own primitives. Differences are the largest up "
    "to the end of the compared motion, the reference taken at the engine's own sample times. "
    "Values marked ✓ hold a tolerance, values marked ✗ break one. A run agrees if every compared "
    "quantity holds its tolerance: the user's need where one is stated, else the engine's claim, "
    "else a thousandth of the quantity's scale. What one solver does and the other does not (a "
    "launch, a release, an impact) is a disagreement. “Stock” is what an engine's documentation "
    "leads a newcomer to, “tuned” the most accurate settings found."
)
_EQUIVALENCE = (
    "Before any motion, each engine's built model is compared with the reference's equations in "
    "random states under every set of closed stops. Each value is the largest relative difference "
    "of its kind; a dash stands for what the engine does not expose, “not checked” an engine that "
    "exposes nothing. A run whose model differs is not compared."
)
_MOST = 3  # sentences on broken tolerances of one run; the table of all metrics has the rest


def document(comparison: Comparison) -> doc.Document:
    """The whole; a terminal has the tables in short, what broke, and the verdict at its end."""
    results = comparison.results
    machines = results.machines
    first_verdict, last_verdict = verdict_blocks(verdict(results), doc.mark_of(results.passed))
    blocks: list[doc.Block] = [first_verdict, _tiles(results)]
    if machines:
        blocks.append(motion(comparison))
    blocks.append(overview(results))
    if any(run.wall_time for run in results.ran):
        blocks.append(work_precision(machines, results.runs))
    for machine in machines:
        blocks += _chapter(comparison, machine)
    if any(run.outcome is not Outcome.AGREES for run in results.runs):
        blocks.append(doc.Heading("What differs, and why", 2, "why"))
        blocks += map(doc.page_only, _differing(results))
    for machine in machines:
        blocks += _evidence(comparison, machine)
    runs = ((run.model, run.label, run.engine_version, run.settings) for run in results.runs)
    mechanisms = [(machine.model, machine.mechanism) for machine in machines]
    blocks += [
        doc.Heading("How the comparison is made", 2),
        doc.Note(_INTRODUCTION),
        doc.Note(_EQUIVALENCE),
        doc.page_only(_assistance(results)),
        *provenance(results, runs, mechanisms),
        doc.terminal_only(doc.Listing(tuple(_findings(results)))),
        last_verdict,
    ]
    window = f"trebucheck: {', '.join(machine.model for machine in machines)}"
    return doc.Document(_QUESTION, tuple(blocks), window, verdict=verdict(results))


# --- Verdicts


def verdict(results: Results) -> str:
    """One line: how many runs came to which verdict, and what was judged."""
    counted = Counter(run.outcome for run in results.runs)
    plurals = {Outcome.AGREES: "agree", Outcome.DISAGREES: "disagree"}
    outcomes = ", ".join(
        f"{counted[each]} {plurals.get(each, each.value)}" for each in Outcome if counted[each]
    )
    judged = sum(len(run.judged) for run in results.runs)
    held = judged - sum(len(run.broken) for run in results.runs)
    checks = [run.equality for run in results.runs if run.equality is not None]
    exposed = [check for check in checks if check.exposed]
    models = f"{sum(check.holds for check in exposed)} of {len(exposed)} built models equivalent"
    if len(exposed) < len(checks):
        models += f", {len(checks) - len(exposed)} not checked"
    quantities = f"{held} of {judged} judged quantities hold"
    headline = _headline(results, judged > 0)
    return f"{headline}. Runs: {outcomes or 'none'}; {quantities}; {models}."


def _headline(results: Results, judged: bool) -> str:
    if not judged:
        return "Nothing was judged"
    if not results.passed:
        return "Agreement does not hold"
    if any(run.outcome is Outcome.NOT_JUDGED for run in results.runs):
        return "Nothing disagrees, but not all could be judged"
    return "Agreement holds"


def _findings(results: Results) -> Iterator[doc.Text]:
    """Broken tolerances and failed runs, with causes."""
    for run in results.runs:
        name = f"{run.model}, {run.label}"
        for line in complaints(run, _MOST):
            yield doc.Text(line, "bad", lead=f"{name}:")
        if run.message:
            text = f"{run.outcome.value}: {run.message}"
            yield doc.Text(text, MARKS[run.outcome], lead=f"{name}:")
        if run.unjudged:
            yield doc.Text(_unjudged(run), "warning", lead=f"{name}:")
        for line in diagnosis(run):
            yield doc.Text(line, "strong", lead=f"{name}, why:")


def _differing(results: Results) -> Iterator[doc.Block]:
    """A section for each run that does not agree: broken tolerances and causes."""
    for run in results.runs:
        if run.outcome is Outcome.AGREES:
            continue
        yield doc.Heading(f"{run.model}, {run.label}: {run.outcome.value}", 3, _why_anchor(run))
        yield from why(run)
        items = [doc.Text(line, "bad") for line in complaints(run, _MOST)]
        if run.message:
            items.append(doc.Text(capital(run.message), MARKS[run.outcome]))
        if run.unjudged:
            items.append(doc.Text(_unjudged(run), "unjudged"))
        yield doc.Listing(tuple(items))


def _unjudged(run: Run) -> str:
    labels = ", ".join(metric.label for metric in run.unjudged)
    return f"not judged: {labels} ({run.unjudged[0].note})."


def _assistance(results: Results) -> doc.Listing:
    """Assistance of trebucheck, by engine and preset."""
    stated = {run.label: run.supplied for run in results.runs if run.supplied is not None}
    items = (doc.Text(supplied_sentence(s), lead=f"{name}:") for name, s in sorted(stated.items()))
    return doc.Listing(tuple(items))


def _tiles(results: Results) -> doc.Tiles:
    """Verdicts counted, and the engines at both ends of the ranking by distance."""
    counted = Counter(run.outcome for run in results.runs)
    failed = sum(counted[each] for each in (*FAILURES, Outcome.NOT_EQUIVALENT))
    rest = sum(counted[each] for each in (Outcome.NOT_JUDGED, Outcome.ABSENT, Outcome.UNSUPPORTED))
    counts: list[tuple[int, str, doc.Mark]] = [
        (counted[Outcome.AGREES], "agree", "good"),
        (counted[Outcome.DISAGREES], "disagree", "bad"),
    ]
    if failed:
        counts.append((failed, "failed or not equivalent", "bad"))
    counts.append((rest, "not judged", "warning"))
    tiles = [doc.Tile(str(n), label, mark if n else "plain") for n, label, mark in counts]
    ranked = _ranking(results)
    if len(ranked) > 1:
        ends = ((ranked[0], "nearest to the reference"), (ranked[-1], "farthest from it"))
        for (run, distance), label in ends:
            detail = f"at most {format_number(distance)} m"
            tiles.append(doc.Tile(run.label, label, detail=detail))
    return doc.Tiles(tuple(tiles))


def _ranking(results: Results) -> list[tuple[Run, float]]:
    """Runs from the nearest to the reference to the farthest, with a marker's largest distance [m].

    Runs of one engine and preset on several machines count by their worst.
    """
    worst: dict[str, tuple[Run, float]] = {}
    for run in results.ran:
        distance = _POSITION.value(run)
        if run.engine == REFERENCE_ENGINE or distance is None:
            continue
        if distance >= worst.get(run.label, (run, -1.0))[1]:
            worst[run.label] = (run, distance)
    return sorted(worst.values(), key=lambda each: each[1])


# --- Plots over time

_POINTS = 300  # drawn per line: more than a plot has columns of pixels; a page stays below 2 MB
_COLUMNS = 4
_SEEN = 5e-3  # of a plot's range: a run nearer to the reference is covered by its line
_TIME = Axis("t", "s")
DISTANCES, TORQUES, FORCES = "distances", "stop torques", "stop forces"
JOINT_FORCES, COORDINATES, ENERGY = "joint forces", "coordinates", "energy"

Sampled = Callable[[Trajectory], FloatArray]
"""A quantity over time; ValueError where the engine cannot observe it."""


@dataclass(frozen=True)
class Line:
    """A run as drawn: up to the end of the compared motion."""

    trajectory: Trajectory
    reference: Trajectory
    """At the run's own times up to that end."""

    @property
    def label(self) -> str:
        """Engine and preset."""
        return f"{self.trajectory.provenance.engine} {self.trajectory.provenance.preset}"

    @property
    def style(self) -> Style:
        """Colour by engine, dashes by preset."""
        return run_style(self.trajectory.provenance.engine, self.trajectory.provenance.preset)

    def values(self, quantity: Sampled) -> Series | None:
        """The quantity, thinned; None if the reference's line would cover it."""
        t = self.reference.t
        values, known = quantity(self.trajectory)[: len(t)], quantity(self.reference)
        if np.abs(values - known).max() <= _SEEN * np.ptp(known):
            return None
        chosen = np.unique(np.linspace(0, len(t) - 1, _POINTS).astype(int))
        return Series(self.label, t[chosen], values[chosen], self.style)

    def difference(self, quantity: Sampled) -> Series:
        """Absolute differences to the reference, distances for points, as `thinned`."""
        known = quantity(self.reference)
        difference = quantity(self.trajectory)[: len(known)] - known
        size = np.abs(difference) if difference.ndim == 1 else np.linalg.norm(difference, axis=1)
        return Series(self.label, *thinned(self.reference.t, size), self.style)


def lines(solution: Solution, trajectories: Mapping[str, Trajectory], end: float) -> list[Line]:
    """Runs of one machine up to `end` [s], but for the tuned reference."""
    return [
        Line(trajectory, solution.trajectory(trajectory.t[trajectory.t <= end]))
        for trajectory in trajectories.values()
        if (trajectory.provenance.engine, trajectory.provenance.preset) != ("reference", "tuned")
    ]


def thinned(t: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Few enough points to draw: the largest value in each of `_POINTS` intervals, at its end."""
    if len(t) <= _POINTS:
        return t, values
    edges = np.linspace(0, len(t), _POINTS + 1).astype(int)
    return t[edges[1:] - 1], np.array([values[a:b].max() for a, b in pairwise(edges)])


def _runs_of(comparison: Comparison, machine: Machine) -> dict[str, Trajectory]:
    """Trajectories of a machine's runs, by label."""
    return {
        label: trajectory
        for (model, label), trajectory in comparison.trajectories.items()
        if model == machine.model
    }


def motion(comparison: Comparison) -> doc.AnimationBlock:
    """Every machine in motion, all its runs over the reference."""

    def scenes() -> tuple[Scene, ...]:
        return tuple(
            motion_scene(
                comparison.solutions[machine.model].trajectory,
                _runs_of(comparison, machine),
                end=machine.compared_to,
                thrown=machine.thrown,
                launch=machine.launch_time,
                name=machine.model,
            )
            for machine in comparison.results.machines
        )

    return doc.AnimationBlock(scenes)


def figures(comparison: Comparison, machine: Machine) -> doc.Grid:
    """All plots of one machine over time, drawn when a page needs them; they zoom together."""

    @cache
    def drawn() -> tuple[Solution, list[Line]]:
        solution = comparison.solutions[machine.model]
        return solution, lines(solution, _runs_of(comparison, machine), machine.compared_to)

    def panels(draw: _Draw) -> Panels:
        return draw(*drawn())

    model = machine.model
    blocks = tuple(
        doc.Figure(
            partial(panels, draw), name.capitalize(), caption, anchor(model, name), model,
            columns=min(columns, _COLUMNS),
        )
        for name, caption, columns, draw in _figures(machine)
    )  # fmt: skip
    return doc.Grid(blocks)


def anchor(model: str, name: str) -> str:
    """Anchor of a machine's figure or section of that name."""
    return f"{model}-{name}".lower().replace(" ", "-")


_Draw = Callable[[Solution, Sequence[Line]], Panels]


def _figures(machine: Machine) -> Iterator[tuple[str, str, int, _Draw]]:
    """Name, sentence, number of quantities, and what draws it."""
    end = machine.compared_to
    marks = tuple(
        Rule(time, f"{name} opens")
        for name, time in machine.release_times.items()
        if time is not None and time <= end
    )
    markers = {marker.name: position(marker.name) for marker in machine.mechanism.markers}
    if markers:
        text = (
            "Of each marker from the reference, at the engine's own times; no sample is "
            f"interpolated. Of each {_POINTS}th of the motion the largest is drawn."
        )
        draw = partial(_over_time, quantities=markers, unit="m", marks=marks)
        yield DISTANCES, text, len(markers), draw
    for name, text, unit, quantities in _quantities(machine):
        if quantities:
            rows = "Upper row: the reference, and runs that part from its line. Lower row: "
            draw = partial(_over_time, quantities=quantities, unit=unit, marks=marks, end=end)
            yield name, f"{text} {rows}differences.", len(quantities), draw
    text = (
        "Total energy less the work of dampers, constant forces and torques, as a share of the "
        "energy at the start (where that is near zero: of the largest kinetic energy). Any drift "
        "but at impacts is numerical."
    )
    yield ENERGY, text, 1, partial(_energy_drift, marks=marks)


def _quantities(machine: Machine) -> Iterator[tuple[str, str, str, dict[str, Sampled]]]:
    """Name, sentence, unit and quantities of the plots over time."""
    mechanism = machine.mechanism
    text = "At least 0 while the contact of the stop is active, 0 once it is released."
    for name, unit in ((TORQUES, "N m"), (FORCES, "N")):
        closed = (s.name for s in mechanism.stops if s.closed and s.force_unit == unit)
        yield name, text, unit, {stop: methodcaller("stop_torque", stop) for stop in closed}
    held = (joint.name for joint in mechanism.joints if joint.held_directions)
    forces: dict[str, Sampled] = {name: partial(_joint_force, name=name) for name in held}
    yield JOINT_FORCES, "Magnitude of the force on each joint's child.", "N", forces
    angles = {name: partial(_coordinate, index=i) for i, name in enumerate(mechanism.angles)}
    yield COORDINATES, "Absolute angles, positive clockwise.", "rad", dict(angles)


def _coordinate(run: Trajectory, index: int) -> FloatArray:
    return run.q[:, index]


def _joint_force(run: Trajectory, name: str) -> FloatArray:
    return np.linalg.norm(run.joint_reaction(name), axis=1)


def position(name: str) -> Sampled:
    """Position of a marker [m]."""
    return lambda run: run.marker(name).position


def _over_time(
    solution: Solution,
    runs: Sequence[Line],
    quantities: Mapping[str, Sampled],
    unit: str,
    marks: tuple[Rule, ...],
    end: float | None = None,
) -> Panels:
    """Quantities up to `end` [s], then their differences to the reference; without it only these.

    A run whose engine cannot observe a quantity has no line.
    """
    panels: list[Plot] = []
    axis = Axis("distance", unit, logarithmic=True)
    if end is not None:
        reference = solution.trajectory(np.linspace(0.0, end, _POINTS))
        for name, quantity in quantities.items():
            series = [Series("reference", reference.t, quantity(reference), REFERENCE)]
            series += _observed(runs, methodcaller("values", quantity))
            panels.append(Plot(_TIME, Axis("", unit), tuple(series), name, rules=marks, height=230))
        axis = Axis("difference", unit, logarithmic=True)
        marks = tuple(Rule(mark.at) for mark in marks)
    for name, quantity in quantities.items():
        series = _observed(runs, methodcaller("difference", quantity))
        panels.append(Plot(_TIME, axis, tuple(series), name, rules=marks, height=250))
    return tuple(panels)


def _observed(runs: Iterable[Line], draw: Callable[[Line], Series | None]) -> list[Series]:
    """Series of the runs that tell a quantity and can be seen."""
    series: list[Series] = []
    for run in runs:
        with suppress(ValueError):
            one = draw(run)
            if one is not None:
                series.append(one)
    return series


def _energy_drift(solution: Solution, runs: Sequence[Line], marks: tuple[Rule, ...]) -> Panels:
    """Energy drift relative to the energy at the start, or to the largest kinetic energy."""
    end = max((run.reference.t[-1] for run in runs), default=0.0)
    known = solution.trajectory(np.linspace(0.0, end, _POINTS))
    start, kinetic = float(known.total_energy[0]), float(known.kinetic_energy.max())
    size, name = kinetic, "largest T"
    if abs(start) > LEAST_START * kinetic:
        size, name = abs(start), "|E(0)|"
    series: list[Series] = []
    for run in runs:
        t, (energy, _) = run.reference.t, sampled_balance(run.trajectory)
        drift = np.abs(energy[: len(t)] - start) / (size or 1.0)
        series.append(Series(run.label, *thinned(t, drift), run.style))
    axis = Axis(f"|E - E(0)| / {name}", "1", logarithmic=True)
    if not size:
        axis = Axis("|E - E(0)|", "J", logarithmic=True)
    return (Plot(_TIME, axis, tuple(series), height=250, rules=marks),)


def work_precision(machines: Sequence[Machine], runs: Sequence[Run]) -> doc.Figure:
    """Error of every run against its wall time: a panel a machine."""
    time = Axis("wall time", "s", logarithmic=True)
    distance = Axis("largest distance of a marker", "m", logarithmic=True)
    panels: list[Plot] = []
    for machine in machines:
        own = (run for run in runs if run.model == machine.model)
        panels.append(Plot(time, distance, tuple(_priced(own)), machine.model))
    text = (
        "Further left is quicker, further down more accurate. Wall times are of this computer, "
        "with everything that the run does: build, simulation, read-out."
    )
    return doc.Figure(tuple(panels), "Error against wall time", text, "work-precision")


def _priced(runs: Iterable[Run]) -> Iterator[Series]:
    for run in runs:
        distance = largest(m.value for m in run.metrics if m.name == "position_max" and m.observed)
        if run.wall_time and distance is not None:
            style, hints = run_style(run.engine, run.preset), (f"{run.steps} steps",)
            x, y = np.array([run.wall_time]), np.array([distance])
            yield Series(run.label, x, y, style, "points", hints)


# --- Agreement

_HINTS = 6
_AGREEMENT = (
    "Largest errors of every run. ✓ holds its tolerance, ✗ breaks it, ○ compared but not judged, – "
    "not observed; the darker a cell, the further within (blue) or beyond (orange) its tolerance. "
    "Each number leads to its plot."
)


@dataclass(frozen=True)
class ErrorColumn:
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
    """Rank of its column."""
    plot: str = ""
    """Name of the figure that shows it over time."""

    @property
    def column(self) -> doc.Column:
        """Its column in a table of runs."""
        medium: doc.Medium = "any" if self.short else "page"
        return doc.Column(
            self.title, self.unit, short=self.short, of=self.cell, rank=self.rank, medium=medium
        )

    def metrics(self, run: Run) -> list[Metric]:
        """Those it stands for."""
        own = [m for m in run.metrics if m.observed and self.subject in (None, m.subject)]
        named = [m for m in own if m.name == self.metric]
        return named or [m for m in own if m.name == self.otherwise]

    def value(self, run: Run) -> float | None:
        """The largest; None if one is missing, or the run has none."""
        return largest(m.value for m in self.metrics(run))

    def cell(self, run: Run) -> doc.Cell:
        """The value, with its unit where that is not the column's, marked by its tolerances."""
        metrics, value = self.metrics(run), self.value(run)
        if not metrics:
            return doc.Cell("")
        text = format_number(value)
        if value is not None:
            text += "".join({f" {m.unit}" for m in metrics} - {f" {self.unit}"})
        name = self.judged or self.metric
        judged = [m for m in run.metrics if m.name == name and self.subject in (None, m.subject)]
        if all(metric.holds is None for metric in judged):
            return doc.Cell(text, "unjudged", hint="compared, but held against no tolerance")
        hint = "; ".join(
            f"{m.label}: {format_number(m.value)} {m.unit}, tolerance {format_number(m.tolerance)}"
            for m in judged[:_HINTS]
        )
        mark = doc.mark_of(all(m.holds is not False for m in judged))
        return doc.Cell(text, mark, hint=hint, heat=_heat(judged))

    def linked(self, run: Run) -> doc.Cell:
        """The cell with a link to its plot, for a page; a dash where the engine tells nothing."""
        cell = self.cell(run)
        if cell.text:
            return replace(cell, link=anchor(run.model, self.plot) if self.plot else "")
        if run.metrics:
            return doc.Cell("–", hint="not observed, or not part of this motion")
        return doc.Cell("")


def _heat(judged: Sequence[Metric]) -> float | None:
    """From -1 to 1: the worst, 8 decades within its tolerance or 3 beyond it at the ends."""
    worst = max((m.share for m in judged if m.share is not None), default=None)
    if worst is None:
        return None
    if worst > 1:
        return min(1.0, 0.3 + 0.7 * math.log10(worst) / 3)
    return -min(1.0, 0.1 - 0.9 * math.log10(worst) / 8) if worst > 0 else -1.0


def largest(values: Iterable[float | None]) -> float | None:
    """Magnitude of the largest; None if one is missing, or all are."""
    sizes: list[float] = []
    for value in values:
        if value is None:
            return None
        sizes.append(abs(value))
    return max(sizes, default=None)


_POSITION = ErrorColumn("position", "m", "position_max", short="position", plot=DISTANCES)
_QUANTITIES = (
    ErrorColumn("release", "s", "release_time", short="release", rank=2, plot=DISTANCES),
    ErrorColumn("launch time", "s", "launch_time", plot=DISTANCES),
    ErrorColumn("launch speed", "m/s", "launch_speed", short="speed", rank=4, plot=DISTANCES),
    ErrorColumn("stop torque", "N m", "stop_torque_max", short="torque", rank=2, plot=TORQUES),
    ErrorColumn(
        "joint force", "1", "joint_reaction_relative", judged="joint_reaction_max",
        plot=JOINT_FORCES,
    ),
    ErrorColumn(
        "energy", "1", "energy_drift", judged="energy_balance", otherwise="energy_drift_kinetic",
        short="energy", rank=3, plot=ENERGY,
    ),
)  # fmt: skip
OVERVIEW = (_POSITION, *_QUANTITIES)
"""One value of each quantity, whatever markers the mechanism has."""


def _wall_time(run: Run) -> str:
    return "–" if run.wall_time is None else f"{run.wall_time:.2f}"


def _step(run: Run) -> str:
    return format_step(run.settings.get("timestep"))


_ENGINE = doc.Column("engine", of=attrgetter("label"))
_WALL = doc.Column("wall", "s", of=_wall_time, rank=6)


def quantities(machine: Machine) -> tuple[ErrorColumn, ...]:
    """Quantities of the agreement table: each marker's position, then what all mechanisms have."""
    markers = machine.mechanism.markers
    positions = (ErrorColumn(each.name, "m", "position_max", each.name) for each in markers)
    return (*positions, *_QUANTITIES)


def differences(machine: Machine) -> tuple[doc.Column, ...]:
    """Columns of a table of its runs: engine, step, and the quantities."""
    return (
        _ENGINE,
        doc.Column("step", "s", of=_step, rank=5),
        replace(_POSITION.column, medium="terminal"),
        *(quantity.column for quantity in quantities(machine)),
    )


def agreement(machine: Machine, runs: Iterable[Run]) -> doc.Table:
    """Table of one machine's runs, for a terminal."""
    last = doc.Column("verdict", of=verdict_cell, wrap=False, rank=0)
    launch = "no launch"
    if machine.launch_time is not None and machine.launch_speed is not None:
        launch = f"launch {machine.launch_time:.4f} s, {machine.launch_speed:.3f} m/s"
    caption = f"{machine.model}: largest differences to the reference ({launch})"
    shown = doc.table((*differences(machine), _WALL, last), runs, caption)
    return doc.terminal_only(doc.without_empty_columns(shown))


def overview(results: Results) -> doc.Table:
    """Every run of every machine against every quantity, for a page."""
    shown = [each for each in OVERVIEW if any(each.metrics(run) for run in results.runs)]
    heads = (
        _ENGINE,
        doc.Column("verdict", align="left", wrap=False, of=verdict_cell),
        *(doc.Column(quantity.title, quantity.unit) for quantity in shown),
        doc.Column("further", align="left"),
        doc.Column("step", "s"),
        _WALL,
    )
    rows: list[doc.Row] = []
    for machine in results.machines:
        if len(results.machines) > 1:
            rows.append(doc.row(f"{machine.model} machine"))
        plots = {anchor(machine.model, name) for name, *_ in _figures(machine)}
        own = (run for run in results.runs if run.model == machine.model)
        rows += [_overview_row(run, shown, plots) for run in own]
    return doc.page_only(doc.without_empty_columns(doc.table(heads, rows, _AGREEMENT)))


def _overview_row(run: Run, shown: Sequence[ErrorColumn], plots: Container[str]) -> doc.Row:
    """A row; its numbers lead to those of the page's plots that show them."""
    cells = [quantity.linked(run) for quantity in shown]
    linked = [cell if cell.link in plots else replace(cell, link="") for cell in cells]
    link = _metrics_anchor(run) if run.outcome is Outcome.AGREES else _why_anchor(run)
    verdict, end = replace(verdict_cell(run), link=link), (_step(run), _wall_time(run))
    own_anchor = anchor(run.model, run.label)
    return doc.row(run.label, verdict, *linked, _further(run, shown), *end, anchor=own_anchor)


def _metrics_anchor(run: Run) -> str:
    return anchor(run.model, f"metrics {run.label}")


def _why_anchor(run: Run) -> str:
    return anchor("why", f"{run.model}-{run.label}")


def _further(run: Run, shown: Sequence[ErrorColumn]) -> doc.Cell:
    """How many of the judged metrics that have no column hold."""
    named = {quantity.judged or quantity.metric for quantity in shown}
    rest = [metric for metric in run.judged if metric.name not in named]
    if not rest:
        return doc.Cell("")
    held = sum(metric.holds is True for metric in rest)
    broken = ", ".join(metric.label for metric in rest if metric.holds is False)
    mark = doc.mark_of(held == len(rest))
    return doc.Cell(f"{held}/{len(rest)}", mark, hint=broken, link=_metrics_anchor(run))


def verdict_cell(run: Run) -> doc.Cell:
    """The outcome, with how many of the judged quantities hold."""
    text = run.outcome.value
    if run.outcome in COMPARED:
        text += f" {len(run.judged) - len(run.broken)}/{len(run.judged)}"
    return doc.Cell(text, MARKS[run.outcome])


# --- Chapters

_LAWS = {
    StopLaw.RELEASE_ONCE: "A stop that has opened stays open (release-once).",
    StopLaw.UNILATERAL: "A stop closes again when its gap comes back to zero (unilateral).",
}
_CERTIFIED = (
    "release_time", "launch_time", "launch_speed", "launch_angle", "range", "stop_torque",
    "total_energy",
)  # fmt: skip
_KNOWN = (
    "position_max", "velocity_max", "release_time", "launch_time", "launch_speed",
    "stop_torque_max", "energy_balance",
)  # fmt: skip


def _chapter(comparison: Comparison, machine: Machine) -> list[doc.Block]:
    runs = [run for run in comparison.results.runs if run.model == machine.model]
    return [
        chapter(machine.model),
        doc.Text(" ".join(_reference_sentences(machine)), medium="page"),
        doc.Text(predictable(machine)),
        agreement(machine, runs),
        *partings(machine, runs),
        figures(comparison, machine),
    ]


def _reference_sentences(machine: Machine) -> Iterator[str]:
    if machine.launch_time is None:
        yield "The reference does not launch."
    else:
        launch = f"{machine.launch_time:.9f} s with {machine.launch_speed:.7f} m/s"
        yield f"The reference launches at {launch}."
    yield f"Compared from the start to {machine.compared_to:.6g} s."
    if machine.needs:
        needs = ", ".join(f"{name} {text}" for name, text in machine.needs.items())
        yield f"Tolerances asked for: {needs}."
    if machine.mechanism.stops:
        yield _LAWS[machine.stop_law]
    if machine.impacts:
        yield f"The reference has {machine.impacts} impact{'s' if machine.impacts > 1 else ''}."
    for name, time in machine.release_times.items():
        if time is not None:
            stop = machine.mechanism.stop(name)
            start = f"{machine.start_torques[name]:.6f} {stop.force_unit}"
            yield f"The {name} opens at {time:.9f} s; its {stop.effort} at the start is {start}."


def _evidence(comparison: Comparison, machine: Machine) -> list[doc.Block]:
    """Evidence for the machine's verdicts, folded away."""
    runs = [run for run in comparison.results.runs if run.model == machine.model]
    pairs = [pair for pair in comparison.results.pairs if pair.model == machine.model]
    title = f"{machine.model.capitalize()} machine: the evidence"
    blocks: list[doc.Block] = [
        doc.Heading(title, 2, anchor(machine.model, "evidence")),
        _uncertainty(machine),
    ]
    if pairs:
        blocks += _pairs(pairs)
    checked = [run for run in runs if run.equality]
    caption = "Largest relative differences of the built models to the reference's equations"
    title = (
        "Model equivalence: each built model against the reference's equations, before any motion"
    )
    checks = doc.table(_EQUIVALENCE_COLUMNS, checked, caption, "page")
    blocks.append(doc.Fold(title, (checks,), anchor=anchor(machine.model, "equivalence")))
    for run in runs:
        if run.metrics:
            held = f"{len(run.judged) - len(run.broken)} of {len(run.judged)} hold"
            name = f"{machine.model}, {run.label}"
            title = f"{name}: every quantity, tolerance and reason ({held})"
            metrics = doc.table(_METRIC_COLUMNS, run.metrics, run.label)
            blocks.append(doc.Fold(title, (metrics,), anchor=_metrics_anchor(run)))
    return blocks


def _uncertainty(machine: Machine) -> doc.Block:
    """How far the reference is known: by its certificate, or by a second integration."""
    certificate = load_certificate(machine.mechanism)
    if certificate is None:
        uncertainty = machine.reference_uncertainty.items()
        known = (f"{format_number(value)} in {k}" for k, value in uncertainty if k in _KNOWN)
        return doc.Note(
            "This machine has no certificate (`trebucheck certify` makes one). By a second "
            "integration at a coarser tolerance the reference is known to "
            f"{', '.join(known)} (SI units)."
        )
    shown = [f for f in certificate.figures if f.name in _CERTIFIED and f.time is None]
    paper = "" if parameters_of(machine.mechanism) is None else " and the paper's own equations"
    text = (
        f"From the certificate of exactly this machine: minimal and redundant coordinates{paper}, "
        "DOP853 over a ladder of tolerances and Taylor series in double and extended precision. A "
        "tolerance finer than ten times the reference's uncertainty is refused."
    )
    values = doc.page_only(certified_figures(shown, "Certified values"))
    title = "How far the reference is known: its certificate"
    return doc.Fold(title, (values, doc.Note(text)))


def _check(run: Run, kind: str) -> doc.Cell:
    """The worst of a kind of checks; a dash where the engine does not expose it."""
    checks = [check for check in run.equality.checks if check.name == kind] if run.equality else []
    if not checks:
        return doc.Cell("–")
    text = format_number(largest(check.value for check in checks))
    return doc.Cell(text, doc.mark_of(all(check.holds for check in checks)))


def _equal(equality: Equality) -> doc.Cell:
    if not equality.exposed:
        return doc.Cell("not checked", "warning")
    text = equality.note or ("equivalent" if equality.holds else "another model")
    return doc.Cell(text, "good" if equality.holds else "bad")


_CHECKS = (
    "total mass", "start", "centre of mass", "stop position", "mass matrix", "force",
    "acceleration", "stop torque",
)  # fmt: skip
_EQUIVALENCE_COLUMNS = (
    _ENGINE,
    *(doc.Column(kind, of=partial(_check, kind=kind)) for kind in _CHECKS),
    doc.Column("states", of=lambda run: run.equality.states),
    doc.Column("verdict", of=lambda run: _equal(run.equality)),
)


def _pairs(pairs: Sequence[Pair]) -> tuple[doc.Block, ...]:
    """Engine against engine: all pairs on a page, those of tuned presets in a terminal."""
    tuned = [pair for pair in pairs if is_tuned(pair.first) and is_tuned(pair.second)]
    every = doc.table(_PAIR_COLUMNS, pairs, "Engine against engine, all pairs")
    caption = "engine against engine (tuned; the report has all)"
    short = doc.table(_PAIR_COLUMNS, tuned, caption, "terminal")
    page = doc.Fold("Engine against engine", (_matrix(pairs), doc.without_empty_columns(every)))
    return page, doc.without_empty_columns(short)


_PAIR_COLUMNS = (
    doc.Column("first", of=attrgetter("first")),
    doc.Column("second", of=attrgetter("second"), rank=0),
    doc.Column("position", "m", of=lambda pair: format_number(pair.position_max)),
    doc.Column("release", "s", of=lambda pair: format_number(pair.release_time_max)),
    doc.Column("speed", "m/s", of=lambda pair: format_number(largest([pair.launch_speed]))),
)


def _matrix(pairs: Sequence[Pair]) -> doc.Table:
    """Distances above the diagonal."""
    distances = {(pair.first, pair.second): format_number(pair.position_max) for pair in pairs}
    labels = [*dict.fromkeys([*(pair.first for pair in pairs), *(pair.second for pair in pairs)])]
    rows = [
        (first, *(distances.get((first, second), "") for second in labels[1:]))
        for first in labels[:-1]
    ]
    caption = "Largest distance between the two positions of a marker [m]"
    return doc.table(["engine", *labels[1:]], rows, caption, "page")


def _metric_value(metric: Metric) -> doc.Cell:
    text = (metric.note or "–") if metric.value is None else f"{metric.value:.6e}"
    return doc.Cell(text, doc.mark_of(metric.holds))


def _reason(metric: Metric) -> str:
    unjudged = f"follows from {metric.follows}" if metric.follows else metric.note or ""
    return metric.reason or unjudged


_METRIC_COLUMNS = (
    doc.Column("metric", of=attrgetter("label")),
    doc.Column("value", of=_metric_value),
    doc.Column("unit", of=attrgetter("unit")),
    doc.Column("tolerance", of=lambda metric: format_number(metric.tolerance)),
    doc.Column("stated by", of=lambda m: m.source or ("" if m.observed else "not observed")),
    doc.Column("reason", of=_reason),
)


# --- The summary, in some thirty lines of Markdown for a pull request

_ROWS, _CAUSES = 16, 6  # runs and causes that are shown at once
_COMPLAINTS = 10  # sentences on broken tolerances of a run behind a fold
_SIGNS = (
    "Largest differences to the reference. ✓ holds its tolerance, ✗ breaks it, ○ is not judged."
)


def summary(results: Results) -> doc.Document:
    """Verdict, errors of the runs, what broke and why, versions; the rest behind folds."""
    first, rest = _most_important(results.runs)
    broken = [*_broken(results.runs)]
    blocks: list[doc.Block] = [
        doc.Text(verdict(results), doc.mark_of(results.passed)),
        _errors(first),
        doc.Note(_SIGNS),
        doc.Listing(tuple(broken[:_CAUSES])),
        doc.Text(_versions(results)),
    ]
    if results.command is not None:
        blocks.append(doc.Code("Made by:", results.command))
    further = broken[_CAUSES:]
    if rest or further:
        shown = (_errors(rest), doc.Listing(tuple(further)))
        blocks.append(doc.Fold(f"Further runs ({len(rest)})", shown))
    items = tuple(
        doc.Text(line, lead=f"{run.model}, {run.label}:")
        for run in results.runs
        for line in complaints(run, _COMPLAINTS)
    )
    if items:
        blocks.append(doc.Fold("Tolerances that are broken", (doc.Listing(items),)))
    mechanisms = [(m.model, m.mechanism_hash[:16], f"{m.judged_to:.6g}") for m in results.machines]
    settings = [(run.model, run.label, format_settings(run.settings)) for run in results.runs]
    tables = (
        doc.table("machine | hash | judged to [s]", mechanisms),
        doc.table(["machine", "engine", doc.words("settings")], settings),
    )
    blocks.append(doc.Fold("Mechanisms and settings", tables))
    return doc.Document("", tuple(blocks))


def _most_important(runs: Sequence[Run]) -> tuple[Sequence[Run], Sequence[Run]]:
    """Runs to be shown, and the rest.

    The rest is the reference against itself, and where there are too many, runs that agree.
    """
    ordered = [*runs]
    if len(runs) > _ROWS:
        ordered.sort(key=lambda run: run.outcome is Outcome.AGREES)
    own = [r for r in ordered if r.engine == REFERENCE_ENGINE and r.outcome is Outcome.AGREES]
    others = [run for run in ordered if run not in own]
    if not others:
        return own[:_ROWS], own[_ROWS:]
    return others[:_ROWS], [*others[_ROWS:], *own]


def _errors(runs: Sequence[Run]) -> doc.Table:
    """Quantities that one of the runs has, at least."""
    heads = (
        doc.Column("machine", of=attrgetter("model")),
        _ENGINE,
        *(quantity.column for quantity in OVERVIEW if any(map(quantity.metrics, runs))),
        doc.Column("verdict", of=verdict_cell),
    )
    return doc.without_empty_columns(doc.table(heads, runs))


def _broken(runs: Iterable[Run]) -> Iterator[doc.Text]:
    """One line for each run that does not agree: the worst of it, and its likeliest cause."""
    for run in runs:
        parts = complaints(run, 1)
        if run.message:
            parts.append(run.message)
        if run.unjudged:
            parts.append(f"not judged: {len(run.unjudged)} quantities")
        if run.diagnosis is not None:
            parts.append(cause_text(run.diagnosis))
        if parts:
            mark: doc.Mark = "bad" if run.broken else "warning"
            text = " ".join(map(sentence, parts))
            yield doc.Text(text, mark, lead=f"{run.model}, {run.label}:")


def _versions(results: Results) -> str:
    engines = {run.engine: run.engine_version for run in results.runs}
    names = ", ".join(f"{engine} {version}" for engine, version in engines.items())
    own = f"trebucheck {results.trebucheck_version}, Python {results.python_version}"
    return f"Versions: {names}; {own}, {results.platform}."
