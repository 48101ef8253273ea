"""The page of advice: settings that reach a target, texts to copy, what was tried."""

from __future__ import annotations

from collections.abc import Iterator

from ....models.mechanism import Mechanism
from ...recommend import Advice, Asked, Attempt, Choice, EngineAdvice, Errors, unit_of
from .. import document as doc
from ..numbers import format_number, format_step, sentence
from .tables import compared_time, provenance


def document(advice: Advice) -> doc.Document:
    """One table of the settings; the page also has the texts to paste, and what was tried."""
    target = _target(advice.asked, advice.mechanism)
    copied = ", ".join(files(advice)) or "none"
    blocks: list[doc.Block] = [
        doc.Text(target, "strong", lead=f"{advice.model}:"),
        _settings(advice),
    ]
    for engine in advice.engines:
        if engine.choice is None:
            blocks.append(doc.Text(engine.message or "", "warning", lead=f"{engine.engine}:"))
    blocks.append(doc.Text(f"{copied}.", lead="To copy, beside recommend.json:"))
    for engine in advice.engines:
        blocks += map(doc.page_only, _chapter(engine))
    runs = [
        (advice.model, f"{e.engine} {e.choice.options}", e.engine_version, e.choice.settings)
        for e in advice.engines
        if e.choice is not None
    ]
    blocks += [
        doc.Heading("How it was found", 2),
        doc.Text(compared_time(advice.launch_time, advice.compared_to, advice.judged_to)),
        doc.Text(sentence(advice.rule)),
        *provenance(advice, runs, [(advice.model, advice.mechanism)]),
    ]
    verdict = f"{advice.model}: {'; '.join(map(_verdict, advice.engines))}"
    window = f"trebucheck recommend: {advice.model}"
    return doc.Document("Settings that reach the target", tuple(blocks), window, verdict=verdict)


def _verdict(engine: EngineAdvice) -> str:
    choice = engine.choice
    settings = "none" if choice is None else f"{choice.options}, step {choice.step:g} s"
    return f"{engine.engine} {settings}"


def _settings(advice: Advice) -> doc.Table:
    unit = advice.mechanism.force_unit
    load = "force" if unit == "N" else "torque"
    heads = doc.columns(
        f"engine | settings | step [s] | position [m] | {load} [{unit}] | release [s] | wall [s] | "
        "(worst neighbour)"
    )
    choices = [(e.engine, e.choice) for e in advice.engines if e.choice is not None]
    choices.sort(key=lambda each: (each[1].wall_time, each[0]))
    rows = [_row(engine, choice, advice.mechanism) for engine, choice in choices]
    caption = (
        "The cheapest measured settings of each engine, the quickest first; errors on this machine"
    )
    return doc.table(doc.ranked(heads, settings=0, step=0, release=2, wall=3), rows, caption)


def _row(engine: str, choice: Choice, mechanism: Mechanism) -> doc.Row:
    here, worst = choice.here, choice.worst_neighbour
    errors = map(format_number, (here.position, here.torque, here.release))
    neighbour = "none measured" if worst is None else _errors(worst, mechanism)
    step, wall = format_step(choice.step), f"{choice.wall_time:.3f}"
    return doc.row(engine, choice.options, step, *errors, wall, neighbour)


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
    values = {"position": target.position, "torque": target.torque, "release": target.release}
    parts = [
        f"{name} within {value:g} {unit_of(name, mechanism)}"
        for name, value in values.items()
        if value is not None
    ]
    if target.torque_share is not None:
        parts.append(f"torque within {100 * target.torque_share:g} % of the largest")
    return ", ".join(parts)


def _errors(errors: Errors, mechanism: Mechanism) -> str:
    parts = [f"position {format_number(errors.position)} m"]
    if any(stop.closed for stop in mechanism.stops):
        unit = mechanism.force_unit
        load = "force" if unit == "N" else "torque"
        share = "" if errors.torque_share is None else f" ({100 * errors.torque_share:.1g} %)"
        parts.append(f"{load} {format_number(errors.torque)} {unit}{share}")
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
