"""`python -m trebucheck` and the `trebucheck` command."""

from __future__ import annotations

import atexit
import gc

# Most of what a command makes it keeps to its end, as modules: seldom is there garbage to look for,
# and none that the system does not free.
gc.set_threshold(20_000, 25, 25)
atexit.register(gc.freeze)

from .cli.app import main  # noqa: E402

__all__ = ["main"]

if __name__ == "__main__":
    raise SystemExit(main())
