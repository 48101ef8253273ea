"""A document as Markdown: what a page has, without its plots; folds are those of GitHub."""

from __future__ import annotations

import re
from collections.abc import Iterable

from .document import (
    SIGNS,
    AnimationBlock,
    Block,
    Cell,
    Code,
    Document,
    Figure,
    Fold,
    Grid,
    Heading,
    Listing,
    Table,
    Text,
    Tiles,
    in_medium,
)


def text(document: Document, *, signs: bool = False) -> str:
    """The document; its title is a heading where it has one.

    Args:
        signs: put the sign of its mark before each text and cell that has one, and strong cells in
            bold.
    """
    title = [f"# {document.title}"] if document.title else []
    return "\n\n".join([*title, *_parts(document.blocks, signs)]) + "\n"


def _parts(blocks: Iterable[Block], signs: bool) -> list[str]:
    return [part for block in in_medium(blocks, "page") if (part := _part(block, signs))]


def _part(block: Block, signs: bool) -> str:
    match block:
        case Heading():
            part = f"{'#' * block.level} {block.text}"
        case Text():
            part = _paragraph(block, signs)
        case Listing():
            part = "\n".join(
                f"{'1.' if block.ordered else '-'} {_paragraph(item, signs)}"
                for item in block.items
            )
        case Tiles():
            part = ", ".join(f"**{tile.value}** {tile.label}" for tile in block.tiles)
        case Table():
            part = _table(block, signs)
        case Code():
            part = f"{block.title}\n\n```\n{block.text.rstrip()}\n```"
        case Figure():
            part = f"**{block.title}** {block.caption}".rstrip()
        case AnimationBlock():
            part = ""
        case Grid():
            part = "\n\n".join(_parts(block.blocks, signs))
        case Fold():
            inner = "\n\n".join(_parts(block.blocks, signs))
            part = f"<details><summary>{_plain(block.title)}</summary>\n\n{inner}\n\n</details>"
        case _:  # an animation, which only a page can show
            part = ""
    return part


def _paragraph(block: Text, signs: bool) -> str:
    sign = _sign(block, signs and block.kind == "text")
    return (
        f"{sign}**{_plain(block.lead)}** {_plain(block.text)}"
        if block.lead
        else f"{sign}{_plain(block.text)}"
    )


def _table(block: Table, signs: bool) -> str:
    titles = [column.heading for column in block.columns_in("page")]
    rows = [
        [text for cell, span in cells for text in (_signed(cell, signs), *[""] * (span - 1))]
        for _, cells in block.rows_in("page")
    ]
    caption = [f"**{_plain(block.caption)}**", ""] if block.caption else []
    return "\n".join([*caption, _line(titles), "|---" * len(titles) + "|", *map(_line, rows)])


def _line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(_plain(cell).replace("|", "\\|") for cell in cells) + " |"


def _signed(cell: Cell, signs: bool) -> str:
    text = f"**{cell.text}**" if signs and cell.mark == "strong" else cell.text
    return _sign(cell, signs and bool(cell.text)) + text


def _sign(of: Text | Cell, shown: bool) -> str:
    return f"{SIGNS[of.mark]} " if shown and of.mark in SIGNS else ""


def _plain(text: str) -> str:
    """On one line, and without tags: what an engine says is no HTML."""
    return re.sub(r"<(?=[A-Za-z/!?])", "&lt;", " ".join(text.splitlines()))


def block(text: str, name: str) -> str:
    """The part of a page between `<!-- generated: name -->` and `<!-- end -->`.

    Raises:
        ValueError: the page has no such block.
    """
    found = re.search(_BLOCK.format(name=re.escape(name)), text, re.DOTALL)
    if found is None:
        raise ValueError(f"the page has no block {name!r}")
    return found[2]


def with_block(text: str, name: str, content: str) -> str:
    """Replace the part of a page between `<!-- generated: name -->` and `<!-- end -->`.

    Raises:
        ValueError: the page has no such block.
    """
    block(text, name)
    replaced = _BLOCK.format(name=re.escape(name))
    return re.sub(replaced, lambda match: match[1] + content + match[3], text, flags=re.DOTALL)


_BLOCK = r"(<!-- generated: {name} -->\n)(.*?)(<!-- end -->)"
