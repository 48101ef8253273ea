"""How far a run is from the reference: the largest distance of any of its points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...models.trajectory import Trajectory
from .runner import Runner
from .trials import points


@dataclass(frozen=True)
class Farthest:
    """Where and when a run is farthest from the reference."""

    point: str
    """Marker, or body of a mechanism without markers."""
    distance: float
    """[m]"""
    time: float
    """[s]"""
    until: float
    """End of the compared time [s]: that of the motion, or the predictability horizon if that is earlier."""


def farthest(trajectory: Trajectory, runner: Runner) -> Farthest:
    """The largest distance of any point from the reference, at the run's own sample times.

    Args:
        runner: of the mechanism, with the end of the motion.

    Raises:
        InputError: the reference cannot begin, or the end does not come.
        SimulationError: the reference failed.
    """
    end = runner.judged_to
    times = trajectory.t[trajectory.t <= end]
    expected = points(runner.reference(times))
    distances = {
        name: np.linalg.norm(position[: len(times)] - expected[name], axis=1)
        for name, position in points(trajectory).items()
    }
    point = max(distances, key=lambda name: float(distances[name].max()))
    at = int(distances[point].argmax())
    return Farthest(point, float(distances[point][at]), float(times[at]), end)
