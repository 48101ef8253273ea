"""Plots of a comparison."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from ...models.arrays import FloatArray
from ...models.trajectory import Trajectory
from ...reference.solution import Solution
from ..report.document import Figure
from ..report.plots import LOGARITHMIC, REFERENCE_LINE, finish, run_style, skeleton
from ..runs.balance import sampled_balance

if TYPE_CHECKING:
    from ..runs.results import Machine
    from .study import Comparison

_POINTS = 500  # drawn per line: enough for the eye, and the report stays a few megabytes

Quantity = Callable[[Trajectory], FloatArray]
"""A quantity over time; ValueError where the engine cannot observe it."""


@dataclass(frozen=True)
class Line:
    """A run as drawn: up to the end of the compared motion."""

    trajectory: Trajectory
    reference: Trajectory
    """At the run's own times up to that end."""

    @property
    def label(self) -> str:
        """Engine and preset."""
        return f"{self.trajectory.provenance.engine} {self.trajectory.provenance.preset}"

    @property
    def style(self) -> dict[str, Any]:
        """Colour by engine, dashes by preset; one entry of the legend for all its lines."""
        line = run_style(self.trajectory.provenance.engine, self.trajectory.provenance.preset)
        return {"name": self.label, "legendgroup": self.label, "line": line}

    def values(self, quantity: Quantity) -> tuple[FloatArray, FloatArray]:
        """Times [s] and values, few enough of them to draw."""
        t = self.reference.t
        stride = max(1, len(t) // _POINTS)
        chosen = [*range(0, len(t), stride), len(t) - 1]
        return t[chosen], quantity(self.trajectory)[chosen]

    def difference(self, quantity: Quantity) -> tuple[FloatArray, FloatArray]:
        """Times [s] and absolute differences to the reference, distances for points; few enough of them to draw."""
        t = self.reference.t
        difference = quantity(self.trajectory)[: len(t)] - quantity(self.reference)
        return _thinned(t, np.abs(difference) if difference.ndim == 1 else np.linalg.norm(difference, axis=1))


def lines(solution: Solution, trajectories: Mapping[str, Trajectory], end: float) -> list[Line]:
    """Runs of one machine up to `end` [s]; the tuned reference is what they are compared with."""
    return [
        Line(trajectory, solution.trajectory(trajectory.t[trajectory.t <= end]))
        for trajectory in trajectories.values()
        if (trajectory.provenance.engine, trajectory.provenance.preset) != ("reference", "tuned")
    ]


def _thinned(t: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Few enough points to draw on a logarithmic axis, which cannot show zeros; the largest of each bin is kept."""
    if len(t) > _POINTS:
        edges = np.linspace(0, len(t), _POINTS + 1).astype(int)
        chosen = np.array([a + int(np.argmax(np.abs(values[a:b]))) for a, b in pairwise(edges)])
        t, values = t[chosen], values[chosen]
    return t, np.where(values > 0, values, np.nan)


def figures(comparison: Comparison, machine: Machine) -> Iterator[Figure]:
    """All plots of one machine, each drawn when a page needs it."""

    @cache
    def runs() -> list[Line]:
        own = {label: t for (model, label), t in comparison.trajectories.items() if model == machine.model}
        return lines(comparison.solutions[machine.model], own, machine.compared_to)

    def drawn(draw: Callable[..., go.Figure], *rest: object) -> Callable[[], go.Figure]:
        return lambda: draw(comparison.solutions[machine.model], runs(), *rest)

    text = "The paths of the markers, and the machine at the start and at the end."
    yield Figure(drawn(_paths, machine.compared_to), "Motion", text)
    text = "At each engine's own times; no sample is interpolated."
    ends = {marker.name: position(marker.name) for marker in machine.mechanism.markers}
    if ends:
        yield Figure(drawn(_over_time, ends, "m"), "Distance from the reference", text)
    for title, text, unit, quantities in _quantities(machine):
        if quantities:
            plot = drawn(_over_time, quantities, unit, machine.compared_to)
            yield Figure(plot, title, f"{text} Below, the differences to the reference.")
    text = "Less the work of dampers, constant forces and torques; of the total energy at the start. Any drift but at "
    text += "impacts is numerical."
    yield Figure(drawn(_energy_drift), "Energy drift", text)


def _quantities(machine: Machine) -> Iterator[tuple[str, str, str, dict[str, Quantity]]]:
    """Title, sentence, unit and quantities of the plots over time."""
    mechanism = machine.mechanism
    angles = {name: _coordinate(i) for i, name in enumerate(mechanism.angles)}
    yield "Angles", "Absolute, positive clockwise.", "rad", angles
    closed = {unit: [s for s in mechanism.stops if s.closed and s.force_unit == unit] for unit in ("N m", "N")}
    text = "At least 0 while the contact of the stop is active, 0 once it is released."
    yield "Stop torques", text, "N m", {stop.name: _stop_torque(stop.name) for stop in closed["N m"]}
    yield "Stop forces", text, "N", {stop.name: _stop_torque(stop.name) for stop in closed["N"]}
    forces = {joint.name: _joint_force(joint.name) for joint in mechanism.joints if joint.held_directions}
    yield "Joint forces", "Magnitude of the force on each joint's child.", "N", forces


def _coordinate(index: int) -> Quantity:
    return lambda trajectory: trajectory.q[:, index]


def _stop_torque(name: str) -> Quantity:
    return lambda trajectory: trajectory.stop_torque(name)


def _joint_force(name: str) -> Quantity:
    return lambda trajectory: np.linalg.norm(trajectory.joint_reaction(name), axis=1)


def position(name: str) -> Quantity:
    """Of a marker [m]."""
    return lambda trajectory: trajectory.marker(name).position


def _paths(solution: Solution, runs: Sequence[Line], end: float) -> go.Figure:
    """The markers in the plane; the machine at the start and at the end."""
    figure = go.Figure()
    reference = solution.trajectory(np.linspace(0.0, end, _POINTS))
    for which, q in zip(("at the start", "at the end"), (reference.q[0], reference.q[-1]), strict=True):
        x, y = skeleton(solution.problem.mechanism, solution.equations.kinematics, q)
        wood = {"color": "#c9b79c", "width": 5}
        figure.add_scatter(x=x, y=y, mode="lines+markers", line=wood, showlegend=False, name=which)
    for i, name in enumerate(reference.markers):
        x, y = reference.marker(name).position.T
        figure.add_scatter(x=x, y=y, name=f"{name}, reference", line=REFERENCE_LINE)
        for run in runs:
            x, y = run.values(position(name))[1].T
            figure.add_scatter(x=x, y=y, showlegend=i == 0, **run.style)
    figure.update_xaxes(title="x [m]")
    figure.update_yaxes(title="y [m]", scaleanchor="x")
    return finish(figure, 620)


def _over_time(
    solution: Solution, runs: Sequence[Line], quantities: Mapping[str, Quantity], unit: str, end: float | None = None
) -> go.Figure:
    """Quantities over time up to `end` [s], and below their differences to the reference; without it only these.

    A run whose engine cannot observe a quantity has no line.
    """
    drawn = [Line.difference] if end is None else [Line.values, Line.difference]
    titles = list(quantities)
    figure = make_subplots(len(drawn), len(titles), shared_xaxes=True, subplot_titles=titles, vertical_spacing=0.08)
    reference = solution.trajectory(np.linspace(0.0, end or 0.0, _POINTS))
    for row, values_of in enumerate(drawn, start=1):
        for column, quantity in enumerate(quantities.values(), start=1):
            first = {"showlegend": row == column == 1, "row": row, "col": column}
            if values_of == Line.values:
                figure.add_scatter(x=reference.t, y=quantity(reference), name="reference", line=REFERENCE_LINE, **first)
            for run in runs:
                with suppress(ValueError):
                    t, values = values_of(run, quantity)
                    figure.add_scatter(x=t, y=values, **run.style, **first)
    figure.update_yaxes(row=len(drawn), **LOGARITHMIC)
    figure.update_xaxes(title="t [s]", row=len(drawn))
    if end is None:
        figure.update_yaxes(title=f"distance [{unit}]")
        return finish(figure, 460)
    figure.update_yaxes(title=f"[{unit}]", row=1, col=1)
    figure.update_yaxes(title=f"difference [{unit}]", row=2, col=1)
    return finish(figure, 620)


def _energy_drift(solution: Solution, runs: Sequence[Line]) -> go.Figure:
    """Energy drift relative to the total energy at the start, logarithmic."""
    start = float(solution.trajectory(np.zeros(1)).total_energy[0])
    figure = go.Figure()
    for run in runs:
        t, (energy, _) = run.reference.t, sampled_balance(run.trajectory)
        t, values = _thinned(t, np.abs(energy[: len(t)] - start) / (abs(start) or 1.0))
        figure.add_scatter(x=t, y=values, **run.style)
    figure.update_yaxes(title="|E - E(0)| / |E(0)|" if start else "|E - E(0)| [J]", **LOGARITHMIC)
    figure.update_xaxes(title="t [s]")
    return finish(figure, 420)
