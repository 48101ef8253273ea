"""Run an importer in its own process, perhaps another Python: JSON in and out on two pipes.

Run as a file, `python worker.py pkg.module:load [folder]`, so that beside the importer's package
only NumPy is needed. Each request is one line, `{"call": name, "arguments": [...]}`; each answer
one line, `{"value": ...}` or `{"error": sentence}`, with what was printed meanwhile, by compiled
code too, under `printed`.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import os
import sys
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

ATTRIBUTES = ("joints", "integrator", "precision", "lacks", "versions")
"""Attributes of what `load` returns, all but `joints` optional."""
METHODS = ("total_mass", "mass_matrix", "acceleration", "limits", "start", "simulate")
"""All optional: what is not there is not offered."""
_PRINTED = 20_000  # characters of what was printed that are handed on


class _Caught:
    """Standard output and error, kept in a file."""

    def __init__(self) -> None:
        self.file = tempfile.TemporaryFile()  # noqa: SIM115 (for as long as this process runs)
        self.read_to = 0
        for descriptor in (1, 2):
            os.dup2(self.file.fileno(), descriptor)

    def text(self) -> str:
        """Text written since the last call."""
        sys.stdout.flush()
        sys.stderr.flush()
        end = os.lseek(self.file.fileno(), 0, os.SEEK_END)
        content = os.pread(self.file.fileno(), min(end - self.read_to, _PRINTED), self.read_to)
        self.read_to = end
        return content.decode(errors="replace")


class _Importer:
    """The function that loads a file, and what it made of the last one."""

    def __init__(self, loader: str, folder: str) -> None:
        self._load = _function(loader, folder)
        self._loaded: Any = None

    def load(self, path: str) -> dict[str, Any]:
        """Load a file, and say what is offered of it."""
        self._loaded = None
        self._loaded = self._load(path)
        facts = {
            name: getattr(self._loaded, name) for name in ATTRIBUTES if hasattr(self._loaded, name)
        }
        return facts | {
            "offers": [name for name in METHODS if callable(getattr(self._loaded, name, None))]
        }

    def call(self, name: str, arguments: list[Any]) -> Any:
        """Call what the importer made; lists of numbers arrive as arrays."""
        given = [
            np.array(each, dtype=float) if isinstance(each, list) else each for each in arguments
        ]
        return getattr(self._loaded, name)(*given)


def _function(loader: str, folder: str) -> Callable[[str], Any]:
    """`module:function`, or `path/to/file.py:function`."""
    name, _, function = loader.rpartition(":")
    if name.endswith(".py"):
        sys.path.insert(0, str(Path(name).resolve().parent))
        spec = importlib.util.spec_from_file_location("importer_under_test", name)
        if spec is None or spec.loader is None:
            raise ImportError(f"{name} is no Python file")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    else:
        sys.path.insert(0, folder)
        module = importlib.import_module(name)
    found = getattr(module, function)
    if not callable(found):
        raise TypeError(f"{loader} is a {type(found).__name__}, not a function that loads a file")
    return found


def plain(value: Any) -> Any:
    """Value as JSON has it: arrays as lists, mappings and sequences alike."""
    if isinstance(value, dict):
        return {str(name): plain(each) for name, each in value.items()}
    if isinstance(value, (str, bool, int, float, type(None))):
        return value
    if isinstance(value, (list, tuple)) and not all(
        isinstance(each, (int, float)) for each in value
    ):
        return [plain(each) for each in value]
    if isinstance(value, (set, frozenset)):
        return sorted(map(str, value))
    return np.asarray(value, dtype=float).tolist()


def answered(make: Callable[[], Any]) -> dict[str, Any]:
    """A value, or the error that making it raised, in a sentence."""
    try:
        return {"value": plain(make())}
    except Exception as error:  # whatever an importer raises is a finding
        return {"error": f"{type(error).__name__}: {error}"}


def main() -> None:
    """Answer requests until there are no more; the first answer tells if the loader imports."""
    answers = os.fdopen(os.dup(1), "w")
    caught = _Caught()
    warnings.simplefilter("always")
    importers: list[_Importer] = []

    def write(answer: dict[str, Any]) -> None:
        answers.write(json.dumps({**answer, "printed": caught.text()}) + "\n")
        answers.flush()

    write(answered(lambda: importers.append(_Importer(*sys.argv[1:3]))))
    for line in sys.stdin:
        request = json.loads(line)
        write(answered(lambda asked=request: _serve(importers[0], asked)))


def _serve(importer: _Importer, request: dict[str, Any]) -> Any:
    if request["call"] == "load":
        return importer.load(*request["arguments"])
    return importer.call(request["call"], request["arguments"])


if __name__ == "__main__":
    main()
