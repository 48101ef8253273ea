"""The page of error budgets, each with its bar chart."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ...explain import (
    Budget,
    ExplainedMachine,
    Explanation,
    Figures,
    PresetComparison,
    QuantityBudget,
)
from .. import document as doc
from ..document import format_number, format_percent
from ..plots import Axis, Label, Panels, Plot, Series, Style
from .tables import chapter, compared_time, provenance, verdict_blocks

_FEW = 1e-3  # shares below this are left out in the terminal; the page's tables have them all
_COLOUR = Style("#3d7ab5")
_ROW, _FRAME = 26, 60  # [pixels] of height
_INTRODUCTION = (
    "Each engine's distance from the reference, split among its causes. Nothing is assigned by "
    "guess: a cause's share is what changes when that cause is taken out of the run, or made "
    "larger by a known factor."
)
_HOW_TO_READ = (
    "An error is a function of time, from the start to the end of what is compared; that of the "
    "position is of the marker with the largest error (without markers, of such a centre of mass). "
    "A cause's share is its part of that function; its percentage is signed (the projection on the "
    "whole error), so that causes that work against each other show it, and all of them with the "
    "unexplained rest add up to 100 %. Causes interact: where two have to come together to do "
    "harm, taking out either removes the same error. So all are taken out one after the other, "
    "once in the order of the table and once in the reverse order; the share is the mean of both "
    "(for causes that interact in pairs, Shapley's value), and the whiskers are half their "
    "difference. (Softness of constraints that is as small as the step allows is measured by a "
    "shorter step and, in place of the reverse order, by doubling it.) A wide whisker says: this "
    "and another cause share that error. “After” names causes that have to be out first, because "
    "taking this one out alone would bring in an error the run does not have. What is explained is "
    "1 - |rest| / |error|, root mean square over time; roundoff, which is random, is taken off the "
    "rest in quadrature."
)
_CHANGES = (
    "Two presets at the step of the first; one option changed at a time, from the first towards "
    "the second and back. Largest distance of any marker, largest error of a stop's torque at any "
    "sample, largest error of a release time, wall time (median of up to three). Factors are "
    "against the preset the line starts from (the second: against the first): ÷ smaller, × larger."
)


def document(explanation: Explanation) -> doc.Document:
    """Budgets; a terminal has them in short, what options buy, what failed, the verdict."""
    line = verdict(explanation)
    first_verdict, last_verdict = verdict_blocks(line, "strong")
    blocks: list[doc.Block] = [
        first_verdict,
        doc.Fold("How to read it", (doc.Note(_INTRODUCTION), doc.Note(_HOW_TO_READ))),
    ]
    for model, message in explanation.failures.items():
        blocks.append(doc.Text(message, "bad", lead=f"{model}:"))
    for machine in explanation.machines:
        blocks += _chapter(explanation, machine)
    runs = ((b.model, b.label, b.engine_version, b.settings) for b in explanation.budgets)
    blocks += [*provenance(explanation, runs, explanation.machines), last_verdict]
    title = "Where the errors come from"
    return doc.Document(title, tuple(blocks), "trebucheck explain", verdict=line)


def verdict(explanation: Explanation) -> str:
    """One line: how much of the errors is accounted for at worst."""
    explained = [
        (quantity.explained, f"{quantity.name}, {budget.model} {budget.label}")
        for budget in explanation.budgets
        for quantity in main_quantities(budget)
        if quantity.explained is not None
    ]
    failed = sum(budget.message is not None for budget in explanation.budgets)
    lost = f" {failed} run{'s' if failed != 1 else ''} failed." if failed else ""
    if not explained:
        return f"Nothing to explain.{lost}"
    least, where = min(explained)
    return f"{_explained(least)} or more of every error shown is explained (least: {where}).{lost}"


def main_quantities(budget: Budget) -> list[QuantityBudget]:
    """Position and stop torques: functions of time in which an error can be seen to grow."""
    kinds = (" torque", " force")
    quantities = (q for q in budget.quantities if q.rms > 0)
    return [q for q in quantities if q.name == "position" or q.name.endswith(kinds)]


def _explained(fraction: float | None) -> str:
    """Tell how much of the error the causes account for; never rounded up to the whole."""
    if fraction is None:
        return "–"
    if fraction > 0.999:
        return "over 99.9 %"
    return f"{math.floor(1000 * max(0.0, fraction)) / 10:.1f} %"


def _chapter(explanation: Explanation, machine: ExplainedMachine) -> Iterator[doc.Block]:
    """A machine's budgets: in short for the terminal, each on the page; what options buy."""
    budgets = [budget for budget in explanation.budgets if budget.model == machine.model]
    rows: list[tuple[str, ...]] = []
    failures: list[doc.Text] = []
    for budget in budgets:
        name, label = f"{machine.model}, {budget.label}", budget.label
        for q in main_quantities(budget):
            # Shares worth a word, the largest first.
            shares = [(share.fraction or 0.0, share.cause) for share in q.shares]
            shares.sort(key=lambda share: -abs(share[0]))
            worth = [f"{c} {format_percent(f)}" for f, c in shares if abs(f) >= _FEW]
            rms, explained = f"{format_number(q.rms)} {q.unit}", _explained(q.explained)
            rows.append((label, q.name, rms, explained, ", ".join(worth)))
            label = ""
        if budget.message:
            failures.append(doc.Text(budget.message, "warning", lead=f"{name}:"))
        for cause in budget.causes:
            if cause.message:
                text = f"not measured: {cause.message}"
                failures.append(doc.Text(text, "warning", lead=f"{name}, {cause.name}:"))
    yield chapter(machine.model)
    yield doc.Note(compared_time(machine.launch_time, machine.compared_to, machine.judged_to))
    heads = doc.columns("engine | error of | rms | explained | causes")
    ranked = doc.ranked(heads, error_of=0, explained=2, causes=0)
    yield doc.table(ranked, rows, f"{machine.model}: where the errors come from", "terminal")
    for budget in budgets:
        yield from _budget(budget)
    yield doc.Heading("Each preset beside the next: what every option buys")
    yield doc.Note(_CHANGES)
    yield from (_changes(each) for each in explanation.comparisons if each.model == machine.model)
    yield doc.Listing(tuple(failures), medium="terminal")


def _budget(budget: Budget) -> Iterator[doc.Block]:
    """One engine's budget on the page."""
    quantities, step = main_quantities(budget), budget.settings.get("timestep")
    yield doc.Heading(f"{budget.label}{_at(step if isinstance(step, int | float) else None)}")
    if budget.message:
        yield doc.Text(f"No budget: {budget.message}", "warning", medium="page")
        return
    if quantities:
        largest: list[str] = []
        for q in quantities:
            point = f" of {budget.point}" if q.name == "position" and budget.point else ""
            error = f"largest error {format_number(q.largest)} {q.unit}"
            largest.append(f"{q.name}{point}: {_explained(q.explained)} explained, {error}")
        yield doc.Note(f"{'; '.join(largest)}.")
        yield doc.Figure(_bars(quantities), columns=2)
    else:
        yield doc.Note("No error to explain.")
    for cause in budget.causes:
        if cause.message:
            text = f"{cause.name} could not be measured and counts as unexplained: {cause.message}"
            yield doc.Text(text, "warning", medium="page")
    if quantities:
        tables = [_measurements(budget, quantities)]
        others = [q for q in budget.quantities if q.rms > 0 and q not in quantities]
        if others:
            # Single values, all of which have the same causes.
            heads = [f"{q.name}: {format_number(q.rms)} {q.unit}" for q in others]
            rows: list[tuple[str, ...]] = []
            for shares in zip(*((*q.shares, q.rest) for q in others), strict=True):
                rows.append((shares[0].cause, *(format_percent(s.fraction) for s in shares)))
            tables.append(doc.table(["share of the error in", *heads], rows, "Other quantities"))
        yield doc.Fold("What was done to measure each cause, and the results", tuple(tables))


def _at(step: float | None) -> str:
    return f", step {step:g} s" if step else ""


def _bars(quantities: Sequence[QuantityBudget]) -> Panels:
    """Signed share of each cause in the errors of position and torques; unexplained last.

    Shares add up to 100 %; whiskers are half the difference of a share's two measures.
    """
    plots: list[Plot] = []
    for quantity in quantities:
        shares = [*quantity.shares, quantity.rest]
        values = np.array([100.0 * (share.fraction or 0.0) for share in shares])
        bands = np.array([100.0 * share.interaction / quantity.rms for share in shares])
        bands[bands < 1.0] = 0.0  # whiskers narrower than a bar's edge say nothing
        rows = np.arange(len(shares), dtype=float)
        # Texts stand to the right of bar and whisker, also of a negative one: to its left are the
        # causes' names. The rest is a norm first: it is all but orthogonal to the error.
        ends = np.maximum(values, 0.0) + bands
        labels: list[Label] = []
        for row, end, share in zip(rows, ends, shares, strict=True):
            rms = quantity.rest_rms if share is quantity.rest else share.rms
            size = f"{format_number(rms)} {quantity.unit}"
            text = f" {format_percent(share.fraction)} ({size}) "
            labels.append(Label(end, row, text, beside=True))
        spread = values - bands, values + bands
        bars = Series("share", values, rows, _COLOUR, "bar", spread=spread)
        causes = Axis("", categories=tuple(share.cause for share in shares))
        title = f"{quantity.name}: rms {format_number(quantity.rms)} {quantity.unit}"
        axes, height = (Axis("share of the error", "%"), causes), _FRAME + _ROW * len(shares)
        plots.append(Plot(*axes, (bars,), title, tuple(labels), height=height))
    return tuple(plots)


def _measurements(budget: Budget, quantities: Sequence[QuantityBudget]) -> doc.Table:
    """Tell what was done about each cause, and its share; roundoff, which has none, comes last."""
    heads = [*doc.columns("cause | what was done")]
    for quantity in quantities:
        group = f"{quantity.name} [{quantity.unit}]"
        heads += [doc.Column(t, group=group) for t in ("in order", "in reverse", "share", "rms")]
    rows: list[doc.Row] = []
    noise: list[doc.Row] = []
    for cause in budget.causes:
        cells: list[str] = []
        if cause.name == "roundoff":
            for q in quantities:
                cells += "", "", format_number(q.roundoff), format_number(q.roundoff_left)
            text = f"{cause.explanation}.\n{cause.done}; in the run, and in what is left"
            noise.append(doc.row(cause.name, text, *cells))
        elif not cause.message:
            for q in quantities:
                for share in q.shares:
                    if share.cause == cause.name:
                        fractions = (share.first, share.second, share.fraction)
                        cells += [*map(format_percent, fractions), format_number(share.rms)]
            after = "all others" if cause.name == "readout" else ", ".join(cause.after)
            after = f"; after {after}" if cause.after else ""
            text = f"{cause.explanation}.\n{cause.done}{after}"
            rows.append(doc.row(doc.Cell(cause.name, hint=cause.explanation), text, *cells))
    rest: list[str] = []
    for q in quantities:
        rest += "", "", format_percent(q.rest.fraction), format_number(q.rest_rms)
    text = "what is left of the error when all shares are taken off"
    rows.append(doc.row(doc.Cell("unexplained", "strong"), text, *rest))
    return doc.table(heads, [*rows, *noise], "Shares of the error, and how they were measured")


def _changes(comparison: PresetComparison) -> doc.Table:
    """The presets and each option's change: values with factors; a terminal has one of the two."""
    first, second, changes = comparison.first, comparison.second, comparison.changes
    former, latter = comparison.presets
    force = "force" if comparison.force_unit == "N" else "torque"
    titles = {
        "position": "position [m]",
        "torque": f"{force} [{comparison.force_unit}]",
        "release": "release [s]",
        "wall_time": "wall [s]",
    }
    settings = [first, second]
    for change in changes:
        settings += [change.alone, change.back]
    # Without stops there are no torques and no releases.
    ran = [figures for figures in settings if figures.message is None]
    fields = [
        name for name in titles if not ran or any(getattr(each, name) is not None for each in ran)
    ]
    presets = (
        (former, first, latter, [(each.option, each.second, each.alone) for each in changes]),
        (latter, second, former, [(each.option, each.first, each.back) for each in changes]),
    )
    rows: list[doc.Row] = []
    for preset, figures, other, options in presets:
        cells = _values(fields, figures, first, preset=True)
        rows.append(doc.row(doc.Cell(preset, "strong"), preset, *cells))
        for option, value, changed in options:
            label = f"{preset}, {option} = {_option_value(value)}"
            cells = _values(fields, changed, figures)
            rows.append(doc.row(label, f"  {option} as {other}", *cells))
    heads = doc.columns(" | ".join(["setting", *(titles[field] for field in fields)]))
    media: tuple[doc.Medium, ...] = ("page", "terminal")
    both = [replace(head, medium=medium, wrap=False) for head in heads for medium in media]
    caption = (
        f"{comparison.model}, {comparison.engine}{_at(comparison.timestep)}: what each option buys "
        "(÷ smaller, × larger)"
    )
    return doc.table(both, rows, caption)


def _values(
    fields: Sequence[str], figures: Figures, against: Figures, *, preset: bool = False
) -> Iterator[doc.Cell]:
    """Cells for page and terminal in turn: the value, and how many times smaller it became."""
    if figures.message:
        yield doc.Cell("failed", "warning", detail=figures.message)
        return
    for field in fields:
        value, before, factor = getattr(figures, field), getattr(against, field), ""
        if figures is not against and value and before:
            ratio = before / value
            factor = f"÷ {_digits(ratio)}" if ratio >= 1 else f"× {_digits(1 / ratio)}"
        yield doc.Cell(format_number(value), detail=factor)
        yield doc.Cell(format_number(value) if preset else factor)


def _digits(value: float) -> str:
    if value < 100:
        return f"{value:.2g}"
    return f"{value:.0f}" if value < 1e4 else format_number(value)


def _option_value(value: object) -> str:
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, list):
        return "(" + ", ".join(_option_value(part) for part in value) + ")"
    return str(value)
