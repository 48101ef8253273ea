"""A document as Markdown: what a page has, without its plots."""

from __future__ import annotations

from collections.abc import Iterable

from .document import Block, Code, Document, Figure, Fold, Heading, Listing, Table, Text, Tiles, in_medium


def text(document: Document) -> str:
    """The document; its title is a heading where it has one."""
    title = [f"# {document.title}"] if document.title else []
    return "\n\n".join([*title, *_parts(document.blocks)]) + "\n"


def _parts(blocks: Iterable[Block]) -> list[str]:
    return [_part(block) for block in in_medium(blocks, "page")]


def _part(block: Block) -> str:
    match block:
        case Heading():
            part = f"{'#' * block.level} {block.text}"
        case Text():
            part = _paragraph(block)
        case Listing():
            part = "\n".join(f"{'1.' if block.ordered else '-'} {_paragraph(item)}" for item in block.items)
        case Tiles():
            part = ", ".join(f"**{tile.value}** {tile.label}" for tile in block.tiles)
        case Table():
            part = _table(block)
        case Code():
            part = f"{block.title}\n\n```\n{block.text.rstrip()}\n```"
        case Figure():
            part = f"**{block.title}** {block.caption}".rstrip()
        case Fold():
            part = "\n\n".join([f"**{block.title}**", *_parts(block.blocks)])
    return part


def _paragraph(block: Text) -> str:
    return f"**{block.lead}** {block.text}" if block.lead else block.text


def _table(block: Table) -> str:
    titles = [column.heading for column in block.columns_in("page")]
    rows = [[t for cell, span in cells for t in (cell.text, *[""] * (span - 1))] for _, cells in block.rows_in("page")]
    caption = [f"**{block.caption}**", ""] if block.caption else []
    return "\n".join([*caption, _line(titles), "|---" * len(titles) + "|", *map(_line, rows)])


def _line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in cells) + " |"
