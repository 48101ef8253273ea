"""The page of convergence studies: orders, laws, floors, limits, plots."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ...converge import Curve, LimitPair, MachineStudies, Point, PowerLaw, Studies, SweepStudy
from .. import document as doc
from ..numbers import format_number, format_settings
from ..plots import Axis, Label, Panels, Plot, Series, Style, run_style
from .tables import capital, chapter, compared_time, is_tuned, provenance

_WHOLE = Style("#8a8f96")


def convergence(studies: Sequence[SweepStudy]) -> Panels:
    """Error against the time step, position and torque, with the fitted lines and their slopes."""
    plots: list[Plot] = []
    for column, curve in enumerate(studies[0].curves):
        series: list[Series] = []
        labels: list[Label] = []
        for k, study in enumerate(studies, 1):
            series += [*_points(study, column, study.label), *_line(study, column)]
            # Lines may all but cover each other; their slopes, each at another place, do not.
            labels += _slope(study, column, k / (len(studies) + 1))
        steps = Axis("time step", "s", logarithmic=True)
        plots.append(Plot(steps, _error(curve), tuple(series), labels=tuple(labels), height=430))
    return tuple(plots)


def swept_parameter(study: SweepStudy) -> Panels:
    """Error against one parameter, and the part that the parameter makes where it is isolated."""
    plots: list[Plot] = []
    for column, curve in enumerate(study.curves):
        series = [*_points(study, column, "whole error", whole=True)] if study.own else []
        series += _points(study, column, "part of the parameter" if study.own else "error")
        series += _line(study, column)
        values, labels = Axis(study.title, study.unit, logarithmic=True), _slope(study, column, 0.5)
        plots.append(Plot(values, _error(curve), tuple(series), labels=tuple(labels)))
    return tuple(plots)


def work_precision(studies: Sequence[SweepStudy]) -> Panels:
    """Error against the median wall time; bars from the quickest to the slowest repeat."""
    times = Axis("wall time, warm", "s", logarithmic=True)
    return tuple(
        Plot(times, _error(curve), tuple(_timed(s, s.curves[i]) for s in studies), height=400)
        for i, curve in enumerate(studies[0].curves)
    )


def _timed(study: SweepStudy, curve: Curve) -> Series:
    timed = [point for point in study.points if point.wall_times]
    x = np.array([np.median(point.wall_times) for point in timed], dtype=float)
    y = np.array([point.error(curve.quantity) or np.nan for point in timed], dtype=float)
    quickest = np.array([min(point.wall_times) for point in timed], dtype=float)
    slowest = np.array([max(point.wall_times) for point in timed], dtype=float)
    hints = tuple(f"{study.title} = {point.value:.3g}" for point in timed)
    style = run_style(study.engine, study.preset)
    return Series(study.label, x, y, style, "both", hints, (quickest, slowest))


def exponent(law: PowerLaw | None) -> str:
    """Exponent and half width of its confidence interval."""
    return "none" if law is None else f"{law.exponent:.3f} ± {law.half_width:.3f}"


def _error(curve: Curve) -> Axis:
    stop = "stop force" if curve.unit == "N" else "stop torque"
    name = "position" if curve.quantity == "position" else stop
    return Axis(f"largest error, {name}", curve.unit, logarithmic=True)


def _points(study: SweepStudy, column: int, name: str, *, whole: bool = False) -> Iterator[Series]:
    """The errors, or the parameter's part of them where it is isolated."""
    own, quantity = study.own and not whole, study.curves[column].quantity
    found = [(point.value, point.error(quantity, own)) for point in study.points]
    ran = np.array([(value, error) for value, error in found if error is not None], dtype=float)
    if len(ran):
        style = _WHOLE if whole else run_style(study.engine, study.preset)
        yield Series(name, ran[:, 0], ran[:, 1], style, "points")


def _line(study: SweepStudy, column: int) -> Iterator[Series]:
    """The law."""
    law = study.curves[column].law
    if law is not None:
        ends = np.array([law.high, law.low]), np.array([law.at(law.high), law.at(law.low)])
        style = replace(run_style(study.engine, study.preset), width=1.2)
        yield Series(f"slope {law.exponent:.3f}", *ends, style, listed=False)


def _slope(study: SweepStudy, column: int, at: float) -> Iterator[Label]:
    """The law's exponent, at that share of its range."""
    law = study.curves[column].law
    if law is not None:
        x = law.low ** (1 - at) * law.high**at
        yield Label(x, law.at(x), exponent(law), run_style(study.engine, study.preset).colour)


_INTRODUCTION = (
    "Each parameter of each engine is swept through its values; the errors are the largest "
    "distances of any marker (without markers, of any centre of mass) from the reference over the "
    "compared time. An exponent is the slope of a straight line in the log-log plane with its 95 % "
    "confidence interval (Student t), over the run of points along which the error changes most "
    "without its slope departing by more than 0.1; the rule knows of no expected exponent. A floor "
    "is an error that the parameter does not lower; its cause is found by refining every other "
    "parameter by one step there. “Stock” is what an engine's documentation leads a newcomer to, "
    "“tuned” the most accurate settings found."
)
_LIMITS = (
    "Largest distance between the same markers of two runs over the compared time, with the time "
    "step extrapolated away [m]. The limits are chosen without the reference: of all three "
    "neighbouring steps whose successive differences show a whole order, those whose limits from "
    "two and three levels lie nearest to each other."
)
_WORK = (
    "Error against wall time of the whole simulation, warm: median of the repeats, bars from the "
    "quickest to the slowest."
)
_OTHERS = (
    "Where the error of the swept parameter itself can be isolated, exponents are of that part: "
    "the distance from the run without it. “What is left” is then the error of that run."
)


def document(studies: Studies) -> doc.Document:
    """All studies; a terminal has the orders, laws and limits of positions, and what failed."""
    failures = tuple(doc.Text(sentence, "warning") for sentence in _failures(studies))
    blocks: list[doc.Block] = []
    if failures:
        title = f"What did not run ({len(failures)})"
        blocks.append(doc.Fold(title, (doc.Listing(failures),), opened=len(failures) <= 5))
    for machine in studies.machines:
        blocks += _chapter(machine)
    runs = [
        (machine.model, f"{study.label}, {study.knob}", study.engine_version, study.settings)
        for machine in studies.machines
        for study in machine.studies
    ]
    mechanisms = [(machine.model, machine.mechanism) for machine in studies.machines]
    blocks += [
        doc.Heading("How it is measured", 2),
        doc.Note(_INTRODUCTION),
        *provenance(studies, runs, mechanisms),
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


def _chapter(machine: MachineStudies) -> Iterator[doc.Block]:
    steps = [study for study in machine.studies if study.knob == "timestep"]
    others = [study for study in machine.studies if study.knob != "timestep"]
    known = " and ".join(
        f"{format_number(value)} {'m' if name == 'position' else machine.mechanism.force_unit}"
        for name, value in machine.uncertainty.items()
    )
    yield chapter(machine.model)
    compared = compared_time(machine.launch_time, machine.compared_to, machine.judged_to)
    source = machine.uncertainty_source
    yield doc.Note(f"{compared} The reference is known to {known} (by {source}).")
    if steps:
        yield doc.Heading("Order in the time step")
        yield _orders(machine, steps)
        drawn, anchor = partial(convergence, steps), f"{machine.model}-order"
        yield doc.Figure(drawn, "Error against the time step", anchor=anchor)
        yield doc.Fold("How each floor's cause was found", (_floors(steps),))
    if machine.pairs:
        yield from _limits(machine)
    if steps:
        drawn, anchor = partial(work_precision, steps), f"{machine.model}-work-precision"
        yield doc.Figure(drawn, "Error against wall time", _WORK, anchor)
    if others:
        yield doc.Heading("Other swept parameters")
        yield doc.Note(_OTHERS)
        yield _laws(machine, others)
    for study in others:
        drawn, title = partial(swept_parameter, study), f"{study.label}: {study.title}"
        yield doc.Figure(drawn, title, _about(study))
    yield doc.Fold("Every point", tuple(map(_point_table, machine.studies)))


def _orders(machine: MachineStudies, studies: Sequence[SweepStudy]) -> doc.Table:
    heads = (
        "engine | (quantity) | (expected) | order | range [s] | floor | set by | "
        "limit to reference | (its own error [m]) | (finest level [s])"
    )
    rows = (
        _curve_row(study, curve, [study.label], *_limit(machine, study, curve))
        for study in studies
        for curve in study.curves
    )
    caption = f"{machine.model}: order of the position's error in the time step, 95 % confidence"
    return doc.table(doc.ranked(doc.columns(heads), range=2, order=0), rows, caption)


def _curve_row(study: SweepStudy, curve: Curve, names: Iterable[str], *end: str) -> doc.Row:
    """Row of a quantity; only the position's has the study's names, and is shown in a terminal."""
    position = curve.quantity == "position"
    first = (name if position else "" for name in names)
    return doc.row(
        *first, curve.quantity, *_law(study, curve), *end, medium="any" if position else "page"
    )


def _law(study: SweepStudy, curve: Curve) -> tuple[str | doc.Cell, ...]:
    """Expected and found exponent, the range of the law, the floor and its cause."""
    expected = "–"
    if study.expected is not None and curve.quantity == "position":
        expected = f"{study.expected:g}"
    law, floor = curve.law, curve.floor
    span = "" if law is None else f"{format_number(law.high)} to {format_number(law.low)}"
    if floor is None:
        return expected, exponent(law), span, "not reached", ""
    cause = doc.Cell(floor.cause, hint=floor.evidence)
    return expected, exponent(law), span, f"{format_number(floor.error)} {curve.unit}", cause


def _limit(machine: MachineStudies, study: SweepStudy, curve: Curve) -> tuple[str, str, str]:
    """Distance of Richardson's limit from the reference, its own error, its finest step."""
    limit = machine.limit(study.label)
    if limit is not None and curve.quantity == "position":
        distance = f"{format_number(limit.position)} {curve.unit}"
        return distance, format_number(limit.estimate), format_number(limit.levels[-1])
    if limit is None or limit.torque is None:
        return "none", "", ""
    return f"{format_number(limit.torque)} {curve.unit}", "", ""


def _floors(studies: Sequence[SweepStudy]) -> doc.Table:
    measured = "measured there: share of the error that is left"
    heads = f"engine | quantity | floor | at [s] | cause | {measured}"
    rows: list[tuple[object, ...]] = []
    for study in studies:
        for curve in study.curves:
            if curve.floor is not None:
                found = curve.floor
                floor, at = f"{format_number(found.error)} {curve.unit}", format_number(found.value)
                rows.append((study.label, curve.quantity, floor, at, found.cause, found.evidence))
    return doc.table(heads, rows, "Floors and their causes")


def _limits(machine: MachineStudies) -> Iterator[doc.Block]:
    tuned = [pair for pair in machine.pairs if is_tuned(pair.first) and is_tuned(pair.second)]
    rows = [
        doc.row(limit.label, "reference", format_number(limit.position), medium="page")
        for limit in machine.limits
        if limit.preset == "tuned"
    ]
    rows += map(_pair_row, tuned)
    heads = doc.ranked(doc.columns("first | second | position [m]"), second=0, position=0)
    yield doc.Heading("Limits against each other")
    yield doc.Note(_LIMITS)
    yield doc.table(heads, rows, f"{machine.model}: Richardson limits against each other")
    if len(machine.pairs) > len(tuned):
        every = doc.table(heads, map(_pair_row, machine.pairs), "All pairs")
        yield doc.Fold("All pairs, stock presets among them", (every,))


def _pair_row(pair: LimitPair) -> doc.Row:
    return doc.row(pair.first, pair.second, format_number(pair.position))


def _laws(machine: MachineStudies, studies: Sequence[SweepStudy]) -> doc.Table:
    parameter = doc.Column("parameter", medium="terminal", wrap=False, rank=0)
    laws = doc.columns("(quantity) | expected | exponent | range | what is left | set by")
    rows = (
        _curve_row(study, curve, [study.label, study.title, _swept(study)])
        for study in studies
        for curve in study.curves
    )
    caption = f"{machine.model}: other swept parameters, exponent of the position's error"
    heads = (*doc.columns("engine | (swept parameter)"), parameter, *laws)
    return doc.table(doc.ranked(heads, range=2, expected=2, exponent=0), rows, caption)


def _swept(study: SweepStudy) -> str:
    """Name of the swept parameter; the sweeps of integrators go by theirs."""
    return str(study.base[study.knob]) if study.knob in study.base else study.knob


def _about(study: SweepStudy) -> str:
    """Why a parameter is swept, at which other options, and what is left."""
    sentences = [f"{capital(study.why)}."]
    if study.base:
        sentences.append(f"At {format_settings(study.base)}.")
    for curve in study.curves:
        if curve.floor is not None:
            left = f"{format_number(curve.floor.error)} {curve.unit} is left"
            cause = f"{curve.floor.cause} ({curve.floor.evidence})"
            sentences.append(f"{curve.quantity.capitalize()}: {left}; cause: {cause}.")
    return " ".join(sentences)


def _point_table(study: SweepStudy) -> doc.Table:
    whole = [f"{curve.quantity} [{curve.unit}]" for curve in study.curves]
    own = [f"of the parameter [{curve.unit}]" for curve in study.curves if study.own]
    setting = f"{study.title} [{study.unit}]"
    heads = " | ".join([setting, "options", *whole, *own, "steps", "wall [s]"])
    rows = [_point(study, point) for point in study.points]
    return doc.table(heads, rows, f"{study.label}: {study.title}", "page")


def _point(study: SweepStudy, point: Point) -> tuple[object, ...]:
    setting = f"{point.value:.5g}", format_settings(point.options)
    if point.message is not None:
        return *setting, doc.Cell(point.message, "warning")
    parts = (False, True) if study.own else (False,)
    errors = (point.error(curve.quantity, own) for own in parts for curve in study.curves)
    return *setting, *map(format_number, errors), point.steps, _wall(point)


def _wall(point: Point) -> str:
    """Median wall time, and from the quickest to the slowest where there are more [s]."""
    times = point.wall_times
    if not times:
        return "–"
    text = f"{np.median(times):.3f}"
    return text if len(times) == 1 else f"{text} ({min(times):.3f} to {max(times):.3f})"
