"""A comparison as a document."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from ...models.machines.trebuchet import parameters_of
from ...reference.certification.certificate import load_certificate
from ..report.document import (
    Block,
    Cell,
    Column,
    Document,
    Fold,
    Heading,
    Listing,
    Mark,
    Medium,
    Note,
    Table,
    Text,
    columns,
    page_only,
    table,
    terminal_only,
)  # fmt: skip
from ..report.numbers import format_number, format_step
from ..report.sections import certified_figures, provenance
from ..runs.results import Cause, Equality, Machine, Metric, Outcome, Pair, Results, Run
from . import plots
from .study import Comparison

_CERTIFIED = ("release_time", "launch_time", "launch_speed", "launch_angle", "range", "stop_torque", "total_energy")
_OUTCOMES: dict[Outcome, tuple[str, Mark]] = {
    Outcome.OK: ("ok", "good"),
    Outcome.BROKEN: ("broken", "bad"),
    Outcome.UNEQUAL: ("unequal", "bad"),
    Outcome.FAILED: ("failed", "bad"),
    Outcome.ABSENT: ("absent", "warning"),
    Outcome.UNSUPPORTED: ("cannot", "warning"),
}
"""In a word, for the terminal, and how good it is."""
_CHECKS = (
    "total mass", "start", "centre of mass", "stop position", "mass matrix", "force", "acceleration", "stop torque",
)  # fmt: skip
"""Kinds of checks of model equivalence, in the order of the table."""

_INTRODUCTION = (
    "Each engine builds the same mechanism from its own primitives. Differences are the largest up to the launch "
    "(velocity of the projectile at 45 degrees), the reference taken at the engine's own sample times. Values marked ✓ "
    "hold a stated tolerance, values marked ✗ break one; the others are reported without a tolerance. “Stock” is what "
    "an engine's documentation leads a newcomer to, “tuned” the most accurate settings found."
)
_EQUIVALENCE = (
    "Before any motion, each engine's built model is compared with the reference's equations in random states under "
    "every set of closed stops. Each value is the largest relative difference of its kind; a dash stands for what the "
    "engine does not expose. A run whose model differs is not compared."
)
_QUANTITIES = (
    "Largest distance of projectile and counterweight; largest error of a release time; error of launch time and "
    "speed; largest error of a stop's torque at any sample; largest error of a joint's force, of that force's largest "
    "value; energy drift, of the total energy."
)


@dataclass(frozen=True)
class Quantity:
    """A quantity of the agreement table: the largest of the metrics of one name."""

    title: str
    unit: str
    metric: str
    subject: str | None = None
    short: str = ""
    """Title in a terminal; '' leaves the column out there."""

    @property
    def column(self) -> Column:
        """Its column."""
        return Column(self.title, self.unit, short=self.short, medium="any" if self.short else "page")

    def metrics(self, run: Run) -> list[Metric]:
        """Those it stands for."""
        return [m for m in run.metrics if m.name == self.metric and self.subject in (None, m.subject)]

    def value(self, run: Run) -> float | None:
        """The largest; None if one is missing, or the run has none."""
        values = [None if m.value is None else abs(m.value) for m in self.metrics(run)]
        return None if None in values else max((value for value in values if value is not None), default=None)

    def cell(self, run: Run) -> Cell:
        """The value, with its unit where that is not the column's, marked by its tolerances."""
        metrics, value = self.metrics(run), self.value(run)
        if not metrics:
            return Cell("")
        other = "" if value is None else "".join({f" {m.unit}" for m in metrics} - {f" {self.unit}"})
        verdicts = {m.holds for m in metrics} - {None}
        return Cell(format_number(value) + other, "plain" if not verdicts else "good" if all(verdicts) else "bad")


QUANTITIES = (
    Quantity("projectile", "m", "position_max", "projectile", short="position"),
    Quantity("counterweight", "m", "position_max", "counterweight"),
    Quantity("release", "s", "release_time", short="release"),
    Quantity("launch time", "s", "launch_time"),
    Quantity("launch speed", "m/s", "launch_speed", short="speed"),
    Quantity("stop torque", "N m", "stop_torque_max", short="torque"),
    Quantity("joint force", "1", "joint_reaction_relative"),
    Quantity("energy", "1", "energy_drift", short="energy"),
)


def document(comparison: Comparison) -> Document:
    """The whole of it; the terminal has the tables in short, what broke, and the verdict at its end."""
    results = comparison.results
    findings = Listing(tuple(_findings(results)))
    verdict_text = Text(verdict(results), "good" if results.passed else "bad")
    blocks: list[Block] = [
        Note("How far can you trust a multibody engine, and why does it differ?"),
        page_only(verdict_text),
        page_only(findings),
        Note(_INTRODUCTION),
    ]
    for machine in results.machines:
        blocks += _chapter(comparison, machine)
    runs = ((run.model, run.label, run.engine_version, run.settings) for run in results.runs)
    end = provenance(results, runs, [(machine.model, machine.mechanism) for machine in results.machines])
    blocks += [*end, terminal_only(findings), terminal_only(Text(verdict(results)))]
    return Document("trebucheck", tuple(blocks), "trebucheck report")


def verdict(results: Results) -> str:
    """One line: what was compared and whether it holds."""
    ran = [run for run in results.runs if run.outcome in (Outcome.OK, Outcome.BROKEN)]
    judged = [metric for run in ran for metric in run.metrics if metric.holds is not None]
    broken = [metric for metric in judged if not metric.holds]
    checks = [run.equality for run in results.runs if run.equality is not None and run.equality.exposed]
    counts = (
        f"{sum(check.holds for check in checks)} of {len(checks)} built models equal, "
        f"{len(ran)} of {len(results.runs)} runs compared, {len(judged)} tolerances checked, {len(broken)} broken"
    )
    return f"{'Agreement holds' if results.passed else 'Agreement does not hold'}: {counts}."


def _findings(results: Results) -> Iterator[Text]:
    """What broke or did not run, and why."""
    for run in results.runs:
        name = f"{run.model}, {run.label}"
        for sentence in complaints(run):
            yield Text(sentence, "bad", lead=f"{name}:")
        if run.message:
            yield Text(f"{run.outcome.value}: {run.message}", _OUTCOMES[run.outcome][1], lead=f"{name}:")
        for sentence in diagnosis(run):
            yield Text(sentence, "strong", lead=f"{name}, why:")


def complaints(run: Run) -> list[str]:
    """One sentence for each tolerance that does not hold."""
    return [
        f"{m.label}: {m.note or f'{format_number(m.value)} {m.unit}'}, "
        f"tolerance {format_number(m.tolerance)} {m.unit} ({m.reason})"
        for m in run.broken
    ]


def diagnosis(run: Run) -> list[str]:
    """When the run begins to differ from the reference and why, in sentences; none for a run that agrees."""
    found = run.diagnosis
    if found is None:
        return []
    holding = ", ".join(found.holding) or "no stop"
    when = (
        "before any motion"
        if found.parts_at is None
        else f"from t = {found.parts_at:.6g} s, while {holding} held in the reference"
    )
    likely = "; ".join(_suspicion(cause) for cause in found.causes[:3]) or "no suspect accounts for it"
    return [f"differs from the reference {when}, first in {found.leads}. Likeliest: {likely}."]


def _suspicion(cause: Cause) -> str:
    """A suspect: what, how much of it, and how much of the deviation that accounts for."""
    amount = f" ({cause.amount})" if cause.amount else ""
    return f"{cause.name}{amount}: {100 * cause.explained:.1f} % of it"


def _chapter(comparison: Comparison, machine: Machine) -> list[Block]:
    runs = [run for run in comparison.results.runs if run.model == machine.model]
    pairs = [pair for pair in comparison.results.pairs if pair.model == machine.model]
    return [
        Heading(f"{machine.model.capitalize()} machine", 2, machine.model),
        page_only(Text(" ".join(_reference_sentences(machine)))),
        Heading("How far the reference is known"),
        *_uncertainty(machine),
        Heading("Model-equivalence check"),
        Note(_EQUIVALENCE),
        _equivalence(runs),
        Heading("Agreement with the reference"),
        _agreement(machine, runs),
        Note(_QUANTITIES),
        *(_pairs(pairs) if pairs else ()),
        *plots.figures(comparison, machine),
        Fold("Every metric of every run, with tolerances and their reasons", tuple(map(_metrics, runs))),
    ]


def _reference_sentences(machine: Machine) -> Iterator[str]:
    if machine.launch_time is None:
        yield "The reference does not launch."
    else:
        yield f"The reference launches at {machine.launch_time:.9f} s with {machine.launch_speed:.7f} m/s."
    yield f"Compared from the start to {machine.compared_to:.6g} s."
    if machine.launch_time is not None and machine.compared_to > machine.launch_time * 1.000001:
        yield (
            "That is beyond the launch, where trajectories diverge exponentially whatever the cause: no tolerance is "
            "put on them there."
        )
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
        known = (f"{format_number(v)} in {k}" for k, v in machine.reference_uncertainty.items() if "(" not in k)
        return (
            Note(
                "This machine has no certificate (`trebucheck certify` makes one). By a second integration at a "
                f"coarser tolerance the reference is known to {', '.join(known)} (SI units)."
            ),
        )
    figures = [f for f in certificate.figures if f.name in _CERTIFIED and f.time is None]
    paper = "" if parameters_of(machine.mechanism) is None else " and the paper's own equations"
    text = (
        f"From the certificate of exactly this machine: minimal and redundant coordinates{paper}, DOP853 over a ladder "
        "of tolerances and Taylor series in double and extended precision. A tolerance finer than ten times the "
        "reference's uncertainty is refused."
    )
    return page_only(certified_figures(figures, "Certified values")), Note(text)


def _equivalence(runs: Sequence[Run]) -> Table:
    rows = [
        (run.label, *(_check(run.equality, kind) for kind in _CHECKS), run.equality.states, _equal(run.equality))
        for run in runs
        if run.equality is not None
    ]
    caption = "Largest relative differences of the built models to the reference's equations"
    return table(["engine", *_CHECKS, "states", "verdict"], rows, caption, "page")


def _check(equality: Equality, kind: str) -> Cell:
    """The worst of a kind of checks; a dash where the engine does not expose it."""
    checks = [check for check in equality.checks if check.name == kind]
    if not checks:
        return Cell("–")
    values = [check.value for check in checks]
    worst = None if None in values else max(value for value in values if value is not None)
    return Cell(format_number(worst), "good" if all(check.holds for check in checks) else "bad")


def _equal(equality: Equality) -> Cell:
    mark: Mark = "bad" if not equality.holds else "good" if equality.exposed else "warning"
    return Cell(equality.note or ("equivalent" if equality.holds else "another model"), mark)


def _agreement(machine: Machine, runs: Sequence[Run]) -> Table:
    quantities = (quantity.column for quantity in QUANTITIES)
    end = (*columns("wall [s] | (steps) | (outcome)"), Column("", medium="terminal"))
    heads = (*columns("engine | step [s]"), *quantities, *end)
    launch = (
        "no launch"
        if machine.launch_time is None or machine.launch_speed is None
        else f"launch {machine.launch_time:.4f} s, {machine.launch_speed:.3f} m/s"
    )
    caption = f"{machine.model}: largest differences to the reference ({launch})"
    return table(heads, map(_agreement_row, runs), caption)


def _agreement_row(run: Run) -> tuple[object, ...]:
    short, mark = _OUTCOMES[run.outcome]
    wall = "–" if run.wall_time is None else f"{run.wall_time:.2f}"
    outcome = Cell(run.outcome.value, mark), Cell(short, mark)
    return *difference_row(run), wall, run.steps, *outcome


def difference_row(run: Run) -> tuple[str | Cell, ...]:
    """Engine, step and the quantities of a run."""
    return run.label, format_step(run.settings.get("timestep")), *(quantity.cell(run) for quantity in QUANTITIES)


def _pairs(pairs: Sequence[Pair]) -> tuple[Block, ...]:
    tuned = [pair for pair in pairs if pair.first.endswith("tuned") and pair.second.endswith("tuned")]
    return (
        Heading("Engine against engine"),
        _matrix(pairs),
        Fold("With release times and launch speeds", (_pair_table(pairs, "Engine against engine, all pairs", "any"),)),
        _pair_table(tuned, "engine against engine (tuned; the report has all)", "terminal"),
    )


def _pair_table(pairs: Iterable[Pair], caption: str, medium: Medium) -> Table:
    rows = (
        (
            pair.first,
            pair.second,
            format_number(pair.position_max),
            format_number(pair.release_time_max),
            format_number(None if pair.launch_speed is None else abs(pair.launch_speed)),
        )
        for pair in pairs
    )
    return table("first | second | position [m] | release [s] | speed [m/s]", rows, caption, medium)


def _matrix(pairs: Sequence[Pair]) -> Table:
    """Distances above the diagonal."""
    distances = {(pair.first, pair.second): pair.position_max for pair in pairs}
    labels = list(dict.fromkeys([*(first for first, _ in distances), *(second for _, second in distances)]))
    rows = [
        (row, *(format_number(distances[row, other]) if (row, other) in distances else "" for other in labels[1:]))
        for row in labels[:-1]
    ]
    caption = "Largest distance between the two projectiles [m]"
    return table(["engine", *labels[1:]], rows, caption, "page")


def _metrics(run: Run) -> Table:
    return table("metric | value | unit | tolerance | reason", map(_metric_row, run.metrics), run.label)


def _metric_row(metric: Metric) -> tuple[object, ...]:
    mark: Mark = "plain" if metric.holds is None else "good" if metric.holds else "bad"
    text = (metric.note or "–") if metric.value is None else f"{metric.value:.6e}"
    reason = metric.reason or (metric.note if metric.value is not None else None) or ""
    return metric.label, Cell(text, mark), metric.unit, format_number(metric.tolerance), reason
