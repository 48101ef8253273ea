"""The page of advice: settings that reach a target, texts to copy, what was tried."""

from __future__ import annotations

from collections.abc import Iterator

from ...recommend import Advice, Choice, EngineAdvice, unit_of
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
        name = engine.engine
        if engine.message:
            blocks.append(doc.Text(engine.message, "warning", lead=f"{name}:"))
        if engine.choice is None:
            verdicts.append(f"{name} none")
        for choice in engine.choices:
            label = f"{name} {_label(choice)}"
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
    choices = [(e.engine, choice) for e in advice.engines for choice in e.choices]
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
        rows.append(doc.row(engine, _label(choice), step, *errors, wall, neighbour))
    caption = (
        "The cheapest measured settings of each engine, the quickest first; errors on this "
        "machine. In assisted ones trebucheck does a part of the run"
    )
    return doc.table(doc.ranked(heads, settings=0, step=0, release=2, wall=3), rows, caption)


def _label(choice: Choice) -> str:
    """Name of a set of options, and whether trebucheck takes part in the run."""
    return choice.options if choice.alone else f"{choice.options} (assisted)"


def _chapter(engine: EngineAdvice) -> Iterator[doc.Block]:
    """An engine's settings in words, texts to copy, and what was tried."""
    yield doc.Heading(f"{engine.engine} {engine.engine_version}", 2, engine.engine)
    for choice in engine.choices:
        runs = len(choice.wall_times)
        timed = f"median of {runs}" if runs > 1 else "one run"
        text = (
            f"({choice.words}), step {choice.step:g} s; wall time is the {timed}, warm, on this "
            "machine."
        )
        if choice.longest_tried:
            text += " No longer step was tried: a longer one may do as well."
        yield doc.Text(text, "good", lead=_label(choice))
        for title, snippet in choice.snippets.items():
            yield doc.Code(title, snippet)
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
        for choice in engine.choices:
            name = engine.engine
            if choice is engine.assisted:
                name += "-assisted"
            for title, text in choice.snippets.items():
                ending = "py"
                if text.startswith("<"):
                    ending = "xml"
                elif text.startswith("trebucheck "):
                    ending = "sh"
                named[f"{name}-{'-'.join(title.lower().split())}.{ending}"] = text
    return named
