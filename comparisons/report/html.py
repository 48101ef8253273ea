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
from markupsafe import Markup, escape

from ...models.arrays import FloatArray
from .document import SIGNS, AnimationBlock, Document, Figure, Heading, in_medium
from .drawing import animation
from .plots import Plot, Series

_SYMBOLS = {
    "circle": "M15 2a4 4 0 1 0 .01 0z",
    "square": "M11 2h8v8h-8z",
    "diamond": "M15 1l5 5-5 5-5-5z",
    "triangle": "M15 1.500l5 8.500h-10z",
    "star": "M15 1l1.500 3.500 4 .3-3 2.600 1 4-3.500-2.200-3.500 2.200 1-4-3-2.600 4-.3z",
    "times": "M11 2l8 8m0-8l-8 8",
}


def page(document: Document) -> str:
    """The whole page as HTML text, scripts and all."""
    state = _Page()
    return animation.template(__package__ or "", "templates/page.html.j2").render(
        document=document,
        in_medium=in_medium,
        signs=SIGNS,
        asset=_asset,
        with_code=_with_code,
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
class _Page:
    """Contents and shared arrays, collected while blocks are rendered."""

    outline: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])
    """Chapters: text, anchor, and parts, which are such entries."""
    arrays: list[str] = field(default_factory=list[str])
    taken: set[str] = field(default_factory=set[str])
    has_plots: bool = False
    level: int = 1  # level of the last heading
    _index: dict[str, int] = field(default_factory=dict[str, int])

    def _list(self, level: int, text: str, anchor: str) -> None:
        """Add a chapter (level 2) or a section (3) to the contents."""
        entry: dict[str, Any] = {"text": text, "anchor": anchor, "parts": []}
        if level == 2:
            self.outline.append(entry)
        elif level == 3 and self.outline:
            self.outline[-1]["parts"].append(entry)

    def anchor(self, heading: Heading) -> str:
        """The heading's anchor, on this page once; chapters and sections come into the contents."""
        text = re.sub(r"[^a-z0-9]+", "-", heading.text.lower()).strip("-")
        stem = heading.anchor or text or "part"
        names = chain([stem], (f"{stem}-{n}" for n in count(2)))
        anchor = next(name for name in names if name not in self.taken)
        self.taken.add(anchor)
        self.level = heading.level
        self._list(heading.level, heading.text, anchor)
        return anchor

    def drawn(self, block: Figure) -> dict[str, Any]:
        """A figure's legend, the places of its plots, and their data.

        Arrays are put among those of the page.
        """
        panels = block.panels()
        self.has_plots = True
        if block.anchor and block.title:
            self._list(3, block.title, block.anchor)
        listed: dict[str, Series] = {}
        places: list[dict[str, Any]] = []
        for plot in panels:
            listed |= {series.name: series for series in plot.series if series.listed}
            # The plot in words, for those who do not see it.
            title = ", ".join(filter(None, (block.title, plot.title))) or "Plot"
            y, x = plot.y.heading or "value", plot.x.heading or "value"
            names = ", ".join(dict.fromkeys(series.name for series in plot.series if series.name))
            alt, height = f"{title}: {y} against {x}; {names}.", 0 if plot.equal else plot.height
            places.append({"title": plot.title, "alt": alt, "height": height})
        entries = [{"name": name, "swatch": _swatch(series)} for name, series in listed.items()]
        return {
            "legend": entries if len(entries) > 1 else [],
            "panels": places,
            "columns": block.columns or min(len(panels), 3),
            "data": Markup(_json([self._plot(plot) for plot in panels])),
        }

    def _plot(self, plot: Plot) -> dict[str, Any]:
        """A plot as the script reads it; arrays are indices among those of the page."""
        data: dict[str, Any] = {
            name: [vars(part) for part in getattr(plot, name)]
            for name in ("labels", "rules", "bands")
        }
        data |= {"x": vars(plot.x), "y": vars(plot.y), "series": []}
        for series in plot.series:
            low, high = (None, None) if series.spread is None else map(self._add, series.spread)
            data["series"].append({
                "name": series.name, "x": self._add(series.x), "y": self._add(series.y),
                "low": low, "high": high, "style": vars(series.style), "mark": series.mark,
                "hints": series.hints,
            })  # fmt: skip
        return data | {"equal": plot.equal, "height": plot.height}

    def _add(self, values: FloatArray) -> int:
        """Index of an array among those of the page; each is there once, in single precision."""
        text = b64encode(np.asarray(values, dtype="<f4").tobytes()).decode()
        if text not in self._index:
            self._index[text] = len(self.arrays)
            self.arrays.append(text)
        return self._index[text]


def _swatch(series: Series) -> Markup:
    """A short stretch of a series, as in its plot."""
    style, parts = series.style, Markup("")
    if series.mark in ("line", "both"):
        dash = Markup(' stroke-dasharray="4 3"') if style.dashed else ""
        line = Markup('<path d="M1 6H29" stroke="{}" stroke-width="{}"{}/>')
        parts += line.format(style.colour, min(style.width, 4), dash)
    if series.mark != "line":
        bar = series.mark == "bar"
        fill = "none" if style.dashed and not bar else style.colour
        symbol = Markup('<path d="{}" fill="{}" stroke="{}"/>')
        shape = _SYMBOLS["square" if bar else style.symbol]
        parts += symbol.format(shape, fill, style.colour)
    return Markup('<svg viewBox="0 0 30 12" aria-hidden="true">{}</svg>').format(parts)


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
    marked = Markup("")
    for k, part in enumerate(parts):
        marked += Markup("<code>{}</code>").format(part) if k % 2 else escape(part)
    return marked


@cache
def _asset(name: str) -> Markup:
    return Markup(files(__package__ or "").joinpath("assets", name).read_text(encoding="utf-8"))
