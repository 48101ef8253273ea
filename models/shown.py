"""Display of descriptions and results: a line, a table or report in a notebook, plots.

Reports stand above what they are about, in packages that import it. So a result asks the renderer
that the package installs when it is imported (`show_with`), and knows no module of a report.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


class Playable(Protocol):
    """An animation of a motion."""

    def to_html(self) -> str:
        """Returns a page of its own."""
        ...

    def save(self, path: str | Path, width: int = 640) -> None:
        """Writes a .gif, .mp4, .svg or .html, by its ending; the width is of a picture [px]."""
        ...


class Renderer(Protocol):
    """Makes reports, pages, figures and animations of results."""

    def document(self, result: Any) -> Any:
        """Returns the report of a result as a document of blocks."""
        ...

    def frame(self, result: Reported) -> str:
        """Returns the report's page as a fragment for a notebook."""
        ...

    def write(self, result: Reported, path: str | Path) -> None:
        """Writes the report's page."""
        ...

    def figure(self, result: Reported, name: str | None = None) -> Figure:
        """Returns a figure of the report; the first one if no name is given."""
        ...

    def animation(self, reference: Any, others: Sequence[Any]) -> Playable:
        """Returns a trajectory in motion, with others over it."""
        ...


_installed: list[Callable[[], Renderer]] = []
_reports: dict[type, Callable[[Any], Any]] = {}


def show_with(load: Callable[[], Renderer]) -> None:
    """Installs the renderer of all results.

    Args:
        load: imports and returns it; called whenever something is shown, so that importing the
            package imports no report.
    """
    _installed[:] = [load]


def renderer() -> Renderer:
    """Returns the renderer that is installed."""
    if not _installed:
        raise RuntimeError("no renderer is installed; `import trebucheck` installs one.")
    return _installed[0]()


def report_with(kind: type, document: Callable[[Any], Any]) -> None:
    """Registers what makes the report of a class of results, for results of other distributions."""
    _reports[kind] = document


class Shown:
    """A description or a result with a `headline` in a line and `facts` in a small table."""

    def headline(self) -> str:
        """The description in a line."""
        raise NotImplementedError

    def facts(self) -> Iterable[tuple[str, str]]:
        """Names and values, each in a few words."""
        return ()

    def __repr__(self) -> str:
        return f"<{self.headline()}>"

    def __str__(self) -> str:
        return self.headline()

    def _repr_html_(self) -> str:
        left = 'style="text-align:left"'
        rows = "".join(
            f'<tr><th scope="row" {left}>{escape(name)}</th><td>{escape(value)}</td></tr>'
            for name, value in self.facts()
        )
        return f"<table><caption {left}>{escape(self.headline())}</caption>{rows}</table>"


class Reported(Shown):
    """A result with a report: a page, plots, and rows of data."""

    def document(self) -> Any:
        """The report as a list of blocks (`comparisons/report/document.py`)."""
        for kind, document in _reports.items():
            if isinstance(self, kind):
                return document(self)
        return renderer().document(self)

    def rows(self) -> Iterable[Mapping[str, object]]:
        """Rows of data, a mapping each."""
        raise NotImplementedError

    def to_dataframe(self) -> pd.DataFrame:
        """Rows of data as a pandas data frame."""
        import pandas as pd

        return pd.DataFrame(list(self.rows()))

    def plot(self, name: str | None = None) -> Figure:
        """A figure of the report by Matplotlib.

        Args:
            name: of the figure, as its link in the report has it; the first one if left out.

        Raises:
            InputError: the report has no figure of that name; the sentence lists them.
        """
        return renderer().figure(self, name)

    def write_html(self, path: str | Path) -> None:
        """Write the report as one HTML file that needs nothing else.

        Raises:
            UnwritableError: the folder cannot be written to, or has no room.
        """
        renderer().write(self, path)

    def _repr_html_(self) -> str:
        return renderer().frame(self)
