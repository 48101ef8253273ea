"""Page of an audit: how far a model file's simulation is off, until when, and what would do."""

from __future__ import annotations

import numpy as np

from ...audit import SHARE, Audit, AuditedRun
from .. import document as doc
from ..plots import Axis, Plot, Series, Style, distinct_colours


def document(found: Audit) -> doc.Document:
    """Errors of the file as it is given, a table of other options, and the cheapest that do."""
    blocks: list[doc.Block] = [doc.Text(f"{found.headline()}."), _facts(found)]
    if found.errors:
        rows = [(f"{each.t:.4g} s", f"{each.error:.2g} m") for each in found.errors]
        blocks.append(doc.Heading("As given: largest distance of any point up to a time"))
        blocks.append(doc.table(("up to", "off by, as given"), rows))
    blocks += [_runs(found), _advice(found)]
    if found.curve:
        plot = _plot(found)
        caption = "Distance of the farthest point at each time; dashed: 1 % of the motion's size."
        blocks.append(doc.Figure((plot,), "Error over time, as given", caption, "error"))
    blocks += [doc.Note(f"Left out: {what}.") for what in found.left_out]
    blocks.append(doc.Note(f"Made with {found.machine_text}."))
    title = f"{found.model}: how far is this simulation from the mechanics?"
    window, command = f"trebucheck audit: {found.model}", found.command or ""
    return doc.Document(title, tuple(blocks), window, command, verdict=found.headline())


def _facts(found: Audit) -> doc.Block:
    points = ", ".join(found.points[:6]) + (", ..." if len(found.points) > 6 else "")
    compared = f"{found.compared_to:.4g} s"
    if found.ended:
        compared += f" of {found.asked:.4g} s: {found.ended}"
    rows = (
        ("file", found.source),
        ("mechanism", found.mechanism.headline()),
        ("compared to", compared),
        ("points", points),
        ("size of the motion", f"{found.size:.4g} m"),
    )
    return doc.table(("what was read", ""), rows)


def _runs(found: Audit) -> doc.Block:
    rows = [_row(run) for run in found.runs]
    caption = (
        "The file with other integrators and steps, all else as given; the processor time is that "
        "of the engine's steps up to the end of what is compared."
    )
    heads = "integrator", "step [s]", "off by [m]", "leaves 1 % at [s]", "processor time [s]"
    return doc.table((*heads, "remark"), rows, caption)


def _row(run: AuditedRun) -> tuple[object, ...]:
    if run.error is None:
        return run.integrator, f"{run.timestep:g}", "–", "–", "–", run.message or ""
    leaves = "never" if run.leaves is None else f"{run.leaves:.3g}"
    time = f"{run.processor_time:.2g}"
    mark = "as given" if run.is_given else ""
    return run.integrator, f"{run.timestep:g}", f"{run.error:.2g}", leaves, time, mark


def _advice(found: Audit) -> doc.Block:
    if found.cheapest is None:
        return doc.Text(f"None of these holds {found.accuracy:.2g} m.")
    title = f"The cheapest of these that hold {found.accuracy:.2g} m"
    if found.is_longest:
        title += "; no longer step was tried"
    return doc.Code(title, found.cheapest)


def _plot(found: Audit) -> Plot:
    t = np.array([each.t for each in found.curve])
    off = np.array([each.error for each in found.curve])
    colour = next(distinct_colours())
    positive = off > 0
    series = (
        Series("as given", t[positive], off[positive], Style(colour)),
        Series(
            "1 % of the size",
            t[[0, -1]],
            np.full(2, SHARE * found.size),
            Style(colour, dashed=True),
        ),
    )
    axis = Axis("distance from the reference", "m", logarithmic=True)
    return Plot(Axis("t", "s"), axis, series)
