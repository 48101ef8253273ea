"""Every logarithmic axis has numbers, however few decades its values span."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from page_checks import DESKTOP, looks
from trebucheck.comparisons.report import html
from trebucheck.comparisons.report.document import Document, Figure
from trebucheck.comparisons.report.plots import Axis, Plot, Series

if TYPE_CHECKING:
    from pathlib import Path

SPANS = (
    (0.0017, 0.0048),
    (0.0208, 0.0449),
    (2.1e-4, 5.1e-4),
    (0.02, 0.5),
    (0.011, 0.9),
    (1.5, 1.6),
    (1e-12, 1.0),
)
LABELS = (
    "[...document.querySelectorAll('.panel svg')].map((svg) => ['x', 'y'].map((axis) => [...svg.querySelectorAll(\
`[aria-label=\"${axis}-axis tick label\"] text`)].filter((label) => label.textContent).length))"
)


def test_a_logarithmic_axis_has_at_least_two_numbers(show: Any, tmp_path: Path) -> None:
    panels = tuple(
        Plot(
            Axis("wall time", "s", logarithmic=True),
            Axis("error", "m", logarithmic=True),
            (series,),
            f"{k}",
        )
        for k, span in enumerate(SPANS)
        for series in [Series("run", np.array(span), np.array(span), mark="points")]
    )
    path = tmp_path / "ticks.html"
    path.write_text(
        html.page(Document("Ticks", (Figure(panels, "Spans", columns=2),))), encoding="utf-8"
    )
    page = show(path).look(DESKTOP)
    looks(
        page, "unfold()"
    )  # a plot is drawn when it is seen, which may be after the page is loaded
    counts = page.evaluate(LABELS)
    assert len(counts) == len(SPANS)
    assert min(least for pair in counts for least in pair) >= 2
