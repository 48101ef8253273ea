"""An engine that is a package of npm: its place, and the process of Node.js that runs it.

The plug-in has a folder with `package.json`, which names the package and its version. Programs are
modules of ECMAScript (:mod:`.node_program`), read from standard input.
"""

from __future__ import annotations

import json
import math
import re
import shutil
import subprocess
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, Any

import numpy as np
from trebucheck.api.engines import ending_with_parent
from trebucheck.models.arrays import FloatArray
from trebucheck.models.errors import SimulationError

ARRAYS = Path(__file__).with_name("node_arrays.cjs")
"""What programs write arrays with."""
_ABSENT = "not installed"
_ERROR = re.compile(r"^\w*Error(?: \[\w+\])?: .{1,500}", re.MULTILINE)


@dataclass(frozen=True)
class NodePackage:
    """One package of npm, installed beside a plug-in."""

    title: str  # as messages have it: `Rapier 2D`
    package: str  # its name on npm: `@dimforge/rapier2d-compat`
    module: str  # the plug-in's Python package; `python -m MODULE` calls `install`
    folder: Path  # with package.json

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

    def arrays(self, program: str) -> dict[str, FloatArray]:
        """Arrays that a module of ECMAScript writes; SimulationError if the process fails."""
        return self._written(program, _arrays)

    def run(self, program: str) -> dict[str, Any]:
        """Run a module of ECMAScript, for what it prints as JSON.

        Raises:
            SimulationError: the process fails.
        """
        return self._written(program, _printed)

    def _written(
        self, program: str, read: Callable[[IO[bytes]], dict[str, Any] | None]
    ) -> dict[str, Any]:
        """Run a program in the package's folder, for what it writes, as `read` reads it.

        The process is ended once it has written them: at its end V8 waits for what it compiles
        beside a run, which takes longer than most runs do, or for ever (nodejs/node#54918).
        """
        with (
            TemporaryFile() as complaints,
            subprocess.Popen(
                ["node", "--input-type=module", "-"],
                cwd=self.folder,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=complaints,
                preexec_fn=ending_with_parent(),  # noqa: PLW1509 (a system call)
            ) as process,
        ):
            assert process.stdin is not None  # it is a pipe, as is the output
            assert process.stdout is not None
            try:
                with suppress(OSError), process.stdin as given:  # it may end without reading
                    given.write(program.encode())
                found = read(process.stdout)
                if found is None:  # it ended before, or wrote something else
                    process.wait()
                    complaints.seek(0)
                    raise self._failure(complaints.read())
            finally:
                process.kill()
        return found

    def _failure(self, complaint: bytes) -> SimulationError:
        text = complaint.decode(errors="replace").strip()
        # Node.js writes the line of the program, the error, where it was called, and its version.
        error = _ERROR.search(text)
        return SimulationError(f"{self.title} failed: {error[0] if error else text[-500:]}")


def _printed(stream: IO[bytes]) -> dict[str, Any] | None:
    """A line of JSON; None where it ends before, or has another line, as of an abort."""
    line = stream.readline()
    try:
        return json.loads(line) if line.endswith(b"\n") else None
    except json.JSONDecodeError:
        return None


def _arrays(stream: IO[bytes]) -> dict[str, FloatArray] | None:
    """Arrays by name: a line of JSON with their shapes, then numbers; None where it ends before."""
    line = stream.readline()
    if not line.endswith(b"\n"):
        return None
    found: dict[str, FloatArray] = {}
    for name, shape in json.loads(line).items():
        length = 8 * math.prod(shape)
        numbers = stream.read(length)
        if len(numbers) < length:
            return None
        found[name] = np.frombuffer(numbers, dtype="<f8").reshape(shape)
    return found
