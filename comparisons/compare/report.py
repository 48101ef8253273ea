"""A comparison as a document."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

from ...models.machines.trebuchet import parameters_of
from ...reference.certification.certificate import load_certificate
from ..report import document as doc
from ..report.document import Block, Cell, Column, Document, Heading, Mark, Note, Table, Text, mark_of, page_only, table
from ..report.numbers import format_number, format_step
from ..report.sections import certified_figures, partings, predictable, provenance
from ..runs.results import COMPARED, Cause, Diagnosis, Equality, Machine, Metric, Outcome, Pair, Results, Run
from . import plots
from .study import Comparison

_CERTIFIED = ("release_time", "launch_time", "launch_speed", "launch_angle", "range", "stop_torque", "total_energy")
_MARKS: dict[Outcome, Mark] = {
    Outcome.AGREES: "good",
    Outcome.DISAGREES: "bad",
    Outcome.NOT_JUDGED: "warning",
    Outcome.NOT_EQUIVALENT: "bad",
    Outcome.FAILED: "bad",
    Outcome.ABSENT: "warning",
    Outcome.UNSUPPORTED: "warning",
}
_PLURALS = {Outcome.AGREES: "agree", Outcome.DISAGREES: "disagree"}
_MOST = 3
"""Sentences on broken tolerances for one run; the table of all metrics has the rest."""
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
_COLUMNS = (
    "Largest distance of each marker; largest error of a release time; error of launch time and speed; largest error "
    "of a stop's torque at any sample; largest error of a joint's force, of that force's largest value; energy drift, "
    "of the total energy. Verdict: quantities that hold their tolerance, of all that were judged."
)


@dataclass(frozen=True)
class Quantity:
    """A quantity of the agreement table: the largest of the metrics of one name."""

    title: str
    unit: str
    metric: str
    subject: str | None = None
    judged: str = ""
    """Metric that has the verdict, if that is another one."""
    short: str = ""
    """Title in a terminal; '' leaves the column out there."""
    rank: int = 1
    """As that of its column."""

    @property
    def column(self) -> Column:
        """Its column in a table of runs."""
        medium = "any" if self.short else "page"
        return Column(self.title, self.unit, short=self.short, of=self.cell, rank=self.rank, medium=medium)

    def metrics(self, run: Run) -> list[Metric]:
        """Those it stands for."""
        of = (m for m in run.metrics if m.observed and m.name == self.metric)
        return [m for m in of if self.subject in (None, m.subject)]

    def value(self, run: Run) -> float | None:
        """The largest; None if one is missing, or the run has none."""
        return _largest(m.value for m in self.metrics(run))

    def cell(self, run: Run) -> Cell:
        """The value, with its unit where that is not the column's, marked by its tolerances."""
        metrics, value = self.metrics(run), self.value(run)
        if not metrics:
            return Cell("")
        other = "" if value is None else "".join({f" {m.unit}" for m in metrics} - {f" {self.unit}"})
        named = [m for m in run.metrics if m.name == (self.judged or self.metric) and self.subject in (None, m.subject)]
        verdicts = {m.holds for m in named} - {None}
        return Cell(format_number(value) + other, mark_of(all(verdicts) if verdicts else None))


def _largest(values: Iterable[float | None]) -> float | None:
    """Magnitude of the largest; None if one is missing, or all are."""
    sizes = [None if value is None else abs(value) for value in values]
    return None if None in sizes else max((size for size in sizes if size is not None), default=None)


_POSITION = Quantity("position", "m", "position_max", short="position")
_QUANTITIES = (
    Quantity("release", "s", "release_time", short="release", rank=2),
    Quantity("launch time", "s", "launch_time"),
    Quantity("launch speed", "m/s", "launch_speed", short="speed", rank=4),
    Quantity("stop torque", "N m", "stop_torque_max", short="torque", rank=2),
    Quantity("joint force", "1", "joint_reaction_relative", judged="joint_reaction_max"),
    Quantity("energy", "1", "energy_drift", judged="energy_balance", short="energy", rank=3),
)
OVERVIEW = (_POSITION, *_QUANTITIES)
"""One value of each quantity, whatever markers the mechanism has."""


def quantities(machine: Machine) -> tuple[Quantity, ...]:
    """Quantities of the agreement table: the position of each marker, then what every mechanism has."""
    positions = (Quantity(marker.name, "m", "position_max", marker.name) for marker in machine.mechanism.markers)
    return (*positions, *_QUANTITIES)


def differences(machine: Machine) -> tuple[Column, ...]:
    """Columns of a table of its runs: engine, step, and the quantities."""
    return (
        Column("engine", of=lambda run: run.label),
        Column("step", "s", of=lambda run: format_step(run.settings.get("timestep")), rank=5),
        replace(_POSITION.column, medium="terminal"),
        *(quantity.column for quantity in quantities(machine)),
    )


def document(comparison: Comparison) -> Document:
    """The whole of it; the terminal has the tables in short, what broke, and the verdict at its end."""
    results = comparison.results
    findings = doc.Listing(tuple(_findings(results)))
    blocks: list[Block] = [
        Note("How far can you trust a multibody engine, and why does it differ?"),
        Text(verdict(results), mark_of(results.passed), medium="page"),
        page_only(findings),
        Note(_INTRODUCTION),
    ]
    for machine in results.machines:
        blocks += _chapter(comparison, machine)
    runs = ((run.model, run.label, run.engine_version, run.settings) for run in results.runs)
    blocks += provenance(results, runs, [(machine.model, machine.mechanism) for machine in results.machines])
    blocks += [doc.terminal_only(findings), Text(verdict(results), medium="terminal")]
    return Document("trebucheck", tuple(blocks), "trebucheck report")


def verdict(results: Results) -> str:
    """One line: how many runs came to which verdict, and what was judged."""
    counted = Counter(run.outcome for run in results.runs)
    outcomes = ", ".join(f"{counted[each]} {_PLURALS.get(each, each.value)}" for each in Outcome if counted[each])
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


def _findings(results: Results) -> Iterator[Text]:
    """What broke or did not run, and why."""
    for run in results.runs:
        name = f"{run.model}, {run.label}"
        for sentence in complaints(run, _MOST):
            yield Text(sentence, "bad", lead=f"{name}:")
        if run.message:
            yield Text(f"{run.outcome.value}: {run.message}", _MARKS[run.outcome], lead=f"{name}:")
        if run.unjudged:
            labels = ", ".join(metric.label for metric in run.unjudged)
            yield Text(f"not judged: {labels} ({run.unjudged[0].note}).", "warning", lead=f"{name}:")
        for sentence in diagnosis(run):
            yield Text(sentence, "strong", lead=f"{name}, why:")


def complaints(run: Run, most: int | None = None) -> list[str]:
    """One sentence for each tolerance that does not hold, the worst first; of the rest their number.

    Args:
        most: how many have a sentence; None: all.
    """
    broken = sorted(run.broken, key=lambda m: math.inf if m.value is None else abs(m.value) / (m.tolerance or 1e-300))
    sentences = [_complaint(metric) for metric in broken[::-1][:most]]
    rest = len(broken) - len(sentences)
    return [*sentences, f"{rest} more of {len(run.judged)} judged quantities break their tolerance."][: len(broken)]


def _complaint(m: Metric) -> str:
    measured = m.note or f"{format_number(m.value)} {m.unit}"
    return f"{m.label}: {measured}, tolerance {format_number(m.tolerance)} {m.unit} ({m.source}: {m.reason})"


def diagnosis(run: Run) -> list[str]:
    """When the run begins to differ from the reference and why, in sentences; none for a run that agrees."""
    diagnosed = run.diagnosis
    if diagnosed is None:
        return []
    when = "in its motion" if run.metrics else "before any motion"
    if diagnosed.parts_at is not None:
        holding = ", ".join(diagnosed.holding) or "no stop"
        when = f"from t = {diagnosed.parts_at:.6g} s, while {holding} held in the reference"
    only = " The motion follows the reference: only what is read from it differs." if diagnosed.motion_agrees else ""
    return [f"differs from the reference {when}, first in {diagnosed.leads}.{only} {_likeliest(diagnosed)}"]


def _likeliest(diagnosed: Diagnosis) -> str:
    """The causes that account for enough of the deviation; without one, what the suspects account for."""
    shares = "; ".join(_suspicion(cause) for cause in diagnosed.named or diagnosed.causes[:3])
    if diagnosed.named:
        return f"Likeliest: {shares}."
    if shares:
        return f"Cause unknown. No suspect accounts for enough of it, and clearly more than others: {shares}."
    return "Cause unknown: no suspect accounts for it."


def _suspicion(cause: Cause) -> str:
    """A suspect: what, how much of it, and how much of the deviation that accounts for."""
    amount = f" ({cause.amount})" if cause.amount else ""
    return f"{cause.name}{amount}: {100 * cause.explained:.1f} % of it"


def _chapter(comparison: Comparison, machine: Machine) -> list[Block]:
    runs = [run for run in comparison.results.runs if run.model == machine.model]
    pairs = [pair for pair in comparison.results.pairs if pair.model == machine.model]
    return [
        Heading(f"{machine.model.capitalize()} machine", 2, machine.model),
        Text(" ".join(_reference_sentences(machine)), medium="page"),
        Text(predictable(machine)),
        Heading("How far the reference is known"),
        *_uncertainty(machine),
        Heading("Model-equivalence check"),
        Note(_EQUIVALENCE),
        table(_EQUIVALENCE_COLUMNS, [run for run in runs if run.equality], _EQUIVALENCE_CAPTION, "page"),
        Heading("Agreement with the reference"),
        _agreement(machine, runs),
        *partings(machine, runs),
        Note(_COLUMNS),
        *(_pairs(pairs) if pairs else ()),
        *plots.figures(comparison, machine),
        doc.Fold(
            "Every metric of every run, with tolerances and their reasons",
            tuple(table(_METRIC_COLUMNS, run.metrics, run.label) for run in runs),
        ),
    ]


def _reference_sentences(machine: Machine) -> Iterator[str]:
    if machine.launch_time is None:
        yield "The reference does not launch."
    else:
        yield f"The reference launches at {machine.launch_time:.9f} s with {machine.launch_speed:.7f} m/s."
    yield f"Compared from the start to {machine.compared_to:.6g} s."
    if machine.needs:
        yield f"Tolerances asked for: {', '.join(f'{name} {text}' for name, text in machine.needs.items())}."
    if machine.impacts:
        yield f"The reference has {machine.impacts} impact{'s' if machine.impacts > 1 else ''}, which take energy."
    for name, time in machine.release_times.items():
        if time is not None:
            stop = machine.mechanism.stop(name)
            start = f"{machine.start_torques[name]:.6f} {stop.force_unit}"
            yield f"The {name} opens at {time:.9f} s; its {stop.effort} at the start is {start}."


def _uncertainty(machine: Machine) -> tuple[Block, ...]:
    certificate = load_certificate(machine.mechanism)
    if certificate is None:
        known = (f"{format_number(v)} in {k}" for k, v in machine.reference_uncertainty.items() if k in _KNOWN)
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
    return page_only(certified_figures(figures, "Certified values")), Note(text)


def _check(run: Run, kind: str) -> Cell:
    """The worst of a kind of checks; a dash where the engine does not expose it."""
    checks = [check for check in run.equality.checks if check.name == kind] if run.equality else []
    if not checks:
        return Cell("–")
    return Cell(format_number(_largest(check.value for check in checks)), mark_of(all(check.holds for check in checks)))


def _equal(equality: Equality) -> Cell:
    mark: Mark = "good" if equality.exposed else "warning"
    if not equality.exposed:
        return Cell("not checked", mark)
    text = equality.note or ("equivalent" if equality.holds else "another model")
    return Cell(text, mark if equality.holds else "bad")


_EQUIVALENCE_CAPTION = "Largest relative differences of the built models to the reference's equations"
_EQUIVALENCE_COLUMNS = (
    Column("engine", of=lambda run: run.label),
    *(Column(kind, of=partial(_check, kind=kind)) for kind in _CHECKS),
    Column("states", of=lambda run: run.equality.states),
    Column("verdict", of=lambda run: _equal(run.equality)),
)


def _agreement(machine: Machine, runs: Iterable[Run]) -> Table:
    heads = (
        *differences(machine),
        Column("wall", "s", of=lambda run: "–" if run.wall_time is None else f"{run.wall_time:.2f}", rank=6),
        Column("steps", of=lambda run: run.steps, medium="page"),
        Column("verdict", of=verdict_cell, wrap=False, rank=0),
    )
    launch = "no launch"
    if machine.launch_time is not None and machine.launch_speed is not None:
        launch = f"launch {machine.launch_time:.4f} s, {machine.launch_speed:.3f} m/s"
    return table(heads, runs, f"{machine.model}: largest differences to the reference ({launch})")


def verdict_cell(run: Run) -> Cell:
    """The outcome, with how many of the judged quantities hold."""
    judged, held = len(run.judged), len(run.judged) - len(run.broken)
    counts = f" {held}/{judged}" if run.outcome in COMPARED else ""
    return Cell(f"{run.outcome.value}{counts}", _MARKS[run.outcome])


def _pairs(pairs: Sequence[Pair]) -> tuple[Block, ...]:
    tuned = [pair for pair in pairs if pair.first.endswith("tuned") and pair.second.endswith("tuned")]
    every = table(_PAIR_COLUMNS, pairs, "Engine against engine, all pairs")
    return (
        Heading("Engine against engine"),
        _matrix(pairs),
        doc.Fold("With release times and launch speeds", (every,)),
        table(_PAIR_COLUMNS, tuned, "engine against engine (tuned; the report has all)", "terminal"),
    )


_PAIR_COLUMNS = (
    Column("first", of=lambda pair: pair.first),
    Column("second", of=lambda pair: pair.second, rank=0),
    Column("position", "m", of=lambda pair: format_number(pair.position_max)),
    Column("release", "s", of=lambda pair: format_number(pair.release_time_max)),
    Column("speed", "m/s", of=lambda pair: format_number(_largest([pair.launch_speed]))),
)


def _matrix(pairs: Sequence[Pair]) -> Table:
    """Distances above the diagonal."""
    distances = {(pair.first, pair.second): format_number(pair.position_max) for pair in pairs}
    labels = list(dict.fromkeys([*(first for first, _ in distances), *(second for _, second in distances)]))
    rows = [(first, *(distances.get((first, second), "") for second in labels[1:])) for first in labels[:-1]]
    return table(["engine", *labels[1:]], rows, "Largest distance between the two positions of a marker [m]", "page")


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
    Column("stated by", of=lambda metric: metric.source or ("" if metric.observed else "not observed")),
    Column("reason", of=lambda metric: metric.reason or _unjudged_reason(metric)),
)
