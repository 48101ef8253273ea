"""A document as one HTML file that needs nothing else."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib.resources import files
from typing import Any

import plotly.graph_objects as go
from jinja2 import Environment, StrictUndefined, Template
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from ...models.drawing import animation
from .document import Animation, Document, in_medium

SIGNS = {"good": "✓", "bad": "✗", "warning": "!"}
"""Before what is marked so, for those who do not see the colour."""


def page(document: Document) -> str:
    """The whole page as HTML text, scripts and all."""
    return _template().render(
        document=document, in_medium=in_medium, signs=SIGNS, embedded=_embedded, plotly=Markup(get_plotlyjs()),
        animated=_animated, animation_assets=animation.assets,
    )  # fmt: skip


def _animated(block: Animation) -> Markup:
    """An animation as HTML that needs the assets of animations on its page."""
    scenes = block.scenes() if callable(block.scenes) else block.scenes
    return animation.Animation(scenes, block.title).fragment(block.anchor)


@cache
def _template() -> Template:
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    text = files(__package__ or "").joinpath("templates/page.html.j2").read_text(encoding="utf-8")
    return environment.from_string(text)


def _embedded(plot: go.Figure | Callable[[], go.Figure]) -> Markup:
    """A figure as HTML that needs plotly.js on its page."""
    plot = plot if isinstance(plot, go.Figure) else plot()
    options: dict[str, Any] = {"displaylogo": False, "responsive": True}
    return Markup(plot.to_html(full_html=False, include_plotlyjs=False, config=options))
