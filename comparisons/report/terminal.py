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
from collections.abc import Sequence
from dataclasses import dataclass, replace

from rich import table as rich_table
from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.console import Console
from rich.text import Text as Styled

from . import document as doc
from .document import Cell, Column

_GAP = 2
_LIST_BELOW = 40  # characters: there is no room for two columns of names and verdicts
_LEAST = 12  # characters of a text on several lines, unless it is shorter
_LINES = 4  # on which the longest text of a column may be spread


@dataclass(frozen=True)
class Fitted:
    """A column that is shown."""

    column: Column
    cells: tuple[Cell, ...]  # one a row of the table
    word: int  # width of its longest word
    least: int  # width in which its texts can be read
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

    def within(self, width: int, gap: int, least: Sequence[int]) -> Layout | None:
        """The columns narrowed, the widest first, until they fit; None if they get too narrow."""
        widths = [column.width for column in self.columns]
        for _ in range(sum(widths) + gap * (len(widths) - 1) - width):
            wide = [i for i, narrowest in enumerate(least) if widths[i] > narrowest]
            if not wide:
                return None
            widths[max(wide, key=widths.__getitem__)] -= 1
        pairs = zip(self.columns, widths, strict=True)
        return replace(self, columns=tuple(replace(c, width=w) for c, w in pairs), gap=gap)

    def with_whole_words(self, width: int) -> Layout | None:
        """Texts broken at spaces; None where that is not enough."""
        return self.within(width, 1, [column.word for column in self.columns])

    def broken(self, width: int) -> Layout:
        """Texts broken at spaces; words only where there is no other way."""
        torn = self.within(width, 1, [1] * len(self.columns))
        return self.with_whole_words(width) or torn or self


def fitted(table: doc.Table, width: int) -> Layout:
    """A table in a terminal of this many characters a line."""
    rows: list[list[Cell]] = []
    for _, spanning in table.rows_in("terminal"):
        rows.append([])
        for cell, span in spanning:  # of columns that a cell spans, the first has its text
            rows[-1] += [cell, *[Cell("")] * (span - 1)]
    pairs = zip(table.columns_in("terminal"), zip(*rows, strict=True), strict=True)
    every = [_measured(column, cells) for column, cells in pairs]
    columns, left_out = [*every], list[Column]()
    while width >= _LIST_BELOW:
        layout = Layout(tuple(columns), _GAP, tuple(left_out))
        on_one_line = [column.width for column in columns]
        for least in (on_one_line, [column.least for column in columns]):
            for gap in (_GAP, 1):
                narrowed = layout.within(width, gap, least)
                if narrowed is not None:
                    return narrowed
        ranks = [0, *(column.column.rank for column in columns[1:])]
        if not max(ranks):  # all these columns must stay
            if table.has_head and layout.with_whole_words(width) is None:
                break
            return layout.broken(width)
        last = max(range(len(ranks)), key=lambda i: (ranks[i], i))
        left_out.insert(0, columns.pop(last).column)
    # Each row as lines of title and value, an empty line between rows.
    titles: list[Cell] = []
    values: list[Cell] = []
    for row in range(len(rows)):
        if row:
            titles.append(Cell(""))
            values.append(Cell(""))
        for column in every:
            if column.cells[row].text:
                titles.append(Cell(column.column.heading_words))
                values.append(column.cells[row])
    head = Column("", align="left")
    return Layout((_measured(head, titles), _measured(head, values)), _GAP).broken(width)


def _measured(column: Column, cells: Sequence[Cell]) -> Fitted:
    lines: list[str] = []
    unit = f"[{column.unit}]" if column.unit else ""
    for text in (column.heading_words, unit, *(cell.text for cell in cells)):
        lines += text.splitlines() or [""]
    whole = max(map(cell_len, lines))
    word = max((cell_len(word) for line in lines for word in line.split()), default=0)
    least = whole
    if column.wrap:
        least = max(word, min(whole, max(_LEAST, math.ceil(whole / _LINES))))
    return Fitted(column, tuple(cells), word, least, whole)


_STYLES: dict[doc.Mark, str] = {
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


def show(document: doc.Document, to: Console) -> None:
    """Print what of a document a terminal has room for; figures and folds are for pages."""
    before: doc.Block | None = None
    for block in doc.in_medium(document.blocks, "terminal"):
        if before is not None and (isinstance(before, doc.Table) or isinstance(block, doc.Table)):
            to.print()
        before = block
        match block:
            case doc.Heading():
                to.print()
                to.rule(Styled(block.text), align="left")
            case doc.Text():
                to.print(_paragraph(block))
            case doc.Listing():
                for item in block.items:
                    to.print(_paragraph(item))
            case doc.Table():
                _show_table(block, to)
            case doc.VerdictGrid():
                for table in block.compact:
                    _show_table(table, to)
            case doc.Code():
                to.print(Styled(f"\n# --- {block.title}", style="dim"))
                to.print(Styled(block.text), soft_wrap=True)
            case doc.Tiles():
                to.print(Styled(", ".join(f"{tile.value} {tile.label}" for tile in block.tiles)))
            case _:
                pass


def _paragraph(block: doc.Text) -> Styled:
    if not block.lead:
        return Styled(block.text, style=_STYLES[block.mark])
    return Styled.assemble((block.lead, _STYLES[block.mark]), " ", block.text)


def _show_table(block: doc.Table, to: Console) -> None:
    """The table under its caption; what had no room is named in a line below it."""
    layout = fitted(block, to.width)
    if block.caption:
        to.print(Styled(block.caption, style="bold"))
    titled = any(fitted.column.heading for fitted in layout.columns)
    drawn = rich_table.Table(box=SIMPLE_HEAD, show_edge=False, padding=(0, layout.gap - 1, 0, 0),
                             pad_edge=False, show_header=titled)  # fmt: skip
    for shown in layout.columns:
        column, heading = shown.column, shown.column.heading_words
        title = Styled(f"{heading}\n[{column.unit}]" if column.unit else heading)
        side = column.align or "left"
        drawn.add_column(title, justify=side, width=shown.width, overflow="fold")
    for row in zip(*(column.cells for column in layout.columns), strict=True):
        drawn.add_row(*(Styled(cell.text, style=_STYLES[cell.mark]) for cell in row))
    to.print(drawn, soft_wrap=False)
    if layout.left_out:
        names = ", ".join(column.heading_words for column in layout.left_out)
        to.print(Styled(f"Not shown in {to.width} columns: {names}.", style="dim"))
