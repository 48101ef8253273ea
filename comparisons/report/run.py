"""The report of one run: its figures, its motion, and its quantities over time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ...models.arrays import FloatArray
from ...models.drawing.scene import scene
from ...models.trajectory import Trajectory
from .document import Animation, Document, Figure
from .plots import Axis, Panels, Plot, Series, Style
from .sections import run_report

_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
_POINTS = 1000  # drawn per line, at most


def document(trajectory: Trajectory) -> Document:
    """Of one run, by itself: nothing is compared."""
    shown = run_report(trajectory)
    caption = "Paths of the markers, the generalized coordinates, what the stops push with, and the energies."
    figure = Figure(_panels(trajectory), "The run", caption, "run", columns=2)
    motion = Animation(lambda: (scene(trajectory),))
    return replace(
        shown, blocks=(*shown.blocks, motion, figure), window=f"trebucheck: {shown.title}"
    )


def _panels(run: Trajectory) -> Panels:
    mechanism, time = run.mechanism, Axis("t", "s")
    paths = {
        name: (motion.position[:, 0], motion.position[:, 1]) for name, motion in run.markers.items()
    }
    coordinates = {name: run.q[:, i] for i, name in enumerate(mechanism.coordinates)}
    unit = "rad or m" if mechanism.slides else "rad"
    energies = {
        "kinetic": run.kinetic_energy,
        "potential": run.potential_energy,
        "total": run.total_energy,
    }
    over_time = [
        ("coordinates", unit, coordinates),
        ("stops", mechanism.force_unit, run.stop_torques),
        ("energy", "J", energies),
    ]
    plots = (
        [Plot(Axis("x", "m"), Axis("y", "m"), _lines(paths), "paths", equal=True)] if paths else []
    )
    for name, of, values in over_time:
        if values:
            series = _lines({label: (run.t, each) for label, each in values.items()})
            plots.append(Plot(time, Axis(name, of), series, name))
    return tuple(plots)


def _lines(curves: Mapping[str, tuple[FloatArray, FloatArray]]) -> tuple[Series, ...]:
    def thinned(values: FloatArray) -> FloatArray:
        return values[np.unique(np.linspace(0, len(values) - 1, _POINTS).astype(int))]

    return tuple(
        Series(name, thinned(x), thinned(y), Style(_COLOURS[i % len(_COLOURS)]))
        for i, (name, (x, y)) in enumerate(curves.items())
    )
