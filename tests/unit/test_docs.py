"""What the documentation says of files is true: every path it names exists."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import trebucheck as tb
import typer
from trebucheck.cli.app import app
from trebucheck.comparisons.report import markdown

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.md"))]
PATH = re.compile(r"`((?:[a-z_]+/)+[\w<>-]*(?:\.\w+)?)`")
ENGINES = ("mujoco", "pymunk", "exudyn")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_paths_that_a_page_names_exist(page: Path) -> None:
    for path in PATH.findall(page.read_text()):
        names = (
            [path.replace("<name>", engine) for engine in ENGINES] if "<name>" in path else [path]
        )
        assert all((ROOT / name).exists() for name in names), f"{page.name} names {path}"


def test_every_command_and_every_public_name_is_on_its_page() -> None:
    """Their texts are generated (`python docs/generate.py commands api`)."""
    commands, api = ((ROOT / "docs" / f"{name}.md").read_text() for name in ("commands", "api"))
    root: Any = typer.main.get_command(app)
    assert not [name for name in root.commands if f"## `trebucheck {name}`" not in commands]
    assert not [
        name for name in tb.__all__ if callable(getattr(tb, name)) and f"## tb.{name}\n" not in api
    ]


def test_every_page_is_on_the_site() -> None:
    navigation = (ROOT / "mkdocs.yml").read_text()
    assert not [
        page.name for page in (ROOT / "docs").glob("*.md") if f": {page.name}\n" not in navigation
    ]


def test_a_block_of_a_page_is_replaced_and_a_page_without_it_refused() -> None:
    page = (
        "a\n<!-- generated: x -->\nold\n<!-- end -->\nb <!-- generated: y -->\nkept\n<!-- end -->"
    )
    replaced = markdown.with_block(page, "x", "new \\1\n")
    assert replaced == page.replace("old\n", "new \\1\n")
    assert markdown.block(replaced, "y") == "kept\n"
    with pytest.raises(ValueError, match="'z'"):
        markdown.with_block(page, "z", "new")
