"""A report as a list of blocks; `html`, `terminal` and `markdown` show it. How its numbers read.

A mark is a named state of a value or a text ("good": it holds its tolerance). The page shows it by
a class and a sign, the terminal by a style; no renderer relies on colour alone. A medium says where
a block, a row or a column is shown: a terminal has room for fewer of them. Headings, notes and
tiles are for pages unless they say otherwise; figures and folds always are.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import TYPE_CHECKING, Any, Literal, TypeVar

if TYPE_CHECKING:
    from .drawing.scene import Scene
    from .plots import Panels

Mark = Literal["plain", "good", "bad", "warning", "unjudged", "muted", "strong"]
Medium = Literal["any", "page", "terminal"]

SIGNS: dict[Mark, str] = {"good": "✓", "bad": "✗", "warning": "!", "unjudged": "○"}
"""Before what is marked so, for those who do not see the colour."""


def mark_of(holds: bool | None) -> Mark:
    """Mark of a value by its tolerance; plain where it has none."""
    marks: dict[bool | None, Mark] = {None: "plain", True: "good", False: "bad"}
    return marks[holds]


# --- Numbers


def format_number(value: float | None) -> str:
    """Two significant digits; a dash for none."""
    if value is None:
        return "–"
    return "0" if value == 0 else _scientific(value, digits=1)


def format_value(value: object) -> str:
    """Format a value of a table: a number to six digits, a dash for none."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def format_step(value: object) -> str:
    """A time step with as many digits as it needs, four at most; a dash for what is no number."""
    if not isinstance(value, float):
        return "–"
    digits = 0
    while digits < 3 and float(_scientific(value, digits)) != value:
        digits += 1
    return _scientific(value, digits)


def _scientific(value: float, digits: int) -> str:
    mantissa, exponent = f"{value:.{digits}e}".split("e")
    return f"{mantissa}e{int(exponent)}"


def format_percent(fraction: float | None) -> str:
    """A signed share in per cent, a dash for none."""
    if fraction is None:
        return "–"
    value = 100.0 * fraction
    if abs(value) >= 10:
        return f"{value:.0f} %"
    if abs(value) >= 0.1:
        return f"{value:.1f} %"
    return "0 %" if value == 0 else "< 0.1 %"


def format_settings(settings: Mapping[str, object]) -> str:
    """Options and their values in a line."""
    return ", ".join(f"{name} = {value}" for name, value in settings.items())


def sentence(text: str) -> str:
    """A sentence with a capital and a full stop; a symbol at its beginning, such as l1, is kept."""
    first = re.match(r"\w*", text)
    word = first.group() if first else ""
    capital = text[:1].upper() + text[1:] if len(word) > 1 and word.isalpha() else text
    return capital if text.endswith(".") else f"{capital}."


# --- Blocks


@dataclass(frozen=True)
class Placed:
    """A part of a report, and which medium shows it."""

    medium: Medium = field(default="any", kw_only=True)

    @property
    def kind(self) -> str:
        """Class in a word, for the template of the page."""
        return type(self).__name__.removesuffix("Block").lower()


@dataclass(frozen=True)
class PagePart(Placed):
    """A part that only pages show, unless it says otherwise."""

    medium: Medium = field(default="page", kw_only=True)


@dataclass(frozen=True)
class Heading(PagePart):
    """A heading; level 2 opens a chapter, 3 a section, 4 a part of one; the title is level 1.

    Without an anchor it has one from its text.
    """

    text: str
    level: Literal[2, 3, 4] = 3
    anchor: str = ""


@dataclass(frozen=True)
class Text(Placed):
    """A paragraph. The mark applies to `lead`, its first words, or without them to all of it."""

    text: str
    mark: Mark = "plain"
    lead: str = ""


@dataclass(frozen=True)
class Note(Text):
    """A paragraph that says how to read what is beside it."""

    mark: Mark = "muted"
    medium: Medium = field(default="page", kw_only=True)


@dataclass(frozen=True)
class Listing(Placed):
    """Sentences, each of which stands for itself."""

    items: tuple[Text, ...]
    ordered: bool = False


@dataclass(frozen=True)
class Tile:
    """A number and what it counts."""

    value: str
    label: str
    mark: Mark = "plain"
    detail: str = ""


@dataclass(frozen=True)
class Tiles(PagePart):
    """Numbers that come before all else."""

    tiles: tuple[Tile, ...]


@dataclass(frozen=True)
class Code(Placed):
    """A text to copy, or data, as it is."""

    title: str
    text: str


@dataclass(frozen=True)
class Fold(PagePart):
    """Blocks behind a title that opens them."""

    title: str
    blocks: tuple[Block, ...]
    opened: bool = False
    anchor: str = ""


@dataclass(frozen=True)
class Figure(PagePart):
    """Plots with their title and the sentence that says how to read them."""

    plot: Panels | Callable[[], Panels]  # or what draws it, for a page only
    title: str = ""
    caption: str = ""
    anchor: str = ""
    group: str = ""  # figures of one group zoom together
    columns: int = 0  # plots in a row where there is room; 0: up to three
    chosen: str = ""  # what the choices of its plots are, as 'quantity'

    def panels(self) -> Panels:
        """The plots."""
        return self.plot() if callable(self.plot) else self.plot


@dataclass(frozen=True)
class Grid(PagePart):
    """Figures beside each other, as many as there is room for."""

    blocks: tuple[Figure, ...]


@dataclass(frozen=True)
class AnimationBlock(PagePart):
    """Mechanisms in motion, with their runs over the reference; one is shown at a time."""

    scenes: tuple[Scene, ...] | Callable[[], tuple[Scene, ...]]
    """Or what makes them, for a page only."""
    title: str = "Motion"
    anchor: str = "motion"


# --- Tables

_NUMBER = re.compile(r"(over )?[-+÷×<]?\s?\d")


@dataclass(frozen=True)
class Column(Placed):
    """A column of a table.

    `short` is the title in a terminal, where that has to be another; neighbours of one `group`
    share a heading on the page. `of` gives the value for the object that a row is about. Where
    `align` and `wrap` are None, they follow from the cells: numbers stand to the right, and texts
    with spaces may be wrapped. Where a terminal is too narrow, the columns of the highest `rank`
    are left out first, of one rank the rightmost; those of rank 0, and the first one, never.
    """

    title: str
    unit: str = ""
    align: Literal["left", "right"] | None = None
    short: str = ""
    group: str = ""
    wrap: bool | None = None
    rank: int = 1
    of: Callable[[Any], object] = str

    @property
    def heading(self) -> str:
        """Title and unit; a pure number has none."""
        return self.title if self.unit in ("", "1") else f"{self.title} [{self.unit}]".lstrip()

    @property
    def heading_words(self) -> str:
        """Its title in a terminal."""
        return self.short or self.title


def columns(titles: str) -> tuple[Column, ...]:
    """Columns from a line like "engine | step [s] | (steps)"; in round brackets: for pages only."""
    parsed: list[Column] = []
    for title in map(str.strip, titles.split("|")):
        if title.startswith("("):
            parsed.append(page_only(_column(title[1:-1])))
        else:
            parsed.append(_column(title))
    return tuple(parsed)


def _column(title: str) -> Column:
    text, _, unit = title.partition(" [")
    return Column(text, unit.removesuffix("]"))


def ranked(columns: Iterable[Column], **ranks: int) -> tuple[Column, ...]:
    """The columns with a rank for those whose title, its spaces as underscores, has one."""
    names = ((column, column.title.replace(" ", "_")) for column in columns)
    return tuple(replace(column, rank=ranks.get(name, column.rank)) for column, name in names)


def words(title: str, *, wrap: bool = True, medium: Medium = "any") -> Column:
    """A column of texts."""
    return Column(title, align="left", wrap=wrap, medium=medium)


@dataclass(frozen=True)
class Cell:
    """A value; pages also show its detail, small below it, and its hint where it is pointed at."""

    text: str
    mark: Mark = "plain"
    detail: str = ""
    hint: str = ""
    link: str = ""  # anchor of what the page shows of it elsewhere
    heat: float | None = None
    """From -1, far within its tolerance, to 1, far beyond it; the page colours it."""


@dataclass(frozen=True)
class Row(Placed):
    """A row of a table; with fewer cells than columns, the last one spans the rest."""

    cells: tuple[Cell, ...]
    anchor: str = ""


def row(*values: object, anchor: str = "", medium: Medium = "any") -> Row:
    """A row from plain values."""
    cells = (value if isinstance(value, Cell) else Cell(format_value(value)) for value in values)
    return Row(tuple(cells), anchor, medium=medium)


@dataclass(frozen=True)
class Table(Placed):
    """Rows of cells under columns; without rows it is not shown, without titles it has no head."""

    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    caption: str = ""

    @property
    def has_head(self) -> bool:
        """Tell whether any column has a title."""
        return any(column.title or column.unit for column in self.columns)

    def columns_in(self, medium: Medium) -> list[Column]:
        """Columns that the medium shows."""
        return in_medium(self.columns, medium)

    def rows_in(self, medium: Medium) -> list[tuple[Row, list[tuple[Cell, int]]]]:
        """Rows that the medium shows; each cell with the number of shown columns that it spans."""
        visible = [column.medium in ("any", medium) for column in self.columns]
        rows: list[tuple[Row, list[tuple[Cell, int]]]] = []
        for row in in_medium(self.rows, medium):
            last = len(row.cells) - 1
            spans = [*map(int, visible[:last]), sum(visible[last:])]
            cells = zip(row.cells, spans, strict=True)
            rows.append((row, [(cell, span) for cell, span in cells if span]))
        return rows

    def groups(self) -> list[tuple[str, int]]:
        """Headings over several of the page's columns, with their numbers of columns."""
        by_group = groupby(self.columns_in("page"), lambda column: column.group)
        groups = [(group, len([*members])) for group, members in by_group]
        return groups if any(group for group, _ in groups) else []


def table(
    heads: str | Sequence[Column | str],
    rows: Iterable[object],
    caption: str = "",
    medium: Medium = "any",
) -> Table:
    """A table of rows, of sequences of values, or of objects that the columns have their values of.

    A value is a `Cell` or what `format_value` shows.
    The heads are columns or their titles, or all titles in a line, as `columns` reads them.
    """
    if isinstance(heads, str):
        heads = columns(heads)
    parsed = [head if isinstance(head, Column) else _column(head) for head in heads]
    body: list[Row] = []
    for item in rows:
        if isinstance(item, Row):
            body.append(item)
        elif isinstance(item, tuple):
            body.append(row(*item))
        else:
            body.append(row(*(column.of(item) for column in parsed)))
    whole = [each.cells for each in body if len(each.cells) == len(parsed)]
    laid_out: list[Column] = []
    for i, column in enumerate(parsed):
        # Numbers stand to the right, all else and the first column to the left.
        texts = [cells[i].text for cells in whole]
        values = [_NUMBER.match(text) is not None for text in texts if text not in ("", "–")]
        align, wrap = column.align, column.wrap
        if align is None:
            align = "left" if i == 0 or 2 * sum(values) < len(values) else "right"
        if wrap is None:
            wrap = i > 0 and any(" " in text for text in texts)
        laid_out.append(replace(column, align=align, wrap=wrap))
    return Table(tuple(laid_out), tuple(body), caption, medium=medium)


def without_empty_columns(shown: Table) -> Table:
    """The table without columns in which no row has a value or a verdict; the first one stays."""
    count, kept = len(shown.columns), {0}
    for each in shown.rows:
        for i, cell in enumerate(each.cells):
            says = cell.text not in ("", "–") or cell.mark in ("good", "bad", "warning")
            if says and len(each.cells) == count:
                kept.add(i)
    rows: list[Row] = []
    for each in shown.rows:
        last = len(each.cells) - 1  # where there are fewer cells it spans the rest, and stays
        stays = kept if len(each.cells) == count else kept | {last}
        cells = tuple(cell for i, cell in enumerate(each.cells) if i in stays)
        rows.append(replace(each, cells=cells))
    columns = tuple(column for i, column in enumerate(shown.columns) if i in kept)
    return replace(shown, columns=columns, rows=tuple(rows))


# --- Grids of verdicts


@dataclass(frozen=True)
class VerdictSign:
    """A verdict that cells of a grid may have."""

    name: str
    sign: str  # which tells it without its colour
    label: str
    counted: str  # the same of a number of runs


@dataclass(frozen=True)
class QuantityRow:
    """A row of a card: the error of a run in one quantity, as texts."""

    quantity: str
    subject: str
    error: str
    ratio: str  # to its tolerance
    holds: bool | None
    tolerance: str = ""
    unit: str = ""
    part: str = ""  # of the quantity's scale
    count: str = ""  # figures that hold, of those that are judged
    source: str = ""  # of the tolerance, where it is not every run's


@dataclass(frozen=True)
class Card:
    """A text that opens where a cell or a head is pointed at: a sentence, quantities, facts."""

    title: str
    lead: str = ""
    quantities: tuple[QuantityRow, ...] = ()
    facts: tuple[tuple[str, str], ...] = ()
    command: str = ""
    link: str = ""  # address of a page that says more


@dataclass(frozen=True)
class GridCell:
    """The verdict on a run."""

    state: str
    card: Card  # its lead is read out to those who do not see the state
    symbol: str = ""  # of the quantity that broke
    heat: float = 0.0  # 0 to 1: how far beyond its tolerance, or within
    own: str = ""  # share of the run that is the engine's


@dataclass(frozen=True)
class GridRow:
    """An engine and preset with the verdicts on its runs, one a column; None: not run."""

    engine: str
    preset: str
    group: str
    cells: tuple[GridCell | None, ...]
    leading: tuple[str, ...]  # texts of the leading columns
    card: Card
    apart: bool = False  # below the others, and not counted


@dataclass(frozen=True)
class GridColumn:
    """A problem."""

    name: str
    group: str
    features: tuple[str, ...]
    card: Card


@dataclass(frozen=True)
class VerdictGrid(Placed):
    """Verdicts of engines on problems, which a page sorts, filters and opens.

    Other media show `compact`.
    """

    states: tuple[VerdictSign, ...]
    presets: tuple[str, ...]
    rows: tuple[GridRow, ...]  # by group
    columns: tuple[GridColumn, ...]  # by group
    leading: tuple[str, ...]  # titles of the columns between the heads of rows and the cells
    shares: tuple[str, ...]  # shares of a run that are an engine's own, the whole first
    legend: str
    apart: str  # title of the rows that stand apart
    compact: tuple[Table, ...]

    @property
    def kind(self) -> str:
        """Class in a word, for the template of the page."""
        return "verdicts"

    def filters(self) -> dict[str, tuple[str, ...]]:
        """Values by which rows and columns are chosen, by what they are of."""
        features = dict.fromkeys(name for column in self.columns for name in column.features)
        return {
            "preset": self.presets,
            "engine": tuple(sorted({row.engine for row in self.rows})),
            "scheme": tuple(dict.fromkeys(row.group for row in self.rows)),
            "feature": tuple(features),
        }

    def quantities(self) -> tuple[str, ...]:
        """Quantities that some run is judged by."""
        names: dict[str, None] = {}
        for row in self.rows:
            for cell in filter(None, row.cells):
                names |= dict.fromkeys(each.quantity for each in cell.card.quantities)
        return tuple(names)


# --- Documents

Block = (
    Heading
    | Text
    | Listing
    | Tiles
    | Table
    | Figure
    | Grid
    | AnimationBlock
    | Code
    | Fold
    | VerdictGrid
)


@dataclass(frozen=True)
class Document:
    """A report: its title, its blocks, and the title of the window it is shown in."""

    title: str
    blocks: tuple[Block, ...]
    window: str = "trebucheck"
    command: str = ""  # command line that makes this report again
    verdict: str = ""  # the whole in a line, for who asks for no more; the title where it is empty
    wide: bool = False  # as wide as the window, without contents beside it


def figures_of(document: Document) -> dict[str, Figure]:
    """Figures of a report, those of folds too, by their anchors or else titles."""
    named: dict[str, Figure] = {}
    pending: list[Block] = [*document.blocks]
    while pending:
        block = pending.pop(0)
        if isinstance(block, Figure):
            title = re.sub(r"\W+", "-", block.title.lower()).strip("-")
            name = block.anchor or title or "figure"
            named[name if name not in named else f"{name}-{len(named) + 1}"] = block
        elif isinstance(block, Grid | Fold):
            pending[:0] = block.blocks
    return named


_P = TypeVar("_P", bound=Placed)


def in_medium(parts: Iterable[_P], medium: Medium) -> list[_P]:
    """Parts that the medium shows; tables without rows are left out."""
    matching = (part for part in parts if part.medium in ("any", medium))
    return [part for part in matching if not isinstance(part, Table) or part.rows_in(medium)]


def page_only(block: _P) -> _P:
    """The block, kept out of terminals."""
    return replace(block, medium="page")


def terminal_only(block: _P) -> _P:
    """The block, kept out of pages."""
    return replace(block, medium="terminal")
