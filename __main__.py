"""`python -m trebucheck` and the `trebucheck` command."""

from __future__ import annotations

import atexit
import gc

# A command keeps its modules and results to its end, so that a search for garbage finds little: it
# is made less often than Python's default, and not at the exit, where the system frees all memory.
gc.set_threshold(20_000, 25, 25)
atexit.register(gc.freeze)

from .cli.app import main  # noqa: E402

__all__ = ["main"]

if __name__ == "__main__":
    raise SystemExit(main())
