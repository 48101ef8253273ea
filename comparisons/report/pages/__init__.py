"""Pages: the report of each command as a document of blocks; the renderer of results in a session.

`import trebucheck` installs this package as the renderer of `models/shown.py`, which says what its
functions raise: reports, pages in a frame or a file, figures, animations.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from markupsafe import escape

from ....models.errors import InputError
from ....models.files import write_text
from ....models.shown import Reported
from ....models.trajectory import Trajectory
from .. import html
from ..document import Document, figures_of
from ..plots import picture

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..drawing.animation import Animation

_HEIGHT = 640  # of a report's frame [px]


@cache
def _pages() -> dict[type, Callable[[Any], Document]]:
    """Maker of the report of each class of results; imported when the first report is made."""
    from ....reference.certification.certificate import Certificate
    from ....reference.throw.throw import Throw
    from ...audit import Audit
    from ...compare import Comparison
    from ...converge import Studies
    from ...diff import Difference
    from ...explain import Explanation
    from ...horizon import Horizon
    from ...recommend import Advice
    from . import audit, compare, converge, diff, explain, horizon, recommend, run, throw

    made: dict[type, Callable[[Any], Document]] = {
        Comparison: compare.document,
        Studies: converge.document,
        Explanation: explain.document,
        Horizon: horizon.document,
        Audit: audit.document,
        Advice: recommend.document,
        Difference: diff.document,
        Trajectory: run.document,
        Certificate: run.certificate_report,
        Throw: lambda one: throw.document(one.performance, one),
    }
    if find_spec("pyarrow") is not None:  # which is an extra
        from ...campaigns.changes import CampaignDifference
        from ...campaigns.store import CampaignStore
        from . import campaign

        made[CampaignStore] = campaign.document
        made[CampaignDifference] = campaign.difference_document
    return made


def document(result: object) -> Document:
    """Make the report of a result.

    Raises:
        TypeError: results of its class have no report here.
    """
    for kind, make in _pages().items():
        if isinstance(result, kind):
            return make(result)
    raise TypeError(f"there is no report of {type(result).__name__}.")


def animation(reference: Trajectory, others: Sequence[Trajectory]) -> Animation:
    """Make an animation of a trajectory, with others of the same mechanism over it.

    Raises:
        InputError: another one is of another mechanism.
    """
    from ...runs.runner import horizon_of
    from ..drawing.animation import Animation
    from ..plots import motions_scene

    shown = motions_scene(reference, others, horizon_of([reference, *others]))
    return Animation((shown,), f"{shown.mechanism_title}: the motion")


def frame(result: Reported) -> str:
    """The report's page as a fragment for a notebook: a frame that needs no other file."""
    shown: Document = result.document()
    page = escape(html.page(shown))
    style = f"width:100%;height:{_HEIGHT}px;border:1px solid #8883"
    return f'<iframe title="{escape(shown.title)}" style="{style}" srcdoc="{page}"></iframe>'


def write(result: Reported, path: str | Path) -> None:
    """Write the report's page."""
    write_text(Path(path), html.page(result.document()))


def figure(result: Reported, name: str | None = None) -> Figure:
    """Draw a figure of the report, the first one if no name is given."""
    figures = figures_of(result.document())
    if not figures:
        raise InputError(f"the report of {result} has no figure.")
    chosen = next(iter(figures)) if name is None else name
    if chosen not in figures:
        raise InputError(
            f"the report of {result} has no figure {chosen!r}; there are {', '.join(figures)}."
        )
    block = figures[chosen]
    drawn = picture(block.panels(), block.columns or 3, block.title)

    def png() -> bytes:
        out = io.BytesIO()
        drawn.savefig(out, format="png", dpi=110)
        return out.getvalue()

    # Notebooks show a figure that pyplot knows; this one it does not, so it brings its own picture.
    vars(drawn)["_repr_png_"] = png
    return drawn
