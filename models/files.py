"""Atomic writing of files: they appear whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from .errors import UnwritableError


@contextmanager
def replacing(path: str | Path) -> Generator[Path, None, None]:
    """A temporary file beside `path`, put in its place once the block ends well, removed otherwise.

    Raises:
        UnwritableError: the folder cannot be made or written to; the sentence names it.
    """
    target = Path(path)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.is_dir():
            raise UnwritableError(f"{target} cannot be written: it is a folder.")
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.", suffix=".part")
    except OSError as error:
        raise UnwritableError(f"{target} cannot be written: {error.strerror or error}.") from None
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)  # mkstemp makes it private; a report is for others to read
        temporary.replace(target)
    except OSError as error:
        raise UnwritableError(f"{target} cannot be written: {error.strerror or error}.") from None
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: str | Path, text: str) -> None:
    """Write UTF-8 text, whole or not at all.

    Raises:
        UnwritableError: the folder cannot be made or written to.
    """
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def refuse_unwritable(folder: str | Path) -> None:
    """Raise UnwritableError now, before long work, if a folder cannot be written to; nothing is left behind.

    Raises:
        UnwritableError: the folder, or the nearest one above it that exists, is no folder or not writable.
    """
    target = Path(folder)
    existing = next(path for path in (target.absolute(), *target.absolute().parents) if path.exists())
    if not existing.is_dir():
        raise UnwritableError(f"{target} cannot be written: {existing} is not a folder.")
    try:
        with tempfile.TemporaryFile(dir=existing):
            pass
    except OSError as error:
        raise UnwritableError(f"{target} cannot be written: {error.strerror or error}.") from None
