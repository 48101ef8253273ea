"""Page of a horizon: until when a start of some bits determines a motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...horizon import Horizon
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
        name = f"{each.start_bits} bits"  # once in the legend, of one colour
        for points, style in (
            (each.growth, "line"),
            (each.parted, "dashed"),
            (each.linear, "points"),
        ):
            if points:
                t, radius = np.array([(point.t, point.radius) for point in points]).T
                look, mark = Style(colour, style == "dashed"), "line"
                if style == "points":
                    mark = "points"
                series.append(Series(name, t, radius, look, mark))
    axis = Axis("distance from one motion", "rad", logarithmic=True)
    return Plot(Axis("t", "s"), axis, tuple(series), title)
