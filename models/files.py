"""Atomic writing of files: they appear whole or not at all. Reading of those that somebody else wrote."""

from __future__ import annotations

import os
import stat
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from .errors import InputError, UnwritableError


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


def read_bytes(path: str | Path, largest: int) -> bytes:
    """The content of a regular file.

    Args:
        largest: size that is read [B].

    Raises:
        InputError: it cannot be read, is no regular file or is too large; the sentence names it.
    """
    refuse_irregular(path)
    try:
        with Path(path).open("rb") as file:
            content = file.read(largest + 1)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from None
    except ValueError as error:  # of a path that no system takes, such as one with a zero character
        raise InputError(f"{str(path)!r} cannot be read: {error}.") from None
    if len(content) > largest:
        size = Path(path).stat().st_size / 1e6
        raise InputError(f"{path} cannot be read: it has {size:.3g} MB; at most {largest / 1e6:g} MB are taken.")
    return content


def refuse_irregular(path: str | Path) -> None:
    """Raise InputError for a pipe, device or socket: its content may have no end, or never come."""
    try:
        mode = Path(path).stat().st_mode
    except (OSError, ValueError):
        return  # whoever opens it says what is wrong
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise InputError(f"{path} cannot be read: it is a pipe, a device or a socket; a regular file is needed.")
