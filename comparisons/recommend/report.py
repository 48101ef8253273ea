"""Advice as a document."""

from __future__ import annotations

from collections.abc import Iterator

from ...models.mechanism import Mechanism
from ..report.document import Block, Code, Document, Heading, Text
from ..report.numbers import format_number, sentence
from ..report.sections import compared_time
from .cases import unit_of
from .results import Advice, Asked, Attempt, Choice, EngineAdvice, Errors


def document(advice: Advice) -> Document:
    """One chapter an engine: settings, errors, wall time, what was tried, and the texts to paste."""
    blocks: list[Block] = [
        Text(_target(advice.asked, advice.mechanism), "strong", lead=f"{advice.model}:"),
        Text(compared_time(advice.launch_time, advice.compared_to, advice.judged_to)),
        Text(sentence(advice.rule)),
    ]
    for engine in advice.engines:
        blocks += _chapter(engine, advice.mechanism)
    return Document("Settings that reach the target", tuple(blocks), "trebucheck recommend")


def _target(target: Asked, mechanism: Mechanism) -> str:
    """The accuracy target, in words."""
    values = (("position", target.position), ("torque", target.torque), ("release", target.release))
    parts = [f"{name} within {value:g} {unit_of(name, mechanism)}" for name, value in values if value is not None]
    if target.torque_share is not None:
        parts.append(f"torque within {100 * target.torque_share:g} % of the largest")
    return ", ".join(parts)


def _chapter(engine: EngineAdvice, mechanism: Mechanism) -> Iterator[Block]:
    yield Heading(f"{engine.engine} {engine.engine_version}", 2, medium="any")
    if engine.choice is None:
        yield Text(engine.message or "", "warning", lead="None reaches it:")
    else:
        yield from _choice(engine.choice, mechanism)
    for attempt in engine.attempts:
        yield Text(_attempt(attempt), "muted", lead=f"  {attempt.options:<20}")
    for title, text in engine.snippets.items():
        yield Code(title, text)


def _choice(choice: Choice, mechanism: Mechanism) -> Iterator[Text]:
    yield Text(f"({choice.words}), step {choice.step:g} s", "good", lead=choice.options)
    yield Text(f"  this machine:    {_errors(choice.here, mechanism)}")
    if choice.worst_neighbour is not None:
        yield Text(f"  worst neighbour: {_errors(choice.worst_neighbour, mechanism)}")
    runs = len(choice.wall_times)
    yield Text(f"  wall time {choice.wall_time:.3f} s ({f'median of {runs}' if runs > 1 else 'one run'}, warm, here)")


def _errors(errors: Errors, mechanism: Mechanism) -> str:
    parts = [f"position {format_number(errors.position)} m"]
    if any(stop.closed for stop in mechanism.stops):
        unit = mechanism.force_unit
        share = "" if errors.torque_share is None else f" ({100 * errors.torque_share:.1g} %)"
        parts.append(f"{'force' if unit == 'N' else 'torque'} {format_number(errors.torque)} {unit}{share}")
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
