"""Generate schemas, tables, pictures and reference pages of the repository (`make generated`).

With names of parts only those: `python docs/generate.py readme commands`.
"""

from __future__ import annotations

import inspect
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from enum import Enum
from pathlib import Path
from types import ModuleType
from typing import Any

import console
import mjcf
import notebook
import trebucheck as tb
import typer
from mjcf_readme import readme
from trebucheck.cli.app import app
from trebucheck.comparisons.compare.study import Comparison
from trebucheck.comparisons.converge.results import Studies
from trebucheck.comparisons.data.certified import names, publish
from trebucheck.comparisons.diff import DifferenceData
from trebucheck.comparisons.explain.results import Explanation
from trebucheck.comparisons.judge.study import Judgement
from trebucheck.comparisons.matrix import distilled, orders_of
from trebucheck.comparisons.matrix import matrix as read_matrix
from trebucheck.comparisons.mjcf import record_motion
from trebucheck.comparisons.problems import check
from trebucheck.comparisons.recommend import Advice
from trebucheck.comparisons.report import markdown
from trebucheck.comparisons.report.document import Document, table, without_empty_columns
from trebucheck.comparisons.report.pages import compare as figures
from trebucheck.comparisons.report.pages.compare import differences
from trebucheck.comparisons.report.pages.matrix import document as matrix_document
from trebucheck.comparisons.report.pages.problems import library
from trebucheck.comparisons.report.plots import Axis, Panels, Plot, picture, write_picture
from trebucheck.comparisons.runs.process import Worker, simulate
from trebucheck.comparisons.runs.results import Results
from trebucheck.comparisons.runs.scales import scales_until
from trebucheck.comparisons.runs.stretching import stretching_until
from trebucheck.conformance.verdicts import Conformance
from trebucheck.models.library.benchmark import Benchmark
from trebucheck.models.library.registry import benchmarks, models
from trebucheck.models.mechanism import mechanism_schema
from trebucheck.models.mjcf.recorded import RECORDED_FILE
from trebucheck.models.mjcf.writer import write_model_folder
from trebucheck.models.spec import schema_text
from trebucheck.reference.solver import solve
from trebucheck_importers.files import publish as publish_zoo
from trebucheck_importers.report import machine_table, overview, versions_table
from trebucheck_importers.report import page as page_of_importer
from trebucheck_importers.results import ImporterResults
from trebucheck_importers.zoo.registry import zoo
from trebucheck_paper.evidence.claims import Study
from trebucheck_paper.report import summary
from trebucheck_paper.study import study
from typer.cli import get_docs_for_click

ROOT = Path(__file__).parents[1]
OTHERS = tuple(name for name in models() if name not in ("fixed", "rolling"))


def agreement_table(comparison: Comparison) -> str:
    """The tables of docs/agreement.md, one a machine, in Markdown."""
    tables = []
    for machine in comparison.results.machines:
        runs = (
            run
            for run in comparison.results.runs
            if run.model == machine.model and run.engine != "reference"
        )
        shown = table(differences(machine), runs, f"{machine.model.capitalize()} machine")
        tables.append(without_empty_columns(shown))
    return markdown.text(Document("", tuple(tables)))


def distance_plots(comparison: Comparison) -> Panels:
    """Distance of the projectile from the reference over time, both machines."""
    drawn: list[Plot] = []
    for machine in comparison.results.machines:
        own = {
            label: t
            for (name, label), t in comparison.trajectories.items()
            if name == machine.model
        }
        runs = figures.lines(comparison.solutions[machine.model], own, machine.compared_to)
        position = figures.position("projectile")
        series = tuple(
            run.difference(position) for run in runs if not run.label.startswith("reference")
        )
        axis = Axis("distance from the reference", "m", logarithmic=True)
        drawn.append(Plot(Axis("t", "s"), axis, series, machine.model))
    return tuple(drawn)


def write_schemas() -> None:
    """The published JSON schemas."""
    (ROOT / "models" / "schemas" / "mechanism.schema.json").write_text(mechanism_schema())
    (ROOT / "comparisons" / "schemas" / "results.schema.json").write_text(schema_text(Results))
    (ROOT / "comparisons" / "schemas" / "diff.schema.json").write_text(schema_text(DifferenceData))
    (ROOT / "comparisons" / "schemas" / "judgement.schema.json").write_text(schema_text(Judgement))
    (ROOT / "comparisons" / "schemas" / "conformance.schema.json").write_text(
        schema_text(Conformance)
    )
    (ROOT / "comparisons" / "schemas" / "converge.schema.json").write_text(schema_text(Studies))
    (ROOT / "comparisons" / "schemas" / "explain.schema.json").write_text(schema_text(Explanation))
    (ROOT / "paper" / "trebucheck_paper" / "schemas" / "paper.schema.json").write_text(
        schema_text(Study)
    )
    (ROOT / "comparisons" / "schemas" / "recommend.schema.json").write_text(schema_text(Advice))


def write_problems() -> None:
    """The page of the problem library: every problem with its figures beside the reference's."""
    page = ROOT / "docs" / "problems.md"
    before = page.read_text() if page.is_file() else ""
    kept = re.search(r"<!-- generated: engines -->\n.*?<!-- end -->", before, re.DOTALL)
    engines = kept[0] if kept else "<!-- generated: engines -->\n<!-- end -->"
    figures = markdown.text(library(list(map(check, benchmarks()))))
    page.write_text(
        "<!-- written by docs/generate.py -->\n# The problem "
        f"library\n\n{_PROBLEMS}\n{engines}\n\n{figures}"
    )


def write_engines_on_problems() -> None:
    """The table of the same page that says how engines move the problems."""
    page = ROOT / "docs" / "problems.md"
    rows = (engines_on(entry) for entry in benchmarks())
    heads = ("problem", *_STEPS)
    page.write_text(
        _with_block(page.read_text(), "engines", markdown.text(Document("", (table(heads, rows),))))
    )


def engines_on(entry: Benchmark) -> tuple[str, ...]:
    """Largest error of a marker against the reference, relative to problem size, by engine."""
    cells = [f"{entry.number} {entry.name}"]
    problem = entry.problem()
    solution = solve(problem)
    scales = scales_until(solution, problem.duration)
    horizon = stretching_until(solution, problem.duration, scales).horizon
    with Worker(timeout=600.0) as worker:
        for name, share in _STEPS.items():
            try:
                engine = tb.engine(name, "tuned", timestep=share * scales.time)
                moved = worker.call(simulate, engine, problem)
            except tb.TrebucheckError as error:
                cells.append(str(error))
                continue
            inside = moved.t <= horizon
            exact = solution.trajectory(moved.t[inside])
            errors = (
                abs(moved.marker(m).position[inside] - exact.marker(m).position).max()
                for m in moved.markers
            )
            cells.append(f"{max(errors) / scales.length:.1e}")
    return tuple(cells)


_STEPS = {"mujoco": 1e-3, "pymunk": 1e-3, "exudyn": 1e-4}
"""Time step of each engine, relative to the problem's characteristic time."""


_PROBLEMS = """\
Published and closed-form benchmark problems. A name or number stands wherever a machine's does
(`trebucheck compare --model slider-crank`, `tb.model("A01")`), with parameters by `--set`, and
brings its own duration and law of the stops. `trebucheck problems --tag loop` lists,
`trebucheck problems pendulum --set length=2` holds the reference against the figures for these
parameters. Expected values are published, or computed from a closed form or by quadrature; the
tolerance is what the reference is held to by the tests.

Engines, tuned, at a thousandth of the problem's characteristic time (Exudyn at a ten-thousandth):
the largest error of a marker's coordinate up to the problem's end, or its predictability horizon if
that is earlier, in parts of the mechanism's size; or why there is none. `trebucheck compare` judges
them, names the quantities that are off, and looks for causes.
"""


def _with_block(text: str, name: str, content: str) -> str:
    """The text with what stands between `<!-- generated: name -->` and `<!-- end -->` replaced."""
    block = re.compile(rf"(<!-- generated: {name} -->\n).*?(<!-- end -->)", re.DOTALL)
    return block.sub(lambda match: match[1] + content + match[2], text)


def small_table(agreement: str) -> str:
    """The README's table: tuned engines on the paper's machines, one row an engine."""
    chosen = ("projectile [m]", "launch time [s]", "joint force")
    rows: dict[str, list[str]] = {}
    titles: list[str] = []
    heads: list[str] = []
    for line in agreement.partition("<!-- end -->")[0].splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if line.endswith(" machine**"):
            titles += [f"{line.strip('*').split()[0].lower()}: {title}" for title in chosen]
        elif line.startswith("| engine"):
            heads = cells
        elif cells[0].endswith(" tuned"):
            of = dict(zip(heads, cells, strict=True))
            rows.setdefault(cells[0].split()[0], []).extend(of[title] for title in chosen)
    lines = [
        ("engine", *titles),
        ("---",) * (1 + len(titles)),
        *((name, *row) for name, row in rows.items()),
    ]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


def write_agreement() -> None:
    """The page of differences, with its picture."""
    comparison = tb.compare()
    page = ROOT / "docs" / "agreement.md"
    text = _with_block(page.read_text(), "agreement", agreement_table(comparison))
    page.write_text(
        _with_block(text, "other machines", agreement_table(tb.compare(OTHERS, presets=["tuned"])))
    )
    write_picture(picture(distance_plots(comparison)), ROOT / "docs" / "pictures" / "distance.svg")


def write_paper() -> None:
    """The page of the paper's claims."""
    page = ROOT / "docs" / "paper.md"
    page.write_text(_with_block(page.read_text(), "paper", summary(study(["reference"]))))


_MOTION = ["animate", "fixed", "--engines", "pymunk", "--preset", "stock", "--width", "560"]


def write_motion() -> None:
    """The README's moving picture."""
    made = Path(sys.executable).parent / "trebucheck"
    subprocess.run([made, *_MOTION, "--out", ROOT / "docs/pictures/fixed.gif"], check=True)


def write_readme() -> None:
    """The README's table, from the page of differences, and the answers of its commands."""
    readme = ROOT / "README.md"
    table = small_table((ROOT / "docs" / "agreement.md").read_text())
    readme.write_text(_with_block(readme.read_text(), "table", table))
    console.refresh(readme)


def write_commands() -> None:
    """The page of all commands, from their help."""
    command: Any = typer.main.get_command(app)
    context = typer.Context(command, info_name="trebucheck")
    text = get_docs_for_click(obj=command, ctx=context, name="trebucheck", title="Commands")
    # Examples as code.
    text = re.sub(r"^(?:Example: )?(trebucheck .*)$", r"    \1", text, flags=re.MULTILINE)
    # Escaped, so that a terminal shows units and does not take them for colours.
    text = text.replace("\\[", "[")
    (ROOT / "docs" / "commands.md").write_text(
        f"<!-- written by docs/generate.py -->\n{text.strip()}\n"
    )


def importer_results() -> dict[str, ImporterResults | None]:
    """Results of each importer that has an adapter; None where it has not been run."""
    folders = sorted(
        (path.parent for path in (ROOT / "importers").glob("*/load.py")), key=lambda path: path.name
    )
    files = {folder.name: folder / "results.json" for folder in folders}
    return {
        name: ImporterResults.load(file) if file.is_file() else None for name, file in files.items()
    }


def write_importers() -> None:
    """Write the tables of importers, also of each machine, and a report page for each one."""
    importers = importer_results()
    page = ROOT / "docs" / "importers.md"
    text = _with_block(page.read_text(), "versions", markdown.text(versions_table(importers)))
    page.write_text(_with_block(text, "importers", markdown.text(overview(importers), signs=True)))
    folder = ROOT / "docs" / "importers"
    folder.mkdir(exist_ok=True)
    for name, results in importers.items():
        if results is not None:
            written = markdown.text(page_of_importer(results, name))
            (folder / f"{name}.md").write_text(f"<!-- written by docs/generate.py -->\n{written}")
    for machine in models():
        own = ROOT / "models" / "mjcf" / machine / "README.md"
        listed = markdown.text(machine_table(importers, machine), signs=True)
        own.write_text(_with_block(own.read_text(), "importers", listed))


def write_results() -> None:
    """Run the built-in engines on the paper's machines and all problems for the matrix (1 h)."""
    models = ["fixed", "rolling", *(entry.name for entry in benchmarks())]
    today = datetime.now(UTC).date().isoformat()
    folder = ROOT / "docs" / "results"
    for name in _STEPS:
        found = distilled(tb.compare(models, [name]).results, today)
        swept = tb.converge("fixed", [name], knobs=["timestep"])
        found = found.model_copy(update={"orders": tuple(orders_of(swept))})
        (folder / f"{name}.json").write_text(found.to_json() + "\n")
    swing = tb.Mechanism.from_json((ROOT / "plugins" / "free-swing.json").read_text())
    swung = distilled(tb.compare([swing], [*_STEPS], until=2.0).results, today)
    (folder / "free-swing.json").write_text(swung.to_json() + "\n")


def write_matrix() -> None:
    """The page of engine x problem x quantity, from the results that the repository holds."""
    files = [
        *(ROOT / "docs" / "results").glob("*.json"),
        *(ROOT / "plugins" / "results").glob("*.json"),
    ]
    page, written = (
        ROOT / "docs" / "matrix.md",
        replace(matrix_document(read_matrix(sorted(files))), title=""),
    )
    page.write_text(_with_block(page.read_text(), "matrix", markdown.text(written, signs=True)))


def write_api() -> None:
    """The page of all public names, from their docstrings."""
    parts = [
        "<!-- written by docs/generate.py -->\n# API\n\n`import trebucheck as tb`; SI units and "
        "radians.\n"
    ]
    for name in sorted(tb.__all__, key=str.lower):
        value = getattr(tb, name)
        if callable(value):
            parts.append(
                f"## tb.{name}\n\n```text\n{_signature(name, value)}\n\n"
                f"{_docstring(value)}{_members(value)}\n```\n"
            )
    (ROOT / "docs" / "api.md").write_text("\n".join(parts))


def _signature(name: str, value: Any) -> str:
    """Signature as it is called; fields of pydantic models are described below it instead."""
    called = value.__call__ if isinstance(value, ModuleType) else value
    arguments = list(map(_argument, inspect.signature(called).parameters.values()))
    text = f"tb.{name}({', '.join(arguments)})"
    text = text if len(text) <= 100 else f"tb.{name}(\n    " + ",\n    ".join(arguments) + ",\n)"
    fields = getattr(value, "model_fields", {}) if isinstance(value, type) else {}
    described = [
        f"    {field}: {about.description}" for field, about in fields.items() if about.description
    ]
    return "\n".join((text, "", "Fields:", *described)) if described else text


def _argument(parameter: inspect.Parameter) -> str:
    stars = {parameter.VAR_POSITIONAL: "*", parameter.VAR_KEYWORD: "**"}.get(parameter.kind, "")
    typed = f": {parameter.annotation}" if isinstance(parameter.annotation, str) else ""
    default = parameter.default
    if default is parameter.empty:
        return f"{stars}{parameter.name}{typed}"
    return f"{stars}{parameter.name}{typed} = {_default(default)}"


def _default(value: Any) -> str:
    """A default as it is written; sets of classes in the order of their names."""
    if isinstance(value, Enum):
        return str(value.value)
    if isinstance(value, frozenset) and value and all(isinstance(each, type) for each in value):
        return f"frozenset({{{', '.join(sorted(each.__name__ for each in value))}}})"
    return repr(value)


def _members(value: Any) -> str:
    """Public methods and properties of a class, with the first line of what is said of them."""
    if not isinstance(value, type) or issubclass(value, Exception):
        return ""
    own = {
        name: each
        for base in reversed(value.__mro__)
        if "trebucheck" in base.__module__
        for name, each in vars(base).items()
        if not name.startswith("_")
    }
    said = {
        name: inspect.getdoc(each)
        for name, each in own.items()
        if callable(each) or hasattr(each, "__get__")
    }
    lines = [f"    {name}: {text.splitlines()[0]}" for name, text in sorted(said.items()) if text]
    return "\n".join(("", "", "Members:", *lines)) if lines else ""


def _docstring(value: Any) -> str:
    own = value.__call__.__doc__ if isinstance(value, ModuleType) else value.__doc__
    text = re.sub(r":\w+:`\.*([\w.]+)`", r"`\1`", inspect.cleandoc(own or ""))
    return text.replace("  # doctest: +SKIP", "")


def write_trajectories() -> None:
    """The certified trajectories."""
    for name in names():
        publish(name, ROOT / "comparisons" / "data" / "trajectories")
    publish_zoo(ROOT / "importers" / "trebucheck_importers" / "zoo" / "files")


def write_zoo_list() -> None:
    """The list of the zoo's models."""
    rows = [
        (f"[{each.name}](files/{each.name}.xml)", each.feature, ", ".join(each.needs) or "")
        for each in zoo()
    ]
    listed = markdown.text(Document("", (table(["model", "what it has", "needs"], rows),)))
    (ROOT / "importers" / "trebucheck_importers" / "zoo" / "README.md").write_text(
        _ZOO.format(count=len(rows)) + listed.strip() + "\n"
    )


_ZOO = """\
<!-- written by docs/generate.py -->
# Small MJCF models of one feature each

{count} files, each written by hand, with the certified motion of the mechanism that it is:
`files/NAME.nc` has joint values, uncertainties, mass matrix and accelerations at three states, and
forces of limits and contacts at rest. `trebucheck importer my_package:load` holds an importer
against them; what importers make of them: [docs/importers.md](../../docs/importers.md). *Needs*:
what it takes to move one, beside a tree's equations of motion.

"""


def write_mjcf() -> None:
    """The machines' MJCF, with the events of their certified motions and pictures."""
    for name in models():
        folder, mechanism = ROOT / "models" / "mjcf" / name, tb.model(name)
        motion = record_motion(mechanism)
        (folder / RECORDED_FILE).write_text(motion.model_dump_json() + "\n")
        write_model_folder(mechanism, folder, motion=motion)
        (folder / "README.md").write_text(readme(name, motion))
        mjcf.draw(mechanism, motion, folder)
    write_importers()  # its READMEs have a table of theirs


PARTS: dict[str, Callable[[], None]] = {
    "schemas": write_schemas,
    "problems": write_problems,
    "engines": write_engines_on_problems,
    "trajectories": write_trajectories,
    "zoo": write_zoo_list,
    "mjcf": write_mjcf,
    "agreement": write_agreement,
    "paper": write_paper,
    "motion": write_motion,
    "readme": write_readme,
    "tutorial": lambda: console.refresh(ROOT / "docs" / "tutorial.md"),
    "commands": write_commands,
    "importers": write_importers,
    "results": write_results,
    "matrix": write_matrix,
    "api": write_api,
    "notebook": lambda: notebook.execute(ROOT / "examples" / "notebook.ipynb"),
}


def main() -> None:
    """Rewrite the parts that are named, or all of them."""
    for name in sys.argv[1:] or PARTS:
        PARTS[name]()


if __name__ == "__main__":
    main()
