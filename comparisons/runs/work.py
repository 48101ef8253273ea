"""Cost and errors of runs, for diagrams of work and precision."""

from __future__ import annotations

import math
from collections.abc import Iterable

from .quantities import QUANTITIES
from .results import COMPARED, Metric, Run, WorkPoint


def largest_errors(metrics: Iterable[Metric]) -> dict[str, float]:
    """Largest error of each quantity by its metric, where every figure of it has a value."""
    sizes: dict[str, float] = {}
    for metric in metrics:
        if metric.observed and QUANTITIES[metric.name].is_error:
            size = math.inf if metric.value is None else abs(metric.value)
            sizes[metric.name] = max(size, sizes.get(metric.name, 0.0))
    return {name: size for name, size in sizes.items() if math.isfinite(size)}


def work_of(run: Run) -> tuple[WorkPoint, ...]:
    """Cost and errors of a run at the time steps that are known: its sweep, else its own."""
    step = run.settings.get("timestep")
    if run.sweep or run.outcome not in COMPARED or not isinstance(step, float):
        return run.sweep
    point = WorkPoint(
        timestep=step,
        steps=run.steps,
        costs=() if run.cost is None else (run.cost,),
        reading_time=run.reading_time,
        errors=largest_errors(run.metrics),
    )
    return (point,)
