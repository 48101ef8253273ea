"""A document in a terminal."""

from __future__ import annotations

import os

from rich import table as rich_table
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.text import Text as Styled

from .document import (
    Block,
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
from .layout import fitted

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
