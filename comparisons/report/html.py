"""A document as one HTML file that needs nothing else: no network, no other file."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from functools import partial
from itertools import chain, count, groupby
from operator import attrgetter
from typing import Any

from markupsafe import Markup, escape

from ...models.arrays import FloatArray
from .document import (
    SIGNS,
    AnimationBlock,
    Card,
    Document,
    Figure,
    GridRow,
    Heading,
    VerdictGrid,
    in_medium,
)
from .drawing import animation
from .plots import Plot, common_legend, with_own_colours


def page(document: Document) -> str:
    """The whole page as HTML text, scripts and all."""
    package = __package__ or ""

    def animated(block: AnimationBlock) -> Markup:
        """An animation, whose style and script the page has once."""
        scenes = block.scenes() if callable(block.scenes) else block.scenes
        return animation.Animation(scenes, block.title).fragment(block.anchor)

    return animation.template(package, "templates/page.html.j2").render(
        page=_Page(),
        document=document,
        in_medium=in_medium,
        signs=SIGNS,
        asset=partial(animation.resource, package),
        with_code=_with_code,
        animated=animated,
        verdicts=_verdict_grid,
        animation_assets=animation.assets,
        json=animation.script_json,
    )


@dataclass
class _Page:
    """Contents and shared arrays, collected while blocks are rendered."""

    outline: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])
    """Chapters: text, anchor, and parts, which are such entries."""
    arrays: dict[str, int] = field(default_factory=dict[str, int])
    """Numbers of arrays, by what is in them; each is on the page once."""
    taken: set[str] = field(default_factory=set[str])
    has_plots: bool = False
    level: int = 1  # level of the last heading

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
        """A figure's legends, the places of its plots, and their data.

        Plots that list the same series have one legend above them, others each their own. Arrays
        are put among those of the page.
        """
        panels = with_own_colours(block.panels())
        self.has_plots = True
        if block.anchor and block.title:
            self._list(3, block.title, block.anchor)
        common = common_legend(panels)
        places: list[dict[str, Any]] = []
        for plot in panels:
            # The plot in words, for those who do not see it.
            title = ", ".join(filter(None, (block.title, plot.title))) or "Plot"
            y, x = plot.y.heading or "value", plot.x.heading or "value"
            names = ", ".join(dict.fromkeys(series.name for series in plot.series if series.name))
            alt, height = f"{title}: {y} against {x}; {names}.", 0 if plot.equal else plot.height
            own = plot.legend if common is None else ()
            place = {"title": plot.title, "alt": alt, "height": height, "legend": own}
            places.append(place | {"choice": plot.choice})
        return {
            "legend": common or (),
            "panels": places,
            "choices": [*dict.fromkeys(plot.choice for plot in panels if plot.choice)],
            "columns": block.columns or min(len(panels), 3),
            "data": animation.script_json([self._plot(plot) for plot in panels]),
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
                "hints": series.hints, "listed": series.listed,
            })  # fmt: skip
        return data | {"equal": plot.equal, "height": plot.height}

    def _add(self, values: FloatArray) -> int:
        """Number of an array among those of the page, in single precision."""
        return self.arrays.setdefault(animation.packed(values), len(self.arrays))


# --- Grids of verdicts


def _verdict_grid(block: VerdictGrid) -> Markup:
    """A grid as a table, with what its cells open as data for the script."""
    package = __package__ or ""
    groups: list[tuple[str, int]] = []
    for group, members in groupby(block.columns, attrgetter("group")):
        groups.append((group, len([*members])))

    def group_of(numbered: tuple[int, GridRow]) -> tuple[str, bool]:
        row = numbered[1]
        return (block.apart if row.apart else row.group), row.apart

    row_groups: list[tuple[str, bool, list[tuple[int, GridRow]]]] = []
    for (group, apart), rows in groupby(enumerate(block.rows), group_of):
        row_groups.append((group, apart, [*rows]))
    fragment = animation.template(package, "templates/verdicts.html.j2")
    data = animation.script_json(_GridData(block).content())
    return Markup(fragment.render(block=block, groups=groups, row_groups=row_groups, data=data))


_OF_PROBLEM = "%PROBLEM%"  # stands for the name of a cell's problem in its command


@dataclass
class _GridData:
    """A grid as the script reads it; each text is there once, and told by its number.

    So is what quantities share. Titles and leads of cells follow from the table, and the name of
    its problem is left out of a cell's command.
    """

    block: VerdictGrid
    texts: dict[str, int] = field(default_factory=dict[str, int])
    shared: dict[tuple[str, ...], int] = field(default_factory=dict[tuple[str, ...], int])

    def content(self) -> dict[str, Any]:
        """The whole."""
        block = self.block
        states = [state.name for state in block.states]
        rows: list[dict[str, Any]] = []
        for row in block.rows:
            cells: list[dict[str, Any] | None] = []
            for cell, column in zip(row.cells, block.columns, strict=True):
                if cell is None:
                    cells.append(None)
                    continue
                own = block.shares.index(cell.own) if cell.own in block.shares else -1
                named = {"state": states.index(cell.state), "symbol": cell.symbol, "own": own}
                command = cell.card.command.replace(f" {column.name} ", f" {_OF_PROBLEM} ", 1)
                cells.append(named | self._details(cell.card, command))
            named = {name: getattr(row, name) for name in ("engine", "preset", "group", "apart")}
            rows.append(named | {"card": self._card(row.card), "cells": cells})
        columns: list[dict[str, Any]] = []
        for column in block.columns:
            named = {name: getattr(column, name) for name in ("name", "group", "features")}
            columns.append(named | {"card": self._card(column.card)})
        return {
            "states": [vars(state) for state in block.states],
            "presets": block.presets,
            "shares": block.shares,
            "apart": block.apart,
            "leading": len(block.leading),
            "ofProblem": _OF_PROBLEM,
            "rows": rows,
            "columns": columns,
            "shared": [[*map(self._number, each)] for each in self.shared],
            "texts": [*self.texts],
        }

    def _card(self, card: Card) -> dict[str, Any]:
        heads = {"title": self._number(card.title), "lead": self._number(card.lead)}
        return heads | self._details(card, card.command)

    def _details(self, card: Card, command: str) -> dict[str, Any]:
        quantities: list[list[Any]] = []
        for each in card.quantities:
            of_all = each.quantity, each.subject, each.tolerance, each.unit, each.count, each.source
            own = map(self._number, (each.error, each.ratio, each.part))
            number = self.shared.setdefault(of_all, len(self.shared))
            quantities.append([number, *own, each.holds])
        return {
            "quantities": quantities,
            "facts": [[self._number(name), self._number(fact)] for name, fact in card.facts],
            "command": self._number(command),
            "link": self._number(card.link),
        }

    def _number(self, text: str) -> int:
        return self.texts.setdefault(text, len(self.texts))


def _with_code(text: object) -> Markup:
    """Text in which parts between backquotes are code."""
    parts = str(text).split("`")
    if len(parts) % 2 == 0:  # one is left over: they mean something else
        return escape(text)
    marked = Markup("")
    for k, part in enumerate(parts):
        marked += Markup("<code>{}</code>").format(part) if k % 2 else escape(part)
    return marked
