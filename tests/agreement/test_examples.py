"""The scripts in examples/ run as they stand, and say something."""

from __future__ import annotations

import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).parents[2] / "examples").glob("*.py"))
ENGINES = ("mujoco", "pymunk", "exudyn")


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs(path: Path, tmp_path: Path) -> None:
    text = path.read_text()
    absent = [name for name in ENGINES if re.search(rf'"{name}"|import {name}', text) and find_spec(name) is None]
    if absent:
        pytest.skip(f"{', '.join(absent)} is not installed here")
    done = subprocess.run([sys.executable, str(path)], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()
    assert not list(tmp_path.iterdir())  # an example leaves nothing behind
