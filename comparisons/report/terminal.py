"""A document in a terminal."""

from __future__ import annotations

from functools import cache

from rich import table as rich_table
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.text import Text as Styled

from .document import Block, Code, Column, Document, Heading, Listing, Mark, Table, Text, Tiles, in_medium

_STYLES: dict[Mark, str] = {
    "plain": "",
    "good": "green",
    "bad": "bold red",
    "warning": "yellow",
    "muted": "dim",
    "strong": "bold",
}


@cache
def console() -> Console:
    """Standard output."""
    return Console(highlight=False)


def progress_console() -> Console:
    """Standard error, so that a progress bar never gets between the results."""
    return Console(stderr=True)


def show(document: Document, to: Console) -> None:
    """Print what of a document a terminal has room for."""
    for block in in_medium(document.blocks, "terminal"):
        _show(block, to)


def _show(block: Block, to: Console) -> None:
    match block:
        case Heading():
            to.print()
            to.rule(Styled(block.text), align="left")
        case Text():
            to.print(_paragraph(block), soft_wrap=True)
        case Listing():
            for item in block.items:
                to.print(_paragraph(item), soft_wrap=True)
        case Table():
            to.print(_table(block, to.width))
        case Code():
            to.print(Styled(f"\n# --- {block.title}", style="dim"))
            to.print(Styled(block.text), soft_wrap=True)
        case Tiles():
            to.print(_paragraph(Text(", ".join(f"{tile.value} {tile.label}" for tile in block.tiles))))
        case _:
            pass  # figures and folds are for pages


def _paragraph(block: Text) -> Styled:
    if not block.lead:
        return Styled(block.text, style=_STYLES[block.mark])
    return Styled.assemble((block.lead, _STYLES[block.mark]), " ", block.text)


def _table(block: Table, width: int) -> rich_table.Table:
    drawn = rich_table.Table(
        title=Styled(block.caption) if block.caption else None,
        title_justify="left",
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        pad_edge=False,
        show_header=block.has_head,
    )
    columns, rows = block.columns_in("terminal"), block.rows_in("terminal")
    for column in columns:
        drawn.add_column(_heading(column), justify=column.align or "left", no_wrap=not column.wrap, overflow="fold")
    for _, cells in rows:
        drawn.add_row(*(Styled(cell.text, style=_STYLES[cell.mark]) for cell, _ in cells))
    if sum(map(_least_width, drawn.columns)) > width:  # no_wrap would cut texts off
        for column in drawn.columns:
            column.no_wrap = False
    return drawn


def _least_width(column: rich_table.Column) -> int:
    """Of a column with its gap, no word of it broken."""
    texts = [str(text) for text in (column.header, *column.cells)]
    parts = [part for text in texts for part in (text.splitlines() if column.no_wrap else text.split())]
    return 2 + max(map(len, parts), default=0)


def _heading(column: Column) -> Styled:
    title = column.short or column.title
    return Styled(f"{title}\n[{column.unit}]" if column.unit else title)
