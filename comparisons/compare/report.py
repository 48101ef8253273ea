"""A comparison as a document."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial

from ...engines.supplied import sentence
from ...models.machines.trebuchet import parameters_of
from ...models.problem import StopLaw
from ...reference.certification.certificate import load_certificate
from ..report import document as doc
from ..report.document import (
    Block,
    Cell,
    Column,
    Document,
    Heading,
    Mark,
    Note,
    Table,
    Text,
    Tile,
    mark_of,
    page_only,
    table,
    without_empty_columns,
)
from ..report.numbers import format_number
from ..report.sections import certified_figures, partings, predictable, provenance
from ..runs.results import FAILURES, Equality, Machine, Metric, Outcome, Pair, Results, Run
from . import plots
from .agreement import agreement, largest, metrics_anchor, overview, ranking
from .sentences import differing, findings, verdict
from .study import Comparison

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
        *([plots.motion(comparison)] if results.machines else []),
        overview(results),
    ]
    if any(run.wall_time for run in results.ran):
        blocks.append(plots.work_precision(results.machines, results.runs))
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
        tuple(Text(sentence(given), lead=f"{label}:") for label, given in sorted(stated.items()))
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
        plots.figures(comparison, machine),
    ]


def _evidence(comparison: Comparison, machine: Machine) -> list[Block]:
    """What stands behind the machine's verdicts, folded away."""
    runs = [run for run in comparison.results.runs if run.model == machine.model]
    pairs = [pair for pair in comparison.results.pairs if pair.model == machine.model]
    return [
        Heading(
            f"{machine.model.capitalize()} machine: the evidence",
            2,
            plots.anchor(machine.model, "evidence"),
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
            anchor=plots.anchor(machine.model, "equivalence"),
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
