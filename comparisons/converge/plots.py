"""Plots of the studies, as Plotly figures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from ..report.plotly_plots import LOGARITHMIC, finish, run_style
from .results import Curve, PowerLaw, Study

_MARKS = {"tuned": "circle", "stock": "square-open"}


def convergence(studies: Sequence[Study]) -> go.Figure:
    """Error against the time step, position and torque, with the fitted lines and their slopes."""
    figure = _pair(studies)
    for k, study in enumerate(studies, start=1):
        _points(figure, study, study.label)
        # Lines may all but cover each other; their slopes, each at another place, do not.
        _lines(figure, study, at=k / (len(studies) + 1))
    return _finished(figure, "time step [s]", 520)


def swept_parameter(study: Study) -> go.Figure:
    """Error against one parameter, and where it can be isolated, the part of it that the parameter makes."""
    figure = _pair([study])
    if study.own:
        _points(figure, study, "whole error", whole=True)
    _points(figure, study, "part of the parameter" if study.own else "error")
    _lines(figure, study)
    return _finished(figure, f"{study.title} [{study.unit}]", 360)


def work_precision(studies: Sequence[Study]) -> go.Figure:
    """Error against the median wall time; bars from the quickest to the slowest repeat."""
    figure = _pair(studies)
    for study in studies:
        timed = [point for point in study.points if point.wall_times]
        median = np.array([np.median(point.wall_times) for point in timed])
        spread = {
            "type": "data",
            "symmetric": False,
            "array": np.array([max(point.wall_times) for point in timed]) - median,
            "arrayminus": median - np.array([min(point.wall_times) for point in timed]),
            "thickness": 1,
        }
        for column, curve in enumerate(study.curves, start=1):
            figure.add_scatter(
                x=median, y=[point.error(curve.quantity) for point in timed], error_x=spread, mode="lines+markers",
                name=study.label, legendgroup=study.label, showlegend=column == 1, row=1, col=column,
                customdata=[point.value for point in timed], hovertemplate="h = %{customdata:.3g} s: %{y:.2e}",
                line=run_style(study.engine, study.preset), marker=_mark(study),
            )  # fmt: skip
    return _finished(figure, "wall time, warm [s]", 480)


def exponent(law: PowerLaw | None) -> str:
    """Exponent and half width of its confidence interval."""
    return "none" if law is None else f"{law.exponent:.3f} ± {law.half_width:.3f}"


def _pair(studies: Sequence[Study]) -> go.Figure:
    titles = [_title(curve) for curve in studies[0].curves]
    return make_subplots(rows=1, cols=len(titles), subplot_titles=titles, horizontal_spacing=0.09)


def _title(curve: Curve) -> str:
    name = "position" if curve.quantity == "position" else f"stop {'force' if curve.unit == 'N' else 'torque'}"
    return f"{name} [{curve.unit}]"


def _finished(figure: go.Figure, x_title: str, height: int) -> go.Figure:
    figure.update_xaxes(title=x_title, **LOGARITHMIC)
    figure.update_yaxes(**LOGARITHMIC)
    figure.update_yaxes(title="largest error", col=1)
    return finish(figure, height, legend_at=-0.25)


def _mark(study: Study) -> dict[str, Any]:
    return {"symbol": _MARKS.get(study.preset, "diamond"), "size": 8}


def _points(figure: go.Figure, study: Study, name: str, *, whole: bool = False) -> None:
    """The errors, or where it can be isolated and unless the whole is asked for, the parameter's part of them."""
    own = study.own and not whole
    colour = "#aaaaaa" if whole else run_style(study.engine, study.preset)["color"]
    for column, curve in enumerate(study.curves, start=1):
        ran = [point for point in study.points if point.error(curve.quantity, own)]
        figure.add_scatter(
            x=[point.value for point in ran], y=[point.error(curve.quantity, own) for point in ran],
            mode="markers", name=name, legendgroup=name, showlegend=column == 1, row=1, col=column,
            marker={**_mark(study), "color": colour},
        )  # fmt: skip


def _lines(figure: go.Figure, study: Study, at: float = 0.5) -> None:
    """The laws, each with its exponent at that share of its range."""
    style = run_style(study.engine, study.preset)
    for column, law in enumerate((curve.law for curve in study.curves), start=1):
        if law is None:
            continue
        figure.add_scatter(
            x=[law.high, law.low], y=[law.at(law.high), law.at(law.low)], mode="lines", line=style,
            name=f"slope {law.exponent:.3f}", showlegend=False, row=1, col=column,
        )  # fmt: skip
        label_x = law.low ** (1 - at) * law.high**at
        figure.add_annotation(
            x=np.log10(label_x), y=np.log10(law.at(label_x)), text=exponent(law), showarrow=False, xanchor="right",
            yshift=9, row=1, col=column, font={"size": 12, "color": style["color"]},
        )  # fmt: skip
