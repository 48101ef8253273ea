"""Available memory, so that a run that would not fit is refused before it starts."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

_MEMINFO = Path("/proc/meminfo")
_GROUP = Path("/sys/fs/cgroup")


def available_memory() -> float:
    """Memory that can be taken without swapping [B]; infinite if unknown."""
    return min(_figures(), default=float("inf"))


def _figures() -> Iterator[float]:
    with suppress(
        OSError, ValueError, StopIteration
    ):  # Linux; counts what is only cached as available
        line = next(
            line for line in _MEMINFO.read_text().splitlines() if line.startswith("MemAvailable:")
        )
        yield 1024.0 * int(line.split()[1])
    with suppress(OSError, ValueError):  # a container's limit; "max" where it has none
        yield float(
            int((_GROUP / "memory.max").read_text()) - int((_GROUP / "memory.current").read_text())
        )
    if not _MEMINFO.exists():
        with suppress(OSError, ValueError, AttributeError):
            yield float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
