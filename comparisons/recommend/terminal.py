"""The advice as a person reads it in a terminal."""

from __future__ import annotations

from rich.console import Console

from ...models.mechanism import Mechanism
from ..report.numbers import format_number as figure
from .results import Advice, Attempt, Choice, EngineAdvice, Errors
from .target import Asked, unit_of


def print_advice(advice: Advice, to: Console) -> None:
    """One block an engine: settings, errors, wall time, what was tried, and the texts to paste."""
    to.print(f"[bold]{advice.model}[/]: {asked_text(advice.asked, advice.mechanism)}", soft_wrap=True)
    to.print(f"{advice.rule[:1].upper()}{advice.rule[1:]}.", soft_wrap=True)
    for engine in advice.engines:
        to.print()
        to.rule(f"{engine.engine} {engine.engine_version}", align="left")
        if engine.choice is None:
            to.print(f"[yellow]None reaches it[/]: {engine.message}", soft_wrap=True)
        else:
            _print_choice(engine.choice, advice, to)
        _print_attempts(engine, advice.asked, to)
        for title, text in engine.snippets.items():
            to.print(f"\n[dim]# --- {title}[/]")
            to.print(text, markup=False, soft_wrap=True)


def asked_text(asked: Asked, mechanism: Mechanism) -> str:
    """What is asked, in words."""
    share = None if asked.torque_share is None else f"torque within {100 * asked.torque_share:g} % of the largest"
    parts = [
        None if value is None else f"{name} within {value:g} {unit_of(name, mechanism)}"
        for name, value in (("position", asked.position), ("torque", asked.torque), ("release", asked.release))
    ]
    return ", ".join(part for part in [*parts, share] if part) + ", up to the launch"


def _print_choice(choice: Choice, advice: Advice, to: Console) -> None:
    to.print(f"[green]{choice.options}[/] ({choice.words}), step {choice.step:g} s", soft_wrap=True)
    to.print(f"  this machine:    {_errors(choice.here, advice.mechanism)}", soft_wrap=True)
    if choice.worst_neighbour is not None:
        to.print(f"  worst neighbour: {_errors(choice.worst_neighbour, advice.mechanism)}", soft_wrap=True)
    runs = len(choice.wall_times)
    to.print(f"  wall time {choice.wall_time:.3f} s ({f'median of {runs}' if runs > 1 else 'one run'}, warm, here)")


def _errors(errors: Errors, mechanism: Mechanism) -> str:
    share = "" if errors.torque_share is None else f" ({100 * errors.torque_share:.1g} %)"
    parts = [f"position {figure(errors.position)} m"]
    if any(stop.closed for stop in mechanism.stops):
        unit = mechanism.force_unit
        what = "force" if unit == "N" else "torque"
        parts += [f"{what} {figure(errors.torque)} {unit}{share}", f"release {figure(errors.release)} s"]
    return ", ".join(parts)


def _print_attempts(engine: EngineAdvice, asked: Asked, to: Console) -> None:
    for attempt in engine.attempts:
        to.print(f"  [dim]{attempt.options:<20}[/] {_attempt(attempt)}", soft_wrap=True)


def _attempt(attempt: Attempt) -> str:
    if attempt.step is not None:
        return f"step {attempt.step:g} s, {figure(attempt.wall_time)} s: {attempt.note}"
    if attempt.worst is None:
        return f"runs failed: {attempt.note}"
    if attempt.worst <= 1:
        return f"{attempt.note} (looked at on one machine)"
    return f"at best {attempt.worst:.2g} times what is asked: {attempt.note}"
