"""Two runs of one machine against each other.

Two engines seldom sample the same times: between them, the error against the reference, which is
small and smooth, is interpolated linearly to the other engine's times, so that only a small part of
it is lost. The reference itself cancels in the difference.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...models.arrays import FloatArray
from ...models.launch import Launch
from ...models.trajectory import Trajectory
from .metrics import SAME_END, THROWN
from .results import Pair


@dataclass(frozen=True)
class Compared:
    """What one run contributes to its pairs."""

    t: FloatArray
    """[s], shape (n,)."""
    errors: Mapping[str, FloatArray]
    """Position of each marker minus the reference's [m], shape (n, 2)."""
    release_times: dict[str, float | None]
    launch: Launch | None

    @classmethod
    def of(cls, trajectory: Trajectory, reference: Trajectory, thrown: str = THROWN) -> Compared:
        """Of a trajectory and the reference at its times."""
        errors = {
            name: m.position - reference.marker(name).position
            for name, m in trajectory.markers.items()
        }
        launch = trajectory.launch(marker=thrown) if thrown in errors else None
        return cls(trajectory.t, errors, dict(trajectory.release_times), launch)


def pair_of(
    model: str, labels: tuple[str, str], first: Compared, second: Compared, end: float
) -> Pair:
    """Two runs of one machine up to `end` [s], at the times of the one that has fewer."""
    speeds = [run.launch.speed for run in (first, second) if run.launch]
    common = [name for name in first.errors if name in second.errors]
    distances = [_position_difference(first, second, name, end) for name in common]
    return Pair(
        model=model,
        first=labels[0],
        second=labels[1],
        position_max=max(distances, default=None),
        release_time_max=_release_difference(first, second, end),
        launch_speed=speeds[0] - speeds[1] if len(speeds) == 2 else None,
    )


def _position_difference(first: Compared, second: Compared, marker: str, end: float) -> float:
    coarse, fine = sorted((first, second), key=lambda run: len(run.t))
    t = coarse.t[coarse.t <= min(end, fine.t[-1])]
    interpolated = np.stack(
        [np.interp(t, fine.t, fine.errors[marker][:, axis]) for axis in (0, 1)], axis=1
    )
    return float(np.linalg.norm(coarse.errors[marker][: len(t)] - interpolated, axis=1).max())


def _release_difference(first: Compared, second: Compared, end: float) -> float | None:
    differences: list[float] = []
    for name, first_time in first.release_times.items():
        second_time = second.release_times.get(name)
        if all(time is None or time > end * (1 + SAME_END) for time in (first_time, second_time)):
            continue
        if (first_time is None) != (second_time is None):
            return None
        if first_time is not None and second_time is not None:
            differences.append(abs(first_time - second_time))
    return max(differences, default=None)
