"""Processes that end with the one that started them, also where that one is killed.

A killed process can end nothing itself: on Linux the system does it, if the child has asked for
that. A plug-in whose engine is a program starts it with :func:`ending_with_parent`.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from collections.abc import Callable
from functools import cache, partial
from typing import Any

_PR_SET_PDEATHSIG = 1


def end_with_parent(parent: int) -> None:
    """Make the system end this process when the thread that started it ends (on Linux).

    Elsewhere a process whose parent was killed ends by itself, or after the call that it makes.

    Args:
        parent: number of the process that started this one; if that is gone already, this one ends.
    """
    if sys.platform == "linux":
        _prctl()(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:
            os._exit(1)


def ending_with_parent() -> Callable[[], None] | None:
    """Make the value of `preexec_fn` for a program that is to end with the thread that starts it.

    `subprocess.Popen(["engine"], preexec_fn=ending_with_parent())`. None where the system cannot
    do so, that is on systems other than Linux.
    """
    if sys.platform != "linux":
        return None
    _prctl()  # loaded here: after a fork another thread's lock may be held for ever
    return partial(end_with_parent, os.getpid())


@cache
def _prctl() -> Any:
    return ctypes.CDLL(None).prctl
