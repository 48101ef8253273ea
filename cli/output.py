"""What the commands share on the way out: the progress bar, the files, and the closing line."""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

    from ..comparisons.report.document import Document
    from ..comparisons.runs.study import Progress

Page = Callable[[], str]


@contextmanager
def progress(what: str = "reference", width: int = 40) -> Generator[Progress]:
    """A bar on standard error, where that is a terminal.

    Args:
        what: comes first, before any part has begun.
        width: of the part's name, in characters.
    """
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar

    from ..comparisons.report.terminal import progress_console

    columns = (TextColumn(f"{{task.description:<{width}}}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    to = progress_console()
    with Bar(*columns, console=to, transient=True, disable=not to.is_terminal) as bar:
        task = bar.add_task(what, total=None)
        yield lambda part, done, of: bar.update(task, description=part, completed=done, total=of)


def write_all(data: tuple[Path, str], page: Path, report: Document, called: str, *, current: bool = False) -> None:
    """The same for results that are a document.

    Raises:
        InputError: the folder cannot be written to.
    """
    from ..comparisons.report import html, terminal

    write(data, (page, partial(html.page, report)), partial(terminal.show, report), called, current=current)


def write(
    data: tuple[Path, str],
    page: tuple[Path, Page] | None,
    show: Callable[[Console], None],
    called: str,
    *,
    current: bool = False,
) -> None:
    """Write a command's data and its page, each whole or not at all, print its tables and say where the files are.

    Args:
        data: path and text.
        page: path, and what makes the text; None: the command has none.
        show: prints the results.
        called: what the page is called in the closing line.
        current: nothing is new since the page was written, if the same data are on disk; it is left as it is.

    Raises:
        InputError: the folder cannot be written to.
    """
    from ..comparisons.report.terminal import console
    from ..models.files import write_text

    path, text = data
    current = current and page is not None and page[0].is_file() and path.is_file() and path.read_text("utf-8") == text
    if not current:
        if page is not None:  # before the data: data on disk say that their page was written
            write_text(page[0], page[1]())
        write_text(path, text)
    show(console())
    report = f"{called}: {page[0]}   " if page is not None else ""
    console().print(f"\n{report}Data: {path}", soft_wrap=True)
