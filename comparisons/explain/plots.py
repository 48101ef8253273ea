"""A budget as a bar chart."""

from __future__ import annotations

from collections.abc import Sequence

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from ..report.numbers import format_number, format_percent
from ..report.plots import finish
from .results import Budget, Quantity, Share

_COLOUR, _UNEXPLAINED, _BAND = "#3d7ab5", "#b3261e", "#5d6b7a"
_ROW, _FRAME = 26, 110  # [pixels] of height
_ROOM = 1.75  # of the bars' extent: room for the texts


def main_quantities(budget: Budget) -> list[Quantity]:
    """Position and stop torques: functions of time in which an error can be seen to grow."""
    return [
        q for q in budget.quantities if q.rms > 0 and (q.name == "position" or q.name.endswith((" torque", " force")))
    ]


def bars(quantities: Sequence[Quantity]) -> go.Figure:
    """Signed share of each cause in the position's and the torques' errors, causes downwards, unexplained last.

    Shares add up to 100 %; whiskers are half the difference of a share's two measures.
    """
    titles = [f"{q.name}: rms {format_number(q.rms)} {q.unit}" for q in quantities]
    chart = make_subplots(rows=1, cols=len(quantities), subplot_titles=titles, shared_yaxes=True)
    for column, quantity in enumerate(quantities, start=1):
        _draw(chart, quantity, column)
    chart.update_yaxes(autorange="reversed", showgrid=False)
    height = _FRAME + _ROW * max(len(q.shares) + 1 for q in quantities)
    finish(chart, height).update_layout(showlegend=False, bargap=0.25, margin={"l": 150})
    return chart


def _draw(chart: go.Figure, quantity: Quantity, column: int) -> None:
    found = [*quantity.shares, quantity.rest]
    causes = [share.cause for share in found]
    values = [100.0 * (share.fraction or 0.0) for share in found]
    # Whiskers narrower than a bar's edge say nothing.
    bands = [band if band >= 1.0 else 0.0 for band in (100.0 * share.interaction / quantity.rms for share in found)]
    colours = [_UNEXPLAINED if share is quantity.rest else _COLOUR for share in found]
    whiskers = {"array": bands, "color": _BAND, "thickness": 1.2}
    chart.add_bar(
        x=values, y=causes, orientation="h", marker={"color": colours}, error_x=whiskers,
        hovertemplate="%{y}: %{x:.3g} %<extra></extra>", row=1, col=column,
    )  # fmt: skip
    # Texts stand to the right of bar and whisker, also of a negative one: to its left are the causes' names.
    ends = [max(0.0, value) + band for value, band in zip(values, bands, strict=True)]
    texts = [_text(share, quantity) for share in found]
    chart.add_scatter(
        x=ends, y=causes, mode="text", text=texts, textposition="middle right", hoverinfo="skip", cliponaxis=False,
        textfont={"size": 11}, row=1, col=column,
    )  # fmt: skip
    low = min(0.0, *(value - band for value, band in zip(values, bands, strict=True)))
    high = max(100.0, *ends)
    chart.update_xaxes(
        title="share of the error [%]", range=[1.05 * low, low + _ROOM * (high - low)], row=1, col=column
    )


def _text(share: Share, quantity: Quantity) -> str:
    """The share, and its size; the rest is a norm first: it is all but orthogonal to the error."""
    rms = quantity.rest_rms if share is quantity.rest else share.rms
    return f" {format_percent(share.fraction)} ({format_number(rms)} {quantity.unit}) "
