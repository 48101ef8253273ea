"""Options and output of the command line, for commands of other distributions."""

# Names are given on as they are imported.
# pyright: reportUnusedImport=false

from __future__ import annotations

from ..cli import options, output
from ..models.errors import InputError
