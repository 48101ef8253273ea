"""Plots from data alone: the paper's figures, and those of the further studies."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
from trebucheck.api.reports import Axis, Panels, Plot, Rule, Series, Style, Symbol, engine_colour

from .design.efficiency import MachineEfficiency, Machines, SlingThrow
from .drag.study import DragStudy
from .evidence.claims import Series as PaperSeries

_WORLDS = {"moon": "#7b8794", "mars": "#D55E00", "earth": "#0072B2", "venus": "#E69F00"}
_PRINTED, _GRID, _OTHER = "#c0392b", "#8C6BB1", "#b08d57"
_BARS = ("#0072B2", "#E69F00", "#009E73")
_SYMBOLS: tuple[Symbol, ...] = ("circle", "square", "diamond", "triangle", "star")
_MACHINES = {"a": "fixed", "b": "rolling"}

_CAPTIONS = {
    "Fig. 2": "Multiplier of the hanger's constraint against time, fixed machine, in the paper's "
    "sign.",
    "Fig. 3": "Multiplier of the sling's constraint against time, fixed machine, in the paper's "
    "sign. The kink is the hanger's release.",
    "Fig. 4": "Range against the time of release, without drag, and the paper's best release.",
    "Fig. 5": "Launch speed at 45 deg against l1, l1 + l2 kept, under two laws of a rest, and the "
    "paper's numbers.",
    "Fig. 6": "Path of the counterweight up to the launch.",
    "Fig. 7": "Kinetic energy of the projectile over the total energy against the time of launch; "
    "thin lines: the velocity is at 45 deg.",
}


def plots(series: Sequence[PaperSeries]) -> list[tuple[str, str, Panels]]:
    """Name, caption and plot of each figure of the paper with series, in the paper's order."""
    names = sorted({_figure(each) for each in series})
    return [
        (name, _CAPTIONS.get(name, ""), _panels([each for each in series if _figure(each) == name]))
        for name in names
    ]


def _figure(series: PaperSeries) -> str:
    """'Fig. 6' of 'Fig. 6a'."""
    return re.sub(r"[a-z]$", "", series.figure)


def _panels(series: Sequence[PaperSeries]) -> Panels:
    names = sorted({each.figure for each in series})
    return tuple(
        _plot([each for each in series if each.figure == name], name, len(names) > 1)
        for name in names
    )


def _plot(series: Sequence[PaperSeries], name: str, titled: bool) -> Plot:
    first = series[0]
    paths = (first.x_label, first.y_label) == ("x [m]", "y [m]")  # a metre is a metre
    drawn = tuple(
        Series(each.name, np.array(each.x), np.array(each.y), *_style(each)) for each in series
    )
    title = f"({name[-1]}) {_MACHINES.get(name[-1], '')}" if titled else ""
    return Plot(_axis(first.x_label), _axis(first.y_label), drawn, title, equal=paths, height=400)


def _axis(label: str) -> Axis:
    title, _, unit = label.partition(" [")
    return Axis(title, unit.removesuffix("]"))


def _style(series: PaperSeries) -> tuple[Style, Literal["line", "points"]]:
    if series.kind == "printed":
        line = len(set(series.x)) == 1 and len(series.x) > 1
        return Style(_PRINTED, dashed=line, symbol="times"), "line" if line else "points"
    if series.kind == "points":
        colour = engine_colour(series.engine) if series.engine else _GRID
        number = sum(map(ord, series.name)) % len(_SYMBOLS)
        return Style(colour, dashed=True, symbol=_SYMBOLS[number]), "points"
    if series.name == "reference" or series.name.startswith("rests that can"):
        return Style(engine_colour("reference"), width=2.5), "line"
    return Style(_OTHER, dashed=True, width=1.5), "line"


def best_angles(study: DragStudy) -> Panels:
    """Best angle of release against drag area, world by world, and the printed angles."""
    series = tuple(
        Series(
            curve.world,
            np.array(curve.drag_areas),
            np.degrees(curve.angles),
            Style(_WORLDS[curve.world], width=2),
        )
        for curve in study.readings[0].curves
    )
    rules = tuple(
        Rule(
            math.degrees(each.value),
            f"{each.world}: {each.printed}° in print",
            _WORLDS[each.world],
            "y",
        )
        for each in study.printed
    )
    # Logarithmic: what Venus feels at 0.1 m² takes Mars some hundred. Without drag nothing changes
    # with the area.
    area = Axis("drag area", "m²", logarithmic=True)
    return (Plot(area, Axis("best angle of release", "deg"), series, rules=rules, height=400),)


def efficiencies(machines: Machines) -> Panels:
    """Efficiency of every machine, with three slings."""
    bars: dict[str, Callable[[MachineEfficiency], SlingThrow | None]] = {
        "the paper's sling": lambda machine: machine.table_one,
        "its fastest sling": lambda machine: machine.fastest_sling or machine.table_one,
        "most efficient within bounds": lambda machine: machine.most_efficient,
    }
    names = tuple(machine.name for machine in machines.machines)
    series: list[Series] = []
    for (name, of), colour in zip(bars.items(), _BARS, strict=True):
        throws = [of(machine) for machine in machines.machines]
        heights = np.array(
            [np.nan if throw is None else 100 * throw.efficiency for throw in throws]
        )
        series.append(
            Series(name, np.arange(len(names), dtype=float), heights, Style(colour), "bar")
        )
    return (Plot(Axis("", categories=names), Axis("efficiency", "%"), tuple(series), height=380),)
