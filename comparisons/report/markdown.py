"""A document as Markdown: what a page has, without its plots; folds are those of GitHub."""

from __future__ import annotations

import re
from collections.abc import Iterable

from . import document as doc


def text(document: doc.Document, *, signs: bool = False) -> str:
    """The document; its title is a heading where it has one.

    `signs` puts the sign of its mark before each text and cell, and strong cells in bold.
    """
    title = f"# {document.title}" if document.title else ""
    return "\n\n".join(filter(None, (title, _blocks(document.blocks, signs)))) + "\n"


def _blocks(blocks: Iterable[doc.Block], signs: bool) -> str:
    parts: list[str] = []
    for block in doc.in_medium(blocks, "page"):
        match block:
            case doc.Heading():
                parts.append(f"{'#' * block.level} {block.text}")
            case doc.Text():
                parts.append(_paragraph(block, signs))
            case doc.Listing():
                bullet = "1." if block.ordered else "-"
                items = (f"{bullet} {_paragraph(item, signs)}" for item in block.items)
                parts.append("\n".join(items))
            case doc.Tiles():
                tiles = (f"**{tile.value}** {tile.label}" for tile in block.tiles)
                parts.append(", ".join(tiles))
            case doc.Table():
                parts.append(_table(block, signs))
            case doc.Code():
                parts.append(f"{block.title}\n\n```\n{block.text.rstrip()}\n```")
            case doc.Figure():
                parts.append(f"**{block.title}** {block.caption}".rstrip())
            case doc.VerdictGrid():
                parts += [_table(table, signs) for table in block.compact]
            case doc.Grid():
                parts.append(_blocks(block.blocks, signs))
            case doc.Fold():
                title, inner = _plain(block.title), _blocks(block.blocks, signs)
                parts.append(f"<details><summary>{title}</summary>\n\n{inner}\n\n</details>")
            case doc.AnimationBlock():
                pass  # only a page can show it
    return "\n\n".join(filter(None, parts))


def _paragraph(block: doc.Text, signs: bool) -> str:
    sign = _sign(block, signs and not isinstance(block, doc.Note))
    lead = f"**{_plain(block.lead)}** " if block.lead else ""
    return f"{sign}{lead}{_plain(block.text)}"


def _table(block: doc.Table, signs: bool) -> str:
    titles = [column.heading for column in block.columns_in("page")]
    lines = [_line(titles), "|---" * len(titles) + "|"]
    if block.caption:
        lines = [f"**{_plain(block.caption)}**", "", *lines]
    for _, cells in block.rows_in("page"):
        texts: list[str] = []
        for cell, span in cells:
            strong = signs and cell.mark == "strong"
            value = f"**{cell.text}**" if strong else cell.text
            texts += [_sign(cell, signs and bool(cell.text)) + value, *[""] * (span - 1)]
        lines.append(_line(texts))
    return "\n".join(lines)


def _line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(_plain(cell).replace("|", "\\|") for cell in cells) + " |"


def _sign(of: doc.Text | doc.Cell, shown: bool) -> str:
    return f"{doc.SIGNS[of.mark]} " if shown and of.mark in doc.SIGNS else ""


def _plain(text: str) -> str:
    """Put a text on one line, without tags: what an engine says is no HTML."""
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
