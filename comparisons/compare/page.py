"""The report: one HTML file that needs nothing else."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from importlib.resources import files

import numpy as np
import plotly.graph_objects as go
from jinja2 import Environment, StrictUndefined
from plotly.offline import get_plotlyjs

from ...models.arrays import FloatArray
from ...models.machines.trebuchet import parameters_of
from ...models.trajectory import Trajectory
from ...reference.certification.certificate import Figure as CertifiedFigure
from ...reference.certification.certificate import load_certificate
from ..report.plots import embedded
from ..runs.results import Machine, Pair, Run
from . import plots as figures
from .study import Comparison
from .summary import COLUMNS, GATE_KINDS, complaints, cost, diagnosis, figure, gate_cell, headline, step
from .terminal import verdict

_CERTIFIED = ("release_time", "launch_time", "launch_speed", "launch_angle", "range", "stop_torque", "total_energy")


@dataclass(frozen=True)
class Section:
    """A titled plot with the sentence that says how to read it."""

    title: str
    text: str
    plot: str


@dataclass(frozen=True)
class Chapter:
    """All there is about one machine."""

    machine: Machine
    runs: list[Run]
    pairs: list[Pair]
    sections: list[Section]

    @property
    def certified(self) -> list[CertifiedFigure]:
        """The figures of a throw from the machine's certificate; empty where there is none."""
        certificate = load_certificate(self.machine.mechanism)
        return [f for f in certificate.figures if f.name in _CERTIFIED and f.time is None] if certificate else []

    @property
    def formulations(self) -> str:
        """What its certificate was computed from; the paper's equations are those of its own two machines."""
        if parameters_of(self.machine.mechanism) is None:
            return "minimal and redundant coordinates"
        return "minimal and redundant coordinates and the paper's own equations"

    @property
    def labels(self) -> list[str]:
        """Runs that moved, in the order of the table."""
        paired = {label for pair in self.pairs for label in (pair.first, pair.second)}
        return [run.label for run in self.runs if run.label in paired]

    def apart(self, first: str, second: str) -> str:
        """Distance of the two projectiles as shown; empty below the diagonal."""
        found = next((pair for pair in self.pairs if (pair.first, pair.second) == (first, second)), None)
        return "" if found is None else figure(found.position_max)


def report_html(comparison: Comparison) -> str:
    """The whole report as HTML text, scripts and all."""
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    text = files("trebucheck.comparisons").joinpath("templates/report.html.j2").read_text(encoding="utf-8")
    return environment.from_string(text).render(
        results=comparison.results,
        verdict=verdict(comparison.results),
        chapters=[_chapter(comparison, machine) for machine in comparison.results.machines],
        columns=COLUMNS,
        plotly=get_plotlyjs(),
        figure=figure,
        complaints=complaints,
        diagnosis=diagnosis,
        gate_kinds=GATE_KINDS,
        gate_cell=gate_cell,
        cost=cost,
        headline=headline,
        step=step,
    )


def _chapter(comparison: Comparison, machine: Machine) -> Chapter:
    own = {label: t for (name, label), t in comparison.trajectories.items() if name == machine.model}
    return Chapter(
        machine=machine,
        runs=[run for run in comparison.results.runs if run.model == machine.model],
        pairs=[pair for pair in comparison.results.pairs if pair.model == machine.model],
        sections=_sections(comparison, machine, own),
    )


def _sections(comparison: Comparison, machine: Machine, own: dict[str, Trajectory]) -> list[Section]:
    solution, end = comparison.solutions[machine.model], machine.compared_to
    runs = figures.lines(solution, own, end)
    over_time = partial(figures.over_time, solution, runs, end)
    angles = {body.angle: partial(_coordinate, i) for i, body in enumerate(machine.mechanism.bodies)}
    closed = [stop for stop in machine.mechanism.stops if stop.closed]
    torques = {s.name: partial(_torque, s.name) for s in closed if s.force_unit == "N m"}
    pushes = {s.name: partial(_torque, s.name) for s in closed if s.force_unit == "N"}
    plots: list[tuple[str, str, go.Figure]] = [
        ("Motion", "The paths of projectile and counterweight, and the machine at the start and at the end.",
         figures.paths(solution, runs, end)),
        ("Distance from the reference", "At each engine's own times; no sample is interpolated.",
         figures.distances(runs)),
        ("Angles", "Absolute, positive clockwise; below, the differences to the reference.",
         over_time(angles, "rad")),
        ("Energy drift", "Of the total energy at the start. Nothing dissipates: any drift is numerical.",
         figures.energy_drift(solution, runs)),
    ]  # fmt: skip
    if machine.mechanism.joints:
        text = "Magnitude of the force on each joint's child; below, the differences to the reference."
        forces = {joint.name: partial(_force, joint.name) for joint in machine.mechanism.joints}
        plots.insert(3, ("Joint forces", text, over_time(forces, "N")))
    if torques:
        text = "At least 0 while the rest pushes, 0 once it has let go; below, the differences to the reference."
        plots.insert(3, ("Stop torques", text, over_time(torques, "N m")))
    if pushes:
        text = "At least 0 while it carries the point, 0 once it has let go; below, the differences to the reference."
        plots.insert(3, ("Stop forces", text, over_time(pushes, "N")))
    return [Section(title, text, embedded(plot)) for title, text, plot in plots]


def _coordinate(index: int, trajectory: Trajectory) -> FloatArray:
    return trajectory.q[:, index]


def _torque(name: str, trajectory: Trajectory) -> FloatArray:
    return trajectory.stop_torque(name)


def _force(name: str, trajectory: Trajectory) -> FloatArray:
    return np.linalg.norm(trajectory.joint_reaction(name), axis=1)
