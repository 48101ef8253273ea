"""Output that commands share: the progress bar, the files, and the closing line."""

from __future__ import annotations

import shlex
import sys
import time
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from ..comparisons.report.document import Document
    from ..comparisons.runs.store import Store
    from ..comparisons.runs.study import Progress

_EVER = 1e9  # [s]
_BETWEEN = 30.0
"""[s] between two lines of progress where there is no terminal."""


@dataclass(frozen=True)
class Told:
    """Amount that a command says: all, by default."""

    quiet: bool = False
    """The verdict in a line, and the files; no progress."""
    json: bool = False
    """On standard output the results, nothing else."""


ALL = Told()


@contextmanager
def progress(what: str = "reference", width: int = 40, told: Told = ALL) -> Generator[Progress]:
    """Show a bar on standard error, where that is a terminal, with the estimated time left.

    Elsewhere, as in CI, a line now and then, once the work has gone on for that long.

    Args:
        what: comes first, before any part has begun.
        width: of the part's name, in characters.
        told: how much the command says.
    """
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )
    from rich.progress import Progress as Bar

    from ..comparisons.report.terminal import progress_console

    to = progress_console()
    columns = (
        TextColumn(f"{{task.description:<{min(width, to.width // 2)}}}"),
        BarColumn(20),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("left"),
    )
    if not (told.quiet or to.is_terminal):
        yield _lines(what)
        return
    # The estimate looks back on everything done: parts are few, and some take many times as long as
    # others.
    with Bar(
        *columns, console=to, transient=True, disable=told.quiet, speed_estimate_period=_EVER
    ) as bar:
        task = bar.add_task(what, total=None)
        yield lambda part, done, of: bar.update(task, description=part, completed=done, total=of)


def _lines(what: str) -> Progress:
    """Progress for a log: not a line a part, which may be many."""
    due = time.monotonic() + _BETWEEN

    def show(part: str, done: int, of: int) -> None:
        nonlocal due
        if time.monotonic() >= due:
            due = time.monotonic() + _BETWEEN
            print(f"{done} of {of}: {part or what}", file=sys.stderr, flush=True)

    return show


def publish(
    data: tuple[Path, str],
    report: Document,
    page: Path | None = None,
    called: str = "Report",
    *,
    store: Store | None = None,
    current: bool = False,
    beside: Mapping[str, tuple[Path, str]] | None = None,
    told: Told = ALL,
) -> None:
    """Write a command's data and page, whole or not at all, and show the report with the paths.

    Args:
        data: path and text.
        page: path of the report as a page; None: the command has none.
        called: what the page is called in the closing line.
        store: of the runs; the report says how many of them were taken from it.
        current: nothing is new since the page was written; if the same data are on disk, all are
        left as they are.
        told: how much the command says.
        beside: further files by what they are called in the closing line, each with path and text.

    Raises:
        InputError: the folder cannot be written to.
    """
    from ..comparisons.report import html
    from ..comparisons.report.document import Text
    from ..models.files import write_text

    path, text = data
    others = {} if beside is None else dict(beside)
    if store is not None and store.tally is not None:
        report = replace(report, blocks=(*report.blocks, Text(store.tally)))
    files = [*([] if page is None else [page]), *(other for other, _ in others.values()), path]
    written = all(file.is_file() for file in files) and path.read_bytes() == text.encode()
    if not (current and written):
        if page is not None:  # before the data: data on disk say that their page was written
            write_text(page, html.page(report))
        for other, content in others.values():
            write_text(other, content)
        write_text(path, text)
    if told.json:
        typer.echo(text)
        return
    named = {} if page is None else {called: page}
    for name, (other, _) in others.items():
        named[name] = other
    show(report, told, **named, Data=path)


def show(report: Document, told: Told = ALL, **files: Path) -> None:
    """Print a report, and in a closing line what was written."""
    from ..comparisons.report import terminal

    if told.quiet:
        terminal.console().print(report.verdict or report.title, markup=False)
    else:
        terminal.show(report, terminal.console())
    if files:
        line = "   ".join(f"{name}: {printable(str(path))}" for name, path in files.items())
        terminal.console().print(line if told.quiet else f"\n{line}", soft_wrap=True, markup=False)


def command_line(context: typer.Context) -> str | None:
    """Restore the command line that makes the same again; None where there was none."""
    line = context.find_root().obj
    if line is None:
        return None
    return shlex.join(word for word in shlex.split(line) if word not in _NOT_OF_RESULTS)


_NOT_OF_RESULTS = ("--resume", "--quiet", "-q", "--json")


def printable(text: str) -> str:
    """A text of the user's on one line, its control characters as escapes."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)
