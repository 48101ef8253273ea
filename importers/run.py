"""Checks the importers, each in an environment of its own, and writes importers/NAME/results.json.

Called by `make importers`. Usage: python importers/run.py TREBUCHECK [NAME...]; TREBUCHECK is the command, environments
go to .importers/. Exit code 1 of a check says that something is wrong with an importer, which is a result.
"""

from __future__ import annotations

import re
import subprocess
import sys
import venv
from pathlib import Path
from tempfile import gettempdir

HERE = Path(__file__).parent
STEPS = {"drake": "2e-4", "pybullet": "2e-4", "dart": "2e-4"}
"""Of importers that move by a method of first order [s]; of all others 1e-3."""
TIMEOUT = "300"  # [s] compilers of kernels take their time


def environment(name: str) -> Path:
    """The Python of an importer's environment, made if need be."""
    folder = HERE.parent / ".importers" / name
    python, made = folder / "bin" / "python", folder / "installed.txt"
    wanted = (HERE / name / "requirements.txt").read_text()
    if not made.is_file() or made.read_text() != wanted:
        venv.create(folder, with_pip=True, clear=True)
        pip = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        # What is stated is installed as it is: some packages name versions of others with which they do not run.
        subprocess.run([*pip, "-r", str(HERE / name / "requirements.txt")], check=True)
        made.write_text(wanted)
    return python


def check(trebucheck: str, name: str, python: Path) -> int:
    """Write the results of one importer."""
    out = HERE.parent / ".importers" / "results" / name
    command = [trebucheck, "importer", f"{HERE / name / 'load.py'}:load", "--python", str(python), "--out", str(out)]
    command += ["--timestep", STEPS.get(name, "1e-3"), "--timeout", TIMEOUT, "--quiet"]
    code = subprocess.run(command, check=False).returncode
    if code in (0, 1):
        # What an importer prints names files of this machine.
        text = (out / "importer.json").read_text().replace(str(HERE), "importers").replace(str(HERE.parent) + "/", "")
        text = re.sub(rf"{re.escape(gettempdir())}/\w+/", "", text.replace(str(Path.home()), "~"))
        (HERE / name / "results.json").write_text(text)
        return 0
    return code


def main(trebucheck: str, names: list[str]) -> int:
    """All of them; the exit code is that of the last one that could not be run."""
    failed = 0
    for name in names or sorted(path.parent.name for path in HERE.glob("*/load.py")):
        print(name, flush=True)
        failed = check(trebucheck, name, environment(name)) or failed
    return failed


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], sys.argv[2:]))
