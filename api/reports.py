"""Documents, plots and their renderers, for distributions built on trebucheck."""

# Names are given on as they are imported.
# pyright: reportUnusedImport=false

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
    Table,
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
