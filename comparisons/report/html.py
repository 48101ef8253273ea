"""A document as one HTML file that needs nothing else: no network, no other file."""

from __future__ import annotations

import json
import re
from base64 import b64encode
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from itertools import chain, count
from typing import Any

import numpy as np
from jinja2 import Environment, StrictUndefined, Template
from markupsafe import Markup, escape

from ...models.arrays import FloatArray
from .document import SIGNS, AnimationBlock, Document, Figure, Heading, in_medium
from .drawing import animation
from .plots import Axis, Plot, Series


def page(document: Document) -> str:
    """The whole page as HTML text, scripts and all."""
    state = _Page()
    return _template().render(
        document=document,
        in_medium=in_medium,
        signs=SIGNS,
        asset=_asset,
        animated=_animated,
        animation_assets=animation.assets,
        anchor=state.anchor,
        below=lambda: state.level + 1,
        outline=lambda: state.outline,
        drawn=state.drawn,
        arrays=lambda: Markup(_json(state.arrays)),
        has_plots=lambda: state.has_plots,
    )


@dataclass
class Entry:
    """A heading in the contents, with those below it."""

    text: str
    anchor: str
    parts: list[Entry] = field(default_factory=list["Entry"])


@dataclass(frozen=True)
class LegendEntry:
    """An entry of a legend."""

    name: str
    swatch: Markup


@dataclass(frozen=True)
class Panel:
    """A plot's place on the page, and what it shows in words."""

    title: str
    alt: str
    height: int


@dataclass(frozen=True)
class Drawn:
    """A figure's legend, the places of its plots, and their data."""

    legend: list[LegendEntry]
    panels: list[Panel]
    columns: int
    data: Markup


@dataclass
class _Page:
    """Contents and shared arrays, collected while blocks are rendered."""

    outline: list[Entry] = field(default_factory=list["Entry"])
    arrays: list[str] = field(default_factory=list[str])
    taken: set[str] = field(default_factory=set[str])
    has_plots: bool = False
    level: int = 1
    """Level of the last heading."""
    _index: dict[str, int] = field(default_factory=dict[str, int])

    def anchor(self, heading: Heading) -> str:
        """The heading's anchor, on this page once; chapters and sections come into the contents."""
        stem = (
            heading.anchor or re.sub(r"[^a-z0-9]+", "-", heading.text.lower()).strip("-") or "part"
        )
        names = chain([stem], (f"{stem}-{n}" for n in count(2)))
        anchor = next(name for name in names if name not in self.taken)
        self.taken.add(anchor)
        self.level = heading.level
        if heading.level == 2:
            self.outline.append(Entry(heading.text, anchor))
        elif heading.level == 3 and self.outline:
            self.outline[-1].parts.append(Entry(heading.text, anchor))
        return anchor

    def drawn(self, block: Figure) -> Drawn:
        """A figure's plots, their arrays put among those of the page."""
        panels = block.panels()
        self.has_plots = True
        listed = {series.name: series for plot in panels for series in plot.series if series.listed}
        legend = (
            [LegendEntry(series.name, _swatch(series)) for series in listed.values()]
            if len(listed) > 1
            else []
        )
        places = [
            Panel(plot.title, _alt(block, plot), 0 if plot.equal else plot.height)
            for plot in panels
        ]
        if block.anchor and block.title and self.outline:
            self.outline[-1].parts.append(Entry(block.title, block.anchor))
        columns = block.columns or min(len(panels), 3)
        return Drawn(legend, places, columns, Markup(_json([self._plot(plot) for plot in panels])))

    def _plot(self, plot: Plot) -> dict[str, Any]:
        parts: dict[str, Any] = {
            name: [vars(each) for each in getattr(plot, name)] for name in _PARTS
        }
        series = [self._series(each) for each in plot.series]
        return parts | {
            "x": vars(plot.x), "y": vars(plot.y), "series": series, "equal": plot.equal,
            "height": plot.height,
        }  # fmt: skip

    def _series(self, series: Series) -> dict[str, Any]:
        low, high = (None, None) if series.spread is None else map(self._add, series.spread)
        return {
            "name": series.name, "x": self._add(series.x), "y": self._add(series.y), "low": low,
            "high": high,
            "style": vars(series.style), "mark": series.mark, "hints": series.hints,
        }  # fmt: skip

    def _add(self, values: FloatArray) -> int:
        """Index of an array among those of the page; each is there once, in single precision."""
        text = b64encode(np.asarray(values, dtype="<f4").tobytes()).decode()
        if text not in self._index:
            self._index[text] = len(self.arrays)
            self.arrays.append(text)
        return self._index[text]


_PARTS = ("labels", "rules", "bands")


def _alt(block: Figure, plot: Plot) -> str:
    """A plot in words, for those who do not see it."""
    names = ", ".join(dict.fromkeys(series.name for series in plot.series if series.name))
    title = ", ".join(filter(None, (block.title, plot.title))) or "Plot"
    return f"{title}: {_title(plot.y)} against {_title(plot.x)}; {names}."


def _title(axis: Axis) -> str:
    return (
        f"{axis.title} [{axis.unit}]".strip()
        if axis.unit not in ("", "1")
        else axis.title or "value"
    )


def _swatch(series: Series) -> Markup:
    """A short stretch of a series, as in its plot."""
    style, line = series.style, series.mark in ("line", "both")
    dash = Markup(' stroke-dasharray="4 3"') if style.dashed else ""
    drawn = Markup('<path d="M1 6H29" stroke="{}" stroke-width="{}"{}/>').format(
        style.colour, min(style.width, 4), dash
    )
    return Markup('<svg viewBox="0 0 30 12" aria-hidden="true">{}{}</svg>').format(
        drawn if line else "", "" if series.mark == "line" else _symbol(series)
    )


_SYMBOLS = {
    "circle": "M15 2a4 4 0 1 0 .01 0z",
    "square": "M11 2h8v8h-8z",
    "diamond": "M15 1l5 5-5 5-5-5z",
    "triangle": "M15 1.500l5 8.500h-10z",
    "star": "M15 1l1.500 3.500 4 .3-3 2.600 1 4-3.500-2.200-3.500 2.200 1-4-3-2.600 4-.3z",
    "times": "M11 2l8 8m0-8l-8 8",
}


def _symbol(series: Series) -> Markup:
    style = series.style
    fill = "none" if style.dashed and series.mark != "bar" else style.colour
    shape = _SYMBOLS["square" if series.mark == "bar" else style.symbol]
    return Markup('<path d="{}" fill="{}" stroke="{}"/>').format(shape, fill, style.colour)


def _json(value: object) -> str:
    """JSON that is safe inside a script element."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def _animated(block: AnimationBlock) -> Markup:
    """An animation as HTML that needs the assets of animations on its page."""
    scenes = block.scenes() if callable(block.scenes) else block.scenes
    return animation.Animation(scenes, block.title).fragment(block.anchor)


def _with_code(text: object) -> Markup:
    """Text in which parts between backquotes are code."""
    parts = str(text).split("`")
    if len(parts) % 2 == 0:  # one is left over: they mean something else
        return escape(text)
    marked = (
        Markup("<code>{}</code>").format(part) if k % 2 else escape(part)
        for k, part in enumerate(parts)
    )
    return Markup("").join(marked)


@cache
def _asset(name: str) -> Markup:
    return Markup(files(__package__ or "").joinpath("assets", name).read_text(encoding="utf-8"))


@cache
def _template() -> Template:
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["with_code"] = _with_code
    text = files(__package__ or "").joinpath("templates/page.html.j2").read_text(encoding="utf-8")
    return environment.from_string(text)
