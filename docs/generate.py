"""Write what the repository holds generated: schemas, the README's table and picture (`make generated`)."""

from __future__ import annotations

import re
from pathlib import Path

import trebucheck as tb
from trebucheck.comparisons.compare import plots as figures
from trebucheck.comparisons.compare.agreement import differences
from trebucheck.comparisons.compare.study import Comparison
from trebucheck.comparisons.converge.results import Studies
from trebucheck.comparisons.data.files import names, publish
from trebucheck.comparisons.explain.results import Explanation
from trebucheck.comparisons.problems.check import check
from trebucheck.comparisons.problems.report import library
from trebucheck.comparisons.recommend import Advice
from trebucheck.comparisons.report import markdown
from trebucheck.comparisons.report.document import Document, table
from trebucheck.comparisons.report.figures import picture, write_picture
from trebucheck.comparisons.report.plots import Axis, Panels, Plot
from trebucheck.comparisons.runs.results import Results
from trebucheck.comparisons.runs.runner import Worker, simulate
from trebucheck.comparisons.runs.scales import scales_until
from trebucheck.comparisons.runs.stretching import stretching_until
from trebucheck.models.machines.registry import models
from trebucheck.models.mechanism import mechanism_schema
from trebucheck.models.problems.benchmark import Benchmark
from trebucheck.models.problems.registry import benchmarks
from trebucheck.models.spec import schema_text
from trebucheck.paper.evidence.claims import Study
from trebucheck.paper.report import summary
from trebucheck.paper.study import study
from trebucheck.reference.solver import solve

ROOT = Path(__file__).parents[1]
OTHERS = tuple(name for name in models() if name not in ("fixed", "rolling"))


def agreement_table(comparison: Comparison) -> str:
    """The README's tables, one a machine, in Markdown."""
    tables = []
    for machine in comparison.results.machines:
        runs = (run for run in comparison.results.runs if run.model == machine.model and run.engine != "reference")
        tables.append(table(differences(machine), runs, f"{machine.model.capitalize()} machine"))
    return markdown.text(Document("", tuple(tables)))


def distance_plots(comparison: Comparison) -> Panels:
    """Distance of the projectile from the reference over time, both machines."""
    drawn: list[Plot] = []
    for machine in comparison.results.machines:
        own = {label: t for (name, label), t in comparison.trajectories.items() if name == machine.model}
        runs = figures.lines(comparison.solutions[machine.model], own, machine.compared_to)
        position = figures.position("projectile")
        series = tuple(run.difference(position) for run in runs if not run.label.startswith("reference"))
        axis = Axis("distance from the reference", "m", logarithmic=True)
        drawn.append(Plot(Axis("t", "s"), axis, series, machine.model))
    return tuple(drawn)


def write_schemas() -> None:
    """The published JSON schemas."""
    (ROOT / "models" / "schemas" / "mechanism.schema.json").write_text(mechanism_schema())
    (ROOT / "comparisons" / "schemas" / "results.schema.json").write_text(schema_text(Results))
    (ROOT / "comparisons" / "schemas" / "converge.schema.json").write_text(schema_text(Studies))
    (ROOT / "comparisons" / "schemas" / "explain.schema.json").write_text(schema_text(Explanation))
    (ROOT / "paper" / "schemas" / "paper.schema.json").write_text(schema_text(Study))
    (ROOT / "comparisons" / "schemas" / "recommend.schema.json").write_text(schema_text(Advice))


def write_problems() -> None:
    """The page of the problem library: every problem with its figures beside the reference's."""
    page = ROOT / "docs" / "problems.md"
    before = page.read_text() if page.is_file() else ""
    kept = re.search(r"<!-- generated: engines -->\n.*?<!-- end -->", before, re.DOTALL)
    engines = kept[0] if kept else "<!-- generated: engines -->\n<!-- end -->"
    figures = markdown.text(library(list(map(check, benchmarks()))))
    page.write_text(
        f"<!-- written by docs/generate.py -->\n# The problem library\n\n{_PROBLEMS}\n{engines}\n\n{figures}"
    )


def write_engines_on_problems() -> None:
    """The table of the same page that says how engines move the problems."""
    page = ROOT / "docs" / "problems.md"
    rows = (engines_on(entry) for entry in benchmarks())
    heads = ("problem", *_STEPS)
    page.write_text(_with_block(page.read_text(), "engines", markdown.text(Document("", (table(heads, rows),)))))


def engines_on(entry: Benchmark) -> tuple[str, ...]:
    """The largest distance of a marker from the reference, in parts of the problem's size, by engine."""
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
            errors = (abs(moved.marker(m).position[inside] - exact.marker(m).position).max() for m in moved.markers)
            cells.append(f"{max(errors) / scales.length:.1e}")
    return tuple(cells)


_STEPS = {"mujoco": 1e-3, "pymunk": 1e-3, "exudyn": 1e-4}
"""Of each engine in parts of the problem's characteristic time."""


_PROBLEMS = """Published and closed-form benchmark problems. A name or number stands wherever a machine's does
(`trebucheck compare --model slider-crank`, `tb.model("A01")`), with parameters by `--set`, and brings its own duration
and law of the stops. `trebucheck problems --tag loop` lists, `trebucheck problems pendulum --set length=2` holds the
reference against the figures for these parameters. Expected values are published, or computed from a closed form or by
quadrature; the tolerance is what the reference is held to by the tests.

Engines, tuned, at a thousandth of the problem's characteristic time (Exudyn at a ten-thousandth): the largest error of
a marker's coordinate up to the problem's end, or its predictability horizon if that is earlier, in parts of the
mechanism's size; or why there is none. `trebucheck compare` judges them, names the quantities that are off, and looks
for causes.
"""


def _with_block(text: str, name: str, content: str) -> str:
    """The text with what stands between `<!-- generated: name -->` and `<!-- end -->` replaced."""
    block = re.compile(rf"(<!-- generated: {name} -->\n).*?(<!-- end -->)", re.DOTALL)
    return block.sub(lambda match: match[1] + content + match[2], text)


def main() -> None:
    """Rewrite all of it."""
    write_schemas()
    write_problems()
    write_engines_on_problems()
    for name in names():
        publish(name, ROOT / "comparisons" / "data" / "trajectories")
    comparison = tb.compare()
    readme = ROOT / "README.md"
    text = _with_block(readme.read_text(), "agreement", agreement_table(comparison))
    text = _with_block(text, "other machines", agreement_table(tb.compare(OTHERS, presets=["tuned"])))
    text = _with_block(text, "paper", summary(study(["reference"])))
    readme.write_text(text)
    pictures = ROOT / "docs" / "pictures"
    pictures.mkdir(exist_ok=True)
    write_picture(picture(distance_plots(comparison)), pictures / "distance.svg")


if __name__ == "__main__":
    main()
