"""A report as a list of blocks; `html`, `terminal` and `markdown` show it.

A mark is a named state of a value or a text ("good": it holds its tolerance). The page shows it by
a class and a sign, the terminal by a style; no renderer relies on colour alone. A medium says where
a block, a row or a column is shown: a terminal has room for fewer of them. Headings, notes and
tiles are for pages unless they say otherwise; figures and folds always are.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from .numbers import format_value

if TYPE_CHECKING:
    from .drawing.scene import Scene
    from .plots import Panels

Mark = Literal["plain", "good", "bad", "warning", "unjudged", "muted", "strong"]
Medium = Literal["any", "page", "terminal"]

SIGNS: dict[Mark, str] = {"good": "✓", "bad": "✗", "warning": "!", "unjudged": "○"}
"""Before what is marked so, for those who do not see the colour."""


def mark_of(holds: bool | None) -> Mark:
    """Mark of a value by its tolerance; plain where it has none."""
    return "plain" if holds is None else "good" if holds else "bad"


@dataclass(frozen=True)
class Placed:
    """A part of a report, and which medium shows it."""

    medium: Medium = field(default="any", kw_only=True)

    @property
    def kind(self) -> str:
        """Class in a word, for the template of the page."""
        return type(self).__name__.removesuffix("Block").lower()


@dataclass(frozen=True)
class Heading(Placed):
    """A heading; level 2 opens a chapter, 3 a section, 4 a part of one; the title is level 1.

    Without an anchor it has one from its text.
    """

    text: str
    level: Literal[2, 3, 4] = 3
    anchor: str = ""
    medium: Medium = field(default="page", kw_only=True)


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
class Tiles(Placed):
    """Numbers that come before all else."""

    tiles: tuple[Tile, ...]
    medium: Medium = field(default="page", kw_only=True)


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
        return f"{self.title} [{self.unit}]".lstrip() if self.unit not in ("", "1") else self.title

    @property
    def heading_words(self) -> str:
        """Its title in a terminal."""
        return self.short or self.title

    def laid_out(self, number: int, cells: Sequence[str]) -> Column:
        """The column with alignment and wrapping by its cells; the first one to the left."""
        values = [_NUMBER.match(cell) is not None for cell in cells if cell not in ("", "–")]
        align = "left" if number == 0 or 2 * sum(values) < len(values) else "right"
        wrap = number > 0 and any(" " in cell for cell in cells)
        return replace(
            self, align=self.align or align, wrap=wrap if self.wrap is None else self.wrap
        )


_NUMBER = re.compile(r"(over )?[-+÷×<]?\s?\d")


def columns(titles: str) -> tuple[Column, ...]:
    """Columns from a line like "engine | step [s] | (steps)"; in round brackets: for pages only."""
    parts = map(str.strip, titles.split("|"))
    return tuple(
        page_only(_column(part[1:-1])) if part.startswith("(") else _column(part) for part in parts
    )


def _column(title: str) -> Column:
    text, _, unit = title.partition(" [")
    return Column(text, unit.removesuffix("]"))


def ranked(columns: Iterable[Column], **ranks: int) -> tuple[Column, ...]:
    """The columns with a rank for those whose title, its spaces as underscores, has one."""
    return tuple(
        replace(column, rank=ranks.get(column.title.replace(" ", "_"), column.rank))
        for column in columns
    )


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
    link: str = ""
    """Anchor of what the page shows of it elsewhere."""
    heat: float | None = None
    """From -1, far within its tolerance, to 1, far beyond it; the page colours it."""


@dataclass(frozen=True)
class Row(Placed):
    """A row of a table; with fewer cells than columns, the last one spans the rest."""

    cells: tuple[Cell, ...]
    anchor: str = ""


@dataclass(frozen=True)
class Table(Placed):
    """Rows of cells under columns; without rows it is not shown, without titles it has no head."""

    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    caption: str = ""

    @property
    def has_head(self) -> bool:
        """Whether any column has a title."""
        return any(column.title or column.unit for column in self.columns)

    def columns_in(self, medium: Medium) -> list[Column]:
        """Columns that the medium shows."""
        return in_medium(self.columns, medium)

    def rows_in(self, medium: Medium) -> list[tuple[Row, list[tuple[Cell, int]]]]:
        """Rows that the medium shows; each cell with the number of shown columns that it spans."""
        visible = [column.medium in ("any", medium) for column in self.columns]
        rows: list[tuple[Row, list[tuple[Cell, int]]]] = []
        for row in in_medium(self.rows, medium):
            spans = [*map(int, visible[: len(row.cells) - 1]), sum(visible[len(row.cells) - 1 :])]
            rows.append(
                (row, [(cell, span) for cell, span in zip(row.cells, spans, strict=True) if span])
            )
        return rows

    def groups(self) -> list[tuple[str, int]]:
        """Headings over several of the page's columns, with their numbers of columns."""
        groups = [
            (group, len(list(of_it)))
            for group, of_it in groupby(self.columns_in("page"), lambda c: c.group)
        ]
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
    body = tuple(_row(each, parsed) for each in rows)
    cells = [
        [r.cells[i].text for r in body if len(r.cells) == len(parsed)] for i in range(len(parsed))
    ]
    return Table(
        tuple(column.laid_out(i, cells[i]) for i, column in enumerate(parsed)),
        body,
        caption,
        medium=medium,
    )


def without_empty_columns(shown: Table) -> Table:
    """The table without columns in which no row has a value or a verdict; the first one stays."""
    count = len(shown.columns)
    whole = [each.cells for each in shown.rows if len(each.cells) == count]
    kept = {0, *(i for i in range(count) if any(_says_something(cells[i]) for cells in whole))}

    def without(row: Row) -> Row:
        last = len(row.cells) - 1  # spans the rest, where the row has fewer cells
        spans = last < count - 1
        return replace(
            row,
            cells=tuple(c for i, c in enumerate(row.cells) if i in kept or (spans and i == last)),
        )

    columns = tuple(column for i, column in enumerate(shown.columns) if i in kept)
    return replace(shown, columns=columns, rows=tuple(map(without, shown.rows)))


def _says_something(cell: Cell) -> bool:
    return cell.text not in ("", "–") or cell.mark in ("good", "bad", "warning")


def _row(each: object, heads: Iterable[Column]) -> Row:
    if isinstance(each, Row):
        return each
    return row(*each) if isinstance(each, tuple) else row(*(column.of(each) for column in heads))


def row(*values: object, anchor: str = "", medium: Medium = "any") -> Row:
    """A row from plain values."""
    cells = (value if isinstance(value, Cell) else Cell(format_value(value)) for value in values)
    return Row(tuple(cells), anchor, medium=medium)


@dataclass(frozen=True)
class Figure(Placed):
    """Plots with their title and the sentence that says how to read them."""

    plot: Panels | Callable[[], Panels]
    """Or what draws it, for a page only."""
    title: str = ""
    caption: str = ""
    anchor: str = ""
    group: str = ""
    """Figures of one group zoom together."""
    columns: int = 0
    """Plots in a row where there is room; 0: up to three."""
    medium: Medium = field(default="page", kw_only=True)

    def panels(self) -> Panels:
        """The plots."""
        return self.plot() if callable(self.plot) else self.plot


@dataclass(frozen=True)
class Grid(Placed):
    """Figures beside each other, as many as there is room for."""

    blocks: tuple[Figure, ...]
    medium: Medium = field(default="page", kw_only=True)


@dataclass(frozen=True)
class AnimationBlock(Placed):
    """Mechanisms in motion, with their runs over the reference; one is shown at a time."""

    scenes: tuple[Scene, ...] | Callable[[], tuple[Scene, ...]]
    """Or what makes them, for a page only."""
    title: str = "Motion"
    anchor: str = "motion"
    medium: Medium = field(default="page", kw_only=True)


@dataclass(frozen=True)
class Code(Placed):
    """A text to copy, or data, as it is."""

    title: str
    text: str


@dataclass(frozen=True)
class Fold(Placed):
    """Blocks behind a title that opens them."""

    title: str
    blocks: tuple[Block, ...]
    opened: bool = False
    anchor: str = ""
    medium: Medium = field(default="page", kw_only=True)


Block = Heading | Text | Listing | Tiles | Table | Figure | Grid | AnimationBlock | Code | Fold


@dataclass(frozen=True)
class Document:
    """A report: its title, its blocks, and the title of the window it is shown in."""

    title: str
    blocks: tuple[Block, ...]
    window: str = "trebucheck"
    command: str = ""
    """Command line that makes this report again."""
    verdict: str = ""
    """The whole in a line, for who asks for no more; the title where it is empty."""


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
