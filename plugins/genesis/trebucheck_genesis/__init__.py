"""Genesis as an engine of trebucheck."""

import os

# Its compiler would print a line on the standard output wherever it is imported.
os.environ.setdefault("ENABLE_QUADRANTS_HEADER_PRINT", "false")
