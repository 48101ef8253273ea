"""A document in a terminal, its tables laid out in a number of characters.

No word of a table is cut, and what is left out is named. Tried in this order, until it fits: two
spaces between columns, or one; texts on several lines, broken at spaces; fewer columns, those of
the highest `Column.rank` first, and of one rank the rightmost. Columns of rank 0 stay. Where even
these do not fit, all texts are broken at spaces; where that would still cut a word, and below 40
characters, each row becomes a list.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from rich import table as rich_table
from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.console import Console
from rich.text import Text as Styled

from .document import (
    Block,
    Cell,
    Code,
    Column,
    Document,
    Heading,
    Listing,
    Mark,
    Table,
    Text,
    Tiles,
    in_medium,
)

_GAP = 2
_LIST_BELOW = 40  # characters: there is no room for two columns of names and verdicts
_LEAST = 12  # characters of a text on several lines, unless it is shorter
_LINES = 4  # on which the longest text of a column may be spread


@dataclass(frozen=True)
class Fitted:
    """A column that is shown."""

    column: Column
    cells: tuple[Cell, ...]
    """One a row of the table."""
    least: int
    """Width in which its texts can be read."""
    width: int
    """Width of its texts on one line; or, where the table was made to fit, the one it has."""


@dataclass(frozen=True)
class Layout:
    """Columns of a table that are shown, the spaces between them, and what is left out."""

    columns: tuple[Fitted, ...]
    gap: int
    left_out: tuple[Column, ...] = ()

    @property
    def room(self) -> int:
        """Width of the gaps."""
        return self.gap * (len(self.columns) - 1)

    def within(self, width: int) -> Layout | None:
        """The columns narrowed, the widest first, until they fit; None if that is unreadable."""
        over = sum(column.width for column in self.columns) + self.room - width
        widths = [column.width for column in self.columns]
        for _ in range(over):
            wide = [i for i, column in enumerate(self.columns) if widths[i] > column.least]
            if not wide:
                return None
            widths[max(wide, key=widths.__getitem__)] -= 1
        narrowed = (
            replace(column, width=width) for column, width in zip(self.columns, widths, strict=True)
        )
        return replace(self, columns=tuple(narrowed))

    def without_last(self) -> Layout | None:
        """Without the column that is left out next; None if all must stay."""
        ranks = [0, *(fitted.column.rank for fitted in self.columns[1:])]
        if not max(ranks):
            return None
        last = max(range(len(ranks)), key=lambda i: (ranks[i], i))
        kept = (*self.columns[:last], *self.columns[last + 1 :])
        return Layout(kept, _GAP, (self.columns[last].column, *self.left_out))


def fitted(table: Table, width: int) -> Layout:
    """A table in a terminal of this many characters a line."""
    if width < _LIST_BELOW:
        return _as_lists(table, width)
    layout = Layout(tuple(_columns(table)), _GAP)
    while True:
        if found := _as_it_is(layout, width):
            return found
        fewer = layout.without_last()
        if fewer is None:
            whole = _with_whole_words(layout, width)
            return whole or (_as_lists(table, width) if table.has_head else _broken(layout, width))
        layout = fewer


def _as_it_is(layout: Layout, width: int) -> Layout | None:
    """The layout with all its columns; texts stay on one line if they can."""
    whole = replace(
        layout, columns=tuple(replace(column, least=column.width) for column in layout.columns)
    )
    ways = (replace(each, gap=gap).within(width) for each in (whole, layout) for gap in (_GAP, 1))
    return next((way for way in ways if way is not None), None)


def _with_whole_words(layout: Layout, width: int) -> Layout | None:
    """All texts broken at spaces; None where that is not enough."""
    columns = tuple(
        replace(each, least=_longest_word(_texts(each.column, each.cells)))
        for each in layout.columns
    )
    return replace(layout, columns=columns, gap=1).within(width)


def _broken(layout: Layout, width: int) -> Layout:
    """All texts broken at spaces; words only where there is no other way."""
    torn = tuple(replace(each, least=1) for each in layout.columns)
    return (
        _with_whole_words(layout, width)
        or replace(layout, columns=torn, gap=1).within(width)
        or layout
    )


def _columns(table: Table) -> Iterable[Fitted]:
    columns = table.columns_in("terminal")
    rows = [_spread(cells) for _, cells in table.rows_in("terminal")]
    for column, cells in zip(columns, zip(*rows, strict=True), strict=True):
        texts = _texts(column, cells)
        whole = max(map(cell_len, texts))
        least = max(_longest_word(texts), min(whole, max(_LEAST, math.ceil(whole / _LINES))))
        yield Fitted(column, cells, least if column.wrap else whole, whole)


def _spread(cells: Sequence[tuple[Cell, int]]) -> list[Cell]:
    """One cell a column: of one that spans several, the first has the text."""
    return [each for cell, span in cells for each in (cell, *[Cell("")] * (span - 1))]


def _texts(column: Column, cells: Iterable[Cell]) -> list[str]:
    """Lines of the cells and of the heading."""
    heading = (column.heading_words, f"[{column.unit}]" if column.unit else "")
    return [
        line
        for text in (*heading, *(cell.text for cell in cells))
        for line in text.splitlines() or [""]
    ]


def _longest_word(texts: Iterable[str]) -> int:
    return max((cell_len(word) for text in texts for word in text.split()), default=0)


def _as_lists(table: Table, width: int) -> Layout:
    """Each row as lines of title and value, an empty line between rows."""
    columns = [*_columns(table)]
    lines: list[tuple[Cell, Cell]] = []
    for row in range(len(columns[0].cells)):
        lines += [(Cell(""), Cell(""))] if row else []
        lines += [
            (Cell(each.column.heading_words), each.cells[row])
            for each in columns
            if each.cells[row].text
        ]
    pair = Column("", align="left"), Column("", align="left")
    found = (
        Fitted(head, cells, 0, 0)
        for head, cells in zip(pair, zip(*lines, strict=True), strict=True)
    )
    whole = tuple(replace(f, width=max(map(cell_len, _texts(f.column, f.cells)))) for f in found)
    return _broken(Layout(whole, _GAP), width)


_STYLES: dict[Mark, str] = {
    "plain": "",
    "good": "green",
    "bad": "bold red",
    "warning": "yellow",
    "unjudged": "dim",
    "muted": "dim",
    "strong": "bold",
}


def console() -> Console:
    """Standard output; in a file or a pipe of unstated width each sentence is one line."""
    to = Console(highlight=False)
    to.soft_wrap = not to.is_terminal and "COLUMNS" not in os.environ
    return to


def progress_console() -> Console:
    """Standard error, so that a progress bar never gets between the results."""
    return Console(stderr=True)


def show(document: Document, to: Console) -> None:
    """Print what of a document a terminal has room for."""
    before: Block | None = None
    for block in in_medium(document.blocks, "terminal"):
        if before is not None and (isinstance(before, Table) or isinstance(block, Table)):
            to.print()
        _show(block, to)
        before = block


def _show(block: Block, to: Console) -> None:
    match block:
        case Heading():
            to.print()
            to.rule(Styled(block.text), align="left")
        case Text():
            to.print(_paragraph(block))
        case Listing():
            for item in block.items:
                to.print(_paragraph(item))
        case Table():
            _show_table(block, to)
        case Code():
            to.print(Styled(f"\n# --- {block.title}", style="dim"))
            to.print(Styled(block.text), soft_wrap=True)
        case Tiles():
            to.print(
                _paragraph(Text(", ".join(f"{tile.value} {tile.label}" for tile in block.tiles)))
            )
        case _:
            pass  # figures and folds are for pages


def _paragraph(block: Text) -> Styled:
    if not block.lead:
        return Styled(block.text, style=_STYLES[block.mark])
    return Styled.assemble((block.lead, _STYLES[block.mark]), " ", block.text)


def _show_table(block: Table, to: Console) -> None:
    """The table under its caption; what had no room is named in a line below it."""
    layout = fitted(block, to.width)
    if block.caption:
        to.print(Styled(block.caption, style="bold"))
    titled = any(column.column.heading for column in layout.columns)
    drawn = rich_table.Table(
        box=SIMPLE_HEAD,
        show_edge=False,
        padding=(0, layout.gap - 1, 0, 0),
        pad_edge=False,
        show_header=titled,
    )
    for column in layout.columns:
        heading = _heading(column.column)
        drawn.add_column(
            heading, justify=column.column.align or "left", width=column.width, overflow="fold"
        )
    for row in zip(*(column.cells for column in layout.columns), strict=True):
        drawn.add_row(*(Styled(cell.text, style=_STYLES[cell.mark]) for cell in row))
    to.print(drawn, soft_wrap=False)
    if layout.left_out:
        names = ", ".join(column.heading_words for column in layout.left_out)
        to.print(Styled(f"Not shown in {to.width} columns: {names}.", style="dim"))


def _heading(column: Column) -> Styled:
    return Styled(
        f"{column.heading_words}\n[{column.unit}]" if column.unit else column.heading_words
    )
