"""What a further study shows on the page: texts, small tables and plots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import plotly.graph_objects as go

from ...comparisons.report.plots import embedded

Cell = str


@dataclass(frozen=True)
class Block:
    """A text, a table, a plot, or several of them under one heading."""

    title: str = ""
    texts: tuple[str, ...] = ()
    headings: tuple[str, ...] = ()
    rows: tuple[tuple[Cell, ...], ...] = field(default=())
    plot: str = ""


def table(title: str, headings: Sequence[str], rows: Sequence[Sequence[object]], *texts: str) -> Block:
    """A table; numbers are shown to six digits."""
    return Block(title, texts, tuple(headings), tuple(tuple(cell(each) for each in row) for row in rows))


def drawn(title: str, plot: go.Figure, *texts: str) -> Block:
    """A plot."""
    return Block(title, texts, plot=embedded(plot))


def sentences(texts: Sequence[str]) -> tuple[str, ...]:
    """Findings, each as a sentence that stands for itself."""
    return tuple(_capital(text) + ("" if text.endswith(".") else ".") for text in texts)


def _capital(text: str) -> str:
    """With a capital, unless it begins with a symbol: G is not g."""
    return text if text[1:2] in ("", " ") else text[:1].upper() + text[1:]


def cell(value: object) -> Cell:
    """A value as a table shows it."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
