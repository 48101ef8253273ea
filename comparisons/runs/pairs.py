"""Engine against engine.

Two engines seldom sample the same times. Their motions are not interpolated for that: what is carried over to the
other's times is the deviation from the reference, which is small and smooth, so that carrying it over linearly
costs a small part of something small. The reference itself drops out of the difference.
"""

from __future__ import annotations

import numpy as np

from ...models.arrays import FloatArray
from ...models.trajectory import Trajectory
from ...reference.solution import Solution
from .results import Pair

_MARKER = "projectile"


def against_each_other(
    solution: Solution, first: tuple[str, Trajectory], second: tuple[str, Trajectory], end: float
) -> Pair:
    """Two trajectories up to `end` [s], at the times of the one that has fewer."""
    (label, one), (other_label, other) = first, second
    launches = one.launch(), other.launch()
    return Pair(
        model=solution.problem.mechanism.name,
        first=label,
        second=other_label,
        position_max=_apart(solution, one, other, end),
        release_time_max=_releases_apart(one, other),
        launch_speed=launches[0].speed - launches[1].speed if launches[0] and launches[1] else None,
    )


def _apart(solution: Solution, one: Trajectory, other: Trajectory, end: float) -> float | None:
    if _MARKER not in one.markers or _MARKER not in other.markers:
        return None
    coarse, fine = sorted((one, other), key=lambda trajectory: len(trajectory.t))
    t = coarse.t[coarse.t <= min(end, fine.t[-1])]
    mine = _deviation(solution, coarse)[: len(t)]
    theirs = _deviation(solution, fine)
    carried = np.stack([np.interp(t, fine.t, theirs[:, axis]) for axis in (0, 1)], axis=1)
    return float(np.linalg.norm(mine - carried, axis=1).max())


def _deviation(solution: Solution, trajectory: Trajectory) -> FloatArray:
    return trajectory.marker(_MARKER).position - solution.trajectory(trajectory.t).marker(_MARKER).position


def _releases_apart(one: Trajectory, other: Trajectory) -> float | None:
    differences: list[float] = []
    for name, mine in one.release_times.items():
        theirs = other.release_times.get(name)
        if (mine is None) != (theirs is None):
            return None
        if mine is not None and theirs is not None:
            differences.append(abs(mine - theirs))
    return max(differences, default=None)
