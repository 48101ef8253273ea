"""Documents, plots and their renderers, for distributions built on trebucheck."""

from __future__ import annotations

from ..comparisons.report import document, markdown
from ..comparisons.report.document import (
    Block,
    Cell,
    Code,
    Column,
    Document,
    Figure,
    Heading,
    Listing,
    Mark,
    Note,
    Text,
    format_number,
    row,
    sentence,
    table,
    words,
)
from ..comparisons.report.pages.tables import mechanism_as_data
from ..comparisons.report.plots import (
    Axis,
    Panels,
    Plot,
    Rule,
    Series,
    Style,
    Symbol,
    engine_colour,
)

__all__ = [
    "Axis",
    "Block",
    "Cell",
    "Code",
    "Column",
    "Document",
    "Figure",
    "Heading",
    "Listing",
    "Mark",
    "Note",
    "Panels",
    "Plot",
    "Rule",
    "Series",
    "Style",
    "Symbol",
    "Text",
    "document",
    "engine_colour",
    "format_number",
    "markdown",
    "mechanism_as_data",
    "row",
    "sentence",
    "table",
    "words",
]
