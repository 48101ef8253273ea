"""The time of first parting: when an engine's motion leaves the reference, beyond what can be predicted.

An error of the relative size eps that is made all along the motion has grown to eps times the
stretching (:mod:`.stretching`) by a time t. A motion that first differs by `PARTED` of a scale at t
so shows the base error eps = PARTED / stretching(t). Up to the predictability horizon, where the
stretching reaches its limit, any engine that holds the default tolerance has a base error below
PARTED / LIMIT, a hundred-thousandth; so it parts later.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...models.arrays import BoolArray, FloatArray
from ...models.trajectory import Trajectory
from .results import Metric
from .scales import Scales
from .stretching import LIMIT, PARTED, Stretching


def parting(
    trajectory: Trajectory,
    reference: Trajectory,
    angles: BoolArray,
    scales: Scales,
    stretching: Stretching,
) -> Iterator[Metric]:
    """Time of first parting and the base error that it shows; of motions whose end lies beyond their horizon only.

    Args:
        reference: at the trajectory's times.
        angles: which coordinates are angles, shape (n_q,).
        scales: of the compared motion.
        stretching: of the reference motion to its end.
    """
    end = float(stretching.t[-1])
    if stretching.horizon >= end:
        return
    within = trajectory.t <= end
    apart = np.flatnonzero(~(_distance(trajectory, reference, angles, scales)[within] <= PARTED))
    time = float(trajectory.t[apart[0]]) if len(apart) else None
    by = (
        f"by {PARTED:g} of a scale"
        if time is not None
        else f"it does not part by the end, {end:.6g} s"
    )
    yield Metric(
        name="base_error", value=_base_error(stretching, end if time is None else time), unit="1"
    )
    yield Metric(name="first_parting", value=time, unit="s", note=by)


def _distance(
    trajectory: Trajectory, reference: Trajectory, angles: BoolArray, scales: Scales
) -> FloatArray:
    """Largest of coordinates and markers at each time, in parts of angle and length: none of them jumps."""
    distance = (
        np.abs(trajectory.q - reference.q) / np.where(angles, scales.angle, scales.length)
    ).max(axis=1)
    for name, motion in trajectory.markers.items():
        apart = np.linalg.norm(motion.position - reference.marker(name).position, axis=1)
        distance = np.maximum(distance, apart / scales.length)
    return distance


def _base_error(stretching: Stretching, time: float) -> float:
    """At most, of a motion that has not parted before a time [s]: by the stretching of the next sample."""
    index = min(int(np.searchsorted(stretching.t, time)), len(stretching.t) - 1)
    least = LIMIT if time > stretching.horizon else 1.0
    return PARTED / max(float(stretching.largest[index]), least)
