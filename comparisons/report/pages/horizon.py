"""Page of a horizon: until when a start of some bits determines a motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ....models.arrays import FloatArray
from ...horizon import Growth, Horizon
from .. import document as doc
from ..plots import Axis, Plot, Series, Style, distinct_colours


def document(found: Horizon) -> doc.Document:
    """Digits with their times, and the growth."""
    asked = "the launch" if found.until is None else f"{found.until:.6g} s"
    parts = f"angles in rad, slides in parts of {found.length:.6g} m"
    caption = (
        f"Digit k is known while all motions are within half of 10^-k of one value ({parts}), and "
        "lost when two of them are more than 10^-k apart. Both are proved; what is between the two "
        "times is open."
    )
    blocks: list[doc.Block] = [table_of([found], caption)]
    blocks.append(doc.Note(f"All motions are enclosed to {found.end:.6g} s of {asked}."))
    for why, what in ((found.ended, "They end there"), (found.unlinear, "No linear estimate")):
        if why:
            blocks.append(doc.Note(f"{what}: {why.rstrip('.')}."))
    blocks.append(doc.Note(f"Took {found.processor_time:.2g} s of processor time."))
    if found.growth:
        growth = (
            "How far any motion is from one of them at most, proved; how far two of them are from "
            "what is between them, proved (dashed); the derivative by the start times its radius "
            "(symbols)."
        )
        blocks.append(doc.Figure((plot([found]),), "How far motions come apart", growth, "growth"))
    title = f"{found.model}: what a start of {found.start_bits} bits determines"
    window, command = f"trebucheck prove: {found.model}", found.command or ""
    return doc.Document(title, tuple(blocks), window, command, verdict=found.headline())


def table_of(found: Sequence[Horizon], caption: str = "") -> doc.Block:
    """Times by bits of the start and digits."""
    rows: list[tuple[str, ...]] = []
    for each in found:
        for known in each.known:
            lost = "not found" if known.lost is None else f"{known.lost:.4g} s"
            until = f"{known.until:.4g} s"
            rows.append((f"{each.start_bits}", f"{known.digits}", until, lost))
    heads = ("bits of the start", "digits", "known until", "lost at")
    return doc.table(heads, rows, caption)


def plot(found: Sequence[Horizon], title: str = "") -> Plot:
    """Bounds and linear estimates over time, a colour for each number of bits."""
    series: list[Series] = []
    for each, colour in zip(found, distinct_colours(), strict=False):
        name = f"{each.start_bits} bits"
        curves = (
            Series(name, *_curve(each.growth), Style(colour)),
            Series(name, *_curve(each.parted), Style(colour, dashed=True), listed=False),
            Series(name, *_curve(each.linear), Style(colour), "points", listed=False),
        )
        series += [curve for curve in curves if len(curve.x)]
    axis = Axis("distance from one motion", "rad", logarithmic=True)
    return Plot(Axis("t", "s"), axis, tuple(series), title)


def _curve(points: Sequence[Growth]) -> tuple[FloatArray, FloatArray]:
    """Times and radii."""
    return np.array([each.t for each in points]), np.array([each.radius for each in points])
