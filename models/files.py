"""Atomic writing of files, which appear whole or not at all, and guarded reading."""

from __future__ import annotations

import errno
import os
import stat
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from .errors import InputError, UnwritableError

_NAME_MAX = 255  # bytes of a name, where the system does not tell its own limit


def write_bytes(path: str | Path, content: bytes | memoryview) -> None:
    """Write a file, whole or not at all; a full disk leaves nothing behind.

    Raises:
        UnwritableError: the folder cannot be made or written to, or has no room; the sentence names
            the file.
    """
    target = Path(path)
    refuse_unwritable(target.parent, target.name)  # before a folder is made for it
    with _sentence_for(target):
        target.parent.mkdir(parents=True, exist_ok=True)
        # A short name fits into the folder, whatever name the target has.
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=".", suffix=".part")
        temporary = Path(name)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
            umask = os.umask(0)
            os.umask(umask)
            # mkstemp makes it private; a report is for others to read.
            temporary.chmod(0o666 & ~umask)
            temporary.replace(target)
        finally:
            temporary.unlink(missing_ok=True)


def write_text(path: str | Path, text: str) -> None:
    """Write UTF-8 text, whole or not at all; raises as :func:`write_bytes`."""
    write_bytes(path, text.encode())


def refuse_unwritable(folder: str | Path, file: str = "") -> None:
    """Raise UnwritableError before long work if a folder cannot be written to.

    Args:
        file: the name of what is to be written into it, where that is the user's own.

    Raises:
        UnwritableError: the folder, or the nearest one above it that exists, is no folder or not
            writable; a name is too long; or there is a folder in the file's place.
    """
    target, above = Path(folder, file), Path(folder).absolute()
    with _sentence_for(target):
        existing = next(path for path in (above, *above.parents) if _exists(path))
        if not existing.is_dir():
            raise UnwritableError(f"{target} cannot be written: {existing} is not a folder.")
        if file and target.is_dir():
            raise UnwritableError(f"{target} cannot be written: it is a folder.")
        longest = os.pathconf(existing, "PC_NAME_MAX") if hasattr(os, "pathconf") else _NAME_MAX
        if any(len(os.fsencode(part)) > longest for part in target.parts):
            raise OSError(errno.ENAMETOOLONG, os.strerror(errno.ENAMETOOLONG))
        with tempfile.TemporaryFile(dir=existing):
            pass


def _exists(path: Path) -> bool:
    """Tell whether a path exists; raises OSError where the system cannot tell."""
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    return True


@contextmanager
def _sentence_for(target: Path) -> Generator[None, None, None]:
    """The system's own errors as one sentence about a file."""
    try:
        yield
    except UnwritableError:
        raise
    except OSError as error:
        raise UnwritableError(f"{target} cannot be written: {error.strerror or error}.") from None
    except ValueError as error:  # no system takes the path, such as one with a zero character
        raise UnwritableError(f"{str(target)!r} cannot be written: {error}.") from None


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
        raise InputError(
            f"{path} cannot be read: it has {size:.3g} MB; at most {largest / 1e6:g} MB are taken."
        )
    return content


def refuse_irregular(path: str | Path) -> None:
    """Raise InputError for a pipe, device or socket: its content may have no end, or never come."""
    try:
        mode = Path(path).stat().st_mode
    except (OSError, ValueError):
        return  # whoever opens it says what is wrong
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise InputError(
            f"{path} cannot be read: it is a pipe, a device or a socket; a regular file is needed."
        )
