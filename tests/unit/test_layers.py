"""Architecture: imports run one way and never in circles, counts do not rise, engines stay
apart."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from fnmatch import fnmatch
from functools import cache, partial
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import counts
import pytest

ROOT = Path(__file__).parents[2]
LAYERS = ("models", "reference", "engines", "comparisons", "conformance", "cli", "api")
ROOMS = tuple(sorted(path.parent for path in (ROOT / "engines").glob("*/engine.py")))
ENGINES = tuple(room.name for room in ROOMS if room.name != "reference")
MODULES = sorted(path for layer in LAYERS for path in (ROOT / layer).rglob("*.py"))
FRONT = [ROOT / f"{name}.py" for name in ("__init__", "__main__", "renamed", "version")]

RANKS: tuple[tuple[str, ...], ...] = (
    ("models", "models/elements"),  # a mechanism is made of elements, which know its geometry
    ("models/library",),
    ("models/mjcf",),
    ("reference", "engines"),
    ("reference/taylor", "reference/throw", *(f"engines/{name}" for name in ENGINES)),
    ("reference/sensitivity", "reference/proof"),
    ("reference/certification",),
    ("engines/reference",),
    ("comparisons/runs",),
    ("comparisons/report/drawing",),
    ("comparisons/report",),
    ("comparisons/diagnosis",),
    ("comparisons/data",),
    ("comparisons",),  # the studies of one module: diff, matrix, ...
    ("comparisons/campaigns",),
    ("comparisons/report/pages",),
    ("conformance",),
    ("cli",),
    ("api",),
)
"""Folders from the ground up: a module imports from its own folder and from lower ranks alone."""


def _name(path: Path) -> str:
    """Dotted name of a module from the package's root; of a package's `__init__`, the package's."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


NAMES = {_name(path): path for path in (*MODULES, *FRONT)}


@cache
def _imports(path: Path) -> tuple[tuple[str, bool], ...]:
    """Imported modules as dotted names from the package's root, and whether at module level."""
    return tuple(_imported(path))


def _imported(path: Path) -> Iterator[tuple[str, bool]]:
    tree = ast.parse(path.read_text())
    package = path.relative_to(ROOT).parts[:-1]
    top = set(map(id, tree.body))
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name, id(node) in top
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else ()
            module = ".".join([*base, node.module] if node.module else base)
            inner = [f"{module}.{alias.name}".lstrip(".") for alias in node.names]
            # `from . import module` imports the module, `from .module import name` that module.
            for name in (
                {name if name in NAMES else module for name in inner} if node.level else {module}
            ):
                yield name, id(node) in top


@cache
def _graph() -> dict[str, set[str]]:
    """Modules of the package that each module imports, also those only for type checkers."""
    return {
        name: {other for other, _ in _imports(path) if other in NAMES and other != name}
        for name, path in NAMES.items()
    }


def _rank(folder: str) -> int:
    return next(i for i, row in enumerate(RANKS) if folder in row)


def _folder(name: str) -> str:
    return NAMES[name].parent.relative_to(ROOT).as_posix()


modules = pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))


@modules
def test_imports_run_one_way(path: Path) -> None:
    own = path.parent.relative_to(ROOT).as_posix()
    for name, at_module_level in _imports(path):
        first = name.split(".")[0]
        assert first != "trebucheck", (
            f"{path.name} imports {name} absolutely; inside, imports are relative"
        )
        if name in NAMES and name != "version" and _folder(name) != own:
            assert _folder(name) != ".", f"{own}/{path.name} imports the front door"
            together = {_folder(name), own} == {"models", "models/elements"}
            assert together or _rank(_folder(name)) < _rank(own), f"{own}/{path.name}: {name}"
        if first in ENGINES and at_module_level and name not in NAMES:
            assert own == f"engines/{first}", f"{path.name} imports {first}"


def test_only_the_reference_engine_imports_the_reference() -> None:
    for path in MODULES:
        own = path.parent.relative_to(ROOT).as_posix()
        if own.startswith("engines") and own != "engines/reference":
            assert not any(
                name.startswith("reference") for name, _ in _imports(path) if name in NAMES
            ), path


def test_every_folder_has_a_rank() -> None:
    ranked = [folder for row in RANKS for folder in row]
    assert len(ranked) == len(set(ranked))
    assert {path.parent.relative_to(ROOT).as_posix() for path in MODULES} == {
        f for f in ranked if (ROOT / f).is_dir()
    }
    assert all((ROOT / folder).is_dir() for folder in ranked)


def test_no_modules_import_each_other_in_a_circle() -> None:
    inside = {name: others - {""} for name, others in _graph().items() if name}
    try:
        TopologicalSorter(inside).prepare()
    except CycleError as circle:
        pytest.fail(" -> ".join(circle.args[1]))


def test_every_module_is_imported() -> None:
    """Modules are imported by another one, by a plug-in, or by name when they are asked for."""
    asking = (
        "__init__.py",
        "engines/registry.py",
        "models/shown.py",
        "models/trajectory.py",
        "pyproject.toml",
    )
    asked_for = "".join((ROOT / name).read_text() for name in asking).replace(
        "trebucheck.conformance", "conformance"
    )
    plugged = "".join(path.read_text() for path in ROOT.glob("plugins/*/*/*.py"))
    imported = {other for others in _graph().values() for other in others}
    imported |= set(re.findall(r"from trebucheck\.([\w.]+) import", plugged))
    alone = [
        name
        for name, path in NAMES.items()
        if path not in FRONT and path.name != "__init__.py" and name not in imported
        if not name.startswith("api.")  # for distributions built on trebucheck
        if f'"{name}"' not in asked_for and f'"{name.removeprefix("engines.")}"' not in asked_for
    ]
    assert not alone


ONE_IMPORTER = {
    "models.elements.*": "an element is one file; their table imports it",
    "models.library.*": "problems of one kind; the registry of problems imports them",
    "engines.*": "the same names in the room of each engine, so that the rooms can be compared",
    "cli.*": "commands that answer one question of the help; the app imports them",
    "comparisons.report.pages.*": "a page is one file; its command imports it",
    "comparisons.diagnosis.*": "one means of a diagnosis each, read without the others",
    "comparisons.campaigns.*": "one step of a campaign each; what needs pyarrow or SALib, extras",
    "comparisons.certify": "tb.certify, and its command",
    "reference.proof.*": "one step of a proof each, from balls to events",
    "comparisons.mjcf": "tb.mjcf, and its command",
    "conformance.check": "tb.check, and the plug-in of pytest",
    "conformance.certificate": "the page of a conformance run; its command imports it",
    "conformance.skeleton": "files of a new plug-in; its command imports it",
    "reference.motion": "tb.solve, and the sensitivities",
    "reference.sensitivity.sensitivities": "tb.sensitivities, and the horizons",
    "reference.stiff": "an implicit method, and when it takes over",
    "reference.kernel": "arithmetic that Numba compiles, apart from when it does",
    "reference.certification.proved": "what is proved of a certificate's figures",
    "reference.certification.paper": "figures of the paper's machines alone",
    "renamed": "names of earlier releases; the front door imports it",
}
"""Reasons of modules that one other module imports: each would otherwise be part of that one."""


def test_a_module_with_one_importer_has_a_reason() -> None:
    alone = counts.modules_with_one_importer(counts.modules(*counts.CORE))
    assert not [name for name in alone if not any(map(partial(fnmatch, name), ONE_IMPORTER))]
    assert not [reason for reason in ONE_IMPORTER if not any(fnmatch(n, reason) for n in alone)]


@pytest.mark.parametrize("what", counts.CEILINGS)
def test_no_count_rises(what: str) -> None:
    """A count that fell is the new ceiling: `python tests/counts.py` prints them."""
    assert _counted()[what] <= counts.CEILINGS[what]


@cache
def _counted() -> dict[str, float]:
    return counts.count(*counts.CORE)


def test_every_package_is_shipped() -> None:
    text = (ROOT / "pyproject.toml").read_text()
    assert len(MODULES) > 100
    for path in {path.parent.relative_to(ROOT) for path in MODULES}:
        assert f'"trebucheck.{".".join(path.parts)}"' in text


def test_no_machine_path_or_registry_is_committed() -> None:
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    assert len(lines) > 0
    for line in lines:
        name, separator, version = line.partition("==")
        assert separator and name and version and " " not in line and "/" not in line, line


OUTSIDE_THE_ENGINES = [
    path
    for path in MODULES
    if path.relative_to(ROOT).parts[0]
    in ("models", "reference", "comparisons", "conformance", "cli")
    and path.relative_to(ROOT).parts[:2]
    != ("models", "mjcf")  # MJCF is a format, whose root element is <mujoco>
]
HELP_TEXTS = {"cli/app.py"}  # what the package is about, and examples of commands


def _names_and_texts(path: Path) -> Iterator[tuple[int, str]]:
    """Identifiers and string literals of a module, without its docstrings: line and text."""
    tree = ast.parse(path.read_text())
    docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and id(node) not in docstrings
        ):
            yield node.lineno, node.value
        for field in ("id", "attr", "name", "asname", "arg", "module"):
            found = getattr(node, field, None)
            if isinstance(found, str):
                yield getattr(node, "lineno", 0), found


@pytest.mark.parametrize("path", OUTSIDE_THE_ENGINES, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_engine_is_named_outside_its_room(path: Path) -> None:
    """What depends on an engine is in its package, where a plug-in can supply it as well."""
    if str(path.relative_to(ROOT)) in HELP_TEXTS:
        return
    for line, text in _names_and_texts(path):
        named = [name for name in ENGINES if name in text.lower()]
        assert not named, f"{path.relative_to(ROOT)}:{line} names {named[0]}: {text[:60]!r}"


def test_only_the_registry_names_the_engines_in_the_engines_own_room() -> None:
    paths = list((ROOT / "engines").glob("*.py"))
    assert len(paths) > 3
    for path in paths:
        if path.name != "registry.py":
            for line, text in _names_and_texts(path):
                assert not any(name in text.lower() for name in ENGINES), (
                    f"engines/{path.name}:{line}: {text}"
                )
