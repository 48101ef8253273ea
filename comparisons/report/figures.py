"""Plots of pages as pictures by Matplotlib, for papers, notebooks and the README."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ...models.errors import InputError
from .document import Block, Document, Fold, Grid
from .document import Figure as Plots
from .plots import INK, Axis, Panels, Plot, Series

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SYMBOLS = {
    "circle": "o",
    "square": "s",
    "diamond": "D",
    "triangle": "^",
    "star": "*",
    "times": "x",
}
_WIDTH, _HEIGHT = 4.2, 3.2  # of one plot [inches]
FORMATS = ("svg", "png", "pdf")


def figures_of(document: Document) -> dict[str, Plots]:
    """All figures of a report, those of folds too, by their anchors or else titles."""
    named: dict[str, Plots] = {}
    for block in _figures(document.blocks):
        name = block.anchor or re.sub(r"\W+", "-", block.title.lower()).strip("-") or "figure"
        named[name if name not in named else f"{name}-{len(named) + 1}"] = block
    return named


def _figures(blocks: Iterable[Block]) -> Iterator[Plots]:
    for block in blocks:
        if isinstance(block, Plots):
            yield block
        elif isinstance(block, Grid | Fold):
            yield from _figures(block.blocks)


def picture(panels: Panels, columns: int = 3, title: str = "") -> Figure:
    """Plots beside each other under one legend.

    Args:
        panels: the plots.
        columns: plots in a row, at most.
        title: above all of them.
    """
    from matplotlib.figure import Figure  # without pyplot: no window, no global state

    columns = min(columns, len(panels))
    rows = math.ceil(len(panels) / columns)
    figure = Figure((columns * _WIDTH, rows * _HEIGHT + 0.6), layout="constrained")
    axes: Sequence[Axes] = np.atleast_1d(figure.subplots(rows, columns)).ravel().tolist()
    for plot, on in zip(panels, axes, strict=False):
        _draw(plot, on)
    for empty in axes[len(panels) :]:
        empty.set_visible(False)
    handles = {
        name: line
        for on in axes
        for line, name in zip(*on.get_legend_handles_labels(), strict=True)
    }
    if len(handles) > 1:
        figure.legend(
            handles.values(),
            handles.keys(),
            loc="outside lower center",
            ncols=4,
            frameon=False,
            fontsize=8,
        )
    if title:
        figure.suptitle(title)
    return figure


def write_picture(figure: Figure, path: str | Path) -> None:
    """Write a picture in the format that its name ends with; the same data give the same bytes.

    Raises:
        InputError: the format is not one of `FORMATS`, or the folder cannot be written to.
    """
    import io

    import matplotlib as mpl

    from ...models.files import write_bytes

    kind = Path(path).suffix.removeprefix(".").lower()
    if kind not in FORMATS:
        raise InputError(
            f"picture {str(path)!r} must end with one of "
            f"{', '.join(f'.{each}' for each in FORMATS)}."
        )
    out = io.BytesIO()
    dates: dict[str, Any] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}, "png": {}}
    with mpl.rc_context({"svg.hashsalt": "trebucheck", "svg.fonttype": "none"}):
        figure.savefig(out, format=kind, dpi=200, metadata=dates[kind])
    write_bytes(Path(path), out.getvalue())


def _draw(plot: Plot, on: Axes) -> None:
    bars = [series for series in plot.series if series.mark == "bar"]
    for series in plot.series:
        if series.mark == "bar":
            _bar(plot, series, bars.index(series), len(bars), on)
        else:
            _series(series, on)
    for rule in plot.rules:
        line = on.axvline if rule.across == "x" else on.axhline
        line(rule.at, color=rule.colour or "#8a97a5", linewidth=0.8, linestyle=":")
    for band in plot.bands:
        on.axvspan(band.start, band.end, color=band.colour, alpha=0.15, linewidth=0)
    for label in plot.labels:
        side: dict[str, Any] = (
            {"ha": "left", "va": "center"} if label.beside else {"ha": "center", "va": "bottom"}
        )
        on.annotate(label.text, (label.x, label.y), (4, 2), fontsize=7, color=_ink(label.colour),
                    textcoords="offset points", **side)  # fmt: skip
    _axes(plot, on)


def _axes(plot: Plot, on: Axes) -> None:
    on.set_title(plot.title, fontsize=9)
    _axis(plot.x, on, "x")
    _axis(plot.y, on, "y")
    on.tick_params(labelsize=8)
    on.grid(visible=True, alpha=0.25, linewidth=0.5)
    if plot.equal:
        on.set_aspect("equal", adjustable="datalim")
    if plot.y.categories:
        on.invert_yaxis()


def _axis(axis: Axis, on: Axes, which: Literal["x", "y"]) -> None:
    title = f"{axis.title} [{axis.unit}]".strip() if axis.unit not in ("", "1") else axis.title
    if axis.logarithmic:
        (on.set_xscale if which == "x" else on.set_yscale)("log", nonpositive="mask")
    if axis.categories:
        ticks = on.set_xticks if which == "x" else on.set_yticks
        ticks(range(len(axis.categories)), axis.categories)
    (on.set_xlabel if which == "x" else on.set_ylabel)(title, fontsize=8)


def _series(series: Series, on: Axes) -> None:
    style, colour = series.style, _ink(series.style.colour)
    points = series.mark in ("points", "both")
    look: dict[str, Any] = {
        "color": colour, "label": series.name if series.listed else None,
        "linestyle": "none" if series.mark == "points" else ("--" if style.dashed else "-"),
        "linewidth": style.width * 0.75,
        "alpha": 0.4 if style.colour == INK and not style.dashed else 1.0,
        "marker": _SYMBOLS[style.symbol] if points else "", "markersize": 4.5,
        "markerfacecolor": "white" if style.dashed else colour,
    }  # fmt: skip
    if series.spread is None:
        on.plot(series.x, series.y, **look)
    else:
        low, high = series.spread
        on.errorbar(
            series.x, series.y, xerr=(series.x - low, high - series.x), elinewidth=0.8, **look
        )


def _bar(plot: Plot, series: Series, number: int, of: int, on: Axes) -> None:
    width = 0.8 / of
    shift = -0.4 + (number + 0.5) * width
    look: dict[str, Any] = {
        "color": _ink(series.style.colour),
        "label": series.name if series.listed else None,
    }
    if plot.y.categories:
        spread = (
            None
            if series.spread is None
            else (series.x - series.spread[0], series.spread[1] - series.x)
        )
        on.barh(series.y + shift, series.x, width, xerr=spread, **look)
    else:
        on.bar(series.x + shift, series.y, width, **look)


def _ink(colour: str) -> str:
    return "#1d2733" if colour == INK else colour
