"""Pages of a single run and of a certificate."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from ....models.arrays import FloatArray
from ....models.trajectory import Trajectory
from ....reference.certification.certificate import Certificate
from ...runs.balance import sampled_balance
from ...runs.runner import Farthest
from .. import document as doc
from ..document import format_number, format_settings, sentence
from ..drawing.scene import scene
from ..plots import Axis, Panels, Plot, Series, Style
from .tables import certified_figures

_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
_POINTS = 1000  # drawn per line, at most


def document(trajectory: Trajectory) -> doc.Document:
    """The page of one run by itself: nothing is compared."""
    shown = run_report(trajectory)
    caption = (
        "Paths of the markers, the generalized coordinates, what the stops push with, and the "
        "energies."
    )
    figure = doc.Figure(_panels(trajectory), "The run", caption, "run", columns=2)
    motion = doc.AnimationBlock(lambda: (scene(trajectory),))
    blocks = (*shown.blocks, motion, figure)
    return replace(shown, blocks=blocks, window=f"trebucheck: {shown.title}")


def _panels(run: Trajectory) -> Panels:
    mechanism, plots = run.mechanism, list[Plot]()
    if run.markers:
        paths = {name: (m.position[:, 0], m.position[:, 1]) for name, m in run.markers.items()}
        plots.append(Plot(Axis("x", "m"), Axis("y", "m"), _lines(paths), "paths", equal=True))
    unit = "rad or m" if mechanism.slides else "rad"
    coordinates = {name: run.q[:, i] for i, name in enumerate(mechanism.coordinates)}
    energies = {
        "kinetic": run.kinetic_energy,
        "potential": run.potential_energy,
        "total": run.total_energy,
    }
    over_time = (
        ("coordinates", unit, coordinates),
        ("stops", mechanism.force_unit, run.stop_torques),
        ("energy", "J", energies),
    )
    for name, unit, values in over_time:
        if values:
            series = _lines({label: (run.t, each) for label, each in values.items()})
            plots.append(Plot(Axis("t", "s"), Axis(name, unit), series, name))
    return tuple(plots)


def _lines(curves: Mapping[str, tuple[FloatArray, FloatArray]]) -> tuple[Series, ...]:
    def thinned(values: FloatArray) -> FloatArray:
        return values[np.unique(np.linspace(0, len(values) - 1, _POINTS).astype(int))]

    return tuple(
        Series(name, thinned(x), thinned(y), Style(_COLOURS[i % len(_COLOURS)]))
        for i, (name, (x, y)) in enumerate(curves.items())
    )


def certificate_report(certificate: Certificate) -> doc.Document:
    """Figures of events; folded away, those at chosen times and the computations."""
    number = sum(computation.independent for computation in certificate.computations)
    figures = f"{len(certificate.figures)} figures from {number} independent computations"
    events = [figure for figure in certificate.figures if figure.time is None]
    timed = [figure for figure in certificate.figures if figure.time is not None]
    further = f"{len(timed)} further figures, at chosen times"
    absent = (doc.Text(text, "warning", lead="left out:") for text in certificate.absent)
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
        doc.Fold(further, (doc.page_only(certified_figures(timed, further)),)),
        doc.Listing(tuple(absent)),
        doc.Fold("The computations", (computations,)),
        doc.Note(f"Uncertainty: {rule} Versions: {versions}."),
        doc.Note(f"Mechanism {certificate.mechanism_hash}."),
    )
    title, window = f"{certificate.model}: {figures}", f"trebucheck certify: {certificate.model}"
    return doc.Document(title, blocks, window, certificate.command)


def run_report(trajectory: Trajectory, distance: Farthest | str | None = None) -> doc.Document:
    """Quantities of one run.

    Args:
        distance: from the reference, or why that is not known; None: not asked for.
    """
    run = trajectory.provenance
    title = f"{trajectory.mechanism.name}, {run.engine} {run.preset} ({run.engine_version})"
    rows, verdict = [*_quantities(trajectory)], ""
    if distance is not None:
        rows.append(("from the reference", _far(distance)))
        verdict = f"{title}: {_far(distance)} from the reference"
    return doc.Document(title, (doc.table("|", rows, title),), verdict=verdict)


def _far(distance: Farthest | str) -> str:
    if isinstance(distance, str):
        return f"not known: {distance}"
    place = f"{distance.point} at {distance.time:.6g} s; compared to {distance.until:.6g} s"
    return f"{format_number(distance.distance)} m ({place})"


def _quantities(trajectory: Trajectory) -> Iterator[tuple[str, str]]:
    yield "simulated", f"{trajectory.t[-1]:.6g} s in {trajectory.provenance.steps} steps"
    yield "wall time", f"{trajectory.provenance.wall_time:.3f} s"
    for name, time in trajectory.release_times.items():
        if trajectory.mechanism.stop(name).closed:
            yield f"{name} opens", "not" if time is None else f"{time:.9f} s"
    for name, torque in trajectory.stop_torques.items():
        stop = trajectory.mechanism.stop(name)
        yield f"{name}, largest {stop.effort}", f"{torque.max():.6g} {stop.force_unit}"
    launch = trajectory.launch() if "projectile" in trajectory.markers else None
    if launch is not None:
        yield "launch (velocity at 45 deg)", f"{launch.time:.9f} s"
        yield "launch speed", f"{launch.speed:.8f} m/s"
    balance, _ = sampled_balance(trajectory)
    drift = np.abs(balance - balance[0]).max()
    yield "energy drift", f"{drift:.3g} J of {trajectory.total_energy[0]:.6g} J"
