"""Runs the plug-ins, each in an environment of its own: tests, the suite of conformance, and the committed comparison.

Called by `make plugins`; needs nothing but Python. Usage: python plugins/run.py WHEEL_SOURCE NAME...
"""

from __future__ import annotations

import subprocess
import sys
import venv
from pathlib import Path

HERE = Path(__file__).parent
MACHINES = ("fixed", "rolling")


def environment(name: str, source: Path) -> Path:
    """The folder of the environment's programs; trebucheck and the plug-in are installed anew."""
    folder = source / ".plugins" / name
    programs = folder / "bin"
    if not programs.exists():
        venv.create(folder, with_pip=True)
    constraints = HERE / name / "constraints.txt"
    chosen = constraints if constraints.exists() else source / "constraints.txt"
    pip = [str(programs / "python"), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*pip, "--constraint", str(chosen), str(source), str(HERE / name), "pytest"], check=True)
    subprocess.run([*pip, "--force-reinstall", "--no-deps", str(source), str(HERE / name)], check=True)
    if (HERE / name / f"trebucheck_{name}" / "__main__.py").exists():  # it brings what pip cannot
        subprocess.run([str(programs / "python"), "-m", f"trebucheck_{name}"], check=True)
    return programs


def problems(programs: Path) -> list[str]:
    """Names of the machines and of the library's problems."""
    code = "import trebucheck.models.problems.registry as r; print(*(each.name for each in r.benchmarks()))"
    found = subprocess.run([str(programs / "python"), "-c", code], check=True, capture_output=True, text=True, cwd="/")
    return [*MACHINES, *found.stdout.split()]


def results(programs: Path, name: str) -> int:
    """Compare the engine on every problem, sweep its step on the first machine, and keep what a matrix needs."""
    trebucheck, folder, path = str(programs / "trebucheck"), programs.parent, HERE / "results" / f"{name}.json"
    compare = [trebucheck, "compare", "--engines", name, "--models", ",".join(problems(programs)), "--quiet"]
    # Exit code 1 says that some run disagrees, which is a result.
    found = subprocess.run([*compare, "--out", str(folder / "report")], cwd=folder)
    if found.returncode not in (0, 1):
        return found.returncode
    files = [str(folder / "report" / "results.json")]
    converge = [trebucheck, "converge", "--engines", name, "--models", MACHINES[0], "--knobs", "timestep", "--quiet"]
    # Without it, orders are those that the engine declares, and are said to be so.
    if subprocess.run([*converge, "--out", str(folder / "converge")], cwd=folder).returncode == 0:
        files.append(str(folder / "converge" / "converge.json"))
    path.parent.mkdir(exist_ok=True)
    return subprocess.run([trebucheck, "matrix", *files, "--quiet", "--out", str(path)], cwd=folder).returncode


def conformance(programs: Path, name: str) -> int:
    """What the tuned preset keeps of what it declares; the certificate is left in the environment's folder."""
    out = programs.parent / "conformance"
    command = [str(programs / "trebucheck"), "conform", f"{name}/tuned", "--out", str(out)]
    return subprocess.run(command, cwd=programs.parent).returncode


def main(source: Path, names: list[str]) -> int:
    """Run them all; the exit code is that of the first that fails."""
    failed = 0
    for name in names:
        programs = environment(name, source)
        tests = subprocess.run([str(programs / "python"), "-m", "pytest", "-q", "-c", "/dev/null", "--rootdir",
                                str(HERE / name), str(HERE / name / "tests")])  # fmt: skip
        failed = failed or tests.returncode or conformance(programs, name) or results(programs, name)
    return failed


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]).resolve(), sys.argv[2:]))
