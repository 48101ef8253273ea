"""Runs the plug-ins, each in an environment of its own, and keeps what the matrix shows of them.

Of each: install it with trebucheck, run its tests, the suite of conformance, a comparison on every
problem, sweeps of its time step, what its users ask first (`answers.py`), and with which releases
of the engine (`releases.py`); then write `results/NAME.json`, `answers/NAME.json` and
`releases/NAME.json`. A stage that has ended, well or not, is not run again while trebucheck and the
plug-in are the same files; `--again` runs all of it. What fails is listed at the end, and nothing
else is lost.

Called by `make plugins`; needs nothing but Python: python plugins/run.py SOURCE [--budget SECONDS]
[--again] [--no-diagnose] [--commit NAME] NAME...
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
import time
import venv
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

HERE = Path(__file__).parent
FREE_SWING = HERE / "free-swing.json"
"""The fixed machine without its stops: what an engine's scheme does with nothing but joints."""
DURATION = 2.0  # [s] of the free swing
RUNS = 8  # most parts of a problem, each with a budget: checks, runs, diagnoses of two presets


@dataclass(frozen=True)
class Batch:
    """Problems that one command takes."""

    problems: tuple[str, ...]
    arguments: tuple[str, ...] = ()


MACHINES: Mapping[str, Batch] = {
    "free-swing": Batch((str(FREE_SWING),), ("--until", str(DURATION))),
    "machines": Batch(("fixed", "rolling"), ("--sweep",)),
}
"""With work and precision at several steps on the machines; of all problems it would take hours."""
COMPILED = frozenset({"brax", "mjx"})
"""Compiled anew for half a minute at each step: no work and precision of these."""
SWEPT: Mapping[str, Batch] = {"free-swing": MACHINES["free-swing"], "fixed": Batch(("fixed",))}
CODE = (".py", ".cjs", ".mjs", ".j2")
"""Suffixes of Python, of programs for Node.js, and of templates of programs."""


@dataclass
class Plugin:
    """One plug-in with its environment."""

    name: str
    source: Path
    budget: float
    again: bool
    only: tuple[str, ...] = ()
    """How the names of the stages begin that are asked for; all if empty."""
    commit: str = ""
    """Of trebucheck's sources, kept with the results; unknown if empty."""
    diagnose: bool = True
    """Whether comparisons look for causes, which is most of their time."""
    done: dict[str, tuple[int, float]] = field(default_factory=dict[str, tuple[int, float]])
    """Exit code and seconds of each stage."""

    def __post_init__(self) -> None:
        self.folder = self.source / ".plugins" / self.name
        self.programs = self.folder / "bin"
        own = [path for path in files(HERE / self.name) if path.parent.name != "tests"]
        self.key = digest([*core_files(self.source), *own, FREE_SWING])
        """Digest of everything that results follow from."""

    def run(self) -> None:
        """Stages; nothing but the environment is needed for those that follow."""
        if self.stage("environment", self.environment):
            return
        python = str(self.programs / "python")
        pytest = [
            python,
            "-m",
            "pytest",
            "-q",
            "-c",
            "/dev/null",
            "-p",
            "no:cacheprovider",
            "--rootdir",
            str(HERE),
        ]
        tests = [
            str(path) for path in (HERE / self.name / "tests", HERE / "tests") if path.is_dir()
        ]
        self.stage("tests", lambda: self.call([*pytest, *tests], 20 * self.budget), always=True)
        for study, batches in (
            ("compare", MACHINES),
            ("converge", SWEPT),
            ("compare", self.library()),
        ):
            for name, batch in batches.items():
                self.stage(
                    f"{study} {name}", lambda s=study, n=name, of=batch: self.studied(s, n, of)
                )
        for asked in ("answers", "releases"):
            written = str(HERE / asked / f"{self.name}.json")
            command = [python, str(HERE / f"{asked}.py"), self.name, written]
            self.stage(asked, lambda of=command: self.call(of, 20 * self.budget))
        self.stage("matrix", self.matrix, always=True)
        conform = [
            *self.trebucheck("conform", f"{self.name}/assisted"),
            "--out",
            str(self.folder / "conformance"),
        ]
        self.stage("conform", lambda: self.call(conform, 20 * self.budget))

    def stage(self, name: str, work: object, *, always: bool = False) -> int:
        """Exit code of a stage, run now or before; 0 if it is not asked for, and left as it was."""
        if (
            self.only
            and name != "environment"
            and not any(name.startswith(each) for each in self.only)
        ):
            return 0
        stamp = self.folder / "stages" / f"{name.replace(' ', '-')}.json"
        kept = json.loads(stamp.read_text()) if stamp.is_file() else {}
        whole = self.diagnose or not name.startswith("compare")
        key = self.key if whole else f"{self.key}, not diagnosed"
        if kept.get("key") in (self.key, key) and not (self.again or always):
            self.done[name] = kept["code"], kept["seconds"]
            return int(kept["code"])
        print(f"{self.name}: {name}", flush=True)
        start = time.monotonic()
        code = int(work())  # type: ignore[operator]
        self.done[name] = code, round(time.monotonic() - start, 1)
        stamp.parent.mkdir(parents=True, exist_ok=True)
        stamp.write_text(json.dumps({"key": key, "code": code, "seconds": self.done[name][1]}))
        return code

    def environment(self) -> int:
        """Install trebucheck and the plug-in anew."""
        if not self.programs.exists():
            venv.create(self.folder, with_pip=True)
        own = HERE / self.name / "constraints.txt"
        chosen = own if own.exists() else self.source / "constraints.txt"
        pip = [
            str(self.programs / "python"),
            "-m",
            "pip",
            "install",
            "--quiet",
            "--disable-pip-version-check",
        ]
        both = [str(self.source), str(HERE / "toolkit"), str(HERE / self.name)]
        fast = f"{self.source}[fast]"  # the reference is compiled: half of a comparison's time
        code = self.call([*pip, "--constraint", str(chosen), fast, *both[1:], "pytest"], 1800.0)
        code = code or self.call([*pip, "--force-reinstall", "--no-deps", *both], 1800.0)
        if (
            HERE / self.name / f"trebucheck_{self.name}" / "__main__.py"
        ).exists():  # it brings what pip cannot
            code = code or self.call(
                [str(self.programs / "python"), "-m", f"trebucheck_{self.name}"], 1800.0
            )
        for folder in both:  # what pip leaves where it builds
            for left in [Path(folder) / "build", *Path(folder).glob("*.egg-info")]:
                shutil.rmtree(left, ignore_errors=True)
        return code

    def library(self) -> dict[str, Batch]:
        """The library's problems by chapter."""
        code = (
            "from trebucheck.models.library.registry import benchmarks; "
            "print(*(f'{e.number}:{e.name}' for e in benchmarks()))"
        )
        run = [str(self.programs / "python"), "-c", code]
        chapters: dict[str, tuple[str, ...]] = {}
        for entry in subprocess.run(
            run, check=True, capture_output=True, text=True, cwd="/"
        ).stdout.split():
            number, _, name = entry.partition(":")
            chapters[number[0]] = (*chapters.get(number[0], ()), name)
        return {chapter: Batch(problems) for chapter, problems in chapters.items()}

    def trebucheck(self, *arguments: str) -> list[str]:
        """The environment's command."""
        return [str(self.programs / "trebucheck"), *arguments]

    def studied(self, study: str, name: str, batch: Batch) -> int:
        """Exit code of a study of the engine: 0 if it came to an end, whatever it found."""
        out, written = (
            self.folder / study / name,
            {"compare": "results.json"}.get(study, f"{study}.json"),
        )
        (out / written).unlink(missing_ok=True)
        command = self.trebucheck(
            study, "--engines", self.name, "--models", ",".join(batch.problems), *batch.arguments
        )
        if self.name in COMPILED and "--sweep" in command:
            command.remove("--sweep")
        command += ["--knobs", "timestep"] if study == "converge" else []
        command += ["--no-diagnose"] if study == "compare" and not self.diagnose else []
        command += ["--resume", "--timeout", f"{self.budget:g}", "--quiet", "--out", str(out)]
        code = self.call(command, RUNS * self.budget * len(batch.problems))
        # Exit code 1 says that some run disagrees, which is a result.
        return 0 if code in (0, 1) and (out / written).is_file() else code or 1

    def matrix(self) -> int:
        """Results so far as one file; none if there are none."""
        found = [
            *self.folder.glob("compare/*/results.json"),
            *self.folder.glob("converge/*/converge.json"),
        ]
        # Results tell their command.
        names = [str(path.relative_to(self.folder)) for path in sorted(found)]
        written, path = self.folder / "matrix.json", HERE / "results" / f"{self.name}.json"
        command = self.trebucheck("matrix", *names, "--quiet", "--out", written.name)
        if self.commit:
            command += ["--commit", self.commit]
        code = self.call(command, 600.0)
        if not code:
            path.parent.mkdir(exist_ok=True)
            shutil.copyfile(written, path)
        return code

    def call(self, command: list[str], seconds: float) -> int:
        """Exit code of a command; 124 if it timed out, as with `timeout`."""
        process = subprocess.Popen(command, cwd=self.folder, start_new_session=True)
        try:
            return process.wait(seconds)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, 9)  # what it started, too
            process.wait()
            return 124


def files(folder: Path) -> list[Path]:
    """Files that decide what runs."""
    return sorted(
        path for path in folder.rglob("*") if path.suffix in (*CODE, ".toml", ".txt", ".json")
    )


def core_files(source: Path) -> Iterator[Path]:
    """Files of trebucheck that the results depend on."""
    for folder in ("models", "reference", "engines", "comparisons", "conformance"):
        yield from (path for path in files(source / folder) if path.suffix in CODE)
    toolkit = source / "plugins" / "toolkit" / "trebucheck_toolkit"
    yield from (path for path in files(toolkit) if path.suffix in CODE)
    yield source / "constraints.txt"


def digest(paths: list[Path]) -> str:
    """Digest of the contents."""
    found = hashlib.sha256()
    for path in paths:
        found.update(path.read_bytes())
    return found.hexdigest()


def main() -> int:
    """Run them all; the exit code is 1 if a stage of any failed."""
    parser = argparse.ArgumentParser()
    parser.add_argument("source", type=Path)
    parser.add_argument("names", nargs="+")
    parser.add_argument(
        "--budget", type=float, default=120.0, help="longest wait for one run, or one diagnosis [s]"
    )
    parser.add_argument("--again", action="store_true", help="run what has been run before, too")
    parser.add_argument(
        "--only",
        default="",
        help="how the names of stages begin, comma-separated: compare E,matrix",
    )
    parser.add_argument("--commit", default="", help="of the sources, kept with the results")
    parser.add_argument(
        "--no-diagnose", action="store_true", help="verdicts without causes, in less time"
    )
    given = parser.parse_args()
    only = tuple(filter(None, given.only.split(",")))
    plugins = [
        Plugin(
            name,
            given.source.resolve(),
            given.budget,
            given.again,
            only,
            commit=given.commit,
            diagnose=not given.no_diagnose,
        )
        for name in given.names
    ]
    for plugin in plugins:
        try:
            plugin.run()
        except Exception as error:  # one plug-in's failure must not cost the others
            print(f"{plugin.name}: {type(error).__name__}: {error}", file=sys.stderr)
            plugin.done["run.py"] = 1, 0.0
    for plugin in plugins:
        failed = ", ".join(f"{stage} ({code})" for stage, (code, _) in plugin.done.items() if code)
        seconds = sum(spent for _, spent in plugin.done.values())
        print(
            f"{plugin.name:<10} {len(plugin.done)} stages in {seconds:.0f} s; failed: "
            f"{failed or 'none'}"
        )
    return int(any(code for plugin in plugins for code, _ in plugin.done.values()))


if __name__ == "__main__":
    sys.exit(main())
