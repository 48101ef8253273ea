"""An engine that is a package of npm: its place, and the process of Node.js that runs it.

The plug-in has a folder with `package.json`, which names the package and its version, and
`move.cjs`, a program that reads a scene as JSON from standard input and writes its samples,
little-endian float64, to standard output. Its first argument is the path of `node_scene.cjs`, what
such programs share.
"""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from trebucheck.models.arrays import FloatArray
from trebucheck.models.errors import SimulationError

SCENE = Path(__file__).with_name("node_scene.cjs")
"""What programs that move a scene share."""
_ABSENT = "not installed"


@dataclass(frozen=True)
class NodePackage:
    """One package of npm, installed beside a plug-in."""

    title: str  # as messages have it: `Rapier 2D`
    package: str  # its name on npm: `@dimforge/rapier2d-compat`
    module: str  # the plug-in's Python package; `python -m MODULE` calls `install`
    folder: Path  # with package.json and move.cjs

    @property
    def _manifest(self) -> Path:
        return self.folder / "node_modules" / self.package / "package.json"

    def is_installed(self) -> bool:
        """Tell whether Node.js is on the path and the package in the folder."""
        return shutil.which("node") is not None and self._manifest.exists()

    def absence(self) -> str:
        """A sentence for a package that is not here, with the command that installs it."""
        if shutil.which("node") is None:
            return (
                f"{self.title} runs in Node.js (18 or later), and no program `node` is on the path."
            )
        return f"{self.title} is not installed here; `python -m {self.module}` brings it by npm."

    def version(self) -> str:
        """Version of the package; 'not installed' if it or Node.js is not here."""
        if not self.is_installed():
            return _ABSENT
        return str(json.loads(self._manifest.read_text(encoding="utf-8"))["version"])

    def install(self) -> None:
        """Install the package by npm, in the version of package.json.

        Raises:
            SystemExit: always: with npm's exit code, or a sentence where there is no npm.
        """
        npm = shutil.which("npm")
        if npm is None:
            raise SystemExit(
                f"{self.title} is installed by npm, of Node.js 18 or later, and no program "
                f"`npm` is on the path."
            )
        command = [npm, "install", "--no-package-lock", "--no-audit", "--no-fund"]
        raise SystemExit(subprocess.run(command, cwd=self.folder, check=False).returncode)

    def move(self, scene: Mapping[str, Any]) -> FloatArray:
        """Samples of a scene, shape (steps + 1, columns); SimulationError if the process fails."""
        written = self._node("move.cjs", str(SCENE), text=json.dumps(scene))
        return np.frombuffer(written, dtype="<f8").reshape(scene["steps"] + 1, -1)

    def run(self, program: str) -> dict[str, Any]:
        """What a module of ECMAScript prints as JSON; SimulationError if the process fails."""
        return json.loads(self._node("--input-type=module", "-", text=program))

    def _node(self, *arguments: str, text: str) -> bytes:
        """Output of Node.js in the package's folder."""
        ended = subprocess.run(
            ["node", *arguments],
            cwd=self.folder,
            input=text.encode(),
            capture_output=True,
            check=False,
        )
        if ended.returncode:
            complaint = ended.stderr.decode(errors="replace").strip()[-500:]
            raise SimulationError(f"{self.title} failed: {complaint}")
        return ended.stdout
