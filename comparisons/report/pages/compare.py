"""A comparison in sentences: the verdict, what broke, what could not be judged, and why."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ....engines.supplied import sentence as supplied_sentence
from ....models.arrays import FloatArray
from ....models.machines.trebuchet import parameters_of
from ....models.problem import StopLaw
from ....models.trajectory import Trajectory
from ....reference.certification.certificate import load_certificate
from ....reference.solution import Solution
from ...compare.study import Comparison
from ...diagnosis.rank import SAME
from ...runs.balance import sampled_balance
from ...runs.metrics import LEAST_START
from ...runs.results import (
    COMPARED,
    FAILURES,
    Cause,
    Diagnosis,
    Equality,
    Machine,
    Measured,
    Metric,
    Outcome,
    Pair,
    Results,
    Run,
)
from ...runs.study import REFERENCE as REFERENCE_ENGINE
from .. import document as doc
from ..document import (
    Animation,
    Block,
    Cell,
    Code,
    Column,
    Document,
    Figure,
    Fold,
    Grid,
    Heading,
    Listing,
    Mark,
    Note,
    Row,
    Table,
    Text,
    Tile,
    mark_of,
    page_only,
    row,
    table,
    terminal_only,
    without_empty_columns,
    words,
)
from ..drawing.scene import Scene
from ..numbers import format_number, format_settings, format_step, sentence
from ..plots import REFERENCE, Axis, Panels, Plot, Rule, Series, Style, motion_scene, run_style
from ..tables import certified_figures, partings, predictable, provenance

if TYPE_CHECKING:
    from ...compare.study import Comparison
    from ...runs.results import Machine, Run


MARKS: dict[Outcome, Mark] = {
    Outcome.AGREES: "good",
    Outcome.DISAGREES: "bad",
    Outcome.NOT_JUDGED: "warning",
    Outcome.NOT_EQUIVALENT: "bad",
    Outcome.FAILED: "bad",
    Outcome.TIMED_OUT: "bad",
    Outcome.ABSENT: "warning",
    Outcome.UNSUPPORTED: "warning",
}
"""Marks of verdicts."""
_PLURALS = {Outcome.AGREES: "agree", Outcome.DISAGREES: "disagree"}
_MOST = 3
"""Sentences on broken tolerances for one run; the table of all metrics has the rest."""


def verdict(results: Results) -> str:
    """One line: how many runs came to which verdict, and what was judged."""
    counted = Counter(run.outcome for run in results.runs)
    outcomes = ", ".join(
        f"{counted[each]} {_PLURALS.get(each, each.value)}" for each in Outcome if counted[each]
    )
    judged = sum(len(run.judged) for run in results.runs)
    held = judged - sum(len(run.broken) for run in results.runs)
    checks = [run.equality for run in results.runs if run.equality is not None]
    shown = [check for check in checks if check.exposed]
    models = f"{sum(check.holds for check in shown)} of {len(shown)} built models equivalent"
    unchecked = f", {len(checks) - len(shown)} not checked" if len(shown) < len(checks) else ""
    head = _head(results, judged > 0)
    return f"{head}. Runs: {outcomes or 'none'}; {held} of {judged} judged quantities hold; {models}{unchecked}."


def _head(results: Results, judged: bool) -> str:
    if not judged:
        return "Nothing was judged"
    if not results.passed:
        return "Agreement does not hold"
    undecided = any(run.outcome is Outcome.NOT_JUDGED for run in results.runs)
    return "Nothing disagrees, but not all could be judged" if undecided else "Agreement holds"


def findings(results: Results) -> Iterator[Text]:
    """What broke or did not run, and why."""
    for run in results.runs:
        name = f"{run.model}, {run.label}"
        for line in complaints(run, _MOST):
            yield Text(line, "bad", lead=f"{name}:")
        if run.message:
            yield Text(f"{run.outcome.value}: {run.message}", MARKS[run.outcome], lead=f"{name}:")
        if run.unjudged:
            labels = ", ".join(metric.label for metric in run.unjudged)
            yield Text(
                f"not judged: {labels} ({run.unjudged[0].note}).", "warning", lead=f"{name}:"
            )
        for line in diagnosis(run):
            yield Text(line, "strong", lead=f"{name}, why:")


def complaints(run: Run, most: int | None = None) -> list[str]:
    """One sentence for each tolerance that does not hold, the worst first; of the rest their number.

    Args:
        most: how many have a sentence; None: all.
    """
    broken = sorted(run.broken, key=lambda m: m.share or 0.0)
    sentences = [_complaint(metric) for metric in broken[::-1][:most]]
    rest = len(broken) - len(sentences)
    return [
        *sentences,
        f"{rest} more of {len(run.judged)} judged quantities break their tolerance.",
    ][: len(broken)]


def _complaint(m: Metric) -> str:
    measured = m.note or f"{format_number(m.value)} {m.unit}"
    return f"{m.label}: {measured}, tolerance {format_number(m.tolerance)} {m.unit} ({m.source}: {m.reason})"


def diagnosis(run: Measured) -> list[str]:
    """When the run begins to differ from the reference and why, in sentences; none for a run that agrees."""
    diagnosed = run.diagnosis
    if diagnosed is None:
        return []
    if diagnosed.note:
        return [f"no cause is known: {diagnosed.note}."]
    when = "in its motion" if run.metrics else "before any motion"
    if diagnosed.parts_at is not None:
        holding = ", ".join(diagnosed.holding) or "no stop"
        when = f"from t = {diagnosed.parts_at:.6g} s, while {holding} held in the reference"
    only = (
        " The motion follows the reference: only what is read from it differs."
        if diagnosed.motion_agrees
        else ""
    )
    return [
        f"differs from the reference {when}, first in {diagnosed.leads}.{only} {_likeliest(diagnosed)}"
    ]


def _likeliest(diagnosed: Diagnosis) -> str:
    """The causes that account for enough of the deviation; without one, what the suspects account for."""
    shares = "; ".join(_suspicion(cause) for cause in diagnosed.named or diagnosed.causes[:3])
    if diagnosed.named:
        alike = [
            cause for cause in diagnosed.causes[diagnosed.likeliest :] if cause.explained >= SAME
        ]
        rest = f" As well by: {', '.join(cause.name for cause in alike)}." if alike else ""
        return f"Likeliest: {shares}.{rest}"
    if shares:
        return f"Cause unknown. No suspect accounts for enough of it, and clearly more than others: {shares}."
    return "Cause unknown: no suspect accounts for it."


def _suspicion(cause: Cause) -> str:
    """A suspect: what, how much of it, and how much of the deviation that accounts for."""
    amount = f" ({cause.amount})" if cause.amount else ""
    return f"{cause.name}{amount}: {100 * cause.explained:.1f} % of it"


def differing(results: Results) -> Iterator[Block]:
    """Of each run that does not agree: what broke, what could not be judged, and why."""
    for run in results.runs:
        if run.outcome is Outcome.AGREES:
            continue
        yield Heading(f"{run.model}, {run.label}: {run.outcome.value}", 3, why_anchor(run))
        yield from why(run)
        yield Listing(tuple(_said_of(run)))


def why(found: Measured) -> Iterator[Text]:
    """When and why it differs from the reference, as paragraphs."""
    yield from (Text(sentence, lead="Why:") for sentence in map(_capital, diagnosis(found)))


def why_anchor(run: Run) -> str:
    """Anchor of what is said of a run that does not agree."""
    return f"why-{run.model}-{run.label}".lower().replace(" ", "-")


def _said_of(run: Run) -> Iterator[Text]:
    yield from (
        Text(sentence, "bad" if n < len(run.broken) else "plain")
        for n, sentence in enumerate(complaints(run, _MOST))
    )
    if run.message:
        yield Text(_capital(run.message), MARKS[run.outcome])
    if run.unjudged:
        labels = ", ".join(metric.label for metric in run.unjudged)
        yield Text(f"not judged: {labels} ({run.unjudged[0].note}).", "unjudged")


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


_POINTS = 300  # drawn per line: more than a plot has columns of pixels for, and the page stays below two megabytes
_COLUMNS = 4
_SEEN = 5e-3
"""Share of a plot's range: a run nearer to the reference than that is covered by its line."""
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
        """The quantity, few enough points to draw; None if it would be covered by the reference's line."""
        t = self.reference.t
        own, known = quantity(self.trajectory)[: len(t)], quantity(self.reference)
        if np.abs(own - known).max() <= _SEEN * np.ptp(known):
            return None
        chosen = np.unique(np.linspace(0, len(t) - 1, _POINTS).astype(int))
        return Series(self.label, t[chosen], own[chosen], self.style)

    def difference(self, quantity: Sampled) -> Series:
        """Absolute differences to the reference, distances for points, as `thinned`."""
        known = quantity(self.reference)
        difference = quantity(self.trajectory)[: len(known)] - known
        size = np.abs(difference) if difference.ndim == 1 else np.linalg.norm(difference, axis=1)
        return Series(self.label, *thinned(self.reference.t, size), self.style)


def lines(solution: Solution, trajectories: Mapping[str, Trajectory], end: float) -> list[Line]:
    """Runs of one machine up to `end` [s]; the tuned reference is what they are compared with."""
    return [
        Line(trajectory, solution.trajectory(trajectory.t[trajectory.t <= end]))
        for trajectory in trajectories.values()
        if (trajectory.provenance.engine, trajectory.provenance.preset) != ("reference", "tuned")
    ]


def thinned(t: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Few enough points to draw: at the end of each of `_POINTS` intervals the largest value within it."""
    if len(t) <= _POINTS:
        return t, values
    edges = np.linspace(0, len(t), _POINTS + 1).astype(int)
    return t[edges[1:] - 1], np.array([values[a:b].max() for a, b in pairwise(edges)])


def motion(comparison: Comparison) -> Animation:
    """Every machine in motion, all its runs over the reference."""

    def scenes() -> tuple[Scene, ...]:
        return tuple(_scene(comparison, machine) for machine in comparison.results.machines)

    return Animation(scenes)


def _scene(comparison: Comparison, machine: Machine) -> Scene:
    runs = {
        label: run
        for (model, label), run in comparison.trajectories.items()
        if model == machine.model
    }
    states, name = comparison.solutions[machine.model].trajectory, machine.model
    end, thrown, launch = machine.compared_to, machine.thrown, machine.launch_time
    return motion_scene(states, runs, end=end, thrown=thrown, launch=launch, name=name)


def figures(comparison: Comparison, machine: Machine) -> Grid:
    """All plots of one machine over time, each drawn when a page needs it; they zoom together."""

    @cache
    def runs() -> list[Line]:
        own = {
            label: t
            for (model, label), t in comparison.trajectories.items()
            if model == machine.model
        }
        return lines(comparison.solutions[machine.model], own, machine.compared_to)

    def figure(
        name: str, caption: str, columns: int, draw: Callable[[Solution, Sequence[Line]], Panels]
    ) -> Figure:
        drawn = partial(_drawn, draw, lambda: (comparison.solutions[machine.model], runs()))
        own = anchor(machine.model, name)
        return Figure(drawn, name.capitalize(), caption, own, machine.model, min(columns, _COLUMNS))

    return Grid(tuple(figure(*each) for each in _figures(machine)))


def _drawn(
    draw: Callable[..., Panels], given: Callable[[], tuple[Solution, Sequence[Line]]]
) -> Panels:
    return draw(*given())


def anchor(model: str, name: str) -> str:
    """Anchor of a machine's figure or section of that name."""
    return f"{model}-{name}".lower().replace(" ", "-")


def anchors(machine: Machine) -> set[str]:
    """Anchors of the machine's figures."""
    return {anchor(machine.model, name) for name, *_ in _figures(machine)}


DISTANCES, TORQUES, FORCES, JOINT_FORCES = (
    "distances",
    "stop torques",
    "stop forces",
    "joint forces",
)
COORDINATES, ENERGY = "coordinates", "energy"


def _figures(
    machine: Machine,
) -> Iterator[tuple[str, str, int, Callable[[Solution, Sequence[Line]], Panels]]]:
    """Name, sentence, number of quantities, and what draws it."""
    mechanism = machine.mechanism
    marks = _events(machine)
    ends = {marker.name: position(marker.name) for marker in mechanism.markers}
    if ends:
        text = "Of each marker from the reference, at the engine's own times; no sample is interpolated. "
        text += f"Of each {_POINTS}th of the motion the largest is drawn."
        yield (
            DISTANCES,
            text,
            len(ends),
            partial(_over_time, quantities=ends, unit="m", marks=marks),
        )
    for name, text, unit, quantities in _quantities(machine):
        if quantities:
            sentence = f"{text} Upper row: the reference, and runs that part from its line. Lower row: differences."
            draw = partial(
                _over_time, quantities=quantities, unit=unit, marks=marks, end=machine.compared_to
            )
            yield name, sentence, len(quantities), draw
    text = "Total energy less the work of dampers, constant forces and torques, as a share of the energy at the start "
    text += "(where that is near zero: of the largest kinetic energy). Any drift but at impacts is numerical."
    yield ENERGY, text, 1, partial(_energy_drift, marks=marks)


def _events(machine: Machine) -> tuple[Rule, ...]:
    """Where stops open and the projectile is launched in the reference."""
    times = {f"{name} opens": time for name, time in machine.release_times.items()}
    return tuple(
        Rule(time, text)
        for text, time in times.items()
        if time is not None and time <= machine.compared_to
    )


def _quantities(machine: Machine) -> Iterator[tuple[str, str, str, dict[str, Sampled]]]:
    """Name, sentence, unit and quantities of the plots over time."""
    mechanism = machine.mechanism
    closed = {
        unit: [s for s in mechanism.stops if s.closed and s.force_unit == unit]
        for unit in ("N m", "N")
    }
    text = "At least 0 while the contact of the stop is active, 0 once it is released."
    yield TORQUES, text, "N m", {stop.name: _stop_torque(stop.name) for stop in closed["N m"]}
    yield FORCES, text, "N", {stop.name: _stop_torque(stop.name) for stop in closed["N"]}
    forces = {
        joint.name: _joint_force(joint.name) for joint in mechanism.joints if joint.held_directions
    }
    yield JOINT_FORCES, "Magnitude of the force on each joint's child.", "N", forces
    angles = {name: _coordinate(i) for i, name in enumerate(mechanism.angles)}
    yield COORDINATES, "Absolute angles, positive clockwise.", "rad", angles


def _coordinate(index: int) -> Sampled:
    return lambda trajectory: trajectory.q[:, index]


def _stop_torque(name: str) -> Sampled:
    return lambda trajectory: trajectory.stop_torque(name)


def _joint_force(name: str) -> Sampled:
    return lambda trajectory: np.linalg.norm(trajectory.joint_reaction(name), axis=1)


def position(name: str) -> Sampled:
    """Of a marker [m]."""
    return lambda trajectory: trajectory.marker(name).position


def _over_time(
    solution: Solution,
    runs: Sequence[Line],
    quantities: Mapping[str, Sampled],
    unit: str,
    marks: tuple[Rule, ...],
    end: float | None = None,
) -> Panels:
    """Quantities over time up to `end` [s], then their differences to the reference; without it only these.

    A run whose engine cannot observe a quantity has no line.
    """
    values = (
        []
        if end is None
        else [_values(solution, runs, *each, unit, marks, end) for each in quantities.items()]
    )
    axis = Axis("distance" if end is None else "difference", unit, logarithmic=True)
    marks = marks if end is None else tuple(Rule(mark.at) for mark in marks)
    return (
        *values,
        *(_differences(runs, name, quantity, axis, marks) for name, quantity in quantities.items()),
    )


_TIME = Axis("t", "s")


def _values(
    solution: Solution,
    runs: Sequence[Line],
    name: str,
    quantity: Sampled,
    unit: str,
    marks: tuple[Rule, ...],
    end: float,
) -> Plot:
    reference = solution.trajectory(np.linspace(0.0, end, _POINTS))
    series = [Series("reference", reference.t, quantity(reference), REFERENCE)]
    for run in runs:
        with suppress(ValueError):
            series += filter(None, [run.values(quantity)])
    return Plot(_TIME, Axis("", unit), tuple(series), name, rules=marks, height=230)


def _differences(
    runs: Sequence[Line], name: str, quantity: Sampled, axis: Axis, marks: tuple[Rule, ...]
) -> Plot:
    series: list[Series] = []
    for run in runs:
        with suppress(ValueError):
            series.append(run.difference(quantity))
    return Plot(_TIME, axis, tuple(series), name, rules=marks, height=250)


def _energy_drift(solution: Solution, runs: Sequence[Line], marks: tuple[Rule, ...]) -> Panels:
    """Energy drift relative to the energy at the start, or to the largest kinetic energy where that says more."""
    known = solution.trajectory(
        np.linspace(0.0, max((run.reference.t[-1] for run in runs), default=0.0), _POINTS)
    )
    start, kinetic = float(known.total_energy[0]), float(known.kinetic_energy.max())
    size, name = (
        (abs(start), "|E(0)|") if abs(start) > LEAST_START * kinetic else (kinetic, "largest T")
    )
    series: list[Series] = []
    for run in runs:
        t, (energy, _) = run.reference.t, sampled_balance(run.trajectory)
        drift = np.abs(energy[: len(t)] - start) / (size or 1.0)
        series.append(Series(run.label, *thinned(t, drift), run.style))
    axis = (
        Axis(f"|E - E(0)| / {name}", "1", logarithmic=True)
        if size
        else Axis("|E - E(0)|", "J", logarithmic=True)
    )
    return (Plot(_TIME, axis, tuple(series), height=250, rules=marks),)


def work_precision(machines: Sequence[Machine], runs: Sequence[Run]) -> Figure:
    """Error of every run against its wall time: a panel a machine."""
    panels = tuple(
        Plot(
            Axis("wall time", "s", logarithmic=True),
            Axis("largest distance of a marker", "m", logarithmic=True),
            tuple(_priced([run for run in runs if run.model == machine.model])),
            machine.model,
        )
        for machine in machines
    )
    text = "Further left is quicker, further down more accurate. Wall times are of this computer, with everything that "
    text += "the run does: build, simulation, read-out."
    return Figure(panels, "Error against wall time", text, "work-precision")


def _priced(runs: Sequence[Run]) -> Iterator[Series]:
    for run in runs:
        distances = [
            metric.value
            for metric in run.metrics
            if metric.name == "position_max" and metric.observed
        ]
        if run.wall_time and distances and None not in distances:
            largest = max(abs(value) for value in distances if value is not None)
            steps = (f"{run.steps} steps",)
            at, style = (
                (np.array([run.wall_time]), np.array([largest])),
                run_style(run.engine, run.preset),
            )
            yield Series(run.label, *at, style, "points", steps)


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
        return replace(cell, link=anchor(run.model, self.plot) if self.plot else "")


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


_POSITION = ErrorColumn("position", "m", "position_max", short="position", plot=DISTANCES)
_QUANTITIES = (
    ErrorColumn("release", "s", "release_time", short="release", rank=2, plot=DISTANCES),
    ErrorColumn("launch time", "s", "launch_time", plot=DISTANCES),
    ErrorColumn("launch speed", "m/s", "launch_speed", short="speed", rank=4, plot=DISTANCES),
    ErrorColumn("stop torque", "N m", "stop_torque_max", short="torque", rank=2, plot=TORQUES),
    ErrorColumn(
        "joint force",
        "1",
        "joint_reaction_relative",
        judged="joint_reaction_max",
        plot=JOINT_FORCES,
    ),
    ErrorColumn(
        "energy",
        "1",
        "energy_drift",
        judged="energy_balance",
        otherwise="energy_drift_kinetic",
        short="energy",
        rank=3,
        plot=ENERGY,
    ),
)
OVERVIEW = (_POSITION, *_QUANTITIES)
"""One value of each quantity, whatever markers the mechanism has."""


def quantities(machine: Machine) -> tuple[ErrorColumn, ...]:
    """Quantities of the agreement table: the position of each marker, then what every mechanism has."""
    positions = (
        ErrorColumn(marker.name, "m", "position_max", marker.name)
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


def _overview_row(machine: Machine, run: Run, quantities: Sequence[ErrorColumn]) -> Row:
    existing = anchors(machine)
    cells = (quantity.linked(run) for quantity in quantities)
    linked = [cell if cell.link in existing else replace(cell, link="") for cell in cells]
    agrees = run.outcome is Outcome.AGREES
    verdict = replace(verdict_cell(run), link=metrics_anchor(run) if agrees else why_anchor(run))
    step, wall = Cell(format_step(run.settings.get("timestep"))), Cell(str(_WALL.of(run)))
    own = anchor(run.model, run.label)
    return Row((Cell(run.label), verdict, *linked, _further(run, quantities), step, wall), own)


def metrics_anchor(run: Run) -> str:
    """Anchor of the table of all metrics of a run."""
    return anchor(run.model, f"metrics {run.label}")


def _further(run: Run, quantities: Sequence[ErrorColumn]) -> Cell:
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


_ROWS, _CAUSES, _COMPLAINTS = 16, 6, 10
"""Runs and causes that are shown at once, and sentences on broken tolerances of a run behind a fold."""
_SIGNS = (
    "Largest differences to the reference. ✓ holds its tolerance, ✗ breaks it, ○ is not judged."
)


def summary(results: Results) -> Document:
    """Verdict, errors of the runs, what broke and why, versions; the rest behind folds."""
    first, rest = _foremost(results.runs)
    broken = [*_broken(results.runs)]
    blocks: tuple[Block, ...] = (
        Text(verdict(results), mark_of(results.passed)),
        _errors(first),
        Note(_SIGNS),
        Listing(tuple(broken[:_CAUSES])),
        Text(_versions(results)),
        *_command(results),
        *_folds(results, rest, broken[_CAUSES:]),
    )
    return Document("", blocks)


def _foremost(runs: Sequence[Run]) -> tuple[Sequence[Run], Sequence[Run]]:
    """Runs to be shown, and the rest: the reference against itself, and where there are too many those that agree."""
    ordered = [*runs]
    if len(runs) > _ROWS:
        ordered.sort(key=lambda run: run.outcome is Outcome.AGREES)
    own = [
        run for run in ordered if run.engine == REFERENCE_ENGINE and run.outcome is Outcome.AGREES
    ]
    others = [run for run in ordered if run not in own] or own
    return others[:_ROWS], [*others[_ROWS:], *(own if others is not own else [])]


def _errors(runs: Sequence[Run]) -> Table:
    """Quantities that one of the runs has, at least."""
    heads = (
        Column("machine", of=lambda run: run.model),
        Column("engine", of=lambda run: run.label),
        *(quantity.column for quantity in OVERVIEW if any(map(quantity.metrics, runs))),
        Column("verdict", of=verdict_cell),
    )
    return without_empty_columns(table(heads, runs))


def _broken(runs: Iterable[Run]) -> Iterator[Text]:
    """One line for each run that does not agree: the worst of it, and its likeliest cause."""
    for run in runs:
        parts = [*complaints(run, 1), *([run.message] if run.message else [])]
        parts += [f"not judged: {len(run.unjudged)} quantities"] if run.unjudged else []
        if run.diagnosis is not None:
            parts.append(cause(run.diagnosis))
        if parts:
            text = " ".join(map(sentence, parts))
            yield Text(text, "bad" if run.broken else "warning", lead=f"{run.model}, {run.label}:")


def cause(diagnosis: Diagnosis) -> str:
    """What a run differs in first, and its likeliest cause, in a line."""
    if diagnosis.note:
        return f"cause unknown: {diagnosis.note}"
    named = " or ".join(
        f"{each.name} ({each.amount})" if each.amount else each.name for each in diagnosis.named
    )
    return f"first in {diagnosis.leads}, {f'likeliest: {named}' if named else 'cause unknown'}"


def _versions(results: Results) -> str:
    engines = {run.engine: run.engine_version for run in results.runs}
    names = ", ".join(f"{engine} {version}" for engine, version in engines.items())
    own = f"trebucheck {results.trebucheck_version}, Python {results.python_version}, {results.platform}"
    return f"Versions: {names}; {own}."


def _command(results: Results) -> Iterator[Block]:
    if results.command is not None:
        yield Code("Made by:", results.command)


def _folds(results: Results, rest: Sequence[Run], broken: Sequence[Text]) -> Iterator[Block]:
    if rest or broken:
        yield Fold(f"Further runs ({len(rest)})", (_errors(rest), Listing(tuple(broken))))
    complained = [(run, complaints(run, _COMPLAINTS)) for run in results.runs if run.broken]
    items = [
        Text(text, lead=f"{run.model}, {run.label}:") for run, texts in complained for text in texts
    ]
    if items:
        yield Fold("Tolerances that are broken", (Listing(tuple(items)),))
    mechanisms = [(m.model, m.mechanism_hash[:16], f"{m.judged_to:.6g}") for m in results.machines]
    settings = [(run.model, run.label, format_settings(run.settings)) for run in results.runs]
    yield Fold(
        "Mechanisms and settings",
        (
            table("machine | hash | judged to [s]", mechanisms),
            table(["machine", "engine", words("settings")], settings),
        ),
    )


_QUESTION = "How far can you trust a multibody engine, and why does it differ?"
_CERTIFIED = (
    "release_time",
    "launch_time",
    "launch_speed",
    "launch_angle",
    "range",
    "stop_torque",
    "total_energy",
)
_KNOWN = (
    "position_max",
    "velocity_max",
    "release_time",
    "launch_time",
    "launch_speed",
    "stop_torque_max",
    "energy_balance",
)
_CHECKS = (
    "total mass", "start", "centre of mass", "stop position", "mass matrix", "force", "acceleration", "stop torque",
)  # fmt: skip
"""Kinds of checks of model equivalence, in the order of the table."""
_INTRODUCTION = (
    "Each engine builds the same mechanism from its own primitives. Differences are the largest up to the end of the "
    "compared motion, the reference taken at the engine's own sample times. Values marked ✓ hold a tolerance, values "
    "marked ✗ break one. A run agrees if every compared quantity holds its tolerance: the user's need where one "
    "is stated, else the engine's claim, else a thousandth of the quantity's scale. What one solver does and the other "
    "does not (a launch, a release, an impact) is a disagreement. “Stock” is what an engine's documentation leads a "
    "newcomer to, “tuned” the most accurate settings found."
)
_EQUIVALENCE = (
    "Before any motion, each engine's built model is compared with the reference's equations in random states under "
    "every set of closed stops. Each value is the largest relative difference of its kind; a dash stands for what the "
    "engine does not expose, “not checked” an engine that exposes nothing. A run whose model differs is not compared."
)


def document(comparison: Comparison) -> Document:
    """The whole of it; the terminal has the tables in short, what broke, and the verdict at its end."""
    results = comparison.results
    listed = doc.Listing(tuple(findings(results)))
    blocks: list[Block] = [
        page_only(Text(verdict(results), mark_of(results.passed))),
        _tiles(results),
        *([motion(comparison)] if results.machines else []),
        overview(results),
    ]
    if any(run.wall_time for run in results.ran):
        blocks.append(work_precision(results.machines, results.runs))
    for machine in results.machines:
        blocks += _chapter(comparison, machine)
    if any(run.outcome is not Outcome.AGREES for run in results.runs):
        blocks += [
            Heading("What differs, and why", 2, "why"),
            *(page_only(each) for each in differing(results)),
        ]
    for machine in results.machines:
        blocks += _evidence(comparison, machine)
    blocks += [
        Heading("How the comparison is made", 2),
        Note(_INTRODUCTION),
        Note(_EQUIVALENCE),
        page_only(_own(results)),
    ]
    runs = ((run.model, run.label, run.engine_version, run.settings) for run in results.runs)
    blocks += provenance(
        results, runs, [(machine.model, machine.mechanism) for machine in results.machines]
    )
    blocks += [doc.terminal_only(listed), Text(verdict(results), medium="terminal")]
    return Document(
        _QUESTION,
        tuple(blocks),
        _window(results),
        verdict=verdict(results),
    )


def _own(results: Results) -> doc.Listing:
    """What trebucheck does in each engine's place."""
    stated = {run.label: run.supplied for run in results.runs if run.supplied is not None}
    return doc.Listing(
        tuple(
            Text(supplied_sentence(given), lead=f"{label}:")
            for label, given in sorted(stated.items())
        )
    )


def _window(results: Results) -> str:
    return f"trebucheck: {', '.join(machine.model for machine in results.machines)}"


def _tiles(results: Results) -> doc.Tiles:
    """Verdicts counted, and the engines at both ends of the ranking by distance."""
    counted = Counter(run.outcome for run in results.runs)
    failed = sum(counted[each] for each in (*FAILURES, Outcome.NOT_EQUIVALENT))
    rest = sum(counted[each] for each in (Outcome.NOT_JUDGED, Outcome.ABSENT, Outcome.UNSUPPORTED))
    tiles = [
        Tile(str(counted[Outcome.AGREES]), "agree", "good" if counted[Outcome.AGREES] else "plain"),
        Tile(
            str(counted[Outcome.DISAGREES]),
            "disagree",
            "bad" if counted[Outcome.DISAGREES] else "plain",
        ),
        *([Tile(str(failed), "failed or not equivalent", "bad")] if failed else []),
        Tile(str(rest), "not judged", "warning" if rest else "plain"),
    ]
    ranked = ranking(results)
    if len(ranked) > 1:
        for (run, distance), label in (
            (ranked[0], "nearest to the reference"),
            (ranked[-1], "farthest from it"),
        ):
            tiles.append(Tile(run.label, label, detail=f"at most {format_number(distance)} m"))
    return doc.Tiles(tuple(tiles))


def _chapter(comparison: Comparison, machine: Machine) -> list[Block]:
    runs = [run for run in comparison.results.runs if run.model == machine.model]
    return [
        Heading(f"{machine.model.capitalize()} machine", 2, machine.model),
        Text(" ".join(_reference_sentences(machine)), medium="page"),
        Text(predictable(machine)),
        agreement(machine, runs),
        *partings(machine, runs),
        figures(comparison, machine),
    ]


def _evidence(comparison: Comparison, machine: Machine) -> list[Block]:
    """What stands behind the machine's verdicts, folded away."""
    runs = [run for run in comparison.results.runs if run.model == machine.model]
    pairs = [pair for pair in comparison.results.pairs if pair.model == machine.model]
    return [
        Heading(
            f"{machine.model.capitalize()} machine: the evidence",
            2,
            anchor(machine.model, "evidence"),
        ),
        *_uncertainty(machine),
        *(_pairs(pairs) if pairs else ()),
        doc.Fold(
            "Model equivalence: each built model against the reference's equations, before any motion",
            (
                table(
                    _EQUIVALENCE_COLUMNS,
                    [run for run in runs if run.equality],
                    _EQUIVALENCE_CAPTION,
                    "page",
                ),
            ),
            anchor=anchor(machine.model, "equivalence"),
        ),
        *(_metrics(machine, run) for run in runs if run.metrics),
    ]


def _metrics(machine: Machine, run: Run) -> doc.Fold:
    held = len(run.judged) - len(run.broken)
    title = f"{machine.model}, {run.label}: every quantity, tolerance and reason ({held} of {len(run.judged)} hold)"
    return doc.Fold(
        title, (table(_METRIC_COLUMNS, run.metrics, run.label),), anchor=metrics_anchor(run)
    )


_LAWS = {
    StopLaw.RELEASE_ONCE: "A stop that has opened stays open (release-once).",
    StopLaw.UNILATERAL: "A stop closes again when its gap comes back to zero (unilateral).",
}


def _reference_sentences(machine: Machine) -> Iterator[str]:
    if machine.launch_time is None:
        yield "The reference does not launch."
    else:
        yield f"The reference launches at {machine.launch_time:.9f} s with {machine.launch_speed:.7f} m/s."
    yield f"Compared from the start to {machine.compared_to:.6g} s."
    if machine.needs:
        yield f"Tolerances asked for: {', '.join(f'{name} {text}' for name, text in machine.needs.items())}."
    if machine.mechanism.stops:
        yield _LAWS[machine.stop_law]
    if machine.impacts:
        yield f"The reference has {machine.impacts} impact{'s' if machine.impacts > 1 else ''}."
    for name, time in machine.release_times.items():
        if time is not None:
            stop = machine.mechanism.stop(name)
            start = f"{machine.start_torques[name]:.6f} {stop.force_unit}"
            yield f"The {name} opens at {time:.9f} s; its {stop.effort} at the start is {start}."


def _uncertainty(machine: Machine) -> tuple[Block, ...]:
    certificate = load_certificate(machine.mechanism)
    if certificate is None:
        known = (
            f"{format_number(v)} in {k}"
            for k, v in machine.reference_uncertainty.items()
            if k in _KNOWN
        )
        text = (
            "This machine has no certificate (`trebucheck certify` makes one). By a second integration at a coarser "
            f"tolerance the reference is known to {', '.join(known)} (SI units)."
        )
        return (Note(text),)
    figures = [f for f in certificate.figures if f.name in _CERTIFIED and f.time is None]
    paper = "" if parameters_of(machine.mechanism) is None else " and the paper's own equations"
    text = (
        f"From the certificate of exactly this machine: minimal and redundant coordinates{paper}, DOP853 over a ladder "
        "of tolerances and Taylor series in double and extended precision. A tolerance finer than ten times the "
        "reference's uncertainty is refused."
    )
    title = "How far the reference is known: its certificate"
    return (
        doc.Fold(title, (page_only(certified_figures(figures, "Certified values")), Note(text))),
    )


def _check(run: Run, kind: str) -> Cell:
    """The worst of a kind of checks; a dash where the engine does not expose it."""
    checks = [check for check in run.equality.checks if check.name == kind] if run.equality else []
    if not checks:
        return Cell("–")
    return Cell(
        format_number(largest(check.value for check in checks)),
        mark_of(all(check.holds for check in checks)),
    )


def _equal(equality: Equality) -> Cell:
    mark: Mark = "good" if equality.exposed else "warning"
    if not equality.exposed:
        return Cell("not checked", mark)
    text = equality.note or ("equivalent" if equality.holds else "another model")
    return Cell(text, mark if equality.holds else "bad")


_EQUIVALENCE_CAPTION = (
    "Largest relative differences of the built models to the reference's equations"
)
_EQUIVALENCE_COLUMNS = (
    Column("engine", of=lambda run: run.label),
    *(Column(kind, of=partial(_check, kind=kind)) for kind in _CHECKS),
    Column("states", of=lambda run: run.equality.states),
    Column("verdict", of=lambda run: _equal(run.equality)),
)


def _pairs(pairs: Sequence[Pair]) -> tuple[Block, ...]:
    tuned = [
        pair for pair in pairs if pair.first.endswith("tuned") and pair.second.endswith("tuned")
    ]
    every = without_empty_columns(table(_PAIR_COLUMNS, pairs, "Engine against engine, all pairs"))
    return (
        doc.Fold("Engine against engine", (_matrix(pairs), every)),
        without_empty_columns(
            table(
                _PAIR_COLUMNS,
                tuned,
                "engine against engine (tuned; the report has all)",
                "terminal",
            )
        ),
    )


_PAIR_COLUMNS = (
    Column("first", of=lambda pair: pair.first),
    Column("second", of=lambda pair: pair.second, rank=0),
    Column("position", "m", of=lambda pair: format_number(pair.position_max)),
    Column("release", "s", of=lambda pair: format_number(pair.release_time_max)),
    Column("speed", "m/s", of=lambda pair: format_number(largest([pair.launch_speed]))),
)


def _matrix(pairs: Sequence[Pair]) -> Table:
    """Distances above the diagonal."""
    distances = {(pair.first, pair.second): format_number(pair.position_max) for pair in pairs}
    labels = list(
        dict.fromkeys([*(first for first, _ in distances), *(second for _, second in distances)])
    )
    rows = [
        (first, *(distances.get((first, second), "") for second in labels[1:]))
        for first in labels[:-1]
    ]
    return table(
        ["engine", *labels[1:]],
        rows,
        "Largest distance between the two positions of a marker [m]",
        "page",
    )


def _metric_value(metric: Metric) -> Cell:
    text = (metric.note or "–") if metric.value is None else f"{metric.value:.6e}"
    return Cell(text, mark_of(metric.holds))


def _unjudged_reason(metric: Metric) -> str:
    return f"follows from {metric.follows}" if metric.follows else metric.note or ""


_METRIC_COLUMNS = (
    Column("metric", of=lambda metric: metric.label),
    Column("value", of=_metric_value),
    Column("unit", of=lambda metric: metric.unit),
    Column("tolerance", of=lambda metric: format_number(metric.tolerance)),
    Column(
        "stated by", of=lambda metric: metric.source or ("" if metric.observed else "not observed")
    ),
    Column("reason", of=lambda metric: metric.reason or _unjudged_reason(metric)),
)
