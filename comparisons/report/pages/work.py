"""Work-precision diagrams: the error of a quantity against processor time, and against steps.

The form is that of Hairer, Nørsett and Wanner, *Solving Ordinary Differential Equations I*, and of
SciML's benchmarks: both axes are logarithmic, and each point is a run with another time step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...runs.quantities import QUANTITIES
from ...runs.results import REFERENCE, OfEngine, Run, WorkPoint
from ...runs.work import work_of
from .. import document as doc
from ..document import format_step
from ..plots import Axis, Panels, Plot, Series, run_style

_HEIGHT = 400  # [px]
_COST = Axis("processor time without reading", "s", logarithmic=True)
_STEPS = Axis("steps", "1", logarithmic=True)


@dataclass(frozen=True)
class WorkLine(OfEngine):
    """Runs of an engine and preset at several time steps."""

    engine: str
    preset: str
    version: str
    runs: tuple[WorkPoint, ...]


def lines_of(runs: Iterable[Run]) -> list[WorkLine]:
    """Cost and errors of runs at the time steps that are known; not of the reference's own."""
    return [
        WorkLine(run.engine, run.preset, run.engine_version, points)
        for run in runs
        if (points := work_of(run)) and run.engine != REFERENCE
    ]


def _hint(run: WorkPoint) -> str:
    """Step, number of steps and costs, in lines."""
    lines = [f"step {format_step(run.timestep)} s, {run.steps} steps"]
    if run.cost is not None:
        lines.append(f"{_seconds(run.cost)} of processor time")
        read = "reading is in it, not told apart"
        if run.reading_time is not None:
            read = f"and {_seconds(run.reading_time)} of reading"
        lines.append(read)
    return "\n".join(lines)


def _seconds(time: float) -> str:
    return f"{1e3 * time:.3g} ms" if time < 1.0 else f"{time:.3g} s"


def has_errors(lines: Iterable[WorkLine]) -> bool:
    """Tell whether there is anything to draw: what stands still has no error in any run."""
    return any(any(run.errors.values()) for line in lines for run in line.runs)


def panels(
    lines: Sequence[WorkLine], units: Mapping[str, str], only: str = "", title: str = ""
) -> Panels:
    """Both diagrams of each quantity that some run has an error in.

    Args:
        lines: of one machine or problem.
        units: of the quantities, by metric.
        only: metric of the one quantity to be drawn; '' for all.
        title: of each plot.
    """
    plots: list[Plot] = []
    for metric, kind in QUANTITIES.items():
        errors = [run.errors.get(metric) for line in lines for run in line.runs]
        if metric != (only or metric) or not any(errors):
            continue
        axis = Axis(f"largest error, {kind.words}", units.get(metric, ""), logarithmic=True)
        for cost in (True, False):
            x = _COST if cost else _STEPS
            series = tuple(_series(lines, metric, cost=cost))
            plots.append(Plot(x, axis, series, title, height=_HEIGHT, choice=kind.words))
    return tuple(plots)


def _series(lines: Sequence[WorkLine], metric: str, *, cost: bool) -> Iterator[Series]:
    for line in lines:
        runs = sorted(line.runs, key=lambda run: run.steps)
        runs = [run for run in runs if run.errors.get(metric) and (run.costs or not cost)]
        if not runs:
            continue
        y = np.array([run.errors[metric] for run in runs], dtype=np.float64)
        x = np.array([run.steps for run in runs], dtype=np.float64)
        spread = None
        if cost:
            x = np.array([run.cost for run in runs], dtype=np.float64)
            quickest = np.array([min(run.costs) for run in runs], dtype=np.float64)
            slowest = np.array([max(run.costs) for run in runs], dtype=np.float64)
            spread = quickest, slowest
        style = run_style(line.engine, line.preset)
        hints = tuple(map(_hint, runs))
        yield Series(line.label, x, y, style, "both", hints, spread)


def caption(lines: Sequence[WorkLine], made: str) -> str:
    """Explanation of the diagrams, and where they were measured.

    Args:
        lines: of the diagrams.
        made: versions and hardware (:attr:`.results.ResultFile.machine_text`).
    """
    text = (
        "Further left is cheaper, further down more accurate. A point is a run at one time step, "
        "by the processor's time of build and steps; bars go from the quickest to the slowest "
        "repeat. The adapter's reading of positions, forces and energies is taken out, sensors "
        "that an engine computes in its steps are not."
    )
    whole = [
        line for line in lines if any(run.reading_time is None and run.costs for run in line.runs)
    ]
    if whole:
        names = ", ".join(line.label for line in whole)
        text += f" Not told apart, and so included: that of {names}."
    versions = ", ".join(dict.fromkeys(f"{line.engine} {line.version}" for line in lines))
    return f"{text} Measured with {made}; {versions}."


def figure(panels: Callable[[], Panels], caption: str, anchor: str) -> doc.Figure:
    """Diagrams on a page, those of one quantity at a time."""
    title = "Work and precision"
    return doc.Figure(panels, title, caption, anchor, columns=2, chosen="quantity")
