"""Page of an audit: how far a model file's simulation is off, until when, and why."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ....models.problem import StopLaw
from ...audit import SHARE, Audit, AuditedRun, CauseShare, EngineRun
from ...runs.runner import Runner
from ...runs.study import Until
from .. import document as doc
from ..drawing.scene import RunLook, Scene, scene
from ..plots import Axis, Plot, Series, Style, distinct_colours


def document(found: Audit) -> doc.Document:
    """Errors as given, the motion, causes, other options and engines, and the cheapest option."""
    blocks: list[doc.Block] = [doc.Text(f"{found.headline()}."), _facts(found)]
    if found.errors:
        rows = [(f"{each.t:.4g} s", f"{each.error:.2g} m") for each in found.errors]
        blocks.append(doc.Heading("As given: largest distance of any point up to a time"))
        blocks.append(doc.table(("up to", "off by, as given"), rows))
    if found.samples:
        blocks.append(doc.AnimationBlock(lambda: (_scene(found),), "The motion, as given"))
    blocks += [*_causes(found), _runs(found), _advice(found), *_engines(found), *_figures(found)]
    blocks += [doc.Note(f"Left out: {what}.") for what in found.left_out]
    blocks.append(doc.Note(f"Made with {found.machine_text}."))
    title = f"{found.model}: how far is this simulation from the mechanics?"
    window, command = f"trebucheck audit: {found.model}", found.command or ""
    return doc.Document(title, tuple(blocks), window, command, verdict=found.headline())


def _facts(found: Audit) -> doc.Block:
    points = ", ".join(found.points[:6]) + (", ..." if len(found.points) > 6 else "")
    compared = f"{found.compared_to:.4g} s"
    if found.ended:
        compared += f" of {found.asked:.4g} s: {found.ended}"
    same = f"to {found.difference:.1g} of its accelerations and what else it tells"
    rows = (
        ("file", Path(found.source).name),
        ("mechanism", found.mechanism.headline()),
        (f"the same as in {found.engine} {found.engine_version}", f"{same}, at random states"),
        ("compared to", compared),
        ("predictability horizon", _horizon(found)),
        ("the reference is known to", f"{found.known_to:.1g} of its scales, by rounding"),
        *_controls(found),
        ("points", points),
        ("size of the motion", f"{found.size:.4g} m"),
    )
    return doc.table(("what was read", ""), rows)


def _controls(found: Audit) -> Iterator[tuple[str, str]]:
    """Tell how often recorded controls change; nothing of constant ones."""
    instants = found.mechanism.instants
    if instants:
        yield "recorded controls", f"change {len(instants)} times, last at {instants[-1]:.4g} s"


def _horizon(found: Audit) -> str:
    if found.horizon is None:
        return "not within that"
    return f"{found.horizon:.4g} s: errors of a hundred-thousandth become a thousandth"


def _scene(found: Audit) -> Scene:
    """The reference in motion, and the file as it is given over it."""
    until = Until.of(found.compared_to)
    runner = Runner(found.mechanism, until=until, law=StopLaw.UNILATERAL, predictable=True)
    look = RunLook(found.trajectory(), next(distinct_colours()))
    looks = {f"{found.model} as given": look}
    return scene(runner.reference, looks, end=found.samples[-1].t, thrown=None)


def _causes(found: Audit) -> Iterator[doc.Block]:
    if not found.causes:
        return
    yield doc.Heading(f"Why: causes of the error up to {found.causes_to:.3g} s")
    caption = (
        "Each line takes one more cause out, by a run with the change and those above it that have "
        "a share."
    )
    heads = ("cause", "taken out by", "left [m]", "share")
    yield doc.table(heads, [_cause(each) for each in found.causes], caption)


def _cause(cause: CauseShare) -> tuple[object, ...]:
    left = "–" if cause.left is None else f"{cause.left:.2g}"
    share = f"{100 * cause.share:.1f} %" if cause.share is not None else cause.message or ""
    return cause.name, cause.change, left, share


def _runs(found: Audit) -> doc.Block:
    rows = [_row(run) for run in found.runs]
    caption = (
        "The file with other integrators and steps, all else as given; the processor time is that "
        "of the engine's steps up to the end of what is compared."
    )
    heads = "integrator", "step [s]", "off by [m]", "leaves 1 % at [s]", "processor time [s]"
    return doc.table((*heads, "remark"), rows, caption)


def _row(run: AuditedRun) -> tuple[object, ...]:
    step = f"{run.timestep:g}"
    if run.error is None:
        return run.integrator, step, "–", "–", "–", run.message or ""
    mark = "as given" if run.is_given else "explicit damping" if run.explicit_damping else ""
    time = f"{run.processor_time:.2g}"
    return run.integrator, step, f"{run.error:.2g}", _leaves(run), time, mark


def _leaves(run: AuditedRun | EngineRun) -> str:
    return "never" if run.leaves is None else f"{run.leaves:.3g}"


def _engines(found: Audit) -> Iterator[doc.Block]:
    if not found.engines:
        return
    caption = "The mechanism that was read, by other engines with the preset settings."
    heads = ("engine", "step [s]", "off by [m]", "leaves 1 % at [s]", "remark")
    yield doc.table(heads, [_engine(run) for run in found.engines], caption)


def _engine(run: EngineRun) -> tuple[object, ...]:
    step = "–" if run.timestep is None else f"{run.timestep:g}"
    if run.error is None:
        return run.engine, step, "–", "–", run.message or ""
    return run.engine, step, f"{run.error:.2g}", _leaves(run), ""


def _advice(found: Audit) -> doc.Block:
    if found.cheapest is None:
        return doc.Text(f"None of these holds {found.accuracy:.2g} m.")
    title = f"The cheapest of these that hold {found.accuracy:.2g} m"
    if found.is_longest:
        title += "; no longer step was tried"
    return doc.Code(title, found.cheapest_option)


def _figures(found: Audit) -> Iterator[doc.Block]:
    """Error and energy over time; nothing of a file that cannot be moved as it is given."""
    if not found.samples:
        return
    t, off, energy = (
        np.array([getattr(each, name) for each in found.samples])
        for name in ("t", "error", "energy_error")
    )
    colour = next(distinct_colours())
    positive = off > 0
    allowed = np.full(2, SHARE * found.size)
    errors = (
        Series("as given", t[positive], off[positive], Style(colour)),
        Series("1 % of the size", t[[0, -1]], allowed, Style(colour, dashed=True)),
    )
    distance = Axis("distance from the reference", "m", logarithmic=True)
    caption = "Distance of the farthest point at each time; dashed: 1 % of the motion's size."
    plot = Plot(Axis("t", "s"), distance, errors)
    yield doc.Figure((plot,), "Error over time, as given", caption, "error")
    caption = "Kinetic and potential energy less that of the reference motion, both by the engine."
    series = (Series("as given", t, energy, Style(colour)),)
    plot = Plot(Axis("t", "s"), Axis("energy less the reference's", "J"), series)
    yield doc.Figure((plot,), "Energy over time, as given", caption, "energy")
