"""The page of convergence studies: orders, laws, floors, limits, plots."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ....engines.presets import ASSISTED
from ...converge import Curve, MachineStudies, PowerLaw, Studies, SweepStudy
from .. import document as doc
from ..document import format_number, format_settings
from ..plots import Axis, Label, Panels, Plot, Series, Style, run_style
from . import work
from .tables import (
    PRESETS_EXPLAINED,
    Settings,
    both_assisted,
    capital,
    chapter,
    compared_time,
    provenance,
)
from .work import WorkLine

_WHOLE = Style("#8a8f96")
_INTRODUCTION = (
    "Each parameter of each engine is swept through its values; the errors are the largest "
    "distances of any marker (without markers, of any centre of mass) from the reference over the "
    "compared time. An exponent is the slope of a straight line in the log-log plane with its 95 % "
    "confidence interval (Student t), over the run of points along which the error changes most "
    "without its slope departing by more than 0.1; the rule knows of no expected exponent. A floor "
    "is an error that the parameter does not lower; its cause is found by refining every other "
    "parameter by one step there. " + PRESETS_EXPLAINED
)
_LIMITS = (
    "Largest distance between the same markers of two runs over the compared time, with the time "
    "step extrapolated away [m]. The limits are chosen without the reference: of all three "
    "neighbouring steps whose successive differences show a whole order, those whose limits from "
    "two and three levels lie nearest to each other."
)
_OTHERS = (
    "Where the error of the swept parameter itself can be isolated, exponents are of that part: "
    "the distance from the run without it. “What is left” is then the error of that run."
)


def document(studies: Studies) -> doc.Document:
    """Studies; a terminal has the orders, laws and limits of positions, and what failed."""
    failures = tuple(doc.Text(sentence, "warning") for sentence in _failures(studies))
    blocks: list[doc.Block] = []
    if failures:
        title = f"What did not run ({len(failures)})"
        blocks.append(doc.Fold(title, (doc.Listing(failures),), opened=len(failures) <= 5))
    for machine in studies.machines:
        blocks += _chapter(machine, studies.machine_text)
    runs: list[Settings] = []
    for machine in studies.machines:
        for study in machine.studies:
            name = f"{study.label}, {study.knob}"
            runs.append((machine.model, name, study.engine_version, study.settings))
    blocks += [
        doc.Heading("How it is measured", 2),
        doc.Note(_INTRODUCTION),
        *provenance(studies, runs, studies.machines),
        doc.Listing(failures, medium="terminal"),
    ]
    models = ", ".join(machine.model for machine in studies.machines) or "no machine"
    verdict = f"{len(runs)} sweeps of {models}; {len(failures)} things did not run"
    title = "How fast does each engine's error fall with its settings?"
    return doc.Document(title, tuple(blocks), "trebucheck converge", verdict=verdict)


def _failures(studies: Studies) -> Iterator[str]:
    """Sentences on machines that failed, engines that are not installed, and failed points."""
    for model, message in studies.failures.items():
        yield f"{model}: {message}"
    for name in dict.fromkeys(name for machine in studies.machines for name in machine.absent):
        yield f"{name} is not installed here."
    for machine in studies.machines:
        for study in machine.studies:
            unit = "" if study.unit == "1" else f" {study.unit}"
            for point in study.points:
                if point.message is not None:
                    setting = f"{study.title} = {point.value:.3g}{unit}"
                    yield f"{machine.model}, {study.label}, {setting}: {point.message}"


# --- Plots


def _convergence(studies: Sequence[SweepStudy]) -> Panels:
    """Error against the time step, position and torque, with the fitted lines and their slopes."""
    plots: list[Plot] = []
    for column, curve in enumerate(studies[0].curves):
        series: list[Series] = []
        labels: list[Label] = []
        for k, study in enumerate(studies, 1):
            # Lines may all but cover each other; their slopes, each at another place, do not.
            at = k / (len(studies) + 1)
            drawn, slopes = _measured(study, column, study.label, at)
            series += drawn
            labels += slopes
        steps = Axis("time step", "s", logarithmic=True)
        plots.append(Plot(steps, _error(curve), tuple(series), labels=tuple(labels), height=430))
    return tuple(plots)


def _swept_parameter(study: SweepStudy) -> Panels:
    """Error against one parameter, and the part that the parameter makes where it is isolated."""
    plots: list[Plot] = []
    for column, curve in enumerate(study.curves):
        series: list[Series] = []
        name = "error"
        if study.own:
            name = "part of the parameter"
            series += _points(study, column, "whole error", _WHOLE, part=False)
        drawn, slopes = _measured(study, column, name, 0.5)
        values = Axis(study.title, study.unit, logarithmic=True)
        plots.append(Plot(values, _error(curve), (*series, *drawn), labels=tuple(slopes)))
    return tuple(plots)


def _work_lines(studies: Sequence[SweepStudy]) -> Iterator[WorkLine]:
    """Each sweep of the time step, as work and errors."""
    for study in studies:
        runs = [point.work for point in study.points if point.work is not None]
        yield WorkLine(study.engine, study.preset, study.engine_version, tuple(runs))


def _exponent(law: PowerLaw | None) -> str:
    """Exponent and half width of its confidence interval."""
    return "none" if law is None else f"{law.exponent:.3f} ± {law.half_width:.3f}"


def _error(curve: Curve) -> Axis:
    stop = "stop force" if curve.unit == "N" else "stop torque"
    name = "position" if curve.quantity == "position" else stop
    return Axis(f"largest error, {name}", curve.unit, logarithmic=True)


def _points(
    study: SweepStudy, column: int, name: str, style: Style, *, part: bool
) -> Iterator[Series]:
    """The errors, or the parameter's part of them."""
    quantity = study.curves[column].quantity
    errors = [(point.value, point.error(quantity, part)) for point in study.points]
    ran = np.array([(value, error) for value, error in errors if error is not None], dtype=float)
    if len(ran):
        yield Series(name, ran[:, 0], ran[:, 1], style, "points")


def _measured(
    study: SweepStudy, column: int, name: str, at: float
) -> tuple[list[Series], list[Label]]:
    """The errors, their law as a line, and its exponent at that share of the law's range."""
    law, style = study.curves[column].law, run_style(study.engine, study.preset)
    series, labels = [*_points(study, column, name, style, part=study.own)], list[Label]()
    if law is not None:
        ends = np.array([law.high, law.low]), np.array([law.at(law.high), law.at(law.low)])
        thin = replace(style, width=1.2)
        series.append(Series(f"slope {law.exponent:.3f}", *ends, thin, listed=False))
        x = law.low ** (1 - at) * law.high**at
        labels.append(Label(x, law.at(x), _exponent(law), style.colour))
    return series, labels


# --- Chapters


def _chapter(machine: MachineStudies, made: str) -> Iterator[doc.Block]:
    model = machine.model
    steps = [study for study in machine.studies if study.knob == "timestep"]
    others = [study for study in machine.studies if study.knob != "timestep"]
    known = " and ".join(
        f"{format_number(value)} {'m' if name == 'position' else machine.mechanism.force_unit}"
        for name, value in machine.uncertainty.items()
    )
    yield chapter(model)
    compared = compared_time(machine.launch_time, machine.compared_to, machine.judged_to)
    source = machine.uncertainty_source
    yield doc.Note(f"{compared} The reference is known to {known} (by {source}).")
    if steps:
        yield doc.Heading("Order in the time step")
        yield _orders(machine, steps)
        drawn, title = partial(_convergence, steps), "Error against the time step"
        yield doc.Figure(drawn, title, anchor=f"{model}-order")
        yield doc.Fold("How each floor's cause was found", (_floors(steps),))
    if machine.pairs:
        yield from _limits(machine)
    lines = [*_work_lines(steps)]
    if work.has_errors(lines):
        drawn = partial(work.panels, lines, machine.units)
        yield work.figure(drawn, work.caption(lines, made), f"{model}-work-precision")
    if others:
        yield doc.Heading("Other swept parameters")
        yield doc.Note(_OTHERS)
        yield _laws(machine, others)
    for study in others:
        # Why the parameter is swept, at which other options, and what is left.
        sentences = [f"{capital(study.why)}."]
        if study.base:
            sentences.append(f"At {format_settings(study.base)}.")
        for curve in study.curves:
            if curve.floor is not None:
                left = f"{format_number(curve.floor.error)} {curve.unit} is left"
                cause = f"{curve.floor.cause} ({curve.floor.evidence})"
                sentences.append(f"{curve.quantity.capitalize()}: {left}; cause: {cause}.")
        drawn, title = partial(_swept_parameter, study), f"{study.label}: {study.title}"
        yield doc.Figure(drawn, title, " ".join(sentences))
    yield doc.Fold("Every point", tuple(map(_point_table, machine.studies)))


def _orders(machine: MachineStudies, studies: Sequence[SweepStudy]) -> doc.Table:
    """Orders in the time step, with the distance of Richardson's limit from the reference."""
    heads = (
        "engine | (quantity) | (expected) | order | range [s] | floor | set by | "
        "limit to reference | (its own error [m]) | (finest level [s])"
    )
    rows: list[doc.Row] = []
    for study in studies:
        limit = machine.limit(study.label)
        for curve in study.curves:
            end = "none", "", ""
            if limit is not None and curve.quantity == "position":
                distance = f"{format_number(limit.position)} {curve.unit}"
                end = distance, format_number(limit.estimate), format_number(limit.levels[-1])
            elif limit is not None and limit.torque is not None:
                end = f"{format_number(limit.torque)} {curve.unit}", "", ""
            rows.append(_curve_row(study, curve, [study.label], *end))
    caption = f"{machine.model}: order of the position's error in the time step, 95 % confidence"
    return doc.table(doc.ranked(doc.columns(heads), range=2, order=0), rows, caption)


def _laws(machine: MachineStudies, studies: Sequence[SweepStudy]) -> doc.Table:
    parameter = doc.Column("parameter", medium="terminal", wrap=False, rank=0)
    laws = doc.columns("(quantity) | expected | exponent | range | what is left | set by")
    rows: list[doc.Row] = []
    for study in studies:
        # Sweeps of integrators go by their names.
        swept = str(study.base.get(study.knob, study.knob))
        names = [study.label, study.title, swept]
        rows += [_curve_row(study, curve, names) for curve in study.curves]
    caption = f"{machine.model}: other swept parameters, exponent of the position's error"
    heads = (*doc.columns("engine | (swept parameter)"), parameter, *laws)
    return doc.table(doc.ranked(heads, range=2, expected=2, exponent=0), rows, caption)


def _curve_row(study: SweepStudy, curve: Curve, names: Sequence[str], *end: str) -> doc.Row:
    """Row of a quantity: expected and measured exponent, its range, the floor and its cause.

    Only the position's has the study's names, and is shown in a terminal.
    """
    position = curve.quantity == "position"
    expected, span, left = "–", "", ("not reached", doc.Cell(""))
    if study.expected is not None and position:
        expected = f"{study.expected:g}"
    if curve.law is not None:
        span = f"{format_number(curve.law.high)} to {format_number(curve.law.low)}"
    if curve.floor is not None:
        cause = doc.Cell(curve.floor.cause, hint=curve.floor.evidence)
        left = f"{format_number(curve.floor.error)} {curve.unit}", cause
    law = (curve.quantity, expected, _exponent(curve.law), span, *left)
    if position:
        return doc.row(*names, *law, *end)
    return doc.row(*[""] * len(names), *law, *end, medium="page")


def _floors(studies: Sequence[SweepStudy]) -> doc.Table:
    measured = "measured there: share of the error that is left"
    heads = f"engine | quantity | floor | at [s] | cause | {measured}"
    rows: list[tuple[object, ...]] = []
    for study in studies:
        for curve in study.curves:
            floor = curve.floor
            if floor is not None:
                error, at = f"{format_number(floor.error)} {curve.unit}", format_number(floor.value)
                rows.append((study.label, curve.quantity, error, at, floor.cause, floor.evidence))
    return doc.table(heads, rows, "Floors and their causes")


def _limits(machine: MachineStudies) -> Iterator[doc.Block]:
    short: list[doc.Row] = []
    for limit in machine.limits:
        if limit.preset == ASSISTED:
            position = format_number(limit.position)
            short.append(doc.row(limit.label, "reference", position, medium="page"))
    every: list[doc.Row] = []
    others = False
    for pair in machine.pairs:
        every.append(doc.row(pair.first, pair.second, format_number(pair.position)))
        if both_assisted(pair.first, pair.second):
            short.append(every[-1])
        else:
            others = True
    heads = doc.ranked(doc.columns("first | second | position [m]"), second=0, position=0)
    yield doc.Heading("Limits against each other")
    yield doc.Note(_LIMITS)
    yield doc.table(heads, short, f"{machine.model}: Richardson limits against each other")
    if others:
        shown = doc.table(heads, every, "All pairs")
        yield doc.Fold("All pairs, other presets among them", (shown,))


def _point_table(study: SweepStudy) -> doc.Table:
    """Errors, steps and wall time [s] of every point: the median, from the quickest to slowest."""
    whole = [f"{curve.quantity} [{curve.unit}]" for curve in study.curves]
    own = [f"of the parameter [{curve.unit}]" for curve in study.curves if study.own]
    setting = f"{study.title} [{study.unit}]"
    heads = " | ".join([setting, "options", *whole, *own, "steps", "wall [s]"])
    parts = (False, True) if study.own else (False,)
    rows: list[tuple[object, ...]] = []
    for point in study.points:
        setting = f"{point.value:.5g}", format_settings(point.options)
        if point.message is not None:
            rows.append((*setting, doc.Cell(point.message, "warning")))
            continue
        errors = (point.error(curve.quantity, part) for part in parts for curve in study.curves)
        times, wall = point.wall_times, "–"
        if times:
            wall = f"{np.median(times):.3f}"
        if len(times) > 1:
            wall += f" ({min(times):.3f} to {max(times):.3f})"
        rows.append((*setting, *map(format_number, errors), point.steps, wall))
    return doc.table(heads, rows, f"{study.label}: {study.title}", "page")
