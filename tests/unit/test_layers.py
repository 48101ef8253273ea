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


OUTSIDE_THE_ENGINES = [
    path
    for path in MODULES
    if path.relative_to(ROOT).parts[0] in ("models", "reference", "comparisons", "cli")
    and path.relative_to(ROOT).parts[:2] != ("models", "mjcf")  # MJCF is a format, whose root element is <mujoco>
]
HELP_TEXTS = {"cli/app.py"}  # what the package is about, and examples of commands


def _names_and_texts(path: Path) -> Iterator[tuple[int, str]]:
    """Identifiers and string literals of a module, without its docstrings: line and text."""
    tree = ast.parse(path.read_text())
    docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docstrings:
            yield node.lineno, node.value
        for field in ("id", "attr", "name", "asname", "arg", "module"):
            found = getattr(node, field, None)
            if isinstance(found, str):
                yield getattr(node, "lineno", 0), found


@pytest.mark.parametrize("path", OUTSIDE_THE_ENGINES, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_engine_is_named_outside_its_room(path: Path) -> None:
    """Whatever depends on an engine is in its room (`engines/<name>/`), where a plug-in can supply it as well."""
    if str(path.relative_to(ROOT)) in HELP_TEXTS:
        return
    for line, text in _names_and_texts(path):
        named = [name for name in ENGINE_LIBRARIES if name in text.lower()]
        assert not named, f"{path.relative_to(ROOT)}:{line} names {named[0]}: {text[:60]!r}"


def test_only_the_registry_names_the_engines_in_the_engines_own_room() -> None:
    for path in (ROOT / "engines").glob("*.py"):
        if path.name != "registry.py":
            for line, text in _names_and_texts(path):
                assert not any(name in text.lower() for name in ENGINE_LIBRARIES), f"engines/{path.name}:{line}: {text}"
