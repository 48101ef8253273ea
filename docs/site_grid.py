"""The grid of verdicts in the documentation's site: mkdocs calls these when it builds it.

The page is made from the results that the repository holds, and kept nowhere else.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import trebucheck as tb
from trebucheck.comparisons.report import html
from trebucheck.comparisons.report.pages.matrix import document

ROOT = Path(__file__).parents[1]
PLACE, NAME = "<!-- grid -->", "grid.html"


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """The page of the matrix with a link to the grid, which only the site has."""
    if page.file.src_uri != "matrix.md":
        return markdown
    return markdown.replace(PLACE, f'<a class="md-button" href="{NAME}">Open the grid</a>\n')


def on_post_build(config: Any, **_: Any) -> None:
    """Write the grid beside the site's pages."""
    matrix = tb.matrix(sorted(ROOT.glob("*/results/*.json")))
    links = {run.engine: f"engines/{run.engine}.html" for run in matrix.runs}
    page = html.page(document(matrix, links))
    Path(config.site_dir, NAME).write_text(page, encoding="utf-8")
