"""Options and output of the command line, for commands of other distributions."""

from __future__ import annotations

from ..cli import options, output

__all__ = [
    "options",
    "output",
]
