"""A comparison in some thirty lines of Markdown, for a pull request: only what results.json says."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from ..report.document import (
    Block,
    Code,
    Column,
    Document,
    Fold,
    Listing,
    Note,
    Table,
    Text,
    mark_of,
    table,
    without_empty_columns,
    words,
)
from ..report.numbers import format_settings, sentence
from ..runs.results import Diagnosis, Outcome, Results, Run
from ..runs.study import REFERENCE
from .agreement import OVERVIEW, verdict_cell
from .sentences import complaints, verdict

_ROWS, _CAUSES, _COMPLAINTS = 16, 6, 10
"""Runs and causes that are shown at once, and sentences on broken tolerances of a run behind a fold."""
_SIGNS = (
    "Largest differences to the reference. ✓ holds its tolerance, ✗ breaks it, ○ is not judged."
)


def summary(results: Results) -> Document:
    """Verdict, errors of the runs, what broke and why, versions; the rest behind folds."""
    first, rest = _foremost(results.runs)
    broken = [*_broken(results.runs)]
    blocks: tuple[Block, ...] = (
        Text(verdict(results), mark_of(results.passed)),
        _errors(first),
        Note(_SIGNS),
        Listing(tuple(broken[:_CAUSES])),
        Text(_versions(results)),
        *_command(results),
        *_folds(results, rest, broken[_CAUSES:]),
    )
    return Document("", blocks)


def _foremost(runs: Sequence[Run]) -> tuple[Sequence[Run], Sequence[Run]]:
    """Runs to be shown, and the rest: the reference against itself, and where there are too many those that agree."""
    ordered = [*runs]
    if len(runs) > _ROWS:
        ordered.sort(key=lambda run: run.outcome is Outcome.AGREES)
    own = [run for run in ordered if run.engine == REFERENCE and run.outcome is Outcome.AGREES]
    others = [run for run in ordered if run not in own] or own
    return others[:_ROWS], [*others[_ROWS:], *(own if others is not own else [])]


def _errors(runs: Sequence[Run]) -> Table:
    """Quantities that one of the runs has, at least."""
    heads = (
        Column("machine", of=lambda run: run.model),
        Column("engine", of=lambda run: run.label),
        *(quantity.column for quantity in OVERVIEW if any(map(quantity.metrics, runs))),
        Column("verdict", of=verdict_cell),
    )
    return without_empty_columns(table(heads, runs))


def _broken(runs: Iterable[Run]) -> Iterator[Text]:
    """One line for each run that does not agree: the worst of it, and its likeliest cause."""
    for run in runs:
        parts = [*complaints(run, 1), *([run.message] if run.message else [])]
        parts += [f"not judged: {len(run.unjudged)} quantities"] if run.unjudged else []
        if run.diagnosis is not None:
            parts.append(cause(run.diagnosis))
        if parts:
            text = " ".join(map(sentence, parts))
            yield Text(text, "bad" if run.broken else "warning", lead=f"{run.model}, {run.label}:")


def cause(diagnosis: Diagnosis) -> str:
    """What a run differs in first, and its likeliest cause, in a line."""
    if diagnosis.note:
        return f"cause unknown: {diagnosis.note}"
    named = " or ".join(
        f"{each.name} ({each.amount})" if each.amount else each.name for each in diagnosis.named
    )
    return f"first in {diagnosis.leads}, {f'likeliest: {named}' if named else 'cause unknown'}"


def _versions(results: Results) -> str:
    engines = {run.engine: run.engine_version for run in results.runs}
    names = ", ".join(f"{engine} {version}" for engine, version in engines.items())
    own = f"trebucheck {results.trebucheck_version}, Python {results.python_version}, {results.platform}"
    return f"Versions: {names}; {own}."


def _command(results: Results) -> Iterator[Block]:
    if results.command is not None:
        yield Code("Made by:", results.command)


def _folds(results: Results, rest: Sequence[Run], broken: Sequence[Text]) -> Iterator[Block]:
    if rest or broken:
        yield Fold(f"Further runs ({len(rest)})", (_errors(rest), Listing(tuple(broken))))
    complained = [(run, complaints(run, _COMPLAINTS)) for run in results.runs if run.broken]
    items = [
        Text(text, lead=f"{run.model}, {run.label}:") for run, texts in complained for text in texts
    ]
    if items:
        yield Fold("Tolerances that are broken", (Listing(tuple(items)),))
    mechanisms = [(m.model, m.mechanism_hash[:16], f"{m.judged_to:.6g}") for m in results.machines]
    settings = [(run.model, run.label, format_settings(run.settings)) for run in results.runs]
    yield Fold(
        "Mechanisms and settings",
        (
            table("machine | hash | judged to [s]", mechanisms),
            table(["machine", "engine", words("settings")], settings),
        ),
    )
