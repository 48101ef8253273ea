"""Node.js moves a scene by Rapier: a process a run, JSON in, samples out."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from trebucheck.models.arrays import FloatArray
from trebucheck.models.errors import SimulationError

_FOLDER = Path(__file__).parent / "node"
_PACKAGE = _FOLDER / "node_modules" / "@dimforge" / "rapier2d-compat" / "package.json"


def is_installed() -> bool:
    """Whether Node.js is on the path and Rapier beside this package."""
    return shutil.which("node") is not None and _PACKAGE.exists()


def absence() -> str:
    """What is missing, and what brings it, in one sentence."""
    if shutil.which("node") is None:
        return "Rapier 2D runs in Node.js (18 or later), and no program `node` is on the path."
    return "Rapier 2D is not installed here; `python -m trebucheck_rapier` brings it by npm."


def version() -> str:
    """Of Rapier's npm package; 'not installed' if there is none."""
    if not is_installed():
        return "not installed"
    return str(json.loads(_PACKAGE.read_text(encoding="utf-8"))["version"])


def install() -> None:
    """Install Rapier by npm, in the version of package.json.

    Raises:
        SystemExit: there is no npm, or it fails.
    """
    npm = shutil.which("npm")
    if npm is None:
        raise SystemExit("Rapier 2D is installed by npm, of Node.js 18 or later, and no program `npm` is on the path.")
    command = [npm, "install", "--no-package-lock", "--no-audit", "--no-fund"]
    raise SystemExit(subprocess.run(command, cwd=_FOLDER, check=False).returncode)


def move(scene: Mapping[str, Any]) -> FloatArray:
    """Samples of a scene's bodies, shape (steps + 1, bodies, 6): x, y, angle and their rates.

    Raises:
        SimulationError: the process failed.
    """
    node = shutil.which("node") or "node"
    given = json.dumps(scene).encode()
    found = subprocess.run([node, "move.cjs"], cwd=_FOLDER, input=given, capture_output=True, check=False)
    if found.returncode:
        raise SimulationError(f"rapier failed: {found.stderr.decode(errors='replace').strip()[-500:]}")
    return np.frombuffer(found.stdout, dtype="<f8").reshape(-1, len(scene["bodies"]), 6)
