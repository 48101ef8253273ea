"""The house: imports run one way, modules stay readable, engines stay behind their own door."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LAYERS = ("models", "reference", "engines", "comparisons", "paper", "cli")
ENGINE_LIBRARIES = {"mujoco", "pymunk", "exudyn"}
MODULES = sorted(path for layer in LAYERS for path in (ROOT / layer).rglob("*.py"))
ALLOWED = {
    "models": {"models"},
    "reference": {"models", "reference"},
    "engines": {"models", "engines"},
    "comparisons": {"models", "reference", "engines", "comparisons"},
    "paper": {"models", "reference", "engines", "comparisons", "paper"},
    "cli": {"models", "reference", "engines", "comparisons", "paper", "cli"},
}


def _imports(path: Path) -> Iterator[tuple[str, bool]]:
    """Imported modules as dotted names from the package's root, and whether at module level."""
    tree = ast.parse(path.read_text())
    package = path.relative_to(ROOT).parts[:-1]
    top = set(map(id, tree.body))
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name, id(node) in top
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else ()
            yield ".".join([*base, node.module or ""]), id(node) in top


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_run_one_way(path: Path) -> None:
    layer = path.relative_to(ROOT).parts[0]
    allowed = ALLOWED[layer] | ({"reference"} if path.parts[-3:-1] == ("engines", "reference") else set())
    for name, at_module_level in _imports(path):
        first = name.split(".")[0]
        assert first != "trebucheck", f"{path.name} imports {name} absolutely; inside, imports are relative"
        if first in LAYERS:
            assert first in allowed, f"{layer}/{path.name} imports {name}"
        if first in ENGINE_LIBRARIES and at_module_level:
            assert layer == "engines" and path.parent.name == first, f"{path.name} imports {first}"


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_a_module_can_be_read_at_a_sitting(path: Path) -> None:
    text = path.read_text()
    assert text.count("\n") <= 400
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            assert (node.end_lineno or 0) - node.lineno < 60, f"{path.name}: {node.name}"


def test_every_package_is_shipped() -> None:
    text = (ROOT / "pyproject.toml").read_text()
    for path in {path.parent.relative_to(ROOT) for path in MODULES}:
        assert f'"trebucheck.{".".join(path.parts)}"' in text


def test_no_machine_path_or_registry_is_committed() -> None:
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    for line in lines:
        name, separator, version = line.partition("==")
        assert separator and name and version and " " not in line and "/" not in line, line
