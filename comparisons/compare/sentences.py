"""A comparison in sentences: the verdict, what broke, what could not be judged, and why."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from ..diagnosis.ranking import SAME
from ..report.document import Block, Heading, Listing, Mark, Text
from ..report.numbers import format_number
from ..runs.results import Cause, Diagnosis, Measured, Metric, Outcome, Results, Run

MARKS: dict[Outcome, Mark] = {
    Outcome.AGREES: "good",
    Outcome.DISAGREES: "bad",
    Outcome.NOT_JUDGED: "warning",
    Outcome.NOT_EQUIVALENT: "bad",
    Outcome.FAILED: "bad",
    Outcome.TIMED_OUT: "bad",
    Outcome.ABSENT: "warning",
    Outcome.UNSUPPORTED: "warning",
}
"""Marks of verdicts."""
_PLURALS = {Outcome.AGREES: "agree", Outcome.DISAGREES: "disagree"}
_MOST = 3
"""Sentences on broken tolerances for one run; the table of all metrics has the rest."""


def verdict(results: Results) -> str:
    """One line: how many runs came to which verdict, and what was judged."""
    counted = Counter(run.outcome for run in results.runs)
    outcomes = ", ".join(
        f"{counted[each]} {_PLURALS.get(each, each.value)}" for each in Outcome if counted[each]
    )
    judged = sum(len(run.judged) for run in results.runs)
    held = judged - sum(len(run.broken) for run in results.runs)
    checks = [run.equality for run in results.runs if run.equality is not None]
    shown = [check for check in checks if check.exposed]
    models = f"{sum(check.holds for check in shown)} of {len(shown)} built models equivalent"
    unchecked = f", {len(checks) - len(shown)} not checked" if len(shown) < len(checks) else ""
    head = _head(results, judged > 0)
    return f"{head}. Runs: {outcomes or 'none'}; {held} of {judged} judged quantities hold; {models}{unchecked}."


def _head(results: Results, judged: bool) -> str:
    if not judged:
        return "Nothing was judged"
    if not results.passed:
        return "Agreement does not hold"
    undecided = any(run.outcome is Outcome.NOT_JUDGED for run in results.runs)
    return "Nothing disagrees, but not all could be judged" if undecided else "Agreement holds"


def findings(results: Results) -> Iterator[Text]:
    """What broke or did not run, and why."""
    for run in results.runs:
        name = f"{run.model}, {run.label}"
        for sentence in complaints(run, _MOST):
            yield Text(sentence, "bad", lead=f"{name}:")
        if run.message:
            yield Text(f"{run.outcome.value}: {run.message}", MARKS[run.outcome], lead=f"{name}:")
        if run.unjudged:
            labels = ", ".join(metric.label for metric in run.unjudged)
            yield Text(
                f"not judged: {labels} ({run.unjudged[0].note}).", "warning", lead=f"{name}:"
            )
        for sentence in diagnosis(run):
            yield Text(sentence, "strong", lead=f"{name}, why:")


def complaints(run: Run, most: int | None = None) -> list[str]:
    """One sentence for each tolerance that does not hold, the worst first; of the rest their number.

    Args:
        most: how many have a sentence; None: all.
    """
    broken = sorted(run.broken, key=lambda m: m.share or 0.0)
    sentences = [_complaint(metric) for metric in broken[::-1][:most]]
    rest = len(broken) - len(sentences)
    return [
        *sentences,
        f"{rest} more of {len(run.judged)} judged quantities break their tolerance.",
    ][: len(broken)]


def _complaint(m: Metric) -> str:
    measured = m.note or f"{format_number(m.value)} {m.unit}"
    return f"{m.label}: {measured}, tolerance {format_number(m.tolerance)} {m.unit} ({m.source}: {m.reason})"


def diagnosis(run: Measured) -> list[str]:
    """When the run begins to differ from the reference and why, in sentences; none for a run that agrees."""
    diagnosed = run.diagnosis
    if diagnosed is None:
        return []
    if diagnosed.note:
        return [f"no cause is known: {diagnosed.note}."]
    when = "in its motion" if run.metrics else "before any motion"
    if diagnosed.parts_at is not None:
        holding = ", ".join(diagnosed.holding) or "no stop"
        when = f"from t = {diagnosed.parts_at:.6g} s, while {holding} held in the reference"
    only = (
        " The motion follows the reference: only what is read from it differs."
        if diagnosed.motion_agrees
        else ""
    )
    return [
        f"differs from the reference {when}, first in {diagnosed.leads}.{only} {_likeliest(diagnosed)}"
    ]


def _likeliest(diagnosed: Diagnosis) -> str:
    """The causes that account for enough of the deviation; without one, what the suspects account for."""
    shares = "; ".join(_suspicion(cause) for cause in diagnosed.named or diagnosed.causes[:3])
    if diagnosed.named:
        alike = [
            cause for cause in diagnosed.causes[diagnosed.likeliest :] if cause.explained >= SAME
        ]
        rest = f" As well by: {', '.join(cause.name for cause in alike)}." if alike else ""
        return f"Likeliest: {shares}.{rest}"
    if shares:
        return f"Cause unknown. No suspect accounts for enough of it, and clearly more than others: {shares}."
    return "Cause unknown: no suspect accounts for it."


def _suspicion(cause: Cause) -> str:
    """A suspect: what, how much of it, and how much of the deviation that accounts for."""
    amount = f" ({cause.amount})" if cause.amount else ""
    return f"{cause.name}{amount}: {100 * cause.explained:.1f} % of it"


def differing(results: Results) -> Iterator[Block]:
    """Of each run that does not agree: what broke, what could not be judged, and why."""
    for run in results.runs:
        if run.outcome is Outcome.AGREES:
            continue
        yield Heading(f"{run.model}, {run.label}: {run.outcome.value}", 3, why_anchor(run))
        yield from why(run)
        yield Listing(tuple(_said_of(run)))


def why(found: Measured) -> Iterator[Text]:
    """When and why it differs from the reference, as paragraphs."""
    yield from (Text(sentence, lead="Why:") for sentence in map(_capital, diagnosis(found)))


def why_anchor(run: Run) -> str:
    """Anchor of what is said of a run that does not agree."""
    return f"why-{run.model}-{run.label}".lower().replace(" ", "-")


def _said_of(run: Run) -> Iterator[Text]:
    yield from (
        Text(sentence, "bad" if n < len(run.broken) else "plain")
        for n, sentence in enumerate(complaints(run, _MOST))
    )
    if run.message:
        yield Text(_capital(run.message), MARKS[run.outcome])
    if run.unjudged:
        labels = ", ".join(metric.label for metric in run.unjudged)
        yield Text(f"not judged: {labels} ({run.unjudged[0].note}).", "unjudged")


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
