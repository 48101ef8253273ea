"""Tables and paragraphs that several pages share: verdicts, causes, horizons, provenance."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from decimal import Context
from typing import Protocol

from ....engines.presets import ASSISTED, MEANINGS, PRESETS
from ....models.mechanism import Mechanism
from ....reference.certification.certificate import Figure
from ...diagnosis.rank import MOST_OF_IT, SAME, SUFFICIENT
from ...runs.results import Diagnosis, Machine, Measured, Outcome, RankedCause, ResultFile, Run
from .. import document as doc
from ..document import format_number, format_settings

Settings = tuple[str, str, str, Mapping[str, object]]
"""Machine, engine (and what else names the run), version, and settings."""
MARKS: dict[Outcome, doc.Mark] = {
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
PRESETS_EXPLAINED = (
    "The preset "
    + ", ".join(f"“{preset}” is {MEANINGS[preset]}" for preset in PRESETS)
    + "; each row says what trebucheck does in it."
)
"""Meaning of the presets, for a page's introduction."""
_PROVED_DIGITS = 18  # in a table
_LISTED = 5  # singular positions whose times are stated
# Why nothing is compared beyond the predictability horizon
_HORIZON = (
    "there a hundred-thousandth of a body's inertia, or a millionth of the start, moves the "
    "mechanism by a thousandth of its size, and any two integrators differ"
)
_BEYOND = "beyond it only invariants and the time of first parting are judged"


def verdict_blocks(text: str, mark: doc.Mark) -> tuple[doc.Block, doc.Block]:
    """The verdict in a line: first on a page, last in a terminal."""
    return doc.Text(text, mark, medium="page"), doc.Text(text, mark, medium="terminal")


def judged_mark(holds: bool | None) -> doc.Mark:
    """Mark of a value by its tolerance; its own one where nothing judges it."""
    return "unjudged" if holds is None else doc.mark_of(holds)


def chapter(model: str) -> doc.Heading:
    """Heading of a machine's chapter."""
    return doc.Heading(f"{model.capitalize()} machine", 2, model)


def anchor(model: str, name: str) -> str:
    """Anchor of a machine's figure or section of that name."""
    return f"{model}-{name}".lower().replace(" ", "-")


def capital(text: str) -> str:
    """The text with a capital."""
    return text[:1].upper() + text[1:]


def both_assisted(first: str, second: str) -> bool:
    """Tell whether both labels of runs end in the assisted preset."""
    return first.endswith(ASSISTED) and second.endswith(ASSISTED)


# --- Verdicts and causes


def complaints(run: Run, most: int | None = None) -> list[str]:
    """A sentence on each broken tolerance, or on the `most` worst, then the number of the rest."""
    broken = sorted(run.broken, key=lambda metric: metric.share or 0.0)
    sentences: list[str] = []
    for metric in broken[::-1][:most]:
        measured = metric.note or f"{format_number(metric.value)} {metric.unit}"
        allowed = f"{format_number(metric.tolerance)} {metric.unit}"
        source = f"{metric.source}: {metric.reason}"
        sentences.append(f"{metric.label}: {measured}, tolerance {allowed} ({source})")
    rest = len(broken) - len(sentences)
    if rest:
        judged = len(run.judged)
        sentences.append(f"{rest} more of {judged} judged quantities break their tolerance.")
    return sentences


def diagnosis(run: Measured) -> list[str]:
    """Tell when and why a run differs from the reference; no sentence for a run that agrees."""
    diagnosed = run.diagnosis
    if diagnosed is None:
        return []
    if diagnosed.note:
        return [f"no cause is known: {diagnosed.note}."]
    when = "in its motion" if run.metrics else "before any motion"
    if diagnosed.parts_at is not None:
        holding = ", ".join(diagnosed.holding) or "no stop"
        when = f"from t = {diagnosed.parts_at:.6g} s, while {holding} held in the reference"
    only = ""
    if diagnosed.motion_agrees:
        only = " The motion follows the reference: only what is read from it differs."
    # Each suspect with the share of the deviation that it explains.
    shares = "; ".join(
        f"{_amount(cause)}: {100 * cause.explained:.1f} % of it"
        for cause in diagnosed.named or diagnosed.causes[:3]
        if cause.explained >= MOST_OF_IT
    )
    likeliest = "Cause unknown: no suspect accounts for half of it."
    if diagnosed.named:
        others = diagnosed.causes[diagnosed.likeliest :]
        alike = ", ".join(cause.name for cause in others if cause.explained >= SAME)
        likeliest = f"Likeliest: {shares}.{f' As well by: {alike}.' if alike else ''}"
    elif shares:
        likeliest = (
            "Cause unknown. No suspect accounts for enough of it, and clearly more than others: "
            f"{shares}."
        )
    if diagnosed.reruns_to is not None and any(cause.confirmed for cause in diagnosed.named):
        likeliest += f" Runs with other settings were compared up to {diagnosed.reruns_to:.4g} s."
    if diagnosed.left_out:
        likeliest += f" {_not_made(diagnosed.left_out)}."
    return [f"differs from the reference {when}, first in {diagnosed.leads}.{only} {likeliest}"]


def _not_made(runs: int) -> str:
    """Clause on the runs with other settings that are missing."""
    number = "1 run" if runs == 1 else f"{runs} runs"
    return f"{number} with other settings would have taken too long, so that causes may be missing"


def _amount(cause: RankedCause) -> str:
    return f"{cause.name} ({cause.amount})" if cause.amount else cause.name


def _with_share(cause: RankedCause) -> str:
    """A cause, with its share where it is a part of the deviation only."""
    part = "" if cause.explained >= SUFFICIENT else f": {100 * cause.explained:.0f} % of it"
    return f"{_amount(cause)}{part}"


def cause_text(diagnosed: Diagnosis) -> str:
    """Quantity in which a run differs first, and the likeliest cause, in a line."""
    if diagnosed.note:
        return f"cause unknown: {diagnosed.note}"
    named = " or ".join(map(_with_share, diagnosed.named))
    return f"first in {diagnosed.leads}, {f'likeliest: {named}' if named else 'cause unknown'}"


def why(run: Measured) -> Iterator[doc.Text]:
    """Tell when and why a run differs from the reference, in paragraphs."""
    for sentence in diagnosis(run):
        yield doc.Text(capital(sentence), lead="Why:")


# --- Times


def compared_time(
    launch_time: float | None, compared_to: float | None, judged_to: float | None
) -> str:
    """Tell until when motions are compared, and why not longer.

    Args:
        launch_time: of the reference [s]; None if it does not launch by the end.
        compared_to: end of the compared motion [s]; None: the launch.
        judged_to: that, or the predictability horizon if earlier [s]; None: the end.
    """
    end = compared_to or launch_time or 0.0
    until = f"{end:.6g}"
    if launch_time is not None and launch_time >= end * (1 - 1e-9):
        until = f"the launch at {end:.6f}"
    text = f"Compared from the start to {until} s."
    if judged_to is not None and judged_to < end:
        text += f" Nothing is compared beyond {judged_to:.6g} s: {_HORIZON}."
    return text


def predictable(machine: Machine) -> str:
    """The predictability horizon, the growth of errors on the way, and singular positions."""
    text = f"Predictable to the end, {machine.compared_to:.6g} s."
    if machine.judged_to < machine.compared_to:
        text = f"Predictable until {machine.judged_to:.6g} s; {_BEYOND}: {_HORIZON}."
    horizon = machine.predictability
    if horizon is not None:
        rows = zip(horizon.times, horizon.parameters, horizon.start, strict=True)
        grown = ", ".join(f"by {_growth(p)} and {_growth(s)} at {t:.4g} s" for t, p, s in rows)
        text += f" Relative errors of parameters and of the start are multiplied {grown}."
    passed = machine.singular_positions
    if not passed:
        return text
    times = ", ".join(f"{position.time:.9g}" for position in passed[:_LISTED])
    more = f" and {len(passed) - _LISTED} times more" if len(passed) > _LISTED else ""
    uncertain = max(position.time_uncertainty for position in passed)
    adds = max(position.uncertainty for position in passed)
    return (
        f"{text} The reference passes singular positions, in which its constraints lose rank, on "
        f"the smooth branch of its motion: at {times} s{more} (uncertain by {uncertain:.1g} s); "
        f"each adds at most {adds:.1g} of the longest arm to the uncertainty behind it. Beside "
        "them no forces are compared."
    )


def _growth(factor: float | None) -> str:
    return "infinity" if factor is None else f"{factor:.2g}"


def partings(machine: Machine, runs: Iterable[Run]) -> Iterator[doc.Text]:
    """Tell when each run leaves the reference, where they are compared beyond the horizon."""
    if machine.judged_to >= machine.compared_to:
        return
    times: list[str] = []
    for run in runs:
        time, error = run.metric("first_parting"), run.metric("base_error")
        if time and error:
            parting = "not by the end"
            if time.value is not None:
                parting = f"at {time.value:.4g} s (base error {format_number(error.value)})"
            times.append(f"{run.label} {parting}")
    listed = ", ".join(times) or "none"
    yield doc.Text(f"First parting from the reference, by a thousandth of a scale: {listed}.")


# --- Evidence


class _OfMechanism(Protocol):
    @property
    def model(self) -> str: ...
    @property
    def mechanism(self) -> Mechanism: ...


def provenance(
    result: ResultFile, runs: Iterable[Settings], machines: Iterable[_OfMechanism]
) -> tuple[doc.Block, ...]:
    """The end of a page: versions, the settings of each run, and each machine's mechanism."""
    blocks: list[doc.Block] = [
        doc.Heading("Provenance", 2),
        doc.Note(f"{capital(result.machine_text)}."),
    ]
    if result.shared:
        text = "Workers of a cluster made the runs: their times do not compare engines."
        blocks.append(doc.Text(text))
    elif result.jobs != 1:
        text = f"Wall times: {result.jobs} runs at once, which disturb each other."
        blocks.append(doc.Text(text))
    if result.command is not None:
        title = "The command that makes this again"
        blocks.append(doc.Code(title, result.command, medium="page"))
    rows = [(*names, format_settings(settings)) for *names, settings in runs]
    heads = "machine | engine | version | settings"
    blocks.append(doc.table(heads, rows, "Settings of every run", "page"))
    blocks += [mechanism_as_data(machine.model, machine.mechanism) for machine in machines]
    return tuple(blocks)


def mechanism_as_data(model: str, mechanism: Mechanism) -> doc.Fold:
    """A mechanism's JSON behind its hash."""
    title = f"{model}: the mechanism as JSON, hash {mechanism.content_hash[:16]}"
    return doc.Fold(title, (doc.Code("", mechanism.to_json()),))


def certified_figures(figures: Iterable[Figure], caption: str) -> doc.Table:
    """One row a figure: value, uncertainty, unit, and the proved value."""
    rows = [(f.label, *f.texts, f.unit, _proved(f)) for f in figures]
    heads = doc.columns("figure | value | uncertainty | unit | proved")
    return doc.table(doc.ranked(heads, value=0, uncertainty=0, unit=0), rows, caption)


def _proved(figure: Figure) -> str:
    """The proved value, rounded to what a table can hold."""
    if figure.proved_value is None:
        return "-"
    return str(Context(prec=_PROVED_DIGITS).create_decimal(figure.proved_value))
