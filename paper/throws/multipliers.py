"""The shape of the stops' torques over time: what the paper says of its Figs. 2 and 3, as numbers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.polynomial import Polynomial

from ...models.arrays import FloatArray
from ...models.trajectory import Trajectory

SHAPES = ("parabola", "line", "slope change", "steepening", "climb")
"""How the names of the figures found here begin."""
_FEWEST = 8  # samples below which a fit of three coefficients says nothing


class Fit(NamedTuple):
    """A polynomial fitted to samples."""

    polynomial: Polynomial
    determination: float
    """R^2: the share of the samples' variance that it accounts for."""


def fit(t: FloatArray, values: FloatArray, degree: int) -> Fit | None:
    """Least-squares polynomial through samples, shape (n,) each; None where there are too few, or they are constant."""
    variance = float(np.var(values)) if len(t) >= _FEWEST else 0.0
    if not variance > 0:
        return None
    polynomial = Polynomial.fit(t, values, degree)
    return Fit(polynomial, 1.0 - float(np.mean((values - polynomial(t)) ** 2)) / variance)


def shapes(trajectory: Trajectory) -> dict[str, float]:
    """How the torques of the stops closed at the start run, between releases.

    'parabola' and 'line' are R^2 of such fits, 'slope change' the change of a torque's slope at the other's release
    as a share of its slope before, 'steepening' how many times steeper it is after,
    'climb' the largest rise of a torque that should fall, as a share of its start.
    """
    closed = [stop.name for stop in trajectory.mechanism.stops if stop.closed and stop.name in trajectory.stop_torques]
    released = {name: time for name in closed if (time := trajectory.release_times.get(name)) is not None}
    ordered = sorted(released, key=lambda name: released[name])
    if len(ordered) < 2:
        return {}
    first, last = released[ordered[0]], released[ordered[-1]]
    found: dict[str, float] = {}
    for name in ordered:
        found |= dict(_together(trajectory, name, first))
    found |= dict(_alone(trajectory, ordered[-1], first, last))
    return found


def _samples(trajectory: Trajectory, name: str, start: float, end: float) -> tuple[FloatArray, FloatArray]:
    inside = (trajectory.t >= start) & (trajectory.t < end)
    return trajectory.t[inside], trajectory.stop_torque(name)[inside]


def _together(trajectory: Trajectory, name: str, end: float) -> Iterator[tuple[str, float]]:
    t, torque = _samples(trajectory, name, 0.0, end)
    parabola = fit(t, torque, 2)
    if parabola is not None:
        yield f"parabola ({name})", parabola.determination
        yield f"climb ({name})", float(np.max(torque - np.minimum.accumulate(torque))) / abs(float(torque[0]))


def _alone(trajectory: Trajectory, name: str, start: float, end: float) -> Iterator[tuple[str, float]]:
    before = fit(*_samples(trajectory, name, 0.0, start), 2)
    line = fit(*_samples(trajectory, name, start, end), 1)
    if before is not None and line is not None:
        slope = float(before.polynomial.deriv()(start))
        yield f"line ({name})", line.determination
        after = float(line.polynomial.deriv()(start))
        yield f"slope change ({name})", abs(after - slope) / abs(slope)
        yield f"steepening ({name})", after / slope
