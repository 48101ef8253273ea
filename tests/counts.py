"""Counts of what the code weighs and how it reads: `python tests/counts.py`; ceilings are tested.

A count that falls is written down here as the new ceiling; one that has to rise needs a reason in
the commit that raises it.
"""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).parents[1]
CORE = (
    "models",
    "reference",
    "engines",
    "comparisons",
    "conformance",
    "cli",
    "api",
    "docs",
    "benchmarks",
    "examples",
)
SATELLITES = ("paper", "environments", "importers", "plugins")
PREPOSITIONS = re.compile(r"(Of|What|That|As|By|Whose|With|In|For|To|Which)\b")
ELEMENT_CLASSES = """
PinJoint WeldJoint SlotJoint PrismaticJoint FreeJoint Stop PointStop SpringDamper
RotationalSpringDamper CubicTorsionSpring ConstantForce ConstantTorque
"""
ELEMENTS = frozenset(ELEMENT_CLASSES.split())

CEILINGS: dict[str, float] = {
    # Files that people have are read and audited, with recorded controls, and moved as engines, by
    # others that step MuJoCo's models as well; seven elements; extrema of
    # proofs; an implicit method for stiff motions; Exudyn and pymunk follow recorded efforts; what
    # public model files had that was not read, or not told, and what pymunk moves of them; stiff
    # motions go on over instants, and without Numba
    "lines": 75998,
    # A process that throws machines imports no engine: what it does is a module. What a mechanism
    # was read from, and what moves that file as it is, are one each; an element is one. Stiff
    # motions are one, and rotors as a part of moments, which pymunk and plug-ins build
    "modules": 291,
    # Horizons and published figures, with their pages and tests, are proofs of other questions.
    # Each of the prover's is one formula; what ends with its parent is for plug-ins, too; what
    # throws machines, and what records episodes, import none of what is beside them; the table of
    # elements imports each; the method for stiff motions is a formula
    "modules with one importer": 66,
    "public class names used twice": 1,
    "isinstance on elements": 9,
    "files with isinstance on elements": 7,
    "% of lines over 100": 0.0,
    "% of docstrings that begin with a preposition": 0.48,
    "comprehensions per 100 statements": 5.8,
    "ternaries per 100 statements": 2.78,
}
"""Largest allowed value of each count of the core."""


@dataclass
class Module:
    """One file, parsed."""

    path: Path
    text: str = field(init=False)
    tree: ast.Module = field(init=False)

    def __post_init__(self) -> None:
        self.text = self.path.read_text()
        self.tree = ast.parse(self.text)

    @property
    def name(self) -> str:
        """Dotted name from the repository's root."""
        parts = self.path.relative_to(ROOT).with_suffix("").parts
        return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)

    def imports(self) -> Iterator[str]:
        """Dotted names, from the root, of what its relative imports may name."""
        package = self.path.relative_to(ROOT).parts[:-1]
        for node in ast.walk(self.tree):
            if isinstance(node, ast.ImportFrom) and node.level:
                base = package[: len(package) - node.level + 1]
                module = ".".join([*base, *([node.module] if node.module else [])])
                yield module
                yield from (f"{module}.{alias.name}".lstrip(".") for alias in node.names)


def modules(*folders: str) -> list[Module]:
    """Modules below folders, without tests; the front door's where none is named."""
    paths = [path for folder in folders for path in sorted((ROOT / folder).rglob("*.py"))]
    if folders == CORE:
        paths += sorted(ROOT.glob("*.py"))
    return [Module(path) for path in paths if "tests" not in path.relative_to(ROOT).parts]


def docstrings(module: Module) -> Iterator[str]:
    """First lines of the docstrings of a module, its classes, functions and fields."""
    for node in ast.walk(module.tree):
        body = getattr(node, "body", None)
        for statement in body if isinstance(body, list) else ():
            value = getattr(statement, "value", None)
            text = value.value if isinstance(value, ast.Constant) else None
            if isinstance(statement, ast.Expr) and isinstance(text, str) and text.strip():
                yield text.strip().splitlines()[0]


def comments(module: Module) -> int:
    """Comments of a module, without directives to tools."""
    tokens = tokenize.generate_tokens(io.StringIO(module.text).readline)
    return sum(
        token.type == tokenize.COMMENT
        and not re.match(r"# ?(noqa|type:|pyright|fmt)", token.string)
        for token in tokens
    )


def checks_of_elements(module: Module) -> int:
    """Calls of isinstance that ask for the class of an element."""
    calls = (node for node in ast.walk(module.tree) if isinstance(node, ast.Call))
    asked = (c.args[1] for c in calls if getattr(c.func, "id", "") == "isinstance" and c.args[1:])
    named = ({getattr(n, "id", getattr(n, "attr", "")) for n in ast.walk(a)} for a in asked)
    return sum(bool(names & ELEMENTS) for names in named)


def modules_with_one_importer(every: list[Module]) -> dict[str, str]:
    """Modules that exactly one other module of these imports, and which one."""
    names = {module.name for module in every}
    importers: dict[str, set[str]] = defaultdict(set)
    for module in every:
        for name in module.imports():
            if name in names and name != module.name:
                importers[name].add(module.name)
    packages = {module.name for module in every if module.path.name == "__init__.py"}
    alone = {name: who for name, who in importers.items() if len(who) == 1}
    return {name: who.pop() for name, who in alone.items() if name not in packages}


def count(*folders: str, with_comments: bool = False) -> dict[str, float]:
    """Counts of the modules below folders; of comments, which have no ceiling, if asked for."""
    every = modules(*folders)
    public: Counter[str] = Counter()
    for module in every:
        for node in module.tree.body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                public[node.name] += 1
    lines = [line for module in every for line in module.text.splitlines()]
    nodes = [node for module in every for node in ast.walk(module.tree)]
    statements = sum(isinstance(node, ast.stmt) for node in nodes) / 100
    written = [line for module in every for line in docstrings(module)]
    asking = [checks_of_elements(module) for module in every]
    comprehension = (ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)
    found = {
        "lines": len(lines),
        "modules": len(every),
        "modules with one importer": len(modules_with_one_importer(every)),
        "public class names used twice": sum(number > 1 for number in public.values()),
        "isinstance on elements": sum(asking),
        "files with isinstance on elements": sum(bool(number) for number in asking),
        "% of lines over 100": 100 * sum(len(line) > 100 for line in lines) / len(lines),
        "% of docstrings that begin with a preposition": 100
        * sum(bool(PREPOSITIONS.match(line)) for line in written)
        / max(1, len(written)),
        "comprehensions per 100 statements": sum(isinstance(n, comprehension) for n in nodes)
        / statements,
        "ternaries per 100 statements": sum(isinstance(n, ast.IfExp) for n in nodes) / statements,
    }
    if with_comments:
        found["comments per 100 statements"] = sum(map(comments, every)) / statements
    return found


def main() -> None:
    """Prints the counts of the core, of its folders, and of the satellites."""
    groups = {"core": CORE, **{f: (f,) for f in CORE}, **{f: (f,) for f in SATELLITES}}
    for name, folders in groups.items():
        print(name)
        for what, value in count(*folders, with_comments=name == "core").items():
            if name == "core" or what in ("lines", "modules"):
                print(f"  {what}: {value:.4g}" if value % 1 else f"  {what}: {value:.0f}")


if __name__ == "__main__":
    main()
