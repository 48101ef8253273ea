"""Plots from data alone: the paper's figures, and those of the further studies."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from typing import Any

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from ..comparisons.report.plotly_plots import finish
from ..comparisons.report.plots import engine_colour
from .design.efficiency import MachineEfficiency, Machines, SlingThrow
from .drag.study import DragStudy
from .evidence.claims import Series

_WORLDS = {"moon": "#777777", "mars": "#c0392b", "earth": "#1f77b4", "venus": "#d9a30d"}
_PRINTED, _GRID, _OTHER = "#c0392b", "#9467bd", "#b08d57"
_SYMBOLS = ("circle-open", "square-open", "diamond-open", "triangle-up-open", "star-open")
_MACHINES = {"a": "fixed", "b": "rolling"}

_CAPTIONS = {
    "Fig. 2": "Multiplier of the hanger's constraint against time, fixed machine, in the paper's sign.",
    "Fig. 3": "Multiplier of the sling's constraint against time, fixed machine, in the paper's sign. The kink is the "
    "hanger's release.",
    "Fig. 4": "Range against the time of release, without drag, and the paper's best release.",
    "Fig. 5": "Launch speed at 45 deg against l1, l1 + l2 kept, under two laws of a rest, and the paper's numbers.",
    "Fig. 6": "Path of the counterweight up to the launch.",
    "Fig. 7": "Kinetic energy of the projectile over the total energy against the time of launch; thin lines: the "
    "velocity is at 45 deg.",
}


def plots(series: Sequence[Series]) -> list[tuple[str, str, go.Figure]]:
    """Name, caption and plot of each figure of the paper that there are series of, in the paper's order."""
    names = sorted({_figure(each) for each in series})
    return [
        (name, _CAPTIONS.get(name, ""), _plot([each for each in series if _figure(each) == name])) for name in names
    ]


def _figure(series: Series) -> str:
    """'Fig. 6' of 'Fig. 6a'."""
    return re.sub(r"[a-z]$", "", series.figure)


def _plot(series: Sequence[Series]) -> go.Figure:
    panels = sorted({each.figure for each in series})
    titles = [f"({panel[-1]}) {_MACHINES.get(panel[-1], '')}" for panel in panels] if len(panels) > 1 else None
    figure = make_subplots(rows=1, cols=len(panels), subplot_titles=titles, shared_yaxes=len(panels) > 1)
    in_legend: set[str] = set()
    for each in series:
        column = panels.index(each.figure) + 1
        figure.add_scatter(
            x=each.x,
            y=each.y,
            name=each.name,
            legendgroup=each.name,
            showlegend=each.name not in in_legend,
            row=1,
            col=column,
            **_style(each),
        )
        in_legend.add(each.name)
        figure.update_xaxes(title=each.x_label, row=1, col=column)
    figure.update_yaxes(title=series[0].y_label, col=1)
    if (series[0].x_label, series[0].y_label) == ("x [m]", "y [m]"):  # paths: a metre is a metre
        for column in range(1, len(panels) + 1):
            axis = "" if column == 1 else str(column)
            figure.update_yaxes(scaleanchor=f"x{axis}", constrain="domain", row=1, col=column)
        figure.update_xaxes(matches="x", constrain="domain")
        return finish(figure, 760, -0.1)
    return finish(figure, 460, -0.2)


def _style(series: Series) -> dict[str, Any]:
    if series.kind == "printed":
        line = len(set(series.x)) == 1 and len(series.x) > 1
        mark = {"color": _PRINTED, "symbol": "x", "size": 11, "line": {"width": 2}}
        return (
            {"mode": "lines", "line": {"color": _PRINTED, "dash": "dash"}}
            if line
            else {"mode": "markers", "marker": mark}
        )
    if series.kind == "points":
        colour = engine_colour(series.engine) if series.engine else _GRID
        number = sum(map(ord, series.name)) % len(_SYMBOLS)
        return {"mode": "markers", "marker": {"color": colour, "symbol": _SYMBOLS[number], "size": 9}}
    if series.name == "reference" or series.name.startswith("rests that can"):
        return {"mode": "lines", "line": {"color": engine_colour("reference"), "width": 2.5}}
    return {"mode": "lines", "line": {"color": _OTHER, "width": 1.5, "dash": "dot"}}


def best_angles(study: DragStudy) -> go.Figure:
    """Best angle of release against drag area, world by world, and the printed angles."""
    figure = go.Figure()
    for curve in study.readings[0].curves:
        line = {"color": _WORLDS.get(curve.world), "width": 2}
        figure.add_scatter(x=curve.drag_areas, y=[math.degrees(a) for a in curve.angles], name=curve.world, line=line)
    for each in study.printed:
        line = {"color": _WORLDS.get(each.world), "width": 1, "dash": "dash"}
        figure.add_hline(
            y=math.degrees(each.value), line=line, annotation_text=f"{each.world}: {each.printed}° in print"
        )
    # Logarithmic: what Venus feels at 0.1 m² takes Mars some hundred. Without drag nothing changes with the area.
    figure.update_xaxes(title="C_d A [m²]", type="log", range=[-3, 1], exponentformat="power")
    figure.update_yaxes(title="best angle of release [deg]")
    return finish(figure, 420)


def efficiencies(machines: Machines) -> go.Figure:
    """Efficiency of every machine, with three slings."""
    bars: dict[str, Callable[[MachineEfficiency], SlingThrow | None]] = {
        "the paper's sling": lambda machine: machine.table_one,
        "its fastest sling": lambda machine: machine.fastest_sling or machine.table_one,
        "most efficient within bounds": lambda machine: machine.most_efficient,
    }
    figure, names = go.Figure(), [machine.name for machine in machines.machines]
    for name, of in bars.items():
        throws = [of(machine) for machine in machines.machines]
        figure.add_bar(x=names, y=[None if throw is None else throw.efficiency for throw in throws], name=name)
    figure.update_yaxes(title="efficiency", range=[0, 1], tickformat=".0%")
    return finish(figure, 420)
