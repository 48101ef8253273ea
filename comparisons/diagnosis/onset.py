"""When a motion first violates a tolerance, in which quantity, and which contacts are active then.

An error made early grows by itself on the way to the launch: a whip does that to any error, the
reference's own included. So a position is violated where its error exceeds the tolerance of *that
time*: the tolerance, which is stated for the whole throw, times the share to which an error of the
certified motion has grown by then. That growth is measured on the reference itself, between its
integration and a coarser one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from ...models.arrays import FloatArray
from ...models.launch import LAUNCH_ANGLE
from ...models.problem import Problem
from ...reference.solution import Solution
from ...reference.solver import solve
from ..runs.comparison import THROWN, Comparison
from ..runs.impacts import impact_times
from ..runs.results import Metric

_COARSE = 1e-9  # tolerance of the coarser integration: its error is far above the finer one's
_LEAST = (
    1e-3  # of the growth to the end: an engine's steps and soft stops show from the first one on
)
_GROWTH_SAMPLES = 400


@dataclass(frozen=True)
class Onset:
    """The first quantity to violate its tolerance, when, and the contacts that are active then."""

    first_violated: str
    time: float
    """[s]"""
    active: tuple[str, ...]


def find_onset(c: Comparison, violated: Iterable[Metric]) -> Onset | None:
    """The earliest of all violated quantities; None where none of them belongs to a time."""
    times = {metric.label: _time(c, metric) for metric in violated}
    onsets = {label: t for label, t in times.items() if t is not None}
    if not onsets:
        return None
    first = min(onsets, key=lambda label: onsets[label])
    return Onset(first, onsets[first], active_contacts_at(c.solution, onsets[first]))


def active_contacts_at(solution: Solution, t: float) -> tuple[str, ...]:
    """Stops that are active in the reference at t [s]."""
    return next((s.closed for s in solution.segments if s.start <= t <= s.end), ())


def _time(c: Comparison, metric: Metric) -> float | None:
    """When a violated quantity leaves its tolerance [s]."""
    if metric.name == "release_time":
        times = (
            c.reference.release_times.get(metric.subject or ""),
            c.trajectory.release_times.get(metric.subject or ""),
        )
        return min((t for t in times if t is not None), default=None)
    if metric.name == "impact_time":
        stop = metric.subject or ""
        return min(
            (*impact_times(c.solution, stop), *impact_times(c.trajectory, stop)), default=None
        )
    if metric.name in ("launch_time", "launch_speed"):
        launch = c.solution.launch_at(LAUNCH_ANGLE, metric.subject or THROWN)
        return launch.time if launch else None
    series = next(_series(c, metric), None)
    if series is None or metric.tolerance is None:
        return None
    allowed = metric.tolerance * (growth(c.solution, c.t) if metric.name in _GROWING else 1.0)
    beyond = np.flatnonzero(~(series <= allowed) & c.smooth)
    return float(c.t[beyond[0]]) if len(beyond) else None


_GROWING = {
    "position_max",
    "velocity_max",
    "angle_max",
    "angular_speed_max",
    "slide_max",
    "slide_speed_max",
}
"""Errors that the motion carries on."""


def _series(c: Comparison, metric: Metric) -> Iterator[FloatArray]:
    """The quantity along the motion, shape (n,); nothing for one that is no maximum over time."""
    own, expected, name = c.trajectory, c.reference, metric.subject or ""
    if metric.name == "position_max":
        yield c.distance(own.marker(name).position, expected.marker(name).position)
    elif metric.name == "velocity_max":
        yield c.distance(own.marker(name).velocity, expected.marker(name).velocity)
    elif metric.name in _COORDINATES:
        i = own.mechanism.coordinates.index(name)
        of = _COORDINATES[metric.name]
        yield c.distance(getattr(own, of)[:, i], getattr(expected, of)[:, i])
    elif metric.name == "stop_torque_max":
        yield c.distance(own.stop_torque(name), expected.stop_torque(name))
    elif metric.name == "joint_reaction_max":
        yield c.distance(own.joint_reaction(name), expected.joint_reaction(name))
    elif metric.name == "energy_balance":
        yield c.distance(*c.balance)
    elif metric.name in _ENERGIES:
        of = _ENERGIES[metric.name]
        yield c.distance(getattr(own, of), getattr(expected, of))


_COORDINATES = {
    "angle_max": "q",
    "slide_max": "q",
    "angular_speed_max": "u",
    "slide_speed_max": "u",
}
_ENERGIES = {
    "kinetic_energy_max": "kinetic_energy",
    "potential_energy_max": "potential_energy",
}
"""Field of a trajectory by metric."""


def growth(solution: Solution, t: FloatArray) -> FloatArray:
    """To which share of its size at the end an error has grown by t on the certified motion, at most 1, shape (n,)."""
    problem = solution.problem
    coarse = solve(
        Problem(problem.mechanism, duration=problem.duration, stop_law=problem.stop_law),
        _COARSE,
        _COARSE,
    )
    end = float(t[-1])
    grid = np.linspace(0.0, end, _GROWTH_SAMPLES)
    fine_q, coarse_q = solution.motion(grid).q, coarse.motion(grid).q
    grown = np.maximum.accumulate(np.linalg.norm(coarse_q - fine_q, axis=1))
    return np.interp(t, grid, np.maximum(grown / (grown[-1] or 1.0), _LEAST))
