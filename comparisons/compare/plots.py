"""Plots of the report, as Plotly figures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from ...models.arrays import FloatArray
from ...models.trajectory import Trajectory
from ...reference.solution import Solution
from ..report.plots import ENGINE_COLOURS, finish, run_style, skeleton

_POINTS = 500  # drawn per line: enough for the eye, and the report stays a few megabytes


@dataclass(frozen=True)
class Line:
    """A run as drawn."""

    label: str
    engine: str
    preset: str
    trajectory: Trajectory
    reference: Trajectory
    """At the run's own times."""

    @property
    def style(self) -> dict[str, Any]:
        """Colour by engine, dashes by preset."""
        return run_style(self.engine, self.preset)


def lines(solution: Solution, trajectories: dict[str, Trajectory], end: float) -> list[Line]:
    """Runs of one machine, cut at the end of the compared motion [s]."""
    drawn: list[Line] = []
    for label, trajectory in trajectories.items():
        engine, preset = trajectory.provenance.engine, trajectory.provenance.preset
        if engine == "reference" and preset == "tuned":
            continue  # it is the reference
        cut = _until(trajectory, end)
        drawn.append(Line(label, engine, preset, cut, solution.trajectory(cut.t)))
    return drawn


def _until(trajectory: Trajectory, end: float) -> Trajectory:
    keep = trajectory.t <= end

    def cut(values: Any) -> Any:
        if isinstance(values, np.ndarray):
            return values[keep]
        return {name: part[keep] for name, part in values.items()}

    markers = {
        name: replace(motion, position=motion.position[keep], velocity=motion.velocity[keep])
        for name, motion in trajectory.markers.items()
    }
    names = ("t", "q", "u", "kinetic_energy", "potential_energy", "stop_torques", "joint_reactions", "joint_gaps")
    return replace(trajectory, markers=markers, **{name: cut(getattr(trajectory, name)) for name in names})


def thinned(t: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Few enough points to draw, keeping the largest of each bin, so that no peak is lost."""
    if len(t) <= _POINTS:
        return t, values
    edges = np.linspace(0, len(t), _POINTS + 1).astype(int)
    chosen = np.array([a + int(np.argmax(np.abs(values[a:b]))) for a, b in pairwise(edges)])
    return t[chosen], values[chosen]


def _positive(values: FloatArray) -> FloatArray:
    """Zeros, which a logarithmic axis cannot show, as gaps."""
    return np.where(values > 0, values, np.nan)


def _strided(*arrays: FloatArray) -> list[FloatArray]:
    stride = max(1, len(arrays[0]) // _POINTS)
    return [np.concatenate([a[::stride], a[-1:]]) for a in arrays]


def paths(solution: Solution, runs: list[Line], end: float) -> go.Figure:
    """Projectile and counterweight in the plane; the machine at the start and at the end."""
    figure = go.Figure()
    times = np.linspace(0.0, end, _POINTS)
    reference = solution.trajectory(times)
    mechanism, kinematics = solution.problem.mechanism, solution.equations.kinematics
    for which, q in zip(("at the start", "at the end"), (reference.q[0], reference.q[-1]), strict=True):
        x, y = skeleton(mechanism, kinematics, q)
        wood = {"color": "#c9b79c", "width": 5}
        figure.add_scatter(x=x, y=y, mode="lines+markers", line=wood, showlegend=False, name=which)
    for name in ("projectile", "counterweight"):
        if name not in reference.markers:
            continue
        x, y = reference.marker(name).position.T
        figure.add_scatter(x=x, y=y, name=f"{name}, reference", line={"color": ENGINE_COLOURS["reference"], "width": 4})
        for run in runs:
            x, y = _strided(*run.trajectory.marker(name).position.T)
            shown = name == "projectile"
            figure.add_scatter(x=x, y=y, name=run.label, line=run.style, legendgroup=run.label, showlegend=shown)
    figure.update_xaxes(title="x [m]")
    figure.update_yaxes(title="y [m]", scaleanchor="x")
    return finish(figure, 620)


def over_time(
    solution: Solution,
    runs: list[Line],
    end: float,
    quantities: dict[str, Callable[[Trajectory], FloatArray]],
    unit: str,
) -> go.Figure:
    """Quantities over time above, their differences to the reference below (logarithmic)."""
    columns = len(quantities)
    figure = make_subplots(
        rows=2, cols=columns, shared_xaxes=True, subplot_titles=list(quantities), vertical_spacing=0.08
    )
    reference = solution.trajectory(np.linspace(0.0, end, _POINTS))
    for column, quantity in enumerate(quantities.values(), start=1):
        grey = {"color": ENGINE_COLOURS["reference"], "width": 4}
        figure.add_scatter(
            x=reference.t, y=quantity(reference), name="reference", line=grey, showlegend=column == 1, row=1, col=column
        )
        for run in runs:
            _draw(figure, run, quantity, column)
    figure.update_yaxes(title=f"[{unit}]", row=1, col=1)
    figure.update_yaxes(title=f"difference [{unit}]", row=2, col=1)
    figure.update_yaxes(type="log", exponentformat="power", row=2)
    figure.update_xaxes(title="t [s]", row=2)
    return finish(figure, 620)


def _draw(figure: go.Figure, run: Line, quantity: Callable[[Trajectory], FloatArray], column: int) -> None:
    try:
        mine, theirs = quantity(run.trajectory), quantity(run.reference)
    except ValueError:
        return  # the engine cannot observe it
    t, values = _strided(run.trajectory.t, mine)
    common = {"line": run.style, "legendgroup": run.label, "name": run.label, "col": column}
    figure.add_scatter(x=t, y=values, row=1, showlegend=column == 1, **common)
    t, values = thinned(run.trajectory.t, np.abs(mine - theirs))
    figure.add_scatter(x=t, y=_positive(values), row=2, showlegend=False, **common)


def distances(runs: list[Line]) -> go.Figure:
    """Distance of the projectile and of the counterweight from the reference, logarithmic."""
    figure = make_subplots(rows=1, cols=2, subplot_titles=("projectile", "counterweight"))
    for column, name in enumerate(("projectile", "counterweight"), start=1):
        for run in runs:
            if name not in run.trajectory.markers:
                continue
            apart = run.trajectory.marker(name).position - run.reference.marker(name).position
            t, values = thinned(run.trajectory.t, np.linalg.norm(apart, axis=1))
            figure.add_scatter(
                x=t,
                y=_positive(values),
                name=run.label,
                line=run.style,
                legendgroup=run.label,
                showlegend=column == 1,
                row=1,
                col=column,
            )
    figure.update_yaxes(type="log", exponentformat="power", title="distance [m]")
    figure.update_xaxes(title="t [s]")
    return finish(figure, 460)


def energy_drift(solution: Solution, runs: list[Line]) -> go.Figure:
    """Energy drift relative to the total energy at the start, logarithmic."""
    start = float(solution.trajectory(np.zeros(1)).total_energy[0])
    scale = abs(start) or 1.0
    figure = go.Figure()
    for run in runs:
        t, values = thinned(run.trajectory.t, np.abs(run.trajectory.total_energy - start) / scale)
        figure.add_scatter(x=t, y=_positive(values), name=run.label, line=run.style)
    unit = "|E - E(0)| / |E(0)|" if start else "|E - E(0)| [J]"
    figure.update_yaxes(type="log", exponentformat="power", title=unit)
    figure.update_xaxes(title="t [s]")
    return finish(figure, 420)
