"""Checks the importers, each in an environment of its own, and writes importers/NAME/results.json.

Called by `make importers`. Usage: python importers/run.py TREBUCHECK [NAME...]; TREBUCHECK is the
command, environments go to .importers/, which a change of requirements.txt makes anew. What is
finished, an environment or a model, is kept: the same command goes on after an interruption. An
importer that cannot be installed or run keeps the results that it has, and the others are run. That
something is wrong with an importer is a result, not a failure.
"""

from __future__ import annotations

import json
import os
import platform
import re
import shutil
import subprocess
import sys
import time
import venv
from collections import Counter
from pathlib import Path
from tempfile import gettempdir

HERE = Path(__file__).parent.resolve()
MADE = HERE.parent / ".importers"
STEPS = {"drake": "2e-4", "pybullet": "2e-4", "dart": "2e-4"}
"""Step of importers with a first-order method [s]; all others take 1e-3."""
TIMEOUT = "900"  # [s] for one answer: compilers of kernels take their time


class CannotRunError(Exception):
    """Why an importer cannot be installed or run, in a sentence."""


def environment(name: str) -> Path:
    """The Python of an importer's environment, made if need be.

    Raises:
        CannotRunError: its packages cannot be installed here.
    """
    folder, requirements = MADE / name, HERE / name / "requirements.txt"
    python, made = folder / "bin" / "python", folder / "installed.txt"
    wanted = f"# Python {platform.python_version()}\n{requirements.read_text()}"
    if made.is_file() and made.read_text() == wanted:
        return python
    print(f"  installing: {requirements.read_text().splitlines()[0].lstrip('# ')}", flush=True)
    began = time.monotonic()
    if folder.is_symlink():
        folder.unlink()
    venv.create(folder, with_pip=True, clear=True)
    # Wheels only: what would have to be compiled takes long, and fails in ways that say nothing.
    pip = [
        str(python),
        "-m",
        "pip",
        "install",
        "--quiet",
        "--disable-pip-version-check",
        "--only-binary",
        ":all:",
    ]
    done = subprocess.run(
        [*pip, "-r", str(requirements)], check=False, capture_output=True, text=True
    )
    if done.returncode:
        raise CannotRunError(failed_installation(done.stderr))
    made.write_text(wanted)
    size = sum(path.lstat().st_size for path in folder.rglob("*") if path.is_file())
    print(f"  installed: {size / 1e6:.0f} MB in {time.monotonic() - began:.0f} s", flush=True)
    return python


def failed_installation(said: str) -> str:
    """Error message of pip, in a sentence."""
    here = f"Python {platform.python_version()} on {platform.system()} {platform.machine()}"
    absent = re.search(r"No matching distribution found for (\S+)", said)
    errors = [line for line in said.splitlines() if line.startswith("ERROR:")]
    why = (
        f"there is no wheel of {absent[1]}"
        if absent
        else (errors or ["pip failed"])[-1].removeprefix("ERROR: ")
    )
    return f"cannot be installed with {here}: {why}"


def check(trebucheck: str, name: str, python: Path) -> None:
    """Write the results of one importer.

    Raises:
        CannotRunError: the check ended without results.
    """
    out = MADE / "results" / name
    _forget_others(out, name)
    command = [
        trebucheck,
        "importer",
        f"{HERE / name / 'load.py'}:load",
        "--python",
        str(python),
        "--out",
        str(out),
    ]
    command += ["--timestep", STEPS.get(name, "1e-3"), "--timeout", TIMEOUT, "--resume"]
    # Kernels that were compiled once are kept for the next models and runs.
    caches = {
        "WARP_CACHE_PATH": str(MADE / "kernels" / "warp"),
        "JAX_COMPILATION_CACHE_DIR": str(MADE / "kernels/jax"),
    }
    began = time.monotonic()
    code = subprocess.run(
        command, check=False, stdout=subprocess.DEVNULL, env=os.environ | caches
    ).returncode
    if code not in (0, 1):
        raise CannotRunError(f"the check ended with exit code {code}")
    # What an importer prints names files of this machine.
    text = (
        (out / "importer.json")
        .read_text()
        .replace(str(HERE), "importers")
        .replace(str(HERE.parent) + "/", "")
    )
    text = re.sub(rf"{re.escape(gettempdir())}/\w+/", "", text.replace(str(Path.home()), "~"))
    (HERE / name / "results.json").write_text(text)
    models = json.loads(text)["models"]
    counts = Counter(check["verdict"] for model in models for check in model["checks"])
    told = ", ".join(f"{count} {verdict}" for verdict, count in counts.most_common())
    print(f"  {len(models)} models in {time.monotonic() - began:.0f} s: {told}", flush=True)


def _forget_others(out: Path, name: str) -> None:
    """Remove finished models that other packages, or another adapter, made."""
    stamp, sources = out / "made-with.txt", (HERE / name / "requirements.txt", HERE / "compiled.py")
    wanted = "".join(path.read_text() for path in sources)
    if not stamp.is_file() or stamp.read_text() != wanted:
        shutil.rmtree(out, ignore_errors=True)
        out.mkdir(parents=True)
        stamp.write_text(wanted)


def run(trebucheck: str, names: list[str]) -> dict[str, str]:
    """Run all plug-ins; returns why some could not be run, by name."""
    failed: dict[str, str] = {}
    for number, name in enumerate(names, 1):
        print(f"{name} ({number} of {len(names)})", flush=True)
        try:
            check(trebucheck, name, environment(name))
        except (CannotRunError, OSError) as error:
            failed[name] = str(error)
            print(f"  {error}", flush=True)
    return failed


def main(trebucheck: str, *wanted: str) -> int:
    """1 if some could not be run, 2 if there is none of a name."""
    known = sorted(path.parent.name for path in HERE.glob("*/load.py"))
    unknown = [name for name in wanted if name not in known]
    if unknown:
        print(
            f"error: there is no importer {unknown[0]!r}; there are: {', '.join(known)}.",
            file=sys.stderr,
        )
        return 2
    try:
        failed = run(trebucheck, list(wanted) or known)
    except KeyboardInterrupt:
        print("interrupted; the same command goes on from here.", file=sys.stderr)
        return 130
    for name, why in failed.items():
        print(f"{name}: {why}; its results are as they were.", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
