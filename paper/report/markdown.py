"""The study in a few lines of Markdown, as the README shows it."""

from __future__ import annotations

from ..results import Claim, Study, Verdict
from .text import headline


def summary(study: Study) -> str:
    """How many claims there are, and those that do not hold: printed against ours."""
    failing = [claim for claim in study.claims if claim.verdict is Verdict.FAILS]
    rows = [f"| {claim.where} | {claim.name} | {claim.printed} | {_ours(claim)} |" for claim in failing]
    return "\n".join(
        [headline(study), "", "| where | does not hold | printed | ours |", "|---|---|---|---|", *rows, ""]
    )


def _ours(claim: Claim) -> str:
    return "–" if claim.ours is None else f"{claim.ours.value:.4g} {claim.ours.unit}".rstrip()
