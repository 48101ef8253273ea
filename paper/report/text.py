"""The study in words and short figures, as the terminal and the page show it."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

from ...comparisons.report.numbers import format_number as figure
from ..results import Claim, EngineValue, Quantity, Study, Verdict

SHORT = {Verdict.HOLDS: "holds", Verdict.WITHIN_GRID: "in grid", Verdict.FAILS: "fails", Verdict.OPEN: "open"}
_MARKS = {True: "good", False: "bad", None: ""}


def engines(study: Study) -> list[str]:
    """Engines that any claim has a value of, in the order they were run in."""
    return list(dict.fromkeys(each.engine for claim in study.claims for each in claim.engines))


def sentence(text: str) -> str:
    """With a capital and a full stop, unless it begins with a symbol or a lower-case name."""
    first = text[:1].upper() + text[1:] if re.match(r"[a-z]{2,} ", text) else text
    return first if first.endswith(".") else f"{first}."


def counts(study: Study) -> dict[Verdict, int]:
    """Number of claims by verdict, none left out."""
    found = Counter(claim.verdict for claim in study.claims)
    return {verdict: found[verdict] for verdict in Verdict}


def headline(study: Study) -> str:
    """One line: how many claims there are and what becomes of them."""
    n = counts(study)
    return (
        f"{len(study.claims)} claims: {n[Verdict.HOLDS]} hold to the printed digits, {n[Verdict.WITHIN_GRID]} within "
        f"the paper's grid, {n[Verdict.FAILS]} do not hold, {n[Verdict.OPEN]} cannot be told."
    )


def value(quantity: Quantity | None) -> str:
    """A value to nine digits, with its unit."""
    return "–" if quantity is None else f"{quantity.value:.9g} {quantity.unit}".rstrip()


def uncertainty(quantity: Quantity | None) -> str:
    """To two digits; empty where there is none."""
    return "" if quantity is None or quantity.uncertainty is None else figure(quantity.uncertainty)


def engine_value(claim: Claim, engine: str) -> tuple[str, str, str]:
    """An engine's value, a mark for its colour, and what the page says where it is pointed at."""
    found = next((each for each in claim.engines if each.engine == engine), None)
    if found is None:
        return "", "", ""
    if found.value is None:
        return "–", "", found.note or ""
    allowed = "no bar behind it" if found.tolerance is None else f"allowed: {figure(found.tolerance)} from ours"
    return f"{found.value:.9g}", _MARKS[found.agrees(claim.ours)], allowed


def disagreeing(study: Study) -> list[tuple[Claim, EngineValue]]:
    """Engines' values outside their tolerance."""
    return [(c, each) for c in study.claims for each in c.engines if each.agrees(c.ours) is False]


def agreement(study: Study) -> str:
    """One line: how many of the engines' values lie within their agreement bars."""
    asked = [found for c in study.claims for each in c.engines if (found := each.agrees(c.ours)) is not None]
    return f"{sum(asked)} of {len(asked)} values of engines lie within their agreement bars."


def findings(study: Study, most: int = 3) -> list[str]:
    """The most important of what was found: what holds, then what departs most, one of each place in the paper."""
    found = [_holding(study), *(_failing(claim) for claim in worst(study.claims, most - 1))]
    return [each for each in found if each][:most]


def _holding(study: Study) -> str:
    """How the numbers of the throws fare, which every engine was asked for."""
    asked = [claim for claim in study.claims if claim.engines and _has_number(claim)]
    holding = [claim for claim in asked if claim.verdict in (Verdict.HOLDS, Verdict.WITHIN_GRID)]
    named = engines(study)
    if not asked or not named:
        return ""
    whole = [c for c in holding if all(each.agrees(c.ours) is not False for each in c.engines)]
    return (
        f"Of {len(asked)} printed numbers that engines were asked for, {len(holding)} come out, to their digits or "
        f"within the paper's grid, and {len(whole)} of these in {', '.join(named)} as well."
    )


def _has_number(claim: Claim) -> bool:
    """Whether a number or a bound is in print, not only a sign or a word."""
    return re.match(r"\d|< \d", claim.printed) is not None


def _failing(claim: Claim) -> str:
    return f"{claim.where}, {claim.name} ({claim.printed}) does not hold: {claim.why}."


def worst(claims: Sequence[Claim], most: int) -> list[Claim]:
    """Claims that do not hold, farthest from ours first, no two from one section.

    Before all others come those the paper draws its conclusions from, in its Sec. VII, and of these those in whose
    section most fails.
    """
    failing = [claim for claim in claims if claim.verdict is Verdict.FAILS]
    weight = Counter(_section(claim) for claim in failing)
    ordered = sorted(failing, key=lambda c: (not _concludes(c), -weight[_section(c)], -(c.departure or 0.0)))
    first: dict[str, Claim] = {}
    for claim in ordered:
        first.setdefault(_section(claim), claim)
    return list(first.values())[:most]


def _concludes(claim: Claim) -> bool:
    return "VII" in claim.where


def _section(claim: Claim) -> str:
    return claim.where.replace("Secs.", "Sec.").partition(",")[0]
