"""A conformance run as a certificate of one page, what to do next first, and as a badge."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape
from itertools import groupby

from ..comparisons.report import document as page
from ..engines.inspection import Inspectable
from ..engines.registry import capabilities_of, engine, engine_class
from ..engines.supplied import sentence
from ..models.errors import TrebucheckError
from .suite import INTERFACE, STANDARD, missing
from .verdicts import CheckState, CheckVerdict, Conformance

MARKS: dict[CheckState, page.Mark] = {
    CheckState.KEPT: "good",
    CheckState.BROKEN: "bad",
    CheckState.NOT_JUDGED: "bad",
    CheckState.DEVIATES: "warning",
    CheckState.SKIPPED: "muted",
}
_LISTED = 12


def headline(results: Conformance) -> str:
    """The whole in a line."""
    counts = results.counts
    who = ", ".join(f"{label} {version}" for label, version in results.engines.items())
    others = [state for state in CheckState if counts[state] and state is not CheckState.KEPT]
    counted = ", ".join(f"{counts[state]} {state.value}" for state in others)
    rest = f"; {counted}" if counted else ""
    verdict = "conforms" if results.passed else "does not conform"
    kept = f"{counts[CheckState.KEPT]} of {results.judged} checks kept"
    return f"{who} {verdict} ({results.tier} tier): {kept}{rest}."


def certificate(results: Conformance) -> page.Document:
    """Verdict, what to do next, problems, and every check."""
    line, counts = headline(results), results.counts
    mark: page.Mark = "good" if results.passed else "bad"
    failed = sum(verdict.failed for verdict in results.verdicts)
    known, skipped = counts[CheckState.DEVIATES], counts[CheckState.SKIPPED]
    tiles = (
        page.Tile(f"{counts[CheckState.KEPT]}/{results.judged}", "checks kept", mark),
        page.Tile(str(failed), "broken or not judged", "bad" if failed else "plain"),
        page.Tile(str(known), "known deviations", "warning" if known else "plain"),
        page.Tile(str(skipped), "skipped"),
    )
    blocks: list[page.Block] = [page.Text(line, mark), page.Tiles(tiles)]
    for label in results.engines:  # the parts of a run that each does itself
        supplied = results.supplied.get(label)
        text = "The engine does not say what of a run is its own."
        if supplied is not None:
            text = sentence(supplied)
        blocks.append(page.Text(text, lead=f"{label}:" if len(results.engines) > 1 else ""))
    checks = page.Table(_CHECK_COLUMNS, tuple(_check_row(verdict) for verdict in results.verdicts))
    blocks += [
        *_advice(results),
        page.Heading("Problems", 2),
        page.table(_PROBLEM_COLUMNS, list(_problem_rows(results.verdicts)), "From the simplest on"),
        page.Fold(f"All {len(results.verdicts)} checks", (page.page_only(checks),)),
    ]
    title = f"Conformance of {', '.join(results.engines)}"
    return page.Document(
        title, tuple(blocks), window=title, command=results.command or "", verdict=line
    )


def _advice(results: Conformance) -> Iterator[page.Block]:
    steps = list(next_steps(results))
    if steps:
        yield page.Heading("What to do next", 2, medium="any")
        yield page.Listing(tuple(page.Text(step) for step in steps[:_LISTED]), ordered=True)
    unexplained = [v for v in results.verdicts if v.failed and v.error is not None and not v.cause]
    if unexplained:
        where, name = unexplained[0].problem, unexplained[0].id.split("/", 1)[0]
        yield page.Text(
            "No cause was looked for where none is named, to save time: "
            f"`trebucheck compare --engines {name} --models {where}` does so."
        )
    more = [text for label in results.engines for text in optional_steps(label)]
    if more:
        yield page.Heading("What is missing, and may stay so", 2, medium="any")
        yield page.Listing(tuple(map(page.Text, more)))


def next_steps(results: Conformance) -> Iterator[str]:
    """One sentence for each failing part: the interface first, then problems, simplest first."""
    if not results.judged:  # as where the engine is not installed
        reasons = {verdict.text.removesuffix(".") for verdict in results.verdicts if verdict.text}
        yield from (f"{reason}." for reason in sorted(reasons))
    failing = [verdict for verdict in results.verdicts if verdict.failed]
    for _, group in groupby(failing, key=lambda v: v.id.rsplit("/", 1)[0]):
        first, *others = group
        if first.problem in (INTERFACE, "row"):
            yield from (f"{verdict.check}: {verdict.text}" for verdict in (first, *others))
            continue
        also = f" (also {', '.join(verdict.check for verdict in others)})" if others else ""
        engine, text = first.id.split("/", 1)[0], first.text.removesuffix(".")
        step = f"{engine}, {first.problem}, {first.check}{also}: {text}."
        yield f"{step} It {first.cause}" if first.cause else step


def optional_steps(label: str) -> Iterator[str]:
    """Sentences on what an engine does not declare or offer, most problems first.

    Args:
        label: engine/preset.
    """
    name, _, preset = label.partition("/")
    capabilities = capabilities_of(name, preset)
    needed: dict[str, list[str]] = {}
    for problem in STANDARD:
        for feature in missing(problem, capabilities):
            needed.setdefault(feature, []).append(problem)
    for feature, problems in sorted(needed.items(), key=lambda item: -len(item[1])):
        yield f"no {feature}: needed by {', '.join(problems)}"
    try:
        inspectable = isinstance(engine(name, preset), Inspectable)
    except (TrebucheckError, TypeError, ValueError):
        return
    if not inspectable:
        yield "no model check: `inspect` would tell a wrong mass or frame before any motion"
    if not capabilities.joint_reactions:
        yield "no joint reactions"
    if not capabilities.stop_torques:
        yield "no stop torques"
    if not capabilities.located_releases:
        yield "releases are not located inside a step"
    if not hasattr(engine_class(name), "study"):
        yield (
            "no `study`: its tolerances are the default's, and `explain` and `converge` know its "
            "time step only"
        )


_PROBLEM_COLUMNS = (
    page.words("engine", wrap=False, medium="page"),
    page.words("problem", wrap=False),
    page.Column("kept", align="right"),
    page.Column("worst", align="left"),
    page.Column("of its tolerance", align="right"),
    page.Column("run", "s", align="right", rank=3),
    page.words("verdict"),
)
_CHECK_COLUMNS = (
    page.words("check", wrap=False),
    page.words("verdict", wrap=False),
    page.Column("error", align="right"),
    page.Column("tolerance", align="right"),
    page.words("unit", wrap=False),
    page.words("why"),
)


def _problem_rows(verdicts: Sequence[CheckVerdict]) -> Iterator[page.Row]:
    order = (CheckState.BROKEN, CheckState.NOT_JUDGED, CheckState.DEVIATES, CheckState.KEPT)
    for where, group in groupby(verdicts, key=lambda verdict: verdict.id.rsplit("/", 1)[0]):
        checks = list(group)
        if where.startswith("deviations/"):
            continue
        engine, _, problem = where.rpartition("/")
        states = [verdict.state for verdict in checks]
        judged = len(states) - states.count(CheckState.SKIPPED)
        counts = f"{states.count(CheckState.KEPT)}/{judged}" if judged else ""
        shares = [verdict for verdict in checks if verdict.share is not None]
        worst = max(shares, key=lambda verdict: verdict.share or 0.0, default=None)
        worst_cells = ("", "") if worst is None else (worst.check, f"{worst.share:.2g}")
        wall = next((f"{v.wall_time:.2f}" for v in checks if v.wall_time is not None), "")
        # The worst of the verdicts, and why nothing was judged.
        state = next((state for state in order if state in states), CheckState.SKIPPED)
        text = state.value
        if state is CheckState.SKIPPED:  # so all of them are
            text = f"skipped: {checks[0].text}"
        yield page.row(engine, problem, counts, *worst_cells, wall, page.Cell(text, MARKS[state]))


def _check_row(v: CheckVerdict) -> page.Row:
    error = page.format_number(v.error) if v.error is not None else ""
    tolerance = page.format_number(v.tolerance) if v.tolerance is not None else ""
    why = v.text or v.source
    return page.row(v.id, page.Cell(v.state.value, MARKS[v.state]), error, tolerance, v.unit, why)


def badge(results: Conformance) -> str:
    """An SVG for a README: how many checks are kept."""
    left, right = "trebucheck", f"{results.counts[CheckState.KEPT]}/{results.judged} kept"
    widths = [7 * len(text) + 12 for text in (left, right)]
    label = escape(f"{left}: {right}; {headline(results)}")
    colour = "#2e7d32" if results.passed else "#b3261e"
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{sum(widths)}" height="20" role="img" '
        f'aria-label="{label}">'
        f'<title>{label}</title><rect width="{sum(widths)}" height="20" rx="3" fill="#555"/>'
        f'<path d="M{widths[0]} 0h{widths[1] - 3}a3 3 0 0 1 3 3v14a3 3 0 0 1 -3 3h'
        f'-{widths[1] - 3}z" '
        f'fill="{colour}"/>'
        '<g fill="#fff" font-family="Verdana,DejaVu Sans,sans-serif" font-size="11" '
        'text-anchor="middle">'
        f'<text x="{widths[0] / 2:g}" y="14">{left}</text>'
        f'<text x="{widths[0] + widths[1] / 2:g}" y="14">{escape(right)}</text></g></svg>\n'
    )
