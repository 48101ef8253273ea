"""Pages of a single run and of a certificate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ....models.arrays import FloatArray
from ....models.trajectory import Trajectory
from ....reference.certification.certificate import Certificate
from ...prove import ProofFile
from ...published import PublishedFigure
from ...runs.balance import sampled_balance
from ...runs.runner import Farthest, horizon_of
from .. import document as doc
from ..document import format_number, format_settings, sentence
from ..plots import Axis, Plot, Series, Style, distinct_colours, motions_scene
from .tables import certified_figures

_POINTS = 1000  # drawn per line, at most


def document(trajectory: Trajectory) -> doc.Document:
    """The page of one run by itself: nothing is compared."""
    shown, mechanism, t = run_report(trajectory), trajectory.mechanism, trajectory.t
    caption = (
        "Paths of the markers, the generalized coordinates, what the stops push with, and the "
        "energies."
    )
    plots: list[Plot] = []
    if trajectory.markers:
        positions = {name: marker.position for name, marker in trajectory.markers.items()}
        paths = {name: (xy[:, 0], xy[:, 1]) for name, xy in positions.items()}
        plots.append(Plot(Axis("x", "m"), Axis("y", "m"), _lines(paths), "paths", equal=True))
    energies = {
        "kinetic": trajectory.kinetic_energy,
        "potential": trajectory.potential_energy,
        "total": trajectory.total_energy,
    }
    coordinates = {name: trajectory.q[:, i] for i, name in enumerate(mechanism.coordinates)}
    over_time = (
        ("coordinates", "rad or m" if mechanism.slides else "rad", coordinates),
        ("stops", mechanism.force_unit, trajectory.stop_torques),
        ("energy", "J", energies),
    )
    for name, unit, quantities in over_time:
        if quantities:
            series = _lines({label: (t, values) for label, values in quantities.items()})
            plots.append(Plot(Axis("t", "s"), Axis(name, unit), series, name))
    motion = doc.AnimationBlock(lambda: (motions_scene(trajectory, (), horizon_of([trajectory])),))
    figure = doc.Figure(tuple(plots), "The run", caption, "run", columns=2)
    blocks = (*shown.blocks, motion, figure)
    return replace(shown, blocks=blocks, window=f"trebucheck: {shown.title}")


def _lines(curves: Mapping[str, tuple[FloatArray, FloatArray]]) -> tuple[Series, ...]:
    series: list[Series] = []
    for (name, (x, y)), colour in zip(curves.items(), distinct_colours(), strict=False):
        drawn = np.unique(np.linspace(0, len(x) - 1, _POINTS).astype(int))
        series.append(Series(name, x[drawn], y[drawn], Style(colour)))
    return tuple(series)


def certificate_report(certificate: Certificate) -> doc.Document:
    """Figures of events; folded away, those at chosen times and the computations."""
    number = sum(computation.independent for computation in certificate.computations)
    figures = f"{len(certificate.figures)} figures from {number} independent computations"
    events = [figure for figure in certificate.figures if figure.time is None]
    timed = [figure for figure in certificate.figures if figure.time is not None]
    further = f"{len(timed)} further figures, at chosen times"
    absent = [doc.Text(text, "warning", lead="left out:") for text in certificate.absent]
    why_not = dict.fromkeys(f.not_proved for f in certificate.figures if f.not_proved)
    absent += [doc.Text(sentence(text), "muted", lead="Not proved:") for text in why_not]
    heads = "computation | formulation | integrator | tolerance | independent"
    made = [
        (c.name, c.formulation, c.integrator, c.tolerance, c.independent)
        for c in certificate.computations
    ]
    rule, versions = sentence(certificate.rule), format_settings(certificate.versions)
    computations = doc.table(
        heads, made, "Each was made alone; the uncertainty is what they differ by"
    )
    blocks = (
        certified_figures(events, "Figures of the motion and its events"),
        doc.Text(f"{further}, are in the file.", "muted", medium="terminal"),
        doc.Fold(further, (certified_figures(timed, further),)),
        doc.Listing(tuple(absent)),
        doc.Fold("The computations", (computations,)),
        doc.Note(f"Uncertainty: {rule} Versions: {versions}."),
        doc.Note(f"Mechanism {certificate.mechanism_hash}."),
    )
    title, window = f"{certificate.model}: {figures}", f"trebucheck certify: {certificate.model}"
    return doc.Document(title, blocks, window, certificate.command)


def proof_report(proof: ProofFile, beside: Sequence[PublishedFigure] = ()) -> doc.Document:
    """Figures of a proved motion, and those of its source beside the proof."""
    rows = [(figure.name, figure.value, figure.radius, figure.unit) for figure in proof.figures]
    heads = doc.ranked(doc.columns("figure | value | radius | unit"), value=0, radius=0, unit=0)
    end = "the launch" if proof.until is None else f"{proof.until:.6g} s"
    caption = f"Figures to {end}: the exact value is within the radius of the value"
    cost = (
        f"{proof.steps} steps of {proof.bits} bits in the last trial; all trials took "
        f"{proof.processor_time:.2g} s of processor time. Proved is the motion of the equations "
        "with the doubles of the mechanism's file taken exactly; that these are the mechanism's "
        "equations is shown by independent formulations."
    )
    blocks: tuple[doc.Block, ...] = (doc.table(heads, rows, caption), doc.Note(cost))
    if beside:
        sources = [
            (each.figure, each.unit, each.expected, each.value or "", each.verdict)
            for each in beside
        ]
        titles = doc.columns("figure of the source | unit | expected | proved | verdict")
        heads = doc.ranked(titles, verdict=0, expected=1, unit=2, proved=3)
        blocks = (*blocks, doc.table(heads, sources))
    title = f"{proof.model}: {len(rows)} figures proved to {proof.digits} digits"
    mechanism = doc.Note(f"Mechanism {proof.mechanism_hash}, stops {proof.stop_law.value}.")
    window = f"trebucheck prove: {proof.model}"
    return doc.Document(title, (*blocks, mechanism), window, proof.command or "")


def run_report(trajectory: Trajectory, distance: Farthest | str | None = None) -> doc.Document:
    """Quantities of one run; if asked for, its distance from the reference or why there is none."""
    run, mechanism = trajectory.provenance, trajectory.mechanism
    title = f"{mechanism.name}, {run.engine} {run.preset} ({run.engine_version})"
    rows = [
        ("simulated", f"{trajectory.t[-1]:.6g} s in {run.steps} steps"),
        ("wall time", f"{run.wall_time:.3f} s"),
    ]
    for name, time in trajectory.release_times.items():
        if mechanism.stop(name).closed:
            rows.append((f"{name} opens", "not" if time is None else f"{time:.9f} s"))
    for name, torque in trajectory.stop_torques.items():
        stop = mechanism.stop(name)
        largest = f"{torque.max():.6g} {stop.force_unit}"
        rows.append((f"{name}, largest {stop.effort}", largest))
    launch = trajectory.launch() if "projectile" in trajectory.markers else None
    if launch is not None:
        rows.append(("launch (velocity at 45 deg)", f"{launch.time:.9f} s"))
        rows.append(("launch speed", f"{launch.speed:.8f} m/s"))
    balance, _ = sampled_balance(trajectory)
    drift = np.abs(balance - balance[0]).max()
    rows.append(("energy drift", f"{drift:.3g} J of {trajectory.total_energy[0]:.6g} J"))
    verdict = ""
    if distance is not None:
        text = f"not known: {distance}"
        if not isinstance(distance, str):
            place = f"{distance.point} at {distance.time:.6g} s"
            until = f"compared to {distance.until:.6g} s"
            text = f"{format_number(distance.distance)} m ({place}; {until})"
        rows.append(("from the reference", text))
        verdict = f"{title}: {text} from the reference"
    return doc.Document(title, (doc.table("|", rows, title),), verdict=verdict)
