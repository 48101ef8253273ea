"""The page of advice: settings that reach a target, texts to copy, what was tried."""

from __future__ import annotations

from collections.abc import Iterator

from ....models.mechanism import Mechanism
from ...recommend.results import Advice, Asked, Attempt, Choice, EngineAdvice, Errors
from ...recommend.search import unit_of
from .. import document as doc
from ..numbers import format_number, format_step, sentence
from .tables import compared_time, provenance


def document(advice: Advice) -> doc.Document:
    """One table of the settings; the page also has the texts to paste, and what was tried."""
    asked = _target(advice.asked, advice.mechanism)
    blocks: list[doc.Block] = [
        doc.Text(asked, "strong", lead=f"{advice.model}:"),
        _settings(advice),
        *(
            doc.Text(e.message or "", "warning", lead=f"{e.engine}:")
            for e in advice.engines
            if e.choice is None
        ),
        doc.Text(f"{', '.join(files(advice)) or 'none'}.", lead="To copy, beside recommend.json:"),
        *(doc.page_only(block) for engine in advice.engines for block in _chapter(engine)),
        doc.Heading("How it was found", 2),
        doc.Text(compared_time(advice.launch_time, advice.compared_to, advice.judged_to)),
        doc.Text(sentence(advice.rule)),
    ]
    runs = (
        (advice.model, f"{e.engine} {e.choice.options}", e.engine_version, e.choice.settings)
        for e in advice.engines
        if e.choice is not None
    )
    blocks += provenance(advice, runs, [(advice.model, advice.mechanism)])
    title = "Settings that reach the target"
    choices = ((each.engine, each.choice) for each in advice.engines)
    found = (
        f"{name} {'none' if c is None else f'{c.options}, step {c.step:g} s'}"
        for name, c in choices
    )
    window, verdict = f"trebucheck recommend: {advice.model}", f"{advice.model}: {'; '.join(found)}"
    return doc.Document(title, tuple(blocks), window, verdict=verdict)


def _settings(advice: Advice) -> doc.Table:
    unit = advice.mechanism.force_unit
    heads = doc.ranked(
        doc.columns(
            f"engine | settings | step [s] | position [m] | {'force' if unit == 'N' else 'torque'} "
            f"[{unit}] | release [s] | wall [s] | (worst neighbour)"
        ),
        settings=0,
        step=0,
        release=2,
        wall=3,
    )
    found = sorted(
        ((e.choice.wall_time, e.engine, e.choice) for e in advice.engines if e.choice is not None),
        key=lambda each: each[:2],
    )
    rows = (_row(engine, choice, advice.mechanism) for _, engine, choice in found)
    caption = (
        "The cheapest measured settings of each engine, the quickest first; errors on this machine"
    )
    return doc.table(heads, rows, caption)


def _row(engine: str, choice: Choice, mechanism: Mechanism) -> doc.Row:
    here, worst = choice.here, choice.worst_neighbour
    values = (format_number(value) for value in (here.position, here.torque, here.release))
    neighbour = "none measured" if worst is None else _errors(worst, mechanism)
    return doc.row(
        engine,
        choice.options,
        format_step(choice.step),
        *values,
        f"{choice.wall_time:.3f}",
        neighbour,
    )


def _chapter(engine: EngineAdvice) -> Iterator[doc.Block]:
    yield doc.Heading(f"{engine.engine} {engine.engine_version}", 2, engine.engine)
    if engine.choice is not None:
        runs = len(engine.choice.wall_times)
        timed = f"median of {runs}" if runs > 1 else "one run"
        step = f"({engine.choice.words}), step {engine.choice.step:g} s"
        text = f"{step}; wall time is the {timed}, warm, on this machine."
        yield doc.Text(text, "good", lead=engine.choice.options)
    for title, text in engine.snippets.items():
        yield doc.Code(title, text)
    tried = tuple(doc.Text(_attempt(attempt), lead=attempt.options) for attempt in engine.attempts)
    yield doc.Fold(f"What was tried with {engine.engine}", (doc.Listing(tried),))


def files(advice: Advice) -> dict[str, str]:
    """Texts to paste, by names of files."""
    return {
        f"{engine.engine}-{'-'.join(title.lower().split())}.{_kind(text)}": text
        for engine in advice.engines
        for title, text in engine.snippets.items()
    }


def _kind(text: str) -> str:
    """Ending of a file of that text."""
    return "xml" if text.startswith("<") else "sh" if text.startswith("trebucheck ") else "py"


def _target(target: Asked, mechanism: Mechanism) -> str:
    """The accuracy target, in words."""
    values = (("position", target.position), ("torque", target.torque), ("release", target.release))
    parts = [
        f"{name} within {value:g} {unit_of(name, mechanism)}"
        for name, value in values
        if value is not None
    ]
    if target.torque_share is not None:
        parts.append(f"torque within {100 * target.torque_share:g} % of the largest")
    return ", ".join(parts)


def _errors(errors: Errors, mechanism: Mechanism) -> str:
    parts = [f"position {format_number(errors.position)} m"]
    if any(stop.closed for stop in mechanism.stops):
        unit = mechanism.force_unit
        share = "" if errors.torque_share is None else f" ({100 * errors.torque_share:.1g} %)"
        parts.append(
            f"{'force' if unit == 'N' else 'torque'} {format_number(errors.torque)} {unit}{share}"
        )
        parts.append(f"release {format_number(errors.release)} s")
    return ", ".join(parts)


def _attempt(attempt: Attempt) -> str:
    if attempt.step is not None:
        return f"step {attempt.step:g} s, {format_number(attempt.wall_time)} s: {attempt.note}"
    if attempt.worst is None:
        return f"runs failed: {attempt.note}"
    if attempt.worst <= 1:
        return f"{attempt.note} (checked on one machine)"
    return f"at best {attempt.worst:.2g} times the target: {attempt.note}"
