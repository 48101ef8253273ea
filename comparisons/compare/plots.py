"""Plots of a comparison."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, partial
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ...models.arrays import FloatArray
from ...models.drawing.scene import Scene
from ...models.trajectory import Trajectory
from ...reference.solution import Solution
from ..report.document import Animation, Figure, Grid
from ..report.motion import motion_scene
from ..report.plots import REFERENCE, Axis, Panels, Plot, Rule, Series, Style, run_style
from ..runs.balance import sampled_balance
from ..runs.metrics import LEAST_START

if TYPE_CHECKING:
    from ..runs.results import Machine, Run
    from .study import Comparison

_POINTS = 300  # drawn per line: more than a plot has columns of pixels for, and the page stays below two megabytes
_COLUMNS = 4
_SEEN = 5e-3
"""Share of a plot's range: a run nearer to the reference than that is covered by its line."""

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
    def style(self) -> Style:
        """Colour by engine, dashes by preset."""
        return run_style(self.trajectory.provenance.engine, self.trajectory.provenance.preset)

    def values(self, quantity: Quantity) -> Series | None:
        """The quantity, few enough points to draw; None if it would be covered by the reference's line."""
        t = self.reference.t
        own, known = quantity(self.trajectory)[: len(t)], quantity(self.reference)
        if np.abs(own - known).max() <= _SEEN * np.ptp(known):
            return None
        chosen = np.unique(np.linspace(0, len(t) - 1, _POINTS).astype(int))
        return Series(self.label, t[chosen], own[chosen], self.style)

    def difference(self, quantity: Quantity) -> Series:
        """Absolute differences to the reference, distances for points, as `thinned`."""
        known = quantity(self.reference)
        difference = quantity(self.trajectory)[: len(known)] - known
        size = np.abs(difference) if difference.ndim == 1 else np.linalg.norm(difference, axis=1)
        return Series(self.label, *thinned(self.reference.t, size), self.style)


def lines(solution: Solution, trajectories: Mapping[str, Trajectory], end: float) -> list[Line]:
    """Runs of one machine up to `end` [s]; the tuned reference is what they are compared with."""
    return [
        Line(trajectory, solution.trajectory(trajectory.t[trajectory.t <= end]))
        for trajectory in trajectories.values()
        if (trajectory.provenance.engine, trajectory.provenance.preset) != ("reference", "tuned")
    ]


def thinned(t: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Few enough points to draw: at the end of each of `_POINTS` intervals the largest value within it."""
    if len(t) <= _POINTS:
        return t, values
    edges = np.linspace(0, len(t), _POINTS + 1).astype(int)
    return t[edges[1:] - 1], np.array([values[a:b].max() for a, b in pairwise(edges)])


def motion(comparison: Comparison) -> Animation:
    """Every machine in motion, all its runs over the reference."""

    def scenes() -> tuple[Scene, ...]:
        return tuple(_scene(comparison, machine) for machine in comparison.results.machines)

    return Animation(scenes)


def _scene(comparison: Comparison, machine: Machine) -> Scene:
    runs = {
        label: run
        for (model, label), run in comparison.trajectories.items()
        if model == machine.model
    }
    states, name = comparison.solutions[machine.model].trajectory, machine.model
    end, thrown, launch = machine.compared_to, machine.thrown, machine.launch_time
    return motion_scene(states, runs, end=end, thrown=thrown, launch=launch, name=name)


def figures(comparison: Comparison, machine: Machine) -> Grid:
    """All plots of one machine over time, each drawn when a page needs it; they zoom together."""

    @cache
    def runs() -> list[Line]:
        own = {
            label: t
            for (model, label), t in comparison.trajectories.items()
            if model == machine.model
        }
        return lines(comparison.solutions[machine.model], own, machine.compared_to)

    def figure(
        name: str, caption: str, columns: int, draw: Callable[[Solution, Sequence[Line]], Panels]
    ) -> Figure:
        drawn = partial(_drawn, draw, lambda: (comparison.solutions[machine.model], runs()))
        own = anchor(machine.model, name)
        return Figure(drawn, name.capitalize(), caption, own, machine.model, min(columns, _COLUMNS))

    return Grid(tuple(figure(*each) for each in _figures(machine)))


def _drawn(
    draw: Callable[..., Panels], given: Callable[[], tuple[Solution, Sequence[Line]]]
) -> Panels:
    return draw(*given())


def anchor(model: str, name: str) -> str:
    """Anchor of a machine's figure or section of that name."""
    return f"{model}-{name}".lower().replace(" ", "-")


def anchors(machine: Machine) -> set[str]:
    """Anchors of the machine's figures."""
    return {anchor(machine.model, name) for name, *_ in _figures(machine)}


DISTANCES, TORQUES, FORCES, JOINT_FORCES = (
    "distances",
    "stop torques",
    "stop forces",
    "joint forces",
)
COORDINATES, ENERGY = "coordinates", "energy"


def _figures(
    machine: Machine,
) -> Iterator[tuple[str, str, int, Callable[[Solution, Sequence[Line]], Panels]]]:
    """Name, sentence, number of quantities, and what draws it."""
    mechanism = machine.mechanism
    marks = _events(machine)
    ends = {marker.name: position(marker.name) for marker in mechanism.markers}
    if ends:
        text = "Of each marker from the reference, at the engine's own times; no sample is interpolated. "
        text += f"Of each {_POINTS}th of the motion the largest is drawn."
        yield (
            DISTANCES,
            text,
            len(ends),
            partial(_over_time, quantities=ends, unit="m", marks=marks),
        )
    for name, text, unit, quantities in _quantities(machine):
        if quantities:
            sentence = f"{text} Upper row: the reference, and runs that part from its line. Lower row: differences."
            draw = partial(
                _over_time, quantities=quantities, unit=unit, marks=marks, end=machine.compared_to
            )
            yield name, sentence, len(quantities), draw
    text = "Total energy less the work of dampers, constant forces and torques, as a share of the energy at the start "
    text += "(where that is near zero: of the largest kinetic energy). Any drift but at impacts is numerical."
    yield ENERGY, text, 1, partial(_energy_drift, marks=marks)


def _events(machine: Machine) -> tuple[Rule, ...]:
    """Where stops open and the projectile is launched in the reference."""
    times = {f"{name} opens": time for name, time in machine.release_times.items()}
    return tuple(
        Rule(time, text)
        for text, time in times.items()
        if time is not None and time <= machine.compared_to
    )


def _quantities(machine: Machine) -> Iterator[tuple[str, str, str, dict[str, Quantity]]]:
    """Name, sentence, unit and quantities of the plots over time."""
    mechanism = machine.mechanism
    closed = {
        unit: [s for s in mechanism.stops if s.closed and s.force_unit == unit]
        for unit in ("N m", "N")
    }
    text = "At least 0 while the contact of the stop is active, 0 once it is released."
    yield TORQUES, text, "N m", {stop.name: _stop_torque(stop.name) for stop in closed["N m"]}
    yield FORCES, text, "N", {stop.name: _stop_torque(stop.name) for stop in closed["N"]}
    forces = {
        joint.name: _joint_force(joint.name) for joint in mechanism.joints if joint.held_directions
    }
    yield JOINT_FORCES, "Magnitude of the force on each joint's child.", "N", forces
    angles = {name: _coordinate(i) for i, name in enumerate(mechanism.angles)}
    yield COORDINATES, "Absolute angles, positive clockwise.", "rad", angles


def _coordinate(index: int) -> Quantity:
    return lambda trajectory: trajectory.q[:, index]


def _stop_torque(name: str) -> Quantity:
    return lambda trajectory: trajectory.stop_torque(name)


def _joint_force(name: str) -> Quantity:
    return lambda trajectory: np.linalg.norm(trajectory.joint_reaction(name), axis=1)


def position(name: str) -> Quantity:
    """Of a marker [m]."""
    return lambda trajectory: trajectory.marker(name).position


def _over_time(
    solution: Solution,
    runs: Sequence[Line],
    quantities: Mapping[str, Quantity],
    unit: str,
    marks: tuple[Rule, ...],
    end: float | None = None,
) -> Panels:
    """Quantities over time up to `end` [s], then their differences to the reference; without it only these.

    A run whose engine cannot observe a quantity has no line.
    """
    values = (
        []
        if end is None
        else [_values(solution, runs, *each, unit, marks, end) for each in quantities.items()]
    )
    axis = Axis("distance" if end is None else "difference", unit, logarithmic=True)
    marks = marks if end is None else tuple(Rule(mark.at) for mark in marks)
    return (
        *values,
        *(_differences(runs, name, quantity, axis, marks) for name, quantity in quantities.items()),
    )


_TIME = Axis("t", "s")


def _values(
    solution: Solution,
    runs: Sequence[Line],
    name: str,
    quantity: Quantity,
    unit: str,
    marks: tuple[Rule, ...],
    end: float,
) -> Plot:
    reference = solution.trajectory(np.linspace(0.0, end, _POINTS))
    series = [Series("reference", reference.t, quantity(reference), REFERENCE)]
    for run in runs:
        with suppress(ValueError):
            series += filter(None, [run.values(quantity)])
    return Plot(_TIME, Axis("", unit), tuple(series), name, rules=marks, height=230)


def _differences(
    runs: Sequence[Line], name: str, quantity: Quantity, axis: Axis, marks: tuple[Rule, ...]
) -> Plot:
    series: list[Series] = []
    for run in runs:
        with suppress(ValueError):
            series.append(run.difference(quantity))
    return Plot(_TIME, axis, tuple(series), name, rules=marks, height=250)


def _energy_drift(solution: Solution, runs: Sequence[Line], marks: tuple[Rule, ...]) -> Panels:
    """Energy drift relative to the energy at the start, or to the largest kinetic energy where that says more."""
    known = solution.trajectory(
        np.linspace(0.0, max((run.reference.t[-1] for run in runs), default=0.0), _POINTS)
    )
    start, kinetic = float(known.total_energy[0]), float(known.kinetic_energy.max())
    size, name = (
        (abs(start), "|E(0)|") if abs(start) > LEAST_START * kinetic else (kinetic, "largest T")
    )
    series: list[Series] = []
    for run in runs:
        t, (energy, _) = run.reference.t, sampled_balance(run.trajectory)
        drift = np.abs(energy[: len(t)] - start) / (size or 1.0)
        series.append(Series(run.label, *thinned(t, drift), run.style))
    axis = (
        Axis(f"|E - E(0)| / {name}", "1", logarithmic=True)
        if size
        else Axis("|E - E(0)|", "J", logarithmic=True)
    )
    return (Plot(_TIME, axis, tuple(series), height=250, rules=marks),)


def work_precision(machines: Sequence[Machine], runs: Sequence[Run]) -> Figure:
    """Error of every run against its wall time: a panel a machine."""
    panels = tuple(
        Plot(
            Axis("wall time", "s", logarithmic=True),
            Axis("largest distance of a marker", "m", logarithmic=True),
            tuple(_priced([run for run in runs if run.model == machine.model])),
            machine.model,
        )
        for machine in machines
    )
    text = "Further left is quicker, further down more accurate. Wall times are of this computer, with everything that "
    text += "the run does: build, simulation, read-out."
    return Figure(panels, "Error against wall time", text, "work-precision")


def _priced(runs: Sequence[Run]) -> Iterator[Series]:
    for run in runs:
        distances = [
            metric.value
            for metric in run.metrics
            if metric.name == "position_max" and metric.observed
        ]
        if run.wall_time and distances and None not in distances:
            largest = max(abs(value) for value in distances if value is not None)
            steps = (f"{run.steps} steps",)
            at, style = (
                (np.array([run.wall_time]), np.array([largest])),
                run_style(run.engine, run.preset),
            )
            yield Series(run.label, *at, style, "points", steps)
