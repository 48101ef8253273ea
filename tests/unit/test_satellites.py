"""Distributions beside the core stand on its public interface, and say what they are for."""

from __future__ import annotations

import ast
import importlib
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
import trebucheck as tb

ROOT = Path(__file__).parents[2]
PACKAGES = {
    "paper": ROOT / "paper" / "trebucheck_paper",
    "environments": ROOT / "environments" / "trebucheck_environments",
    "importers": ROOT / "importers" / "trebucheck_importers",
}
satellites = pytest.mark.parametrize("name", PACKAGES)


def _imports(package: Path) -> Iterator[tuple[Path, str, str]]:
    for path in package.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and not node.level and node.module:
                for alias in node.names:
                    yield path, node.module, alias.name
            elif isinstance(node, ast.Import):
                for alias in node.names:
                    yield path, alias.name, ""


@satellites
def test_a_satellite_imports_the_public_interface_alone(name: str) -> None:
    of_ours = [found for found in _imports(PACKAGES[name]) if found[1].startswith("trebucheck.")]
    assert of_ours
    for path, module, imported in of_ours:
        assert module.startswith("trebucheck.api."), f"{path}: {module}.{imported}"
    for path, module, imported in _imports(PACKAGES[name]):
        if module == "trebucheck" and imported:
            assert imported in (*tb.__all__, "__version__"), f"{path}: {imported}"


def test_the_public_modules_only_give_names_on() -> None:
    paths = [path for path in (ROOT / "api").glob("*.py") if path.name != "__init__.py"]
    assert paths
    for path in paths:
        module = importlib.import_module(f"trebucheck.api.{path.stem}")
        _, *imports = ast.parse(path.read_text()).body
        assert imports, path
        given = {"annotations"}
        for statement in imports:
            assert isinstance(statement, ast.ImportFrom), path
            given |= {alias.asname or alias.name for alias in statement.names}
        assert {name for name in vars(module) if name.isidentifier() and name[0] != "_"} == given


@satellites
def test_a_satellite_says_what_it_is(name: str) -> None:
    folder = PACKAGES[name].parent
    project = tomllib.loads((folder / "pyproject.toml").read_text())["project"]
    assert project["name"] == f"trebucheck-{name}"
    assert "trebucheck" in project["dependencies"]
    assert (folder / "CHANGELOG.md").is_file() and "pip install" in (
        folder / "README.md"
    ).read_text()
