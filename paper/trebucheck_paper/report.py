"""The audit of the paper as a document: verdicts, claims, figures, tables and further studies."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace

from trebucheck.api.mechanics import TrebuchetParameters, parameters_of
from trebucheck.api.reports import (
    Block,
    Cell,
    Column,
    Document,
    Figure,
    Heading,
    Mark,
    Note,
    Text,
    format_number,
    markdown,
    mechanism_as_data,
    sentence,
    table,
    words,
)
from trebucheck.api.reports import document as doc

from .chapters import chapters
from .evidence.claims import Claim, EngineValue, Quantity, Study, Verdict
from .plots import plots

_SHORT = {
    Verdict.HOLDS: "holds",
    Verdict.WITHIN_GRID: "in grid",
    Verdict.FAILS: "fails",
    Verdict.OPEN: "open",
}
_FAVOUR = (Verdict.FAILS, Verdict.OPEN, Verdict.WITHIN_GRID, Verdict.HOLDS)
"""Verdicts, the least favourable to a claim first."""
_UNKNOWN = 5  # significant digits that are shown of a number whose uncertainty is not known
_MARKS: dict[Verdict, Mark] = {
    Verdict.HOLDS: "good",
    Verdict.WITHIN_GRID: "strong",
    Verdict.FAILS: "bad",
    Verdict.OPEN: "warning",
}


def document(study: Study) -> Document:
    """Document of verdicts, findings and evidence; a terminal shows verdicts and causes."""
    names = engines(study)
    intro = (
        "“Computational Modeling of a Trebuchet”: its numbers, orders and statements against a "
        f"certified Lagrangian reference and {', '.join(names) or 'no engine'}. Every verdict "
        "follows from a stated rule."
    )
    tiles = tuple(
        doc.Tile(str(number), verdict.value, _MARKS[verdict])
        for verdict, number in counts(study).items()
    )
    total, agreeing = (
        Text(headline(study), "strong", medium="terminal"),
        Text(agreement(study), medium="terminal"),
    )
    most_important = doc.Listing(tuple(Text(each) for each in findings(study)), ordered=True)
    blocks = (
        Note(intro),
        doc.Tiles(tiles),
        Text(f"{headline(study)} {agreement(study)} {proofs(study)}", medium="page"),
        Heading("What matters most", 2),
        doc.page_only(most_important),
        *_claims(study, names),
        *_figures(study),
        *_tables(study),
        *chapters(study.sections),
        *_provenance(study),
        total,
        agreeing,
        doc.terminal_only(most_important),
    )
    return Document(
        "The paper, claim by claim", blocks, "trebucheck paper", verdict=headline(study)
    )


def summary(study: Study) -> str:
    """Markdown for the README: number of claims, and those that fail, printed against ours."""
    failing = [claim for claim in facts(study.claims) if claim.verdict is Verdict.FAILS]
    rows = [(claim.where, claim.name, claim.printed, _value(claim.ours, 4)) for claim in failing]
    columns = ("where", "does not hold", "printed", "ours")
    proved = [
        (each.where, each.name, each.printed, _proof(each).text, each.proved.value or "")
        for each in study.claims
        if each.proved.holds is not None
    ]
    heads = ("where", "claim", "printed", "proof", "enclosed")
    blocks = (
        Text(headline(study)),
        table(columns, rows),
        Text(proofs(study)),
        table(heads, proved),
    )
    return markdown.text(Document("", blocks))


def engines(study: Study) -> list[str]:
    """Engines that any claim has a value of, in the order they were run in."""
    return list(dict.fromkeys(each.engine for claim in study.claims for each in claim.engines))


def facts(claims: Sequence[Claim]) -> list[Claim]:
    """One row for each fact that the paper claims: the one it is counted by.

    A fact holds only if every row that states it does, so it has the verdict of the least
    favourable of its rows. Of those with that verdict the row that the fact is named after stands
    for it, or the first.
    """
    by_fact: dict[str, list[Claim]] = {}
    for claim in claims:
        by_fact.setdefault(claim.fact or claim.name, []).append(claim)
    return [
        min(rows, key=lambda c: (_FAVOUR.index(c.verdict), c.name != name))
        for name, rows in by_fact.items()
    ]


def counts(study: Study) -> dict[Verdict, int]:
    """Number of facts by verdict, none left out."""
    by_verdict = Counter(claim.verdict for claim in facts(study.claims))
    return {verdict: by_verdict[verdict] for verdict in Verdict}


def headline(study: Study) -> str:
    """One line: how many claims there are and what becomes of them."""
    n = counts(study)
    rows = len(study.claims)
    repeats = (
        f" (of {rows} rows; those that state one fact count once)" if rows > sum(n.values()) else ""
    )
    return (
        f"{sum(n.values())} claims{repeats}: {n[Verdict.HOLDS]} hold to the printed digits, "
        f"{n[Verdict.WITHIN_GRID]} within the paper's grid, {n[Verdict.FAILS]} do not hold, "
        f"{n[Verdict.OPEN]} cannot be told."
    )


def agreement(study: Study) -> str:
    """One line: how many of the engines' values lie within their tolerances."""
    judged = [
        agrees
        for c in study.claims
        for each in c.engines
        if (agrees := each.agrees(c.ours)) is not None
    ]
    return (
        f"{sum(judged)} of {len(judged)} values of engines lie within their agreement tolerances."
    )


def disagreeing(study: Study) -> list[tuple[Claim, EngineValue]]:
    """Engines' values outside their tolerance."""
    return [(c, each) for c in study.claims for each in c.engines if each.agrees(c.ours) is False]


def findings(study: Study, most: int = 3) -> list[str]:
    """Most important results: what holds, then the largest departure of each place in the paper."""
    texts = [_holding(study), *(_failing(claim) for claim in worst(study.claims, most - 1))]
    return [each for each in texts if each][:most]


def _holding(study: Study) -> str:
    """Tell how the numbers of the throws fare, of which every engine has a value."""
    judged = [claim for claim in facts(study.claims) if claim.verdict is not Verdict.OPEN]
    numbers = [claim for claim in judged if claim.engines and _has_number(claim)]
    holding = [claim for claim in numbers if claim.verdict in (Verdict.HOLDS, Verdict.WITHIN_GRID)]
    names = engines(study)
    if not numbers or not names:
        return ""
    whole = [c for c in holding if all(each.agrees(c.ours) is not False for each in c.engines)]
    return (
        f"Of {len(numbers)} printed numbers that engines were asked for, {len(holding)} come out, "
        f"to their digits or within the paper's grid, and {len(whole)} of these in "
        f"{', '.join(names)} as well."
    )


def _has_number(claim: Claim) -> bool:
    """Tell whether a number or a bound is in print, not only a sign or a word."""
    return re.match(r"\d|< \d", claim.printed) is not None


def _failing(claim: Claim) -> str:
    return f"{claim.where}, {claim.name} ({claim.printed}) does not hold: {claim.why}."


def worst(claims: Sequence[Claim], most: int) -> list[Claim]:
    """Claims that do not hold, farthest from ours first, no two from one section.

    Before all others come those the paper draws its conclusions from, in its Sec. VII, and of these
    those in whose section most fails.
    """
    failing = [claim for claim in facts(claims) if claim.verdict is Verdict.FAILS]
    weight = Counter(_section(claim) for claim in failing)
    ordered = sorted(
        failing, key=lambda c: ("VII" not in c.where, -weight[_section(c)], -(c.departure or 0.0))
    )
    first: dict[str, Claim] = {}
    for claim in ordered:
        first.setdefault(_section(claim), claim)
    return list(first.values())[:most]


def _section(claim: Claim) -> str:
    return claim.where.replace("Secs.", "Sec.").partition(",")[0]


def _value(quantity: Quantity | None, digits: int = 9) -> str:
    """Value with its unit, to its uncertainty's first digit, or to five digits if unknown."""
    if quantity is None:
        return "–"
    value, width = abs(quantity.value), quantity.uncertainty
    known = _UNKNOWN if width is None else digits
    if width and value:
        known = max(1, math.floor(math.log10(value)) - math.floor(math.log10(width)) + 1)
    return f"{quantity.value:.{min(digits, known)}g} {quantity.unit}".rstrip()


def _claims(study: Study, names: Sequence[str]) -> Iterator[Block]:
    """Claims with our value and the engines'; a terminal lists those that fail, with causes."""
    yield Heading("Claims", 2, "claims")
    yield Note(
        "“Ours” is the reference's, with the half width it is known to (certified where a "
        "certificate has the quantity). Engines run with their assisted presets at their own "
        "default steps; green lies within the engine's tolerance, carried over to the quantity by "
        "how "
        "strongly the machine's parameters move it with the projectile's position; point at a "
        "value for the tolerance and at a verdict for its rule."
    )
    columns = (
        words("where", medium="terminal"),
        replace(words("claim"), rank=0),
        words("where", medium="page"),
        words("printed"),
        Column("verdict", align="left", medium="page"),
        Column("ours", medium="page"),
        Column("ours", medium="terminal", rank=2),
        Column("±", medium="page"),
        *(Column(name, medium="page") for name in names),
        words("proof", medium="page"),
        Column("engines", medium="terminal", rank=3),
        Column("verdict", align="left", medium="terminal", rank=0),
    )
    counted = facts(study.claims)
    stands_for = {claim.fact or claim.name: claim for claim in counted}
    rows = [
        each
        for i, claim in enumerate(study.claims, 1)
        for each in _claim(claim, stands_for[claim.fact or claim.name], names, f"claim-{i}")
    ]
    yield table(columns, rows)
    if len(counted) < len(study.claims):
        repeated = (
            "A verdict in parentheses: the row states the same fact as another one, by which it is "
            "counted."
        )
        yield Text(repeated, "muted")
    for claim in counted:
        if claim.verdict in (Verdict.FAILS, Verdict.OPEN):
            yield Text(
                f"({claim.where}): {claim.why}.",
                _MARKS[claim.verdict],
                claim.name,
                medium="terminal",
            )
    for claim, each in disagreeing(study):
        yield Text(
            f"({claim.name}): {each.value} is outside its tolerance.",
            "bad",
            each.engine,
            medium="terminal",
        )
    rules = [(claim.name, claim.rule, claim.verdict.value) for claim in study.claims]
    yield doc.Fold(
        "The rules behind the verdicts",
        (table((words("claim"), words("rule"), words("verdict")), rules),),
    )
    if study.unreached:
        unreached = [(each.where, each.printed, sentence(each.why)) for each in study.unreached]
        columns = (words("where"), words("printed"), words("why it has no row"))
        yield doc.Fold(
            "Numbers of the paper that no solver can reach, and why", (table(columns, unreached),)
        )


def _claim(claim: Claim, counted: Claim, names: Sequence[str], anchor: str) -> Iterator[doc.Row]:
    """One row, and the reason for its verdict.

    Args:
        counted: the row by which the fact is counted.
    """
    uncertainty = None if claim.ours is None else claim.ours.uncertainty
    verdict, same = _verdict(claim), ""
    if claim is not counted:
        verdict = replace(verdict, text=f"({verdict.text})", mark="muted")
        same = f" (the same fact as “{counted.name}”)"
    yield doc.row(
        claim.where,
        Cell(claim.name, detail=f"{claim.quantity}{same}"),
        claim.where,
        claim.printed,
        verdict,
        _value(claim.ours),
        _value(claim.ours, 6),
        "" if uncertainty is None else format_number(uncertainty),
        *(_engine_value(claim, name) for name in names),
        _proof(claim),
        _agreeing(claim),
        verdict,
        anchor=anchor,
    )
    if claim.why:
        yield doc.row(Cell(""), Cell(sentence(claim.why), "muted"), medium="page")


def _verdict(claim: Claim) -> Cell:
    return Cell(_SHORT[claim.verdict], _MARKS[claim.verdict], hint=claim.rule)


def _proof(claim: Claim) -> Cell:
    """Outcome of the proof; the enclosure shows where it is pointed at."""
    unit = "" if claim.ours is None else claim.ours.unit
    known, mark = claim.proved, doc.mark_of(claim.proved.holds)
    hint = "" if known.value is None else f"{known.value} ± {known.radius} {unit}".rstrip()
    if known.holds is None:
        mark = "muted"
    return Cell(known.sentence(unit), mark, hint=hint)


def proofs(study: Study) -> str:
    """One line: how many rows a proof of their motion decides."""
    holds = Counter(claim.proved.holds for claim in study.claims)
    return (
        f"Of {len(study.claims)} rows {holds[True]} are proved to hold as printed and "
        f"{holds[False]} not to; {holds[None]} are no numbers of a motion that is enclosed."
    )


def _agreeing(claim: Claim) -> str:
    """Tell how many of the engines with a tolerance behind their value agree with ours."""
    judged = [agrees for each in claim.engines if (agrees := each.agrees(claim.ours)) is not None]
    return f"{sum(judged)} of {len(judged)}" if judged else ""


def _engine_value(claim: Claim, engine: str) -> Cell:
    entry = next((each for each in claim.engines if each.engine == engine), None)
    if entry is None:
        return Cell("")
    if entry.value is None:
        return Cell("–", hint=entry.note or "")
    tolerance = entry.tolerance
    hint = (
        "it has no tolerance"
        if tolerance is None
        else f"allowed: {format_number(tolerance)} from ours"
    )
    return Cell(
        f"{entry.value:.{9 if tolerance is not None else _UNKNOWN}g}",
        doc.mark_of(entry.agrees(claim.ours)),
        hint=hint,
    )


def _figures(study: Study) -> Iterator[Block]:
    yield Heading("Figures", 2, "figures")
    yield Note(
        "Lines: the reference. Symbols: samples of the engines. Red: the paper's own numbers."
    )
    for name, caption, plot in plots(study.series):
        yield Figure(plot, name, caption)


def _tables(study: Study) -> Iterator[Block]:
    """Table I with the start, and the claims on Table II."""
    yield Heading("Tables", 2, "tables")
    parameters = next(
        (p for machine in study.machines if (p := parameters_of(machine)) is not None), None
    )
    if parameters is not None:
        fields = TrebuchetParameters.model_fields
        constants = [
            (name, f"{value:.9g}", fields[name].description or "") for name, value in parameters
        ]
        yield Heading("Table I")
        yield Note("With the start angles, which the paper does not print.")
        yield table(("constant", "value", words("what")), constants, medium="page")
    rows = [
        (claim.name, claim.printed, _value(claim.ours), claim.quantity, _verdict(claim))
        for claim in study.claims
        if claim.where == "Table II"
    ]
    if rows:
        yield Heading("Table II")
        columns = (
            words("row"),
            words("printed"),
            "ours",
            words("quantity"),
            words("verdict", wrap=False),
        )
        yield table(columns, rows, medium="page")


def _provenance(study: Study) -> Iterator[Block]:
    versions = ", ".join(f"{name} {version}" for name, version in study.versions.items())
    yield Heading("Provenance", 2)
    yield Note(f"Made {study.made} in {study.seconds:.0f} s; {versions}.")
    for machine in study.machines:
        yield mechanism_as_data(machine.name, machine)
