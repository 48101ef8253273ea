"""Generate the pages, tables and data of the importers: `python importers/generate.py`.

With names of parts only those: `python importers/generate.py importers zoo files`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

from trebucheck.api.mechanics import models
from trebucheck.api.reports import Document, markdown, table
from trebucheck_importers.files import publish
from trebucheck_importers.report import machine_table, overview, page, versions_table
from trebucheck_importers.results import ImporterResults
from trebucheck_importers.zoo.registry import zoo

HERE = Path(__file__).parent
ROOT = HERE.parent
ZOO = HERE / "trebucheck_importers" / "zoo"
_WRITTEN = "<!-- written by importers/generate.py -->\n"
_ZOO = """\
# Small MJCF models of one feature each

{count} files, each written by hand, with the certified motion of the mechanism that it is:
`files/NAME.nc` has joint values, uncertainties, mass matrix and accelerations at three states, and
forces of limits and contacts at rest. `trebucheck importer my_package:load` holds an importer
against them; what importers make of them: [docs/importers.md](../../docs/importers.md). *Needs*:
what it takes to move one, beside a tree's equations of motion.

"""


def importer_results() -> dict[str, ImporterResults | None]:
    """Results of each importer that has an adapter, by name; None where it has not been run."""
    names = sorted(path.parent.name for path in HERE.glob("*/load.py"))
    files = {name: HERE / name / "results.json" for name in names}
    return {
        name: ImporterResults.load(file) if file.is_file() else None for name, file in files.items()
    }


def write_importers() -> None:
    """Write the tables of importers, also of each machine, and a report page for each one."""
    importers = importer_results()
    index = ROOT / "docs" / "importers.md"
    versions = markdown.text(versions_table(importers))
    text = markdown.with_block(index.read_text(), "versions", versions)
    verdicts = markdown.text(overview(importers), signs=True)
    index.write_text(markdown.with_block(text, "importers", verdicts))
    folder = ROOT / "docs" / "importers"
    folder.mkdir(exist_ok=True)
    for name, results in importers.items():
        if results is not None:
            (folder / f"{name}.md").write_text(_WRITTEN + markdown.text(page(results, name)))
    for machine in models():
        readme = ROOT / "models" / "mjcf" / machine / "README.md"
        verdicts = markdown.text(machine_table(importers, machine), signs=True)
        readme.write_text(markdown.with_block(readme.read_text(), "importers", verdicts))


def write_zoo_list() -> None:
    """Write the list of the models of one feature."""
    rows = [
        (f"[{model.name}](files/{model.name}.xml)", model.feature, ", ".join(model.needs))
        for model in zoo()
    ]
    listed = markdown.text(Document("", (table(["model", "what it has", "needs"], rows),)))
    text = _WRITTEN + _ZOO.format(count=len(rows)) + listed.strip() + "\n"
    (ZOO / "README.md").write_text(text)


PARTS: dict[str, Callable[[], None]] = {
    "files": lambda: publish(ZOO / "files"),
    "zoo": write_zoo_list,
    "importers": write_importers,
}

if __name__ == "__main__":
    for part in sys.argv[1:] or PARTS:
        PARTS[part]()
