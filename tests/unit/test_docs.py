"""What the documentation says of files is true: every path it names exists."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.md"))]
PATH = re.compile(r"`((?:[a-z_]+/)+[\w<>-]*(?:\.\w+)?)`")
ENGINES = ("mujoco", "pymunk", "exudyn")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_paths_that_a_page_names_exist(page: Path) -> None:
    for path in PATH.findall(page.read_text()):
        names = [path.replace("<name>", engine) for engine in ENGINES] if "<name>" in path else [path]
        assert all((ROOT / name).exists() for name in names), f"{page.name} names {path}"
