"""What users hold in a session: printed in one line, in a notebook a table or a report, with plots and data frames.

Reports stand above what they are about, in packages that import it, so they are loaded when asked
for, by name.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from html import escape
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

NOTEBOOK = "comparisons.report.notebook"
_ROOT = (__package__ or "").rpartition(".")[0]


def load_module(name: str) -> Any:
    """A module of this package, by its name from the package's root."""
    return import_module(f"{_ROOT}.{name}")


class Shown:
    """A description or a result that says what it is: `headline` in a line, `facts` in a small table."""

    def headline(self) -> str:
        """What it is, in a line."""
        raise NotImplementedError

    def facts(self) -> Iterable[tuple[str, str]]:
        """Names and values, each in a few words."""
        return ()

    def __repr__(self) -> str:
        return f"<{self.headline()}>"

    def __str__(self) -> str:
        return self.headline()

    def _repr_html_(self) -> str:
        rows = (
            f'<tr><th scope="row" style="text-align:left">{escape(name)}</th><td>{escape(value)}</td></tr>'
            for name, value in self.facts()
        )
        return f'<table><caption style="text-align:left">{escape(self.headline())}</caption>{"".join(rows)}</table>'


class Reported(Shown):
    """A result with a report: a page, plots, and rows of data."""

    reported_by: ClassVar[str]
    """Name of the module whose `document` makes the report of it."""

    def document(self) -> Any:
        """The report as a list of blocks (`comparisons/report/document.py`)."""
        return load_module(self.reported_by).document(self)

    def rows(self) -> Iterable[Mapping[str, object]]:
        """What was found, a mapping a row."""
        raise NotImplementedError

    def to_dataframe(self) -> pd.DataFrame:
        """What was found as a pandas data frame."""
        import pandas as pd

        return pd.DataFrame(list(self.rows()))

    def plot(self, name: str | None = None) -> Figure:
        """A figure of the report by Matplotlib.

        Args:
            name: of the figure, as its link in the report has it; the first one if left out.

        Raises:
            InputError: the report has no figure of that name; the sentence lists them.
        """
        return load_module(NOTEBOOK).figure(self, name)

    def write_html(self, path: str | Path) -> None:
        """Write the report as one HTML file that needs nothing else.

        Raises:
            UnwritableError: the folder cannot be written to, or has no room.
        """
        load_module(NOTEBOOK).write(self, path)

    def _repr_html_(self) -> str:
        return load_module(NOTEBOOK).frame(self)
