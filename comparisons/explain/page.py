"""The page of `trebucheck explain`."""

from __future__ import annotations

from importlib.resources import files

from jinja2 import Environment, StrictUndefined
from plotly.offline import get_plotlyjs

from ..report.numbers import format_number as figure
from ..report.plots import embedded
from . import text as shown
from .plots import bars
from .results import Budget, Explanation


def explain_html(explanation: Explanation) -> str:
    """The whole page as HTML text, scripts and all."""
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    text = files("trebucheck.comparisons").joinpath("templates/explain.html.j2").read_text(encoding="utf-8")
    return environment.from_string(text).render(
        explanation=explanation, shown=shown, chart=_chart, figure=figure, plotly=get_plotlyjs()
    )


def _chart(budget: Budget) -> str:
    return embedded(bars(budget)) if shown.main_quantities(budget) else ""
