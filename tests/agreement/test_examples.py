"""The scripts in examples/ run as they stand, and say something."""

from __future__ import annotations

import importlib
import json
import re
import runpy
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

EXAMPLES = sorted((Path(__file__).parents[2] / "examples").glob("*.py"))
NOTEBOOK = Path(__file__).parents[2] / "examples" / "notebook.ipynb"
LIBRARIES = ("mujoco", "pymunk", "exudyn")


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs(
    path: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    text = path.read_text()
    absent = [
        name
        for name in LIBRARIES
        if re.search(rf'"{name}"|import {name}', text) and find_spec(name) is None
    ]
    if absent:
        pytest.skip(f"{', '.join(absent)} is not installed here")
    # In this process and with kept ones: the libraries are loaded once for all examples.
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(path), run_name="__main__")
    assert capfd.readouterr().out.strip()
    assert not list(tmp_path.iterdir())  # an example leaves nothing behind


@pytest.mark.slow
def test_the_notebook_shows_what_its_cells_give(monkeypatch: pytest.MonkeyPatch) -> None:
    """Word by word; numbers to two digits, as they are printed, since engines round differently
    elsewhere.
    """
    monkeypatch.syspath_prepend(str(NOTEBOOK.parents[1] / "docs"))
    outputs = importlib.import_module("executed").outputs
    names: dict[str, Any] = {}
    for cell in json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] == "code":
            found = list(outputs("".join(cell["source"]), names))
            assert [set(each.get("data", ())) for each in found] == [
                set(e.get("data", ())) for e in cell["outputs"]
            ]
            assert_same_words(*(" ".join(map(_text, each)) for each in (found, cell["outputs"])))


def _text(output: dict[str, Any]) -> str:
    return "".join(output.get("text", output.get("data", {}).get("text/plain", ())))


def assert_same_words(found: str, printed: str) -> None:
    assert len(found.split()) == len(printed.split())
    for mine, theirs in zip(found.split(), printed.split(), strict=True):
        if mine != theirs:
            assert float(mine) == pytest.approx(float(theirs), rel=1e-2, abs=0.011), (mine, theirs)
