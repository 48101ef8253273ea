"""`python -m trebucheck` and the `trebucheck` command."""

from __future__ import annotations

from .cli.app import main

__all__ = ["main"]

if __name__ == "__main__":
    raise SystemExit(main())
