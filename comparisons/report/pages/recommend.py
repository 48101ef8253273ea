"""The page of advice: settings that reach a target, texts to copy, what was tried."""

from __future__ import annotations

from collections.abc import Iterator

from ...recommend import Advice, EngineAdvice, unit_of
from .. import document as doc
from ..document import format_number, format_step, sentence
from .tables import Settings, compared_time, provenance


def document(advice: Advice) -> doc.Document:
    """One table of the settings; the page also has the texts to paste, and what was tried."""
    mechanism, asked, model = advice.mechanism, advice.asked, advice.model
    targets = {"position": asked.position, "torque": asked.torque, "release": asked.release}
    target = [
        f"{name} within {value:g} {unit_of(name, mechanism)}"
        for name, value in targets.items()
        if value is not None
    ]
    if asked.torque_share is not None:
        target.append(f"torque within {100 * asked.torque_share:g} % of the largest")
    blocks: list[doc.Block] = [
        doc.Text(", ".join(target), "strong", lead=f"{model}:"),
        _settings(advice),
    ]
    runs: list[Settings] = []
    verdicts: list[str] = []
    for engine in advice.engines:
        name, choice = engine.engine, engine.choice
        if choice is None:
            blocks.append(doc.Text(engine.message or "", "warning", lead=f"{name}:"))
            verdicts.append(f"{name} none")
        else:
            label = f"{name} {choice.options}"
            runs.append((model, label, engine.engine_version, choice.settings))
            verdicts.append(f"{label}, step {choice.step:g} s")
    copied = ", ".join(files(advice)) or "none"
    blocks.append(doc.Text(f"{copied}.", lead="To copy, beside recommend.json:"))
    for engine in advice.engines:
        blocks += map(doc.page_only, _chapter(engine))
    blocks += [
        doc.Heading("How it was found", 2),
        doc.Text(compared_time(advice.launch_time, advice.compared_to, advice.judged_to)),
        doc.Text(sentence(advice.rule)),
        *provenance(advice, runs, [advice]),
    ]
    verdict, window = f"{model}: {'; '.join(verdicts)}", f"trebucheck recommend: {model}"
    return doc.Document("Settings that reach the target", tuple(blocks), window, verdict=verdict)


def _settings(advice: Advice) -> doc.Table:
    """The chosen settings, the quickest first."""
    unit = advice.mechanism.force_unit
    load = "force" if unit == "N" else "torque"
    heads = doc.columns(
        f"engine | settings | step [s] | position [m] | {load} [{unit}] | release [s] | wall [s] | "
        "(worst neighbour)"
    )
    choices = [(e.engine, e.choice) for e in advice.engines if e.choice is not None]
    choices.sort(key=lambda each: (each[1].wall_time, each[0]))
    rows: list[doc.Row] = []
    for engine, choice in choices:
        here, worst, neighbour = choice.here, choice.worst_neighbour, "none measured"
        errors = map(format_number, (here.position, here.torque, here.release))
        if worst is not None:
            neighbour = f"position {format_number(worst.position)} m"
        if worst is not None and any(stop.closed for stop in advice.mechanism.stops):
            share = "" if worst.torque_share is None else f" ({100 * worst.torque_share:.1g} %)"
            neighbour += f", {load} {format_number(worst.torque)} {unit}{share}"
            neighbour += f", release {format_number(worst.release)} s"
        step, wall = format_step(choice.step), f"{choice.wall_time:.3f}"
        rows.append(doc.row(engine, choice.options, step, *errors, wall, neighbour))
    caption = (
        "The cheapest measured settings of each engine, the quickest first; errors on this machine"
    )
    return doc.table(doc.ranked(heads, settings=0, step=0, release=2, wall=3), rows, caption)


def _chapter(engine: EngineAdvice) -> Iterator[doc.Block]:
    """An engine's settings in words, texts to copy, and what was tried."""
    yield doc.Heading(f"{engine.engine} {engine.engine_version}", 2, engine.engine)
    if engine.choice is not None:
        runs = len(engine.choice.wall_times)
        timed = f"median of {runs}" if runs > 1 else "one run"
        step = f"({engine.choice.words}), step {engine.choice.step:g} s"
        text = f"{step}; wall time is the {timed}, warm, on this machine."
        yield doc.Text(text, "good", lead=engine.choice.options)
    for title, text in engine.snippets.items():
        yield doc.Code(title, text)
    tried: list[doc.Text] = []
    for attempt in engine.attempts:
        text = f"at best {attempt.worst or 0.0:.2g} times the target: {attempt.note}"
        if attempt.step is not None:
            wall_time = format_number(attempt.wall_time)
            text = f"step {attempt.step:g} s, {wall_time} s: {attempt.note}"
        elif attempt.worst is None:
            text = f"runs failed: {attempt.note}"
        elif attempt.worst <= 1:
            text = f"{attempt.note} (checked on one machine)"
        tried.append(doc.Text(text, lead=attempt.options))
    yield doc.Fold(f"What was tried with {engine.engine}", (doc.Listing(tuple(tried)),))


def files(advice: Advice) -> dict[str, str]:
    """Texts to paste, by names of files."""
    named: dict[str, str] = {}
    for engine in advice.engines:
        for title, text in engine.snippets.items():
            ending = "py"
            if text.startswith("<"):
                ending = "xml"
            elif text.startswith("trebucheck "):
                ending = "sh"
            named[f"{engine.engine}-{'-'.join(title.lower().split())}.{ending}"] = text
    return named
