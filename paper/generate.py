"""Generate the schema of the audit and its page in docs/: `python paper/generate.py`."""

from __future__ import annotations

from pathlib import Path

from trebucheck.api.mechanics import schema_text
from trebucheck.api.reports import markdown
from trebucheck_paper.evidence.claims import Study
from trebucheck_paper.report import summary
from trebucheck_paper.study import study

HERE = Path(__file__).parent
PAGE = HERE.parent / "docs" / "paper.md"

if __name__ == "__main__":
    schema = HERE / "trebucheck_paper" / "schemas" / "paper.schema.json"
    schema.write_text(schema_text(Study))
    text = summary(study(["reference"]))
    PAGE.write_text(markdown.with_block(PAGE.read_text(), "paper", text))
