"""A distribution for a new engine: written once, to be filled in."""

from __future__ import annotations

import keyword
import re
from importlib.resources import files
from pathlib import Path
from string import Template

from ..engines.registry import engine_names
from ..models.errors import InputError
from ..models.files import refuse_unwritable, write_text

_NAME = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")
_NPM = re.compile(
    r"(?P<npm>(@[a-z0-9-][a-z0-9._-]*/)?[a-z0-9-][a-z0-9._-]*)@(?P<version>[\w.^~*+-]+)"
)


def write_skeleton(name: str, folder: Path, npm: str | None = None) -> tuple[Path, ...]:
    """Write pyproject.toml, package and tests of a plug-in into a new folder.

    Args:
        name: of the engine: small letters, digits and hyphens.
        folder: new.
        npm: the engine's package of npm, NAME@VERSION, if Node.js moves it.

    Returns:
        The files.

    Raises:
        InputError: a name is not valid or taken, the folder exists, or it cannot be written to.
    """
    if not _NAME.fullmatch(name) or keyword.iskeyword(name):
        raise InputError(
            f"engine {name!r}: a name of small letters, digits and hyphens is needed, e.g. "
            f"my-engine."
        )
    if name.startswith("trebucheck-"):
        raise InputError(
            f"engine {name!r}: the name of the engine is needed, without that of the distribution: "
            f"{name.removeprefix('trebucheck-')}."
        )
    if name in engine_names():
        raise InputError(
            f"engine {name!r}: there is one of that name already; another name is needed."
        )
    brought = None if npm is None else _NPM.fullmatch(npm)
    if npm is not None and brought is None:
        raise InputError(f"package {npm!r}: its name and version are needed, e.g. planck@1.4.2.")
    if folder.exists() or folder.is_symlink():
        raise InputError(f"{folder} exists; a new folder is needed, nothing is written over.")
    refuse_unwritable(folder)
    package = f"trebucheck_{name.replace('-', '_')}"
    words = {
        "name": name,
        "package": package,
        **(brought.groupdict() if brought else {}),
        "cls": f"{name.title().replace('-', '').removesuffix('Engine')}Engine",
    }
    kind = "node_" if brought else ""
    contents = {
        "pyproject.toml": f"{kind}pyproject.toml",
        "README.md": f"{kind}README.md",
        ".gitignore": "gitignore",
        f"{package}/__init__.py": f"{kind}init.py",
        f"{package}/engine.py": f"{kind}engine.py",
        "tests/conftest.py": f"{kind}conftest.py",
        f"tests/test_{name.replace('-', '_')}.py": "test.py",
    }
    if brought:
        contents |= {
            f"{package}/__main__.py": "node_main.py",
            f"{package}/node/package.json": "node_package.json",
            f"{package}/templates/alone.mjs.j2": "node_alone.mjs.j2",
        }
    for path, template in contents.items():
        text = (files(__package__ or "") / "templates" / f"{template}.txt").read_text()
        write_text(folder / path, Template(text).substitute(words))
    return tuple(folder / path for path in contents)
