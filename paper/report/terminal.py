"""The study as a person reads it in a terminal."""

from __future__ import annotations

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from ..results import Claim, Study, Verdict
from .text import SHORT, agreement, disagreeing, engines, findings, headline, value

_STYLES = {Verdict.HOLDS: "green", Verdict.WITHIN_GRID: "cyan", Verdict.FAILS: "bold red", Verdict.OPEN: "yellow"}


def print_study(study: Study, to: Console) -> None:
    """The verdicts, why claims do not hold, what engines say otherwise, and the findings."""
    to.print(_table(study))
    for claim in study.claims:
        if claim.verdict in (Verdict.FAILS, Verdict.OPEN):
            to.print(f"[{_STYLES[claim.verdict]}]{claim.name}[/] ({claim.where}): {claim.why}.", soft_wrap=True)
    for claim, each in disagreeing(study):
        to.print(f"[bold red]{each.engine}[/], {claim.name}: {each.value} is outside its bar.", soft_wrap=True)
    to.print(f"\n[bold]{headline(study)}[/]\n{agreement(study)}", soft_wrap=True)
    for sentence in findings(study):
        to.print(f"- {sentence}", soft_wrap=True)


def _table(study: Study) -> Table:
    table = Table(
        title="The paper, claim by claim", title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False
    )
    for name in ("where", "claim", "printed"):
        table.add_column(name)
    table.add_column("ours", justify="right")
    table.add_column("engines", justify="right")
    table.add_column("verdict", no_wrap=True)
    for claim in study.claims:
        verdict = f"[{_STYLES[claim.verdict]}]{SHORT[claim.verdict]}[/]"
        table.add_row(claim.where, claim.name, claim.printed, value(claim.ours), _engines(study, claim), verdict)
    return table


def _engines(study: Study, claim: Claim) -> str:
    """How many of those with a bar behind their value agree with ours."""
    judged = [found for each in claim.engines if (found := each.agrees(claim.ours)) is not None]
    return f"{sum(judged)} of {len(judged)}" if judged and engines(study) else ""
