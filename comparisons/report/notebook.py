"""Reports in a session: as a page in a frame or a file, and their figures by Matplotlib."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

from markupsafe import escape

from ...models.errors import InputError
from ...models.files import write_text
from ...models.shown import Reported
from . import html
from .document import Document
from .figures import figures_of, picture

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_HEIGHT = 640
"""Of a report's frame [px]."""


def frame(result: Reported) -> str:
    """The report's page as a fragment for a notebook: a frame of its own, which needs no other file."""
    shown: Document = result.document()
    page = escape(html.page(shown))
    style = f"width:100%;height:{_HEIGHT}px;border:1px solid #8883"
    return f'<iframe title="{escape(shown.title)}" style="{style}" srcdoc="{page}"></iframe>'


def write(result: Reported, path: str | Path) -> None:
    """Write the report's page.

    Raises:
        UnwritableError: the folder cannot be written to, or has no room.
    """
    write_text(Path(path), html.page(result.document()))


def figure(result: Reported, name: str | None = None) -> Figure:
    """A figure of the report, the first one if no name is given.

    Raises:
        InputError: there is none of that name.
    """
    found = figures_of(result.document())
    chosen = next(iter(found), None) if name is None else name
    if chosen is None or chosen not in found:
        what = (
            "has no figure"
            if not found
            else f"has no figure {chosen!r}; there are {', '.join(found)}"
        )
        raise InputError(f"the report of {result} {what}.")
    block = found[chosen]
    drawn = picture(block.panels(), block.columns or 3, block.title)
    # Notebooks show a figure that pyplot knows; this one it does not, so it brings its own picture.
    vars(drawn)["_repr_png_"] = lambda: _png(drawn)
    return drawn


def _png(figure: Figure) -> bytes:
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=110)
    return out.getvalue()
