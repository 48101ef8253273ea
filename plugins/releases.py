"""Since which release of an engine its settings move the pendulum by the program on its page.

The program of `answers.py` is run with each release, newest first, installed in a folder of its
own, from the one that the plug-in is tested with to the first that does not run it, or moves the
rod elsewhere: by more than a thousandth of its swing, the default tolerance.

Called by `plugins/run.py` in the environment of a plug-in: python plugins/releases.py NAME OUT. The
page of an engine (`python docs/generate.py engine-pages`) shows what it writes.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import sysconfig
import tempfile
import venv
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from answers import AMPLITUDE, made, own_program, tried
from trebucheck.comparisons.runs.process import Worker
from trebucheck.comparisons.runs.tolerances import DEFAULT as TOLERATED
from trebucheck.engines.presets import SETTINGS
from trebucheck.models.arrays import FloatArray
from trebucheck.models.errors import SimulationError
from trebucheck_toolkit.node_package import NodePackage

LIMIT = 120.0  # [s] of a run
INSTALLATION = 900.0  # [s]
_STABLE = re.compile(r"\d+(\.\d+)*")
_ERROR = re.compile(r"^[\w.]*(?:Error|Exception|Interrupt)\b.*", re.MULTILINE)
_SITE = "import sysconfig; print(sysconfig.get_path('purelib'))"
_PRINTED = """
import json, sys
found = {"__name__": "__main__"}
exec(sys.stdin.read(), found)
print("\\n" + json.dumps({"q": found["q"].tolist()}), flush=True)
"""


class Npm:
    """Releases of a package of npm, whose program prints what it has moved."""

    def __init__(self, package: str) -> None:
        self.package = package

    def releases(self) -> list[str]:
        """Releases of the package, oldest first."""
        return json.loads(_told(["npm", "view", self.package, "versions", "--json"]))

    def install(self, release: str, folder: str) -> None:
        """Install one in a folder; RuntimeError if that fails."""
        quiet = ["--no-package-lock", "--no-audit", "--no-fund", "--prefix", folder]
        _told(["npm", "install", *quiet, f"{self.package}@{release}"])

    def moved(self, program: str, folder: str) -> Any:
        """Coordinates that a program moves; SimulationError if it does not run."""
        node = NodePackage(self.package, self.package, module="", folder=Path(folder))
        with Worker(timeout=LIMIT) as worker:
            return worker.compute(partial(node.run, program), self.package)["q"]


class Pypi:
    """Releases of a distribution on PyPI, whose program leaves what it has moved as `q`."""

    def __init__(self, package: str) -> None:
        self.package = package

    def releases(self) -> list[str]:
        """Releases of the distribution, oldest first."""
        listed = _told([sys.executable, "-m", "pip", "index", "versions", self.package])
        return listed.partition("Available versions: ")[2].splitlines()[0].split(", ")[::-1]

    def install(self, release: str, folder: str) -> None:
        """Install one over this environment, whose packages stay as they are where it takes them.

        Raises:
            RuntimeError: that fails.
        """
        venv.create(folder, clear=True)
        python = _python(folder)
        own = _told([python, "-c", _SITE]).strip()
        Path(own, "others.pth").write_text(sysconfig.get_path("purelib") + "\n", encoding="utf-8")
        _told([python, "-m", "pip", "install", "--quiet", f"{self.package}=={release}"])

    def moved(self, program: str, folder: str) -> Any:
        """Coordinates that a program moves; SimulationError if it does not run."""
        try:
            done = subprocess.run(
                [_python(folder), "-c", _PRINTED],
                check=False,
                capture_output=True,
                text=True,
                input=program,
                cwd=folder,
                timeout=LIMIT,
            )
        except subprocess.TimeoutExpired:
            raise SimulationError(f"it takes longer than {LIMIT:g} s") from None
        # It may print more before and after.
        line = next((each for each in done.stdout.splitlines() if each.startswith('{"q"')), "")
        if not line:
            errors = _ERROR.findall(done.stderr) or ["it ended without a result"]
            raise SimulationError(errors[-1])
        return json.loads(line)["q"]


def _python(folder: str) -> str:
    return str(Path(folder) / "bin" / "python")


def _told(command: Sequence[str]) -> str:
    """Standard output of a command; RuntimeError if it fails."""
    done = subprocess.run(
        command, check=False, capture_output=True, text=True, timeout=INSTALLATION
    )
    if done.returncode:
        raise RuntimeError(f"{command[0]} ended with the code {done.returncode}")
    return done.stdout


def since(source: Npm | Pypi, tested: str, program: str) -> dict[str, Any]:
    """The oldest release in an unbroken row with the tested one, and what the one before does.

    Returns:
        Names of the package, of the tested release and of the oldest; the one before it, None if
        there is none, in words what it does, and its error if it has one.
    """
    listed = [each for each in source.releases() if _STABLE.fullmatch(each)]
    found: dict[str, Any] = {"package": source.package, "tested": tested, "since": None}
    right: FloatArray | None = None
    for release in listed[listed.index(tested) :: -1]:
        print(f"{source.package} {release}", flush=True)
        with tempfile.TemporaryDirectory() as folder:
            try:
                source.install(release, folder)
            except (RuntimeError, subprocess.TimeoutExpired):
                return found | {"before": release, "how": "could not be installed"}
            try:
                q = np.array(source.moved(program, folder), dtype=float)
            except SimulationError as error:
                text = str(error).removeprefix(f"{source.package} failed: ")
                said = " ".join(text.replace(folder, ".").split())
                return found | {"before": release, "how": "fails", "error": said}
        right = q if right is None else right
        if q.shape != right.shape:
            return found | {"before": release, "how": "takes other steps"}
        off = float(np.abs(q - right).max()) / (2 * AMPLITUDE)
        if not off <= TOLERATED:
            return found | {"before": release, "how": f"is off by {off:.1e} of the swing"}
        found["since"] = release
    return found | {"before": None}


def main() -> None:
    """Write since which release; nothing of an engine that has no program."""
    name, out = sys.argv[1:]
    program = tried(own_program, name).get("text")
    if not program:
        return
    engine = made(name, SETTINGS)
    npm = getattr(engine, "npm", None)
    source = Pypi(engine.package) if npm is None else Npm(npm.package)
    found = since(source, engine.version(), program)
    if found["since"] is None:
        raise SystemExit(f"{name}: {found['before']} {found['how']}: {found.get('error', '')}")
    Path(out).parent.mkdir(parents=True, exist_ok=True)
    Path(out).write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
