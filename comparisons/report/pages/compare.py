"""The page of a comparison: verdicts, agreement, plots over time, causes, evidence; its summary."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import chain, pairwise
from operator import attrgetter, methodcaller

import numpy as np

from ....engines.presets import ASSISTED
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
from ...runs.results import COMPARED, FAILURES, Machine, Metric, Outcome, Pair, Results, Run
from ...runs.study import REFERENCE as REFERENCE_ENGINE
from .. import document as doc
from .. import plots
from ..document import format_number, format_settings, format_step, sentence
from ..drawing.scene import Scene
from ..plots import Axis, Panels, Plot, Rule, Series
from . import tables, work

_QUESTION = "How far can you trust a multibody engine, and why does it differ?"
_INTRODUCTION = (
    "Each engine builds the same mechanism from its own primitives. Differences are the largest up "
    "to the end of the compared motion, the reference taken at the engine's own sample times. "
    "Values marked ✓ hold a tolerance, values marked ✗ break one. A run agrees if every compared "
    "quantity holds its tolerance: the user's need where one is stated, else the engine's claim, "
    "else a thousandth of the quantity's scale. What one solver does and the other does not (a "
    "launch, a release, an impact) is a disagreement. " + tables.PRESETS_EXPLAINED
)
_EQUIVALENCE = (
    "Before any motion, each engine's built model is compared with the reference's equations in "
    "random states under every set of closed stops. Each value is the largest relative difference "
    "of its kind; a dash stands for what the engine does not expose, “not checked” an engine that "
    "exposes nothing. A run whose model differs is not compared."
)
_EQUIVALENCE_TITLE = (
    "Model equivalence: each built model against the reference's equations, before any motion"
)
_MOST = 3  # sentences on broken tolerances of one run; the table of all metrics has the rest


def document(comparison: Comparison) -> doc.Document:
    """The whole; a terminal has the tables in short, what broke, and the verdict at its end."""
    results = comparison.results
    machines = results.machines
    line = verdict(results)
    first_verdict, last_verdict = tables.verdict_blocks(line, doc.mark_of(results.passed))
    blocks: list[doc.Block] = [first_verdict, _tiles(results)]
    if machines:
        blocks.append(doc.AnimationBlock(partial(_scenes, comparison)))
    blocks.append(_overview(results))
    blocks += _work_precision(results)
    for machine in machines:
        runs = _runs(results, machine)
        launch = "no launch"
        if machine.launch_time is not None and machine.launch_speed is not None:
            launch = f"launch {machine.launch_time:.4f} s, {machine.launch_speed:.3f} m/s"
        caption = f"{machine.model}: largest differences to the reference ({launch})"
        heads = (_ENGINE, _STEP, *(quantity.column for quantity in OVERVIEW), _WALL, _VERDICT)
        errors = doc.without_empty_columns(doc.table(heads, runs, caption, "terminal"))
        blocks += [
            tables.chapter(machine.model),
            doc.Text(" ".join(_reference_sentences(machine)), medium="page"),
            doc.Text(tables.predictable(machine)),
            errors,
            *tables.partings(machine, runs),
            _plots_over_time(comparison, machine),
        ]
    if any(run.outcome is not Outcome.AGREES for run in results.runs):
        blocks.append(doc.Heading("What differs, and why", 2, "why"))
    sections, findings = _differing(results)
    blocks += sections
    for machine in machines:
        blocks += _evidence(results, machine)
    stated = {run.label: run.supplied for run in results.runs if run.supplied is not None}
    assistance: list[doc.Text] = []
    for label, parts in sorted(stated.items()):
        assistance.append(doc.Text(supplied_sentence(parts), lead=f"{label}:"))
    settings = ((run.model, run.label, run.engine_version, run.settings) for run in results.runs)
    blocks += [
        doc.Heading("How the comparison is made", 2),
        doc.Note(_INTRODUCTION),
        doc.Note(_EQUIVALENCE),
        doc.Listing(tuple(assistance), medium="page"),
        *tables.provenance(results, settings, machines),
        findings,
        last_verdict,
    ]
    window = f"trebucheck: {', '.join(machine.model for machine in machines)}"
    return doc.Document(_QUESTION, tuple(blocks), window, verdict=line)


def _runs(results: Results, machine: Machine) -> list[Run]:
    return [run for run in results.runs if run.model == machine.model]


# --- Verdicts


def verdict(results: Results) -> str:
    """One line: how many runs came to which verdict, and what was judged."""
    counted = Counter(run.outcome for run in results.counted)
    plurals = {Outcome.AGREES: "agree", Outcome.DISAGREES: "disagree"}
    outcomes = ", ".join(
        f"{counted[outcome]} {plurals.get(outcome, outcome.value)}"
        for outcome in Outcome
        if counted[outcome]
    )
    judged = sum(len(run.judged) for run in results.counted)
    held = judged - sum(len(run.broken) for run in results.counted)
    checks = [run.equality for run in results.counted if run.equality is not None]
    exposed = [check for check in checks if check.exposed]
    models = f"{sum(check.holds for check in exposed)} of {len(exposed)} built models equivalent"
    if len(exposed) < len(checks):
        models += f", {len(checks) - len(exposed)} not checked"
    headline = "Agreement holds"
    if not judged:
        headline = "Nothing was judged"
    elif not results.passed:
        headline = "Agreement does not hold"
    elif counted[Outcome.NOT_JUDGED]:
        headline = "Nothing disagrees, but not all could be judged"
    quantities = f"{held} of {judged} judged quantities hold"
    return f"{headline}. Runs: {outcomes or 'none'}; {quantities}; {models}."


def _differing(results: Results) -> tuple[list[doc.Block], doc.Listing]:
    """Broken tolerances, failures and causes: a page's sections by run, a terminal's listing."""
    sections: list[doc.Block] = []
    findings: list[doc.Text] = []
    for run in results.runs:
        name = f"{run.model}, {run.label}"
        items = [doc.Text(line, "bad") for line in tables.complaints(run, _MOST)]
        findings += [replace(item, lead=f"{name}:") for item in items]
        if run.message:
            mark = tables.MARKS[run.outcome]
            items.append(doc.Text(tables.capital(run.message), mark))
            findings.append(doc.Text(f"{run.outcome.value}: {run.message}", mark, f"{name}:"))
        if run.unjudged:
            labels = ", ".join(metric.label for metric in run.unjudged)
            text = f"not judged: {labels} ({run.unjudged[0].note})."
            items.append(doc.Text(text, "unjudged"))
            findings.append(doc.Text(text, "warning", f"{name}:"))
        findings += [doc.Text(line, "strong", f"{name}, why:") for line in tables.diagnosis(run)]
        if run.outcome is not Outcome.AGREES:
            title = f"{name}: {run.outcome.value}"
            sections += [
                doc.Heading(title, 3, _why_anchor(run)),
                *map(doc.page_only, tables.why(run)),
                doc.Listing(tuple(items), medium="page"),
            ]
    return sections, doc.Listing(tuple(findings), medium="terminal")


def _tiles(results: Results) -> doc.Tiles:
    """Verdicts counted, and the engines at both ends of the ranking by distance."""
    counted = Counter(run.outcome for run in results.counted)
    failed = sum(counted[outcome] for outcome in (*FAILURES, Outcome.NOT_EQUIVALENT))
    unjudged = (Outcome.NOT_JUDGED, Outcome.ABSENT, Outcome.UNSUPPORTED)
    counts: list[tuple[int, str, doc.Mark]] = [
        (counted[Outcome.AGREES], "agree", "good"),
        (counted[Outcome.DISAGREES], "disagree", "bad"),
    ]
    if failed:
        counts.append((failed, "failed or not equivalent", "bad"))
    counts.append((sum(counted[outcome] for outcome in unjudged), "not judged", "warning"))
    tiles = [doc.Tile(str(n), label, mark if n else "plain") for n, label, mark in counts]
    # Runs of one engine and preset on several machines count by their worst.
    worst: dict[str, float] = {}
    for run in results.ran:
        distance = _POSITION.value(run)
        if run.engine != REFERENCE_ENGINE and distance is not None:
            worst[run.label] = max(distance, worst.get(run.label, 0.0))
    if len(worst) > 1:
        ranked = sorted(worst, key=worst.__getitem__)
        ends = {ranked[0]: "nearest to the reference", ranked[-1]: "farthest from it"}
        for label, place in ends.items():
            detail = f"at most {format_number(worst[label])} m"
            tiles.append(doc.Tile(label, place, detail=detail))
    return doc.Tiles(tuple(tiles))


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
    reference: Trajectory  # at the run's own times up to that end

    @property
    def label(self) -> str:
        """Engine and preset."""
        return f"{self.trajectory.provenance.engine} {self.trajectory.provenance.preset}"

    def series(self, t: FloatArray, values: FloatArray) -> Series:
        """Values as a line: its colour by engine, its dashes by preset."""
        run = self.trajectory.provenance
        return Series(self.label, t, values, plots.run_style(run.engine, run.preset))

    def values(self, quantity: Sampled) -> Series | None:
        """The quantity, thinned; None if the reference's line would cover it."""
        t = self.reference.t
        values, known = quantity(self.trajectory)[: len(t)], quantity(self.reference)
        if np.abs(values - known).max() <= _SEEN * np.ptp(known):
            return None
        chosen = np.unique(np.linspace(0, len(t) - 1, _POINTS).astype(int))
        return self.series(t[chosen], values[chosen])

    def difference(self, quantity: Sampled) -> Series:
        """Absolute differences to the reference, distances for points, as `thinned`."""
        known = quantity(self.reference)
        difference = quantity(self.trajectory)[: len(known)] - known
        size = np.abs(difference) if difference.ndim == 1 else np.linalg.norm(difference, axis=1)
        return self.series(*thinned(self.reference.t, size))


def lines(comparison: Comparison, machine: Machine) -> list[Line]:
    """Runs of one machine up to the end of what is compared, but for the reference."""
    solution, end = comparison.solutions[machine.model], machine.compared_to
    drawn: list[Line] = []
    for label, run in _trajectories(comparison, machine).items():
        if label != plots.REFERENCE_RUN:
            drawn.append(Line(run, solution.trajectory(run.t[run.t <= end])))
    return drawn


def thinned(t: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Few enough points to draw: the largest value in each of `_POINTS` intervals, at its end."""
    if len(t) <= _POINTS:
        return t, values
    edges = np.linspace(0, len(t), _POINTS + 1).astype(int)
    return t[edges[1:] - 1], np.array([values[a:b].max() for a, b in pairwise(edges)])


def _trajectories(comparison: Comparison, machine: Machine) -> dict[str, Trajectory]:
    """Motions of a machine's runs, by label."""
    return {
        label: trajectory
        for (model, label), trajectory in comparison.trajectories.items()
        if model == machine.model
    }


def _scenes(comparison: Comparison) -> tuple[Scene, ...]:
    """Machines in motion, all runs of each over the reference."""
    scenes: list[Scene] = []
    for machine in comparison.results.machines:
        states = comparison.solutions[machine.model].trajectory
        scenes.append(plots.motion_scene(
            states, _trajectories(comparison, machine), end=machine.compared_to,
            thrown=machine.thrown, launch=machine.launch_time, name=machine.model,
            horizon=machine.judged_to,
        ))  # fmt: skip
    return tuple(scenes)


_Draw = Callable[[Solution, Sequence[Line]], Panels]


def _plots_over_time(comparison: Comparison, machine: Machine) -> doc.Grid:
    """Plots of one machine over time, drawn when a page needs them; they zoom together."""
    model = machine.model

    @cache
    def drawn() -> tuple[Solution, list[Line]]:
        return comparison.solutions[model], lines(comparison, machine)

    def panels(draw: _Draw) -> Panels:
        return draw(*drawn())

    blocks: list[doc.Figure] = []
    for name, caption, count, draw in _figures(machine):
        plot, place = partial(panels, draw), tables.anchor(model, name)
        columns = min(count, _COLUMNS)
        blocks.append(doc.Figure(plot, name.capitalize(), caption, place, model, columns))
    return doc.Grid(tuple(blocks))


def _figures(machine: Machine) -> Iterator[tuple[str, str, int, _Draw]]:
    """Name, sentence, number of quantities, and what draws it."""
    mechanism, end = machine.mechanism, machine.compared_to
    rules = tuple(
        Rule(time, f"{name} opens")
        for name, time in machine.release_times.items()
        if time is not None and time <= end
    )
    markers = {marker.name: position(marker.name) for marker in mechanism.markers}
    if markers:
        text = (
            "Of each marker from the reference, at the engine's own times; no sample is "
            f"interpolated. Of each {_POINTS}th of the motion the largest is drawn."
        )
        draw = partial(_over_time, quantities=markers, unit="m", rules=rules)
        yield DISTANCES, text, len(markers), draw

    def force(joint: str) -> Sampled:
        return lambda run: np.linalg.norm(run.joint_reaction(joint), axis=1)

    def coordinate(index: int) -> Sampled:
        return lambda run: run.q[:, index]

    loads: dict[str, dict[str, Sampled]] = {"N m": {}, "N": {}}
    for stop in mechanism.stops:
        if stop.closed:
            loads[stop.force_unit][stop.name] = methodcaller("stop_torque", stop.name)
    forces = {joint.name: force(joint.name) for joint in mechanism.joints if joint.held_directions}
    angles = {name: coordinate(index) for index, name in enumerate(mechanism.angles)}
    active = "At least 0 while the contact of the stop is active, 0 once it is released."
    over_time = (
        (TORQUES, active, "N m", loads["N m"]),
        (FORCES, active, "N", loads["N"]),
        (JOINT_FORCES, "Magnitude of the force on each joint's child.", "N", forces),
        (COORDINATES, "Absolute angles, positive clockwise.", "rad", angles),
    )
    rows = "Upper row: the reference, and runs that part from its line. Lower row: differences."
    for name, text, unit, quantities in over_time:
        if quantities:
            draw = partial(_over_time, quantities=quantities, unit=unit, rules=rules, end=end)
            yield name, f"{text} {rows}", len(quantities), draw
    text = (
        "Total energy less the work of dampers, constant forces and torques, as a share of the "
        "energy at the start (where that is near zero: of the largest kinetic energy). Any drift "
        "but at impacts is numerical."
    )
    yield ENERGY, text, 1, partial(_energy_drift, rules=rules)


def position(name: str) -> Sampled:
    """Position of a marker [m]."""
    return lambda run: run.marker(name).position


def _over_time(
    solution: Solution,
    runs: Sequence[Line],
    quantities: Mapping[str, Sampled],
    unit: str,
    rules: tuple[Rule, ...],
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
            series = [Series("reference", reference.t, quantity(reference), plots.REFERENCE)]
            for run in runs:
                with suppress(ValueError):
                    seen = run.values(quantity)
                    if seen is not None:
                        series.append(seen)
            values = Axis("", unit)
            panels.append(Plot(_TIME, values, tuple(series), name, rules=rules, height=230))
        axis = Axis("difference", unit, logarithmic=True)
        rules = tuple(Rule(rule.at) for rule in rules)
    for name, quantity in quantities.items():
        series = []
        for run in runs:
            with suppress(ValueError):
                series.append(run.difference(quantity))
        panels.append(Plot(_TIME, axis, tuple(series), name, rules=rules, height=250))
    return tuple(panels)


def _energy_drift(solution: Solution, runs: Sequence[Line], rules: tuple[Rule, ...]) -> Panels:
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
        series.append(run.series(*thinned(t, drift)))
    axis = Axis(f"|E - E(0)| / {name}", "1", logarithmic=True)
    if not size:
        axis = Axis("|E - E(0)|", "J", logarithmic=True)
    return (Plot(_TIME, axis, tuple(series), height=250, rules=rules),)


def _work_precision(results: Results) -> Iterator[doc.Figure]:
    """Errors of every run against its cost and its steps: plots of each machine."""
    of_machines = {m.model: work.lines_of(_runs(results, m)) for m in results.machines}
    every = [line for lines in of_machines.values() for line in lines]
    if not work.has_errors(every):
        return
    units = {metric.name: metric.unit for run in results.runs for metric in run.metrics}

    def drawn() -> Panels:
        title = len(of_machines) > 1
        panels = (
            work.panels(lines, units, title=model if title else "")
            for model, lines in of_machines.items()
        )
        return tuple(chain.from_iterable(panels))

    text = work.caption(every, results.machine_text)
    if not any(run.sweep for run in results.runs):
        text += " Each run is a point, at its own step; `trebucheck compare --sweep` adds others."
    yield work.figure(drawn, text, "work-precision")


# --- Agreement

_HINTS = 6
_OVERVIEW = (
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
    judged: str = ""  # metric that has the verdict, if that is another one
    otherwise: str = ""  # metric in the place of one that the run has not
    short: str = ""  # title in a terminal; '' leaves the column out there
    rank: int = 1
    plot: str = ""  # name of the figure that shows it over time

    @property
    def column(self) -> doc.Column:
        """Its column in a table of runs."""
        medium: doc.Medium = "any" if self.short else "page"
        column = doc.Column(self.title, self.unit, short=self.short, rank=self.rank, medium=medium)
        return replace(column, of=self.cell)

    def metrics(self, run: Run) -> list[Metric]:
        """Metrics that it stands for."""
        observed = [m for m in run.metrics if m.observed and self.subject in (None, m.subject)]
        named = [m for m in observed if m.name == self.metric]
        return named or [m for m in observed if m.name == self.otherwise]

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
        # The worst: 8 decades within its tolerance are -1, 3 beyond it 1.
        worst = max((m.share for m in judged if m.share is not None), default=None)
        heat = None
        if worst is not None and worst > 1:
            heat = min(1.0, 0.3 + 0.7 * math.log10(worst) / 3)
        elif worst is not None:
            heat = -min(1.0, 0.1 - 0.9 * math.log10(worst) / 8) if worst > 0 else -1.0
        return doc.Cell(text, mark, hint=hint, heat=heat)


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
    ErrorColumn("joint force", "1", "joint_reaction_relative", judged="joint_reaction_max",
                plot=JOINT_FORCES),
    ErrorColumn("energy", "1", "energy_drift", judged="energy_balance", short="energy", rank=3,
                otherwise="energy_drift_kinetic", plot=ENERGY),
)  # fmt: skip
OVERVIEW = (_POSITION, *_QUANTITIES)
"""One value of each quantity, whatever markers the mechanism has."""


def verdict_cell(run: Run) -> doc.Cell:
    """The outcome, with how many of the judged quantities hold."""
    text = run.outcome.value
    if run.outcome in COMPARED:
        text += f" {len(run.judged) - len(run.broken)}/{len(run.judged)}"
    return doc.Cell(text, tables.MARKS[run.outcome])


def _wall_time(run: Run) -> str:
    return "–" if run.wall_time is None else f"{run.wall_time:.2f}"


_ENGINE = doc.Column("engine", of=attrgetter("label"))
_STEP = doc.Column("step", "s", of=lambda run: format_step(run.settings.get("timestep")), rank=5)
_WALL = doc.Column("wall", "s", of=_wall_time, rank=6)
_VERDICT = doc.Column("verdict", of=verdict_cell, align="left", wrap=False, rank=0)


def quantities(machine: Machine) -> tuple[ErrorColumn, ...]:
    """Quantities of a machine's table: each marker's position, then what all mechanisms have."""
    markers = machine.mechanism.markers
    positions = (ErrorColumn(marker.name, "m", "position_max", marker.name) for marker in markers)
    return (*positions, *_QUANTITIES)


def differences(machine: Machine) -> tuple[doc.Column, ...]:
    """Columns of a page's table of its runs: engine, step, and the quantities."""
    return (_ENGINE, _STEP, *(quantity.column for quantity in quantities(machine)))


def _overview(results: Results) -> doc.Table:
    """Table of all runs against all quantities; numbers lead to the plots with them."""
    shown = [each for each in OVERVIEW if any(each.metrics(run) for run in results.runs)]
    named = {quantity.judged or quantity.metric for quantity in shown}
    columns = (quantity.column for quantity in shown)
    heads = (_ENGINE, _VERDICT, *columns, doc.Column("further", align="left"), _STEP, _WALL)
    rows: list[doc.Row] = []
    for machine in results.machines:
        if len(results.machines) > 1:
            rows.append(doc.row(f"{machine.model} machine"))
        drawn = {name for name, *_ in _figures(machine)}
        for run in _runs(results, machine):
            cells: list[doc.Cell] = []
            for quantity in shown:
                cell = quantity.cell(run)
                if cell.text and quantity.plot in drawn:
                    cell = replace(cell, link=tables.anchor(run.model, quantity.plot))
                elif run.metrics and not cell.text:
                    cell = doc.Cell("–", hint="not observed, or not part of this motion")
                cells.append(cell)
            further = doc.Cell("")
            rest = [metric for metric in run.judged if metric.name not in named]
            if rest:
                broken = [metric.label for metric in rest if metric.holds is False]
                text = f"{len(rest) - len(broken)}/{len(rest)}"
                mark, hint = doc.mark_of(not broken), ", ".join(broken)
                further = doc.Cell(text, mark, hint=hint, link=_metrics_anchor(run))
            evidence = _metrics_anchor if run.outcome is Outcome.AGREES else _why_anchor
            outcome = replace(verdict_cell(run), link=evidence(run))
            cells = [outcome, *cells, further]
            end, place = (_STEP.of(run), _WALL.of(run)), tables.anchor(run.model, run.label)
            rows.append(doc.row(run.label, *cells, *end, anchor=place))
    return doc.without_empty_columns(doc.table(heads, rows, _OVERVIEW, "page"))


def _metrics_anchor(run: Run) -> str:
    return tables.anchor(run.model, f"metrics {run.label}")


def _why_anchor(run: Run) -> str:
    return tables.anchor("why", f"{run.model}-{run.label}")


# --- The reference, and the evidence

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
_CHECKS = (
    "total mass", "start", "centre of mass", "stop position", "mass matrix", "force",
    "acceleration", "stop torque",
)  # fmt: skip


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


def _evidence(results: Results, machine: Machine) -> Iterator[doc.Block]:
    """Evidence for the machine's verdicts, folded away."""
    runs, model = _runs(results, machine), machine.model
    title = f"{model.capitalize()} machine: the evidence"
    yield doc.Heading(title, 2, tables.anchor(model, "evidence"))
    yield _uncertainty(machine)
    pairs = [pair for pair in results.pairs if pair.model == model]
    if pairs:
        yield from _pairs(pairs)
    checked = [run for run in runs if run.equality]
    caption = "Largest relative differences of the built models to the reference's equations"
    heads = ["engine", *_CHECKS, "states", "verdict"]
    checks = doc.table(heads, map(_equivalence_row, checked), caption, "page")
    yield doc.Fold(_EQUIVALENCE_TITLE, (checks,), anchor=tables.anchor(model, "equivalence"))
    for run in runs:
        if not run.metrics:
            continue
        held = f"{len(run.judged) - len(run.broken)} of {len(run.judged)} hold"
        title = f"{model}, {run.label}: every quantity, tolerance and reason ({held})"
        rows: list[tuple[object, ...]] = []
        for m in run.metrics:
            text = (m.note or "–") if m.value is None else f"{m.value:.6e}"
            source = m.source or ("" if m.observed else "not observed")
            reason = m.reason or (f"follows from {m.follows}" if m.follows else m.note or "")
            value, tolerance = doc.Cell(text, doc.mark_of(m.holds)), format_number(m.tolerance)
            rows.append((m.label, value, m.unit, tolerance, source, reason))
        heads = "metric | value | unit | tolerance | stated by | reason"
        shown = doc.table(heads, rows, run.label)
        yield doc.Fold(title, (shown,), anchor=_metrics_anchor(run))


def _uncertainty(machine: Machine) -> doc.Block:
    """Tell how far the reference is known: by its certificate, or by a second integration."""
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
    values = tables.certified_figures(shown, "Certified values")
    return doc.Fold("How far the reference is known: its certificate", (values, doc.Note(text)))


def _equivalence_row(run: Run) -> tuple[object, ...]:
    """The worst of each kind of checks; a dash where the engine does not expose it."""
    equality = run.equality
    assert equality is not None
    cells: list[doc.Cell] = []
    for kind in _CHECKS:
        checks = [check for check in equality.checks if check.name == kind]
        worst = largest(check.value for check in checks)
        mark = doc.mark_of(all(check.holds for check in checks) if checks else None)
        cells.append(doc.Cell(format_number(worst), mark))
    outcome = doc.Cell("not checked", "warning")
    if equality.exposed:
        text = equality.note or ("equivalent" if equality.holds else "another model")
        outcome = doc.Cell(text, doc.mark_of(equality.holds))
    return run.label, *cells, equality.states, outcome


def _pairs(pairs: Sequence[Pair]) -> tuple[doc.Block, ...]:
    """Engine against engine: all pairs on a page, those of assisted presets in a terminal."""
    rows: list[doc.Row] = []
    few: list[doc.Row] = []
    distances: dict[tuple[str, str], str] = {}
    for pair in pairs:
        position, release = format_number(pair.position_max), format_number(pair.release_time_max)
        speed = format_number(largest([pair.launch_speed]))
        rows.append(doc.row(pair.first, pair.second, position, release, speed))
        if tables.both_assisted(pair.first, pair.second):
            few.append(rows[-1])
        distances[pair.first, pair.second] = position
    heads = doc.columns("first | second | position [m] | release [s] | speed [m/s]")
    every = doc.table(heads, rows, "Engine against engine, all pairs")
    caption = f"engine against engine ({ASSISTED}; the report has all)"
    short = doc.table(doc.ranked(heads, second=0), few, caption, "terminal")
    labels = [*dict.fromkeys([*(pair.first for pair in pairs), *(pair.second for pair in pairs)])]
    above: list[tuple[str, ...]] = []
    for first in labels[:-1]:
        above.append((first, *(distances.get((first, second), "") for second in labels[1:])))
    caption = "Largest distance between the two positions of a marker [m]"
    above_diagonal = doc.table(["engine", *labels[1:]], above, caption, "page")
    blocks = above_diagonal, doc.without_empty_columns(every)
    return doc.Fold("Engine against engine", blocks), doc.without_empty_columns(short)


# --- The summary, in some thirty lines of Markdown for a pull request

_ROWS, _CAUSES = 16, 6  # runs and causes that are shown at once
_LISTED = 10  # sentences on broken tolerances of a run behind a fold
_SIGNS = (
    "Largest differences to the reference. ✓ holds its tolerance, ✗ breaks it, ○ is not judged."
)


def summary(results: Results) -> doc.Document:
    """Verdict, errors of the runs, what broke and why, versions; the rest behind folds."""

    def errors(runs: Sequence[Run]) -> doc.Table:
        present = (each.column for each in OVERVIEW if any(map(each.metrics, runs)))
        model, verdict = doc.Column("machine", of=attrgetter("model")), replace(_VERDICT, wrap=None)
        heads = (model, _ENGINE, *present, verdict)
        return doc.without_empty_columns(doc.table(heads, runs))

    # Last of all is the reference against itself; where there are too many runs, those that agree.
    ordered = [*results.runs]
    if len(ordered) > _ROWS:
        ordered.sort(key=lambda run: run.outcome is Outcome.AGREES)
    ordered.sort(key=lambda r: r.engine == REFERENCE_ENGINE and r.outcome is Outcome.AGREES)
    others = [r for r in ordered if r.engine != REFERENCE_ENGINE or r.outcome is not Outcome.AGREES]
    count = min(len(others) or len(ordered), _ROWS)
    rest = ordered[count:]
    broken: list[doc.Text] = []
    all_complaints: list[doc.Text] = []
    for run in results.runs:
        # One line for each run that does not agree: the worst of it, and its likeliest cause.
        parts, name = tables.complaints(run, 1), f"{run.model}, {run.label}:"
        if run.message:
            parts.append(run.message)
        if run.unjudged:
            parts.append(f"not judged: {len(run.unjudged)} quantities")
        if run.diagnosis is not None:
            parts.append(tables.cause_text(run.diagnosis))
        if parts:
            text = " ".join(map(sentence, parts))
            broken.append(doc.Text(text, "bad" if run.broken else "warning", name))
        all_complaints += [doc.Text(line, lead=name) for line in tables.complaints(run, _LISTED)]
    engines = {run.engine: run.engine_version for run in results.runs}
    versions = ", ".join(f"{engine} {version}" for engine, version in engines.items())
    here = f"trebucheck {results.trebucheck_version}, Python {results.python_version}"
    blocks: list[doc.Block] = [
        doc.Text(verdict(results), doc.mark_of(results.passed)),
        errors(ordered[:count]),
        doc.Note(_SIGNS),
        doc.Listing(tuple(broken[:_CAUSES])),
        doc.Text(f"Versions: {versions}; {here}, {results.platform}."),
    ]
    if results.command is not None:
        blocks.append(doc.Code("Made by:", results.command))
    if rest or broken[_CAUSES:]:
        shown = (errors(rest), doc.Listing(tuple(broken[_CAUSES:])))
        blocks.append(doc.Fold(f"Further runs ({len(rest)})", shown))
    if all_complaints:
        listing = doc.Listing(tuple(all_complaints))
        blocks.append(doc.Fold("Tolerances that are broken", (listing,)))
    mechanisms = [(m.model, m.mechanism_hash[:16], f"{m.judged_to:.6g}") for m in results.machines]
    settings = [(run.model, run.label, format_settings(run.settings)) for run in results.runs]
    details = (
        doc.table("machine | hash | judged to [s]", mechanisms),
        doc.table(["machine", "engine", doc.words("settings")], settings),
    )
    blocks.append(doc.Fold("Mechanisms and settings", details))
    return doc.Document("", tuple(blocks))
