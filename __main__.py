"""`python -m trebucheck` and the `trebucheck` command."""

from __future__ import annotations

import atexit
import gc
import os
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import suppress

# A command keeps its modules and results to its end, so that a search for garbage finds little: it
# is made less often than Python's default, and not at the exit, where the system frees all memory.
gc.set_threshold(20_000, 25, 25)
atexit.register(gc.freeze)

_LEFT = 5.0  # [s] after the command's end for which threads of plug-ins are waited for


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line as :func:`.cli.app.main` does; say so where that cannot be loaded."""
    try:
        from .cli.app import main as run
    except KeyboardInterrupt:  # OpenBLAS raises it, too, where it can start no thread
        print("error: interrupted while loading, or there is too little memory.", file=sys.stderr)
        return 130
    except (ImportError, MemoryError, OSError) as error:
        text = " ".join(f"{type(error).__name__}: {error}".split())
        print(f"error: its libraries cannot be loaded: {text[:1000]}.", file=sys.stderr)
        return 2
    return run(arguments)


def command() -> int:
    """Run the command line, and end the process though a plug-in has left threads running."""
    code = main()
    with suppress(RuntimeError):  # the system starts no further thread
        threading.Thread(target=_end_without_threads, args=(code,), daemon=True).start()
    return code


def _end_without_threads(code: int) -> None:
    """End the process if it has not ended after some time, and say what kept it."""
    time.sleep(_LEFT)
    own, here = threading.main_thread(), threading.enumerate()
    left = [thread.name for thread in here if thread is not own and not thread.daemon]
    print(f"note: ended without threads that still run: {', '.join(left)}.", file=sys.stderr)
    os._exit(code)


__all__ = ["main"]

if __name__ == "__main__":
    raise SystemExit(command())
