"""Engine against engine.

Two engines seldom sample the same times. Their motions are not interpolated: the error against the reference, which
is small and smooth, is interpolated linearly to the other engine's times, so that only a small part of a small
quantity is lost. The reference itself cancels in the difference.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...models.arrays import FloatArray
from ...models.launch import Launch
from ...models.trajectory import Trajectory
from .results import Pair

_MARKER = "projectile"


@dataclass(frozen=True)
class Compared:
    """What one run contributes to its pairs."""

    t: FloatArray
    """[s], shape (n,)."""
    error: FloatArray | None
    """Position of the projectile minus the reference's [m], shape (n, 2); None without a projectile."""
    release_times: dict[str, float | None]
    launch: Launch | None

    @classmethod
    def of(cls, trajectory: Trajectory, reference: Trajectory) -> Compared:
        """Of a trajectory and the reference at its times."""
        thrown = _MARKER in trajectory.markers
        error = trajectory.marker(_MARKER).position - reference.marker(_MARKER).position if thrown else None
        launch = trajectory.launch() if thrown else None
        return cls(trajectory.t, error, dict(trajectory.release_times), launch)


def pair_of(model: str, labels: tuple[str, str], first: Compared, second: Compared, end: float) -> Pair:
    """Two runs of one machine up to `end` [s], at the times of the one that has fewer."""
    speeds = [run.launch.speed for run in (first, second) if run.launch]
    return Pair(
        model=model,
        first=labels[0],
        second=labels[1],
        position_max=_position_difference(first, second, end),
        release_time_max=_release_difference(first, second),
        launch_speed=speeds[0] - speeds[1] if len(speeds) == 2 else None,
    )


def _position_difference(first: Compared, second: Compared, end: float) -> float | None:
    coarse, fine = sorted((first, second), key=lambda run: len(run.t))
    if coarse.error is None or fine.error is None:
        return None
    t = coarse.t[coarse.t <= min(end, fine.t[-1])]
    interpolated = np.stack([np.interp(t, fine.t, fine.error[:, axis]) for axis in (0, 1)], axis=1)
    return float(np.linalg.norm(coarse.error[: len(t)] - interpolated, axis=1).max())


def _release_difference(first: Compared, second: Compared) -> float | None:
    differences: list[float] = []
    for name, mine in first.release_times.items():
        theirs = second.release_times.get(name)
        if (mine is None) != (theirs is None):
            return None
        if mine is not None and theirs is not None:
            differences.append(abs(mine - theirs))
    return max(differences, default=None)
