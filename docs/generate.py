"""Generate schemas, tables, pictures and reference pages of the repository (`make generated`).

With names of parts only those: `python docs/generate.py readme commands`.
"""

from __future__ import annotations

import inspect
import json
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from decimal import Context, Decimal
from enum import Enum
from fractions import Fraction
from pathlib import Path
from typing import Any

import mjcf
import trebucheck as tb
import typer
from executed import refresh_notebook, refresh_page
from trebucheck.cli.app import app
from trebucheck.comparisons.audit import Audit
from trebucheck.comparisons.campaigns.store import CampaignFile
from trebucheck.comparisons.compare import Comparison, RunKey
from trebucheck.comparisons.converge import Studies
from trebucheck.comparisons.data.certified import names, publish
from trebucheck.comparisons.diff import DifferenceData
from trebucheck.comparisons.explain import Explanation
from trebucheck.comparisons.horizon import Horizon
from trebucheck.comparisons.judge import Judgement
from trebucheck.comparisons.matrix import Matrix, distilled, orders_of
from trebucheck.comparisons.matrix import matrix as read_matrix
from trebucheck.comparisons.mjcf import recorded
from trebucheck.comparisons.problems import check
from trebucheck.comparisons.prove import ProofFile
from trebucheck.comparisons.published import PublishedFigure, PublishedFigures, published_figures
from trebucheck.comparisons.recommend import Advice
from trebucheck.comparisons.report import markdown
from trebucheck.comparisons.report.document import (
    Block,
    Document,
    Text,
    table,
    without_empty_columns,
)
from trebucheck.comparisons.report.pages import compare as figures
from trebucheck.comparisons.report.pages import horizon as horizon_pages
from trebucheck.comparisons.report.pages import work
from trebucheck.comparisons.report.pages.compare import differences
from trebucheck.comparisons.report.pages.matrix import engine_document, summary
from trebucheck.comparisons.report.pages.problems import library
from trebucheck.comparisons.report.plots import Axis, Panels, Plot, picture, write_picture
from trebucheck.comparisons.runs.process import Worker, simulate
from trebucheck.comparisons.runs.results import Results
from trebucheck.comparisons.runs.runner import motion_of
from trebucheck.comparisons.runs.scales import scales_until
from trebucheck.comparisons.runs.store import Store
from trebucheck.comparisons.runs.stretching import stretching_until
from trebucheck.conformance.verdicts import Conformance
from trebucheck.engines.presets import ASSISTED, PRESETS
from trebucheck.engines.registry import ANNOUNCED, PLUGIN_GROUP, engine_class, engine_study
from trebucheck.models.library.benchmark import Benchmark
from trebucheck.models.library.registry import benchmarks, models
from trebucheck.models.mechanism import mechanism_schema
from trebucheck.models.mjcf.scene import RECORDED_FILE
from trebucheck.models.mjcf.writer import write_model_folder
from trebucheck.models.spec import schema_text
from trebucheck.reference.certification.certificate import SCHEMA as CERTIFICATE_SCHEMA
from trebucheck.reference.certification.certificate import Certificate
from trebucheck.reference.solver import solve
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
        runs = figures.lines(comparison, machine)
        position = figures.position("projectile")
        series = tuple(
            run.difference(position) for run in runs if not run.label.startswith("reference")
        )
        axis = Axis("distance from the reference", "m", logarithmic=True)
        drawn.append(Plot(Axis("t", "s"), axis, series, machine.model))
    return tuple(drawn)


SCHEMAS = {
    "results": Results,
    "diff": DifferenceData,
    "judgement": Judgement,
    "conformance": Conformance,
    "converge": Studies,
    "campaign": CampaignFile,
    "explain": Explanation,
    "audit": Audit,
    "horizon": Horizon,
    "proof": ProofFile,
    "published": PublishedFigures,
    "recommend": Advice,
}


def write_schemas() -> None:
    """Write the published JSON schemas."""
    (ROOT / "models" / "schemas" / "mechanism.schema.json").write_text(mechanism_schema())
    for name, kind in SCHEMAS.items():
        path = ROOT / "comparisons" / "schemas" / f"{name}.schema.json"
        path.write_text(schema_text(kind))
    path = ROOT / "reference" / "certification" / "certificates" / CERTIFICATE_SCHEMA
    path.write_text(schema_text(Certificate))


def write_problems() -> None:
    """Write the page of problems: each with its figures beside the reference's.

    The table of engines stays as it is: it has a part of its own, which takes longer.
    """
    page = ROOT / "docs" / "problems.md"
    engines = markdown.block(page.read_text(), "engines") if page.is_file() else ""
    figures = markdown.text(library(list(map(check, benchmarks()))))
    text = _PROBLEMS + f"\n<!-- generated: engines -->\n{engines}<!-- end -->\n\n{figures}"
    page.write_text(f"<!-- written by docs/generate.py -->\n# The problem library\n\n{text}")


def write_engines_on_problems() -> None:
    """Write the table of that page that says how engines move the problems."""
    page = ROOT / "docs" / "problems.md"
    errors = table(("problem", *_STEPS), (engines_on(entry) for entry in benchmarks()))
    text = markdown.text(Document("", (errors,)))
    page.write_text(markdown.with_block(page.read_text(), "engines", text))


def engines_on(entry: Benchmark) -> tuple[str, ...]:
    """Largest error of a marker against the reference, relative to problem size, by engine."""
    cells = [entry.name]
    problem = entry.problem()
    solution = solve(problem)
    scales = scales_until(solution, problem.duration)
    horizon = stretching_until(solution, problem.duration, scales).horizon
    with Worker(timeout=600.0) as worker:
        for name, share in _STEPS.items():
            try:
                engine = tb.engine(name, ASSISTED, timestep=share * scales.time)
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
Published and closed-form benchmark problems. A name stands wherever a machine's does
(`trebucheck compare --model slider-crank`, `tb.model("pendulum")`), with parameters by `--set`, and
brings its own duration and law of the stops. `trebucheck problems --tag loop` lists,
`trebucheck problems pendulum --set length=2` holds the reference against the figures for these
parameters. Expected values are published, or computed from a closed form or by quadrature; the
tolerance is what the reference is held to by the tests.

Engines, assisted, at a thousandth of the problem's characteristic time (Exudyn a ten-thousandth):
the largest error of a marker's coordinate up to the problem's end, or its predictability horizon if
that is earlier, in parts of the mechanism's size; or why there is none. `trebucheck compare` judges
them, names the quantities that are off, and looks for causes.
"""


def small_table(agreement: str) -> str:
    """The README's table: engines on the paper's machines, a row for each engine and preset."""
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
        elif cells[0].endswith(PRESETS):
            of = dict(zip(heads, cells, strict=True))
            rows.setdefault(cells[0], []).extend(of.get(title, "") for title in chosen)
    lines = [
        ("engine", *titles),
        ("---",) * (1 + len(titles)),
        *((name, *row) for name, row in rows.items()),
    ]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


def write_agreement() -> None:
    """Write the page of differences, with its picture."""
    comparison = tb.compare()
    page = ROOT / "docs" / "agreement.md"
    text = markdown.with_block(page.read_text(), "agreement", agreement_table(comparison))
    others = agreement_table(tb.compare(OTHERS, presets=[ASSISTED]))
    page.write_text(markdown.with_block(text, "other machines", others))
    write_picture(picture(distance_plots(comparison)), ROOT / "docs" / "pictures" / "distance.svg")


def write_work() -> None:
    """Write the README's diagram of work and precision: runs of this computer, at many steps."""
    results = tb.compare("fixed", sweep=True, diagnose=False).results
    lines = work.lines_of(results.runs)
    drawn = picture(work.panels(lines, {"position_max": "m"}, only="position_max"), columns=2)
    write_picture(drawn, ROOT / "docs" / "pictures" / "work.svg")
    text = (
        "![Error of the projectile against processor time and against steps, for each engine and "
        "preset](docs/pictures/work.svg)<br>**What it costs**: the fixed machine up to its launch. "
        f"{work.caption(lines, results.machine_text)} "
        "`trebucheck compare --sweep` draws it for every quantity, on your computer.\n"
    )
    readme = ROOT / "README.md"
    readme.write_text(markdown.with_block(readme.read_text(), "work", text))


_MOTION = ["animate", "fixed", "--engines", "pymunk", "--preset", "settings", "--width", "560"]


def write_motion() -> None:
    """Write the moving picture of the README."""
    made = Path(sys.executable).parent / "trebucheck"
    subprocess.run([made, *_MOTION, "--out", ROOT / "docs/pictures/fixed.gif"], check=True)


def write_readme() -> None:
    """The README's table, from the page of differences, and the answers of its commands."""
    readme = ROOT / "README.md"
    table = small_table((ROOT / "docs" / "agreement.md").read_text())
    readme.write_text(markdown.with_block(readme.read_text(), "table", table))
    refresh_page(readme)


def write_commands() -> None:
    """Write the page of all commands, from their help."""
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


def write_results() -> None:
    """Run the built-in engines on the paper's machines and all problems for the matrix (1 h).

    `COMMIT` in the environment names the sources that the results are kept with. Finished runs are
    kept in `.results`: one that was interrupted goes on with those that are missing.
    """

    def progress(run: RunKey, made: int, of: int) -> None:
        print(f"{run.engine} {run.preset}, {run.model}: {made + 1} of {of}", flush=True)

    commit = os.environ.get("COMMIT", "unknown")
    models = ["fixed", "rolling", *(entry.name for entry in benchmarks())]
    today = datetime.now(UTC).date().isoformat()
    folder = ROOT / "docs" / "results"
    for name in _STEPS:
        kept = ROOT / ".results" / name
        store = Store(kept / "trajectories", resume=True, records=kept / "runs")
        compared = tb.compare(models, [name], sweep=True, store=store, progress=progress)
        found = distilled(compared.results, today)
        swept = tb.converge("fixed", [name], knobs=["timestep"])
        found = found.model_copy(update={"orders": tuple(orders_of(swept))})
        (folder / f"{name}.json").write_text(found.of_commit(commit).to_json() + "\n")
    swing = tb.Mechanism.from_json((ROOT / "plugins" / "free-swing.json").read_text())
    swung = distilled(tb.compare([swing], [*_STEPS], until=2.0).results, today)
    (folder / "free-swing.json").write_text(swung.of_commit(commit).to_json() + "\n")


def write_proofs() -> None:
    """Prove the motions of all machines and problems to thirty digits (fifteen minutes)."""
    folder, reasons = ROOT / "docs" / "proofs", dict[str, str]()
    folder.mkdir(exist_ok=True)
    for file in folder.glob("*.json"):
        file.unlink()
    for name in (*models(), *(entry.name for entry in benchmarks())):
        print(name, flush=True)
        try:
            proof = tb.prove(name, digits=_DIGITS, timeout=_PROOF_LIMIT)
        except (tb.SimulationError, tb.UnsupportedProblemError) as error:
            reasons[name] = str(error)
            continue
        command = f"trebucheck prove {name} --digits {_DIGITS}"
        text = ProofFile.of(proof).made_by(command).to_json()
        (folder / f"{name}.json").write_text(f"{text}\n")
    kept = json.dumps({"digits": _DIGITS, "seconds": _PROOF_LIMIT, "reasons": reasons}, indent=2)
    (folder / _NOT_PROVED).write_text(f"{kept}\n")


def write_published() -> None:
    """Hold the figures of all problems' sources against proofs (five minutes)."""
    found = tuple(published_figures(benchmarks(), _PUBLISHED_DIGITS, _PROOF_LIMIT))
    made = PublishedFigures.made_here(digits=_PUBLISHED_DIGITS, figures=found)
    path = ROOT / "docs" / "published.json"
    path.write_text(f"{made.made_by('docs/generate.py published').to_json()}\n")


def published_row(each: PublishedFigure) -> tuple[str, ...]:
    """A figure of a source, what is proved of it, and where that lies."""
    verdict = each.verdict.replace("outside", "**outside**", 1)
    proved = "" if each.value is None else _shortened(each.value, each.radius or "0")
    expected = f"{each.expected} ± {each.half:.1g}"
    return each.problem, each.figure, each.unit, each.basis, expected, proved, verdict


def _shortened(value: str, radius: str, most: int = 20) -> str:
    """A proved value with so many significant digits, of which the last may be off by one."""
    number = Decimal(value)
    rounded = Context(prec=most).plus(number)
    off = abs(Fraction(rounded) - Fraction(number)) + Fraction(Decimal(radius))
    exponent = rounded.as_tuple().exponent
    assert isinstance(exponent, int)
    return f"{rounded}" if off < Fraction(10) ** exponent else f"{value} ± {radius}"


def write_proved() -> None:
    """Write the page of proved motions, from the files that the repository holds."""
    folder = ROOT / "docs" / "proofs"
    rows: list[tuple[str, ...]] = []
    for path in sorted(folder.glob("*.json")):
        if path.name == _NOT_PROVED:
            continue
        known = ProofFile.from_json(path.read_text())
        launches = (each for each in known.figures if each.name == "launch of projectile")
        figure = next(launches, known.figures[-1])
        until = "launch" if known.until is None else f"{known.until:g} s"
        counts = map(str, (len(known.figures), known.bits, known.steps))
        cost, value = f"{known.processor_time:.1f} s", f"{figure.value} {figure.unit}"
        link = f"[{path.stem}](proofs/{path.name})"
        rows.append((link, until, *counts, cost, f"{figure.name}: {value}"))
    titles = ("model", "to", "figures", "bits", "steps", "processor time", "one of its figures")
    blocks: list[Block] = [table(titles, rows)]
    left = json.loads((folder / _NOT_PROVED).read_text())
    if left["reasons"]:
        limit = f"{left['digits']} digits within {left['seconds']:g} s of processor time each"
        blocks.append(Text(f"Not proved to {limit}, and why:"))
        blocks.append(table(("model", "reason"), left["reasons"].items()))
    published = PublishedFigures.from_json((ROOT / "docs" / "published.json").read_text())
    heads = ("problem", "figure", "unit", "basis", "expected", "proved", "verdict")
    beside = table(heads, map(published_row, published.figures))
    page, text = ROOT / "docs" / "proved.md", markdown.text(Document("", tuple(blocks)))
    text = markdown.with_block(page.read_text(), "proofs", text)
    known = markdown.text(Document("", (beside,)))
    page.write_text(markdown.with_block(text, "published", known))


def write_horizons() -> None:
    """Prove until when starts of some bits determine two motions (fifteen minutes)."""
    folder = ROOT / "docs" / "horizons"
    folder.mkdir(exist_ok=True)
    for file in folder.glob("*.json"):
        file.unlink()
    for name, ends in _HORIZONS.items():
        for bits, until in ends.items():
            print(name, bits, flush=True)
            found = tb.horizon(name, bits, until)
            command = f"trebucheck prove {name} --start-bits {bits}"
            if until is not None:
                command += f" --until {until}"
            path = folder / f"{name}-{bits:03d}.json"
            path.write_text(f"{found.made_by(command).to_json()}\n")


def write_horizon() -> None:
    """Write the page of horizons and its picture, from the files that the repository holds."""
    folder, page = ROOT / "docs" / "horizons", ROOT / "docs" / "horizon.md"
    text, drawn = page.read_text(), list[Plot]()
    for name in _HORIZONS:
        files = sorted(folder.glob(f"{name}-*.json"))
        found = [Horizon.from_json(file.read_text()) for file in files]
        shown: list[Horizon] = []
        for each in found:
            known = tuple(digits for digits in each.known if digits.digits in _SHOWN)
            shown.append(each.model_copy(update={"known": known}))
        table = markdown.text(Document("", (horizon_pages.table_of(shown),)))
        text = markdown.with_block(text, name, table)
        drawn.append(horizon_pages.plot(found, name))
    page.write_text(text)
    write_picture(picture(tuple(drawn), columns=2), ROOT / "docs" / "pictures" / "horizon.svg")


_SHOWN = (1, 3, 6, 9, 12, 15, 18, 24, 30)
"""Digits whose horizons the page has; the files have all."""
_HORIZONS: dict[str, dict[int, str | None]] = {
    "double-pendulum": {24: "12", 53: "18", 64: "16", 113: "16"},
    "fixed": {24: None, 53: None, 113: None},
}
"""Ends [s] by bits of the start and by model; None: the launch."""

_DIGITS = 30
_PUBLISHED_DIGITS = 20
_PROOF_LIMIT = 300.0  # [s] of processor time
_NOT_PROVED = "not-proved.json"


def kept_results() -> Matrix:
    """The runs of all engines that the repository holds."""
    folders = (ROOT / "docs" / "results", ROOT / "plugins" / "results")
    return read_matrix(sorted(file for folder in folders for file in folder.glob("*.json")))


def write_matrix() -> None:
    """Write the page of engines and problems, from the results that the repository holds."""
    page, matrix = ROOT / "docs" / "matrix.md", kept_results()
    links = {run.engine: f"engines/{run.engine}.md" for run in matrix.runs}
    text = markdown.text(summary(matrix, links), signs=True)
    page.write_text(markdown.with_block(page.read_text(), "matrix", text))


def write_engine_pages() -> None:
    """Write the page of each engine, from the results that the repository holds."""
    announce_plug_ins()
    matrix, folder = kept_results(), ROOT / "docs" / "engines"
    names = sorted({run.engine for run in matrix.runs})
    folder.mkdir(exist_ok=True)
    for page in folder.glob("*.md"):
        page.unlink()
    for name in names:
        engine_class(name)  # which says why it cannot be loaded, as its study would not
        study = engine_study(name)
        text = markdown.text(engine_document(matrix, name, study, _DISPUTE), signs=True)
        text += asked_first(ROOT / "plugins" / "answers" / f"{name}.json")
        (folder / f"{name}.md").write_text(f"<!-- written by docs/generate.py -->\n{text}")
    nav = "".join(
        f"      - {engine_study(name).title or name}: engines/{name}.md\n" for name in names
    )
    site = ROOT / "mkdocs.yml"
    site.write_text(re.sub(r"(  - Engines:\n)(?:      - .*\n)*", rf"\g<1>{nav}", site.read_text()))


def asked_first(path: Path) -> str:
    """Answers to what the users of an engine ask first, by `plugins/answers.py`.

    Returns:
        A section of Markdown; '' of an engine without such a file.
    """
    if not path.exists():
        return ""
    told = json.loads(path.read_text())
    presets = told["presets"]
    sentences = [
        "A uniform rod of 1 m swings from 60 degrees for ten seconds: error of its mean period, by "
        "the exact one; energy gained or lost, in parts of that of the swing; how far its pin "
        "comes apart. Then the error of the force of the pin on the rod, in parts of its weight, "
        "as it hangs and as it falls from level, by closed forms.",
    ]
    kept = [
        f"the {what} at {step:.3g} s" if step else f"the {what} at no step that was tried"
        for what, step in presets.get("default", {}).get("to_a_percent", {}).items()
    ]
    if kept:
        sentences.append(f"With only the step set, a percent is kept of {' and of '.join(kept)}.")
    sentences.append(
        "Forces of joints are told: on the second body, in the world's axes."
        if told["reactions"]
        else "It tells no forces of joints."
    )
    rows = "".join(_answer_row(preset, found) for preset, found in presets.items())
    text = f"\n## Asked first\n\n{' '.join(sentences)}\n\n{_ANSWERS_HEAD}{rows}"
    if told["program"]:
        text += (
            "\nThe pendulum at the preset `settings`, as a program with nothing but the engine's "
            "interface; the run is this program:\n\n"
            f"```{told['language']}\n{told['program']}\n```\n"
        )
    return text + releases(path.parents[1] / "releases" / path.name)


def releases(path: Path) -> str:
    """Tell the releases that the program runs with, by `plugins/releases.py`; '' if not known."""
    if not path.exists():
        return ""
    told = json.loads(path.read_text())
    since, tested, error = told["since"], told["tested"], told.get("error")
    row = f"{tested} alone" if since == tested else f"{since} to {tested}"
    before = f"{told['before']} {told['how']}" if told["before"] else "there is none before"
    return (
        "\nThe program moves the rod the same, to a thousandth of its swing, with "
        f"`{told['package']}` {row}; {before}{f': `` {error} ``' if error else ''}.\n"
    )


_ANSWERS_HEAD = (
    "| preset | step [s] | period | energy after 10 s | gap of its pin [m] | force, hanging "
    "| force, swinging |\n|---|---|---|---|---|---|---|\n"
)
_ANSWERS: tuple[tuple[str, str, str], ...] = (
    ("swing", "timestep", ".3g"),
    ("swing", "period", "+.2%"),
    ("swing", "energy", "+.2%"),
    ("swing", "gap", ".1e"),
    ("forces", "hanging", ".1e"),
    ("forces", "swinging", ".1e"),
)
"""Measurements of the columns, their names in the file, and their formats."""


def _answer_row(preset: str, found: Mapping[str, Any]) -> str:
    fields = [
        "–" if found.get(of, {}).get(key) is None else format(found[of][key], how)
        for of, key, how in _ANSWERS
    ]
    row = f"| {preset} | {' | '.join(fields)} |\n"
    failed = [found[of]["failed"] for of in ("swing", "forces") if "failed" in found.get(of, {})]
    return row + "".join(f"| | {text.replace('|', '/')} | | | | | |\n" for text in failed)


_DISPUTE = (
    "Is an option wrong, a model unfair, a number not what you get? Open an issue in this "
    "repository, with the command of the cell (the grid shows it) and what you get instead. What "
    "is set is in the adapter's options, what is claimed for it in its `study.py`."
)


def announce_plug_ins() -> None:
    """Make the adapters of this repository known; their tables need none of their engines."""
    announced: list[str] = []
    for project in sorted((ROOT / "plugins").glob("*/pyproject.toml")):
        points = tomllib.loads(project.read_text())["project"].get("entry-points", {})
        for name, place in points.get(PLUGIN_GROUP, {}).items():
            announced.append(f"{name}={place}")
            sys.path.append(str(project.parent))
    os.environ[ANNOUNCED] = " ".join(announced)


def write_api() -> None:
    """Write the page of all public names, from their docstrings."""
    page = (
        "<!-- written by docs/generate.py -->\n# API\n\n`import trebucheck as tb`; SI units and "
        "radians.\n"
    )
    for name in sorted(tb.__all__, key=str.lower):
        value = getattr(tb, name)
        if callable(value):
            text = re.sub(r":\w+:`\.*([\w.]+)`", r"`\1`", inspect.cleandoc(value.__doc__ or ""))
            text = text.replace("  # doctest: +SKIP", "")
            signature = _signature(name, value)
            page += f"\n## tb.{name}\n\n```text\n{signature}\n\n{text}{_members(value)}\n```\n"
    (ROOT / "docs" / "api.md").write_text(page)


def _signature(name: str, value: Any) -> str:
    """Signature as it is called; fields of pydantic models are described below it instead."""
    arguments = list(map(_argument, inspect.signature(value).parameters.values()))
    text = f"tb.{name}({', '.join(arguments)})"
    if len(text) > 100:
        text = f"tb.{name}(\n    " + ",\n    ".join(arguments) + ",\n)"
    fields = getattr(value, "model_fields", {}) if isinstance(value, type) else {}
    described = [
        f"    {field}: {info.description}" for field, info in fields.items() if info.description
    ]
    return "\n".join((text, "", "Fields:", *described)) if described else text


def _argument(parameter: inspect.Parameter) -> str:
    stars = {parameter.VAR_POSITIONAL: "*", parameter.VAR_KEYWORD: "**"}.get(parameter.kind, "")
    typed = f": {parameter.annotation}" if isinstance(parameter.annotation, str) else ""
    default = parameter.default
    if default is parameter.empty:
        return f"{stars}{parameter.name}{typed}"
    text = repr(default)
    if isinstance(default, Enum):
        text = str(default.value)
    if isinstance(default, frozenset) and any(isinstance(kind, type) for kind in default):
        # The order of a set differs from run to run.
        text = f"frozenset({{{', '.join(sorted(kind.__name__ for kind in default))}}})"
    return f"{stars}{parameter.name}{typed} = {text}"


def _members(value: Any) -> str:
    """Public methods and properties of a class, with the first line of what is said of them."""
    if not isinstance(value, type) or issubclass(value, Exception):
        return ""
    members: dict[str, Any] = {}
    for base in reversed(value.__mro__):
        if "trebucheck" in base.__module__:
            members.update(vars(base))
    lines: list[str] = []
    for name, member in sorted(members.items()):
        described = callable(member) or hasattr(member, "__get__")
        text = inspect.getdoc(member) if described and not name.startswith("_") else None
        if text:
            lines.append(f"    {name}: {text.splitlines()[0]}")
    return "\n".join(("", "", "Members:", *lines)) if lines else ""


def write_trajectories() -> None:
    """Write the certified trajectories."""
    for name in names():
        publish(name, ROOT / "comparisons" / "data" / "trajectories")


def write_mjcf() -> None:
    """The machines' MJCF, with the events of their certified motions and pictures."""
    for name in models():
        folder, mechanism = ROOT / "models" / "mjcf" / name, tb.model(name)
        motion = recorded(motion_of(mechanism))
        (folder / RECORDED_FILE).write_text(motion.model_dump_json() + "\n")
        write_model_folder(mechanism, folder, motion=motion)
        page = folder / "README.md"
        importers = markdown.block(page.read_text(), "importers")  # by importers/generate.py
        page.write_text(markdown.with_block(mjcf.readme(name, motion), "importers", importers))
        mjcf.draw(mechanism, motion, folder)


PARTS: dict[str, Callable[[], None]] = {
    "schemas": write_schemas,
    "problems": write_problems,
    "engines": write_engines_on_problems,
    "trajectories": write_trajectories,
    "mjcf": write_mjcf,
    "agreement": write_agreement,
    "work": write_work,
    "motion": write_motion,
    "readme": write_readme,
    "tutorial": lambda: refresh_page(ROOT / "docs" / "tutorial.md"),
    "commands": write_commands,
    "results": write_results,
    "proofs": write_proofs,
    "published": write_published,
    "proved": write_proved,
    "horizons": write_horizons,
    "horizon": write_horizon,
    "matrix": write_matrix,
    "engine-pages": write_engine_pages,
    "api": write_api,
    "notebook": lambda: refresh_notebook(ROOT / "examples" / "notebook.ipynb"),
}


def main() -> None:
    """Rewrite the parts that are named, or all of them."""
    for name in sys.argv[1:] or PARTS:
        PARTS[name]()


if __name__ == "__main__":
    main()
