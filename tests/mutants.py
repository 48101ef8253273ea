"""Random mutants of the judging code, the adapters and the reference, and how many the tests kill.

    python tests/mutants.py --seed 7 --number 100 --group judging

A mutant is a copy of the package with one expression changed. The tests of its folder run against
the copy until one fails. A mutant that survives is told from one that changes nothing by a probe: a
few comparisons whose every value is held against the unchanged package's. The exit code is 0
whatever is found; the last line is the score.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice, starmap
from pathlib import Path

ROOT = Path(__file__).parents[1]
LONGEST = 1800.0  # [s] of the tests of one mutant

GROUPS: dict[str, tuple[str, ...]] = {
    "judging": ("comparisons/runs", "comparisons/diagnosis", "comparisons/judge.py", "conformance"),
    "adapters": ("engines/mujoco", "engines/pymunk", "engines/exudyn", "engines"),
    "reference": ("reference", "models"),
}
"""Folders and files of each group; mutants are drawn by lines of code from all of them."""

TESTS: dict[str, tuple[str, ...]] = {
    "judging": (
        "tests/meta/test_recorded.py",
        "tests/unit",
        "tests/meta",
        "tests/agreement/test_agreement.py",
    ),
    "adapters": ("tests/meta/test_recorded.py", "tests/unit", "tests/agreement"),
    "reference": ("tests/meta/test_recorded.py", "tests/verification", "tests/unit"),
}
"""Tests that run against the mutants of a group, the quickest first.

Of the files in them those that import the changed module come before the others.
"""

COMPARED = {ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt, ast.Eq: ast.NotEq}
COMPARED |= {ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn}
CALCULATED = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult}
EXCHANGED = {"min": "max", "max": "min", "any": "all", "all": "any"}


@dataclass(frozen=True)
class Mutant:
    """One change of one file."""

    path: Path
    line: int
    before: str
    after: str
    source: str
    """Text of the whole changed file."""

    def __str__(self) -> str:
        return f"{self.path.relative_to(ROOT)}:{self.line}: {self.before} -> {self.after}"


def changed(node: ast.AST) -> Iterator[ast.AST]:
    """What a node may be changed into."""
    match node:
        case ast.Compare(left=left, ops=[operator], comparators=[right]) if (
            type(operator) in COMPARED
        ):
            yield ast.Compare(left, [COMPARED[type(operator)]()], [right])
        case ast.BinOp(left=left, op=operator, right=right) if type(operator) in CALCULATED:
            yield ast.BinOp(left, CALCULATED[type(operator)](), right)
        case ast.BoolOp(op=ast.And(), values=values):
            yield ast.BoolOp(ast.Or(), values)
        case ast.BoolOp(op=ast.Or(), values=values):
            yield ast.BoolOp(ast.And(), values)
        case ast.UnaryOp(op=ast.Not() | ast.USub(), operand=operand):
            yield operand
        case ast.Call(func=ast.Name(id="abs"), args=[argument]):
            yield argument
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=keywords) if (
            name in EXCHANGED
        ):
            yield ast.Call(ast.Name(EXCHANGED[name], ast.Load()), arguments, keywords)
        case ast.IfExp(test=test, body=body, orelse=orelse):
            yield ast.IfExp(test, orelse, body)
        case ast.Constant(value=bool() as value):
            yield ast.Constant(not value)
        case ast.Constant(value=int() | float() as value):
            yield ast.Constant(value * 2 if value else 1)
        case ast.Slice(lower=lower, upper=upper) if lower is not None or upper is not None:
            yield ast.Slice(None, None)
        case _:
            return


def candidates(path: Path) -> list[tuple[Path, ast.expr | ast.Slice, ast.AST]]:
    """Every node of a file that may be changed, with what it is changed into."""
    tree = ast.parse(path.read_text())
    return [(path, node, new) for node in _within_functions(tree) for new in changed(node)]


def made(path: Path, node: ast.expr | ast.Slice, new: ast.AST) -> Mutant | None:
    """The mutant; None where what it says is no Python, inside an f-string for one."""
    encoded = path.read_bytes()
    starts = [0]
    for line in encoded.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    begin = starts[node.lineno - 1] + node.col_offset
    end = starts[(node.end_lineno or node.lineno) - 1] + (node.end_col_offset or 0)
    before, after = encoded[begin:end].decode(), ast.unparse(new)
    if not isinstance(new, ast.Slice):
        after = f"({after})"
    source = (encoded[:begin] + after.encode() + encoded[end:]).decode()
    try:
        ast.parse(source)
    except SyntaxError:
        return None
    return Mutant(path, node.lineno, before, after, source)


def _within_functions(tree: ast.Module) -> Iterator[ast.expr]:
    """Expressions of the bodies of functions, without annotations and defaults."""
    for function in ast.walk(tree):
        if isinstance(function, ast.FunctionDef):
            for statement in function.body:
                for node in ast.walk(statement):
                    if isinstance(node, ast.expr | ast.Slice) and hasattr(node, "lineno"):
                        yield node


def drawn(group: str, number: int, seed: int) -> list[Mutant]:
    """Mutants of a group, drawn from all of its mutants; the seed repeats them."""
    paths = {path for part in GROUPS[group] for path in [*(ROOT / part).rglob("*.py"), ROOT / part]}
    paths = {path for path in paths if path.suffix == ".py"}
    every = [candidate for path in sorted(paths) for candidate in candidates(path)]
    random.Random(seed).shuffle(every)
    return list(islice(filter(None, starmap(made, every)), number))


def environment(folder: Path) -> dict[str, str]:
    """Of a process that imports the package from a folder."""
    path = os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])
    return os.environ | {"PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1"}


def probe(folder: Path) -> str:
    """Values of the probe, as text, or how it failed."""
    done = subprocess.run(
        [sys.executable, str(Path(__file__).with_name("mutant_probe.py"))],
        env=environment(folder), cwd=folder, capture_output=True, text=True, check=False,
        timeout=LONGEST,
    )  # fmt: skip
    return done.stdout if done.returncode == 0 else done.stderr[-500:]


def ordered(tests: Sequence[str], module: Path) -> list[str]:
    """Files of tests: the recorded values, those that import the module, the others."""
    name = ".".join(module.relative_to(ROOT).with_suffix("").parts)
    files: list[Path] = []
    for test in tests:
        path = ROOT / test
        files += sorted(path.rglob("test_*.py")) if path.is_dir() else [path]
    files = list(dict.fromkeys(files))  # a file may be named and be in a folder, too
    quickest, others = files[:1], files[1:]
    others.sort(key=lambda path: f"trebucheck.{name}" not in path.read_text())
    return [str(path.relative_to(ROOT)) for path in quickest + others]


def killed_by(folder: Path, tests: Sequence[str]) -> str | None:
    """The test that fails against the package in a folder; None: all pass.

    Raises:
        subprocess.TimeoutExpired: they do not end in the longest time.
    """
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests]
    done = subprocess.run(
        command, env=environment(folder), cwd=ROOT, capture_output=True, text=True, check=False,
        timeout=LONGEST,
    )  # fmt: skip
    if done.returncode == 0:
        return None
    failed = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    return failed[0] if failed else f"exit code {done.returncode}"


def outcome_of(folder: Path, tests: Sequence[str], unchanged: str) -> tuple[str, str]:
    """Outcome of the mutant in a folder, and what decided it."""
    try:
        killer = killed_by(folder, tests)
        if killer is not None:
            return "killed", killer
        return ("without effect" if probe(folder) == unchanged else "SURVIVED"), ""
    except subprocess.TimeoutExpired:
        # A slow machine does this as well as a loop without end: it is not counted as killed.
        return "SURVIVED", f"not finished in {LONGEST:g} s"


def main() -> None:
    """Draws mutants, tests each, prints each and the score."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--number", type=int, default=30)
    parser.add_argument("--group", choices=sorted(GROUPS), default="judging")
    parser.add_argument("--tests", nargs="*", help="files of tests; those of the group by default")
    asked = parser.parse_args()
    outcomes: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as temporary:
        package = Path(temporary) / "trebucheck"
        ignored = shutil.ignore_patterns(".*", "tests", "docs", "plugins", "__pycache__", "build")
        shutil.copytree(ROOT, package, ignore=ignored)
        right = probe(package.parent)
        for mutant in drawn(asked.group, asked.number, asked.seed):
            target = package / mutant.path.relative_to(ROOT)
            target.write_text(mutant.source)
            tests = ordered(asked.tests or TESTS[asked.group], mutant.path)
            outcome, reason = outcome_of(package.parent, tests, right)
            outcomes[outcome] += 1
            print(f"{outcome:14} {mutant}  {reason}", flush=True)
            target.write_text(mutant.path.read_text())
    effective = outcomes["killed"] + outcomes["SURVIVED"]
    print(json.dumps({"group": asked.group, "seed": asked.seed, **outcomes}))
    print(f"{outcomes['killed']} of {effective} mutants that change something are killed")


if __name__ == "__main__":
    main()
