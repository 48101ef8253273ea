"""The page of the studies: one HTML file that needs nothing else."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files

import numpy as np
from jinja2 import Environment, StrictUndefined
from plotly.offline import get_plotlyjs

from ..report.numbers import format_number as figure
from ..report.plots import embedded
from . import plots as figures
from . import text as shown
from .results import MachineStudies, Point, QuantityName, Studies, Study

_QUANTITIES: tuple[QuantityName, ...] = ("position", "torque")


@dataclass(frozen=True)
class Section:
    """A study of another knob, with its plot."""

    study: Study
    plot: str


@dataclass(frozen=True)
class Chapter:
    """All there is about one machine."""

    machine: MachineStudies
    steps: list[Study]
    convergence: str
    work: str
    sections: list[Section]


def page(studies: Studies) -> str:
    """The whole page as HTML text, scripts and all."""
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    text = files("trebucheck.comparisons").joinpath("templates/converge.html.j2").read_text(encoding="utf-8")
    return environment.from_string(text).render(
        studies=studies,
        chapters=[_chapter(machine) for machine in studies.machines],
        quantities=_QUANTITIES,
        failures=shown.failures(studies),
        plotly=get_plotlyjs(),
        figure=figure,
        shown=shown,
        wall=wall,
    )


def wall(point: Point) -> str:
    """Median wall time, and from the quickest to the slowest where there are more [s]."""
    times = point.wall_times
    if not times:
        return "–"
    text = f"{np.median(times):.3f}"
    return text if len(times) == 1 else f"{text} ({min(times):.3f} to {max(times):.3f})"


def _chapter(machine: MachineStudies) -> Chapter:
    steps = shown.of_the_step(machine)
    return Chapter(
        machine=machine,
        steps=steps,
        convergence=embedded(figures.convergence(steps)) if steps else "",
        work=embedded(figures.work_precision(steps)) if steps else "",
        sections=[Section(study, embedded(figures.knob(study))) for study in shown.of_others(machine)],
    )
