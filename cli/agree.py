"""`trebucheck compare`, `judge`, `conform`, `matrix`, `diff` and `figures`: do engines agree?"""

from __future__ import annotations

import io
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from ..models.errors import InputError
from . import options, output
from .call import Call, command
from .options import argument, folder, option

if TYPE_CHECKING:
    from ..comparisons.report.document import Document

FACTOR = 1.1
"""The study's, which is imported when the command runs."""
_WIDTH = 120
"""Width of a text file, in characters."""


@command(
    "models engines preset timestep duration until tolerance tolerances set beam keyframe qpos "
    "qvel ctrl without option stop_law sweep diagnose resume jobs cluster timeout quiet json",
    folder("report", "Folder for report, summary.md, results.json and trajectories."),
)
def compare_command(call: Call) -> bool:
    """Run engines on machines, measure them against the reference and each other, write the report.

    Writes report.html (self-contained), summary.md (for a pull request), results.json and one
    NetCDF file a run. Ends with exit code 1 if a run disagrees, is not equivalent or failed, or if
    nothing was judged.

    Examples:
    trebucheck compare --out report

    trebucheck compare --models fixed --engines mujoco,pymunk --preset assisted --timestep 1e-3
    --set l1=9.5
    """
    from ..comparisons.compare import compare
    from ..comparisons.report import markdown
    from ..comparisons.report.pages.compare import document, summary

    models, how, store = call.models(), call.run_options(), call.store("trajectories", "runs")
    with call.progress(width=28) as show:
        comparison = compare(
            models,
            **how,
            store=store,
            progress=lambda case, done, of: show(f"{case.model}: {case.label}", done, of),
        )
    results = comparison.results.made_by(call.command_line)
    comparison = replace(comparison, results=results)
    short = markdown.text(summary(results), signs=True)
    call.publish(
        "results.json",
        results.to_json(),
        document(comparison),
        "report.html",
        store=store,
        current=comparison.repeated,
        beside={"Summary": (call.out / "summary.md", short)},
    )
    return comparison.passed


@command(
    "file model duration until set beam keyframe qpos qvel ctrl without tolerance tolerances "
    "stop_law quiet json",
    folder("judgement", "Folder for judgement.html and judgement.json."),
    file=argument("CSV with names and units in its first line, or NetCDF (.nc).", Path),
)
def judge_command(call: Call) -> bool:
    r"""Judge a motion from a file against the reference, in every quantity that it gives.

    Columns are those of `Trajectory.to_dataframe`, each with its unit: t \[s], q theta \[rad], u
    theta \[rad/s], projectile x \[m], projectile vx \[m/s], stop hanger rest [N m], joint fulcrum x
    [N], kinetic energy [J]. Releases stand in comments: # release hanger rest \[s] = 0.8167;
    impacts, too: # impact floor \[s] = 0.4515, impulse [N s] = 13.29. Two samples at the time of an
    impact give the speeds before and after it. Coordinates or a marker's position are needed. Exit
    codes: 0 what is given agrees, 1 it does not or could not be judged, 2 the file is broken.

    Examples:
    trebucheck judge my.csv --model rolling

    trebucheck judge my.csv --model pendulum --tolerance angle=1e-6
    """
    from ..comparisons.judge import judge
    from ..comparisons.report.pages.judge import document
    from ..comparisons.runs.results import Outcome
    from ..models.files import refuse_unwritable

    model, how = call.only_model(), call.run_options()
    refuse_unwritable(call.out)
    with call.progress() as show:
        found = judge(call.file, model, **how, progress=show).made_by(call.command_line)
    page = document(found)
    call.publish("judgement.json", found.to_json(), page, "judgement.html", "Judgement")
    return found.outcome is Outcome.AGREES


@command(
    "file rollout until accuracy keyframe qpos qvel ctrl without engines quiet json",
    folder("audit", "Folder for audit.html and audit.json."),
    file=argument("MJCF or URDF file of a model that moves in a plane.", Path | None, None),
    rollout=option(
        "--rollout",
        "Environment in place of a file, gymnasium:ID or dm_control:DOMAIN-TASK: an episode with "
        "random actions is recorded, its controls into controls.npz, and replayed.",
    ),
    until=option("--until", "End of what is compared (s).", float, 5.0),
    accuracy=option(
        "--accuracy",
        "Error for which the cheapest options are looked for (m); 1 % of the motion's size by "
        "default.",
        float | None,
    ),
)
def audit_command(call: Call) -> None:
    """Tell how far the simulation of a model file is from the mechanics, and until when.

    The file is moved by its engine as it is given, and with other integrators and steps, and held
    against the reference motion of the mechanism in it, up to the first contact or as long as that
    is known. Ends with the cheapest option that holds an accuracy, ready to paste.

    Examples:
    trebucheck audit cartpole.xml --qpos 0,0.1

    trebucheck audit arm.xml --ctrl controls.csv

    trebucheck audit --rollout gymnasium:InvertedPendulum-v5
    """
    from ..comparisons.audit import audit
    from ..comparisons.report.pages.audit import document
    from ..comparisons.runs.model_files import rollout
    from ..models.files import refuse_unwritable

    if (call.file is None) is (call.rollout is None):
        raise InputError(
            f"FILE = {str(call.file)!r} and --rollout = {call.rollout!r}: one of them is needed, "
            "and not both."
        )
    refuse_unwritable(call.out)
    source = call.file
    if call.rollout is not None:
        source = rollout(call.rollout, call.until)
    with call.progress(width=24) as show:
        found = audit(
            source,
            call.until,
            accuracy=call.accuracy,
            **call.model_start(),
            engines=call.names("engines"),
            progress=show,
        )
    found = found.made_by(call.command_line)
    if call.rollout is not None:
        source.controls.save(call.out / "controls.npz")
    call.publish("audit.json", found.to_json(), document(found), "audit.html", "Page")


@command(
    "engine tier problem deviations cluster timeout quiet json",
    folder("conformance", "Folder for certificate.html, badge.svg and conformance.json."),
    engine=argument(
        "NAME, NAME/PRESET, or package.module:Class of an engine that is not installed.",
        names=options.engine_names,
    ),
    tier=option("--tier", "How many problems: quick, standard or full.", str, "standard"),
    problem=option(
        "--problem",
        "Only these problems, comma-separated; repeatable.",
        list[str] | None,
        names=options.machine_names,
    ),
    deviations=option(
        "--deviations", "TOML or JSON: known failures, with id, reason and owner.", Path | None
    ),
    timeout=120.0,
)
def conform_command(call: Call) -> bool:
    """Check what an engine keeps of what it declares, say what is missing, and write a certificate.

    Exit codes: 0 everything that was judged is kept, 1 something is broken or could not be judged,
    or nothing was judged (an engine that is not installed), 2 wrong input.

    Examples:
    trebucheck conform mujoco --problem catapult

    trebucheck conform my_package:MyEngine --tier quick
    """
    from ..conformance.certificate import badge, certificate
    from ..conformance.suite import Session
    from ..models.files import refuse_unwritable

    given = {
        "tier": call.tier,
        "problem": call.problem or [],
        "timeout": call.timeout,
        "json": None,
        "deviations": call.deviations,
        "cluster": call.cluster,
    }
    session = Session.of([call.engine], given, Path.cwd())
    refuse_unwritable(call.out)
    try:
        with call.progress() as show:
            for done, id in enumerate(session.ids):
                show(id.rpartition("/")[0], done, len(session.ids))
                session.judged(id)
    finally:
        session.close()
    results = session.results.made_by(call.command_line)
    call.publish(
        "conformance.json",
        results.to_json(),
        certificate(results),
        "certificate.html",
        "Certificate",
        beside={"Badge": (call.out / "badge.svg", badge(results))},
    )
    return results.passed


class Format(StrEnum):
    """Form in which a difference is shown."""

    TEXT = "text"
    MARKDOWN = "markdown"
    HTML = "html"
    JSON = "json"


_SUFFIXES = {
    ".html": Format.HTML,
    ".htm": Format.HTML,
    ".md": Format.MARKDOWN,
    ".json": Format.JSON,
}


@command(
    "files commit quiet json",
    folder(None, "File to write: .html, .md, or .json, which matrix reads again; none by default."),
    files=argument(
        "results.json of compare, converge.json of converge, .json of matrix; or their folders.",
        list[Path],
    ),
    commit=option("--commit", "Of trebucheck's sources, kept with runs that have none; a name."),
)
def matrix_command(call: Call) -> None:
    """Show engine x problem x quantity of several comparisons: verdicts, errors, orders, causes.

    The page is one grid, engines by name or scheme against problems by class: many on one screen,
    a row each; few with a row for each preset, whose cells show what broke. A cell opens: all
    quantities with tolerances, cause, settings, the command that makes the run again. What the
    page sorts and filters by is in its address.

    Engines of one scheme stand together, and ratios of their errors say what differs by scheme and
    what by implementation. Nothing is run: engines that need environments of their own are compared
    there, and put together here. Orders are measured where a converge.json is given, else as the
    engine declares them. Exit codes: 0 shown, 2 a file is of another kind, a run is there twice, or
    a name means two mechanisms.

    Examples:
    trebucheck matrix report drake/results.json pinocchio/results.json --out matrix.html

    trebucheck matrix report/results.json converge/converge.json --out engines.json
    """
    from ..comparisons.matrix import matrix as matrix_of
    from ..comparisons.report.pages.matrix import document
    from ..models.files import refuse_unwritable, write_text

    out: Path | None = call.out
    if out is not None:
        if out.suffix not in (".html", ".md", ".json"):
            raise InputError(f"--out {output.printable(str(out))} must end in .html, .md or .json.")
        refuse_unwritable(out.parent, out.name)
    matrix = matrix_of(call.files, commit=call.commit).made_by(call.command_line)
    report, written = document(matrix), {}
    if out is not None:
        write_text(out, _in_format(report, matrix.to_json(), _SUFFIXES[out.suffix]))
        written = {"Matrix": out}
    if call.json:
        typer.echo(matrix.to_json())
    else:
        output.show(report, call.told, **written)


_FILE = argument("results.json of compare, or the folder that holds it.", Path)


@command(
    "old new factor format json",
    folder(None, "File to write; standard output by default."),
    old=_FILE,
    new=_FILE,
    factor=option(
        "--factor",
        "An error has moved if it changed by more than this factor; above 1.",
        float,
        FACTOR,
    ),
    format=option("--format", "Else by the name of --out; text by default.", Format | None),
)
def diff_command(call: Call) -> bool:
    """Compare two results of compare: verdicts that broke, errors that moved, runs come or gone.

    For upgrades of engines, of trebucheck, of a machine. Changes below what the reference's
    uncertainty, samples and rounding leave unknown are none. Exit codes: 0 nothing broke, 1 a
    verdict got worse, a run is gone or fails, or nothing could be compared, 2 wrong input.

    Examples:
    trebucheck diff before/results.json after/results.json

    trebucheck diff before after --format html --out diff.html

    trebucheck diff before after --json
    """
    from ..comparisons.diff import data, diff
    from ..comparisons.report.pages.diff import document
    from ..models.files import write_text

    difference, out = diff(call.old, call.new, call.factor), call.out
    report, content = document(difference), data(difference).to_json()
    by_name = None if out is None else _SUFFIXES.get(out.suffix.lower())
    chosen = call.format or by_name or Format.TEXT
    if out is not None:
        write_text(out, _in_format(report, content, chosen))
    if call.json:
        print(content)
    elif out is not None:
        print(f"{difference.summary}\n\nDifference: {output.printable(str(out))}")
    elif chosen is Format.TEXT:
        output.show(report)
    else:
        print(_in_format(report, content, chosen), end="")
    return difference.passed


def _in_format(report: Document, data: str, format: Format) -> str:
    """A report in a format, whole; `data` is its JSON."""
    from ..comparisons.report import html, markdown, terminal

    if format is Format.JSON:
        return data + "\n"
    if format is Format.HTML:
        return html.page(report)
    if format is Format.MARKDOWN:
        return markdown.text(report, signs=True)
    from rich.console import Console

    to = Console(file=io.StringIO(), width=_WIDTH, highlight=False, record=True)
    terminal.show(report, to)
    return to.export_text()


@command(
    "folder formats only",
    folder("figures", "Folder for the pictures."),
    folder=argument(
        "Folder of a comparison, as `trebucheck compare --out` writes it.", Path, Path("report")
    ),
    formats=option("--formats", "Of svg, png and pdf, comma-separated.", str, "svg"),
    only=option("--only", "Names of figures, comma-separated, e.g. fixed-distances; else all."),
)
def figures_command(call: Call) -> None:
    """Write the plots of a comparison as SVG, PNG or PDF, for papers and slides; no engine runs.

    Each plot of the report becomes a file by the name that its link in the report has.

    Examples:
    trebucheck figures report --out figures

    trebucheck figures report --formats pdf,png --only fixed-distances,work-precision
    """
    from ..comparisons.compare import stored
    from ..comparisons.report.document import figures_of
    from ..comparisons.report.pages.compare import document
    from ..comparisons.report.plots import FORMATS, picture, write_picture
    from ..comparisons.report.terminal import console
    from ..models.files import refuse_unwritable

    kinds = options.names(call.formats, "--formats")
    unknown = [kind for kind in kinds if kind not in FORMATS]
    if unknown:
        raise InputError(f"--formats: {unknown[0]!r} is none of {', '.join(FORMATS)}.")
    found = figures_of(document(stored(call.folder)))
    chosen = list(found) if call.only is None else options.names(call.only, "--only")
    missing = [name for name in chosen if name not in found]
    if missing:
        raise InputError(
            f"--only: there is no figure {missing[0]!r}; there are {', '.join(found)}."
        )
    out: Path = call.out
    refuse_unwritable(out)
    for name in chosen:
        block = found[name]
        drawn = picture(block.panels(), block.columns or 3)
        for kind in kinds:
            write_picture(drawn, out / f"{name}.{kind}")
            console().print(str(out / f"{name}.{kind}"), soft_wrap=True, markup=False)
