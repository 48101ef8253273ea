"""A trajectory minus the reference, as functions on one grid of times, so that they can be added and subtracted.

Engines sample at times of their own. The deviation, not the motion, is interpolated to the common grid: it is small
and smooth (with kinks of higher order at releases), so that only a small part of a small quantity is lost. Positions
are interpolated by cubic splines; torques, which have kinks in their slope, linearly.
"""

from __future__ import annotations

import numpy as np
from pydantic import Field
from scipy.interpolate import make_interp_spline

from ...models.arrays import FloatArray
from ...models.spec import Real, Spec
from ...models.trajectory import Trajectory
from ...reference.solution import Solution
from .metrics import measure

GRID = 1000
"""Intervals of the common grid."""
PROJECTILE = "projectile"


class Deviation(Spec):
    """Of one trajectory, on a uniform grid from 0 to the end of the compared motion."""

    end: Real = Field(description="end of the compared motion [s]")
    position: tuple[tuple[Real, ...], ...] = Field(description="of the projectile, x and y [m], shape (2, GRID + 1)")
    torques: dict[str, tuple[Real, ...]] = Field(description="of stops closed at the start [N m, N], on the grid")
    force_units: dict[str, str] = Field(default_factory=dict, description="of the torques; N m where left out")
    energy: tuple[Real, ...] = Field(description="total energy, of that at the start [J], on the grid")
    release_times: dict[str, Real | None] = Field(description="[s]; None where only one of the two releases")
    launch_time: Real | None = Field(description="[s]")
    launch_speed: Real | None = Field(description="[m/s]")
    metrics: dict[str, Real] = Field(description="by label, as in a comparison")

    @property
    def t(self) -> FloatArray:
        """The grid [s], shape (GRID + 1,)."""
        return np.linspace(0.0, self.end, GRID + 1)

    def quantity(self, name: str) -> FloatArray:
        """A quantity as one flat vector; missing figures are NaN.

        Args:
            name: 'position', 'energy', 'launch_time', 'launch_speed', or a stop's name for its torque.
        """
        if name in self.torques:
            return np.array(self.torques[name])
        value = getattr(self, name)
        return np.atleast_1d(np.array(np.nan if value is None else value, dtype=np.float64)).ravel()


def deviation(trajectory: Trajectory, solution: Solution, end: float, reference: Trajectory | None = None) -> Deviation:
    """Set a trajectory beside the reference, at its own times, and interpolate the difference to the common grid.

    Args:
        end: end of the compared motion [s]; the trajectory should go on a little beyond it.
        reference: at the trajectory's times, where it is known already.
    """
    reference = reference or solution.trajectory(trajectory.t)
    grid = np.linspace(0.0, end, GRID + 1)
    error = trajectory.marker(PROJECTILE).position - reference.marker(PROJECTILE).position
    closed = [stop.name for stop in trajectory.mechanism.stops if stop.closed]
    torques = {
        name: np.interp(grid, trajectory.t, trajectory.stop_torque(name) - reference.stop_torque(name))
        for name in closed
        if name in trajectory.stop_torques
    }
    start = float(reference.total_energy[0])
    launch, expected = trajectory.launch(), solution.launch
    metrics = {m.label: m.value for m in measure(trajectory, solution, end, reference) if m.value is not None}
    return Deviation(
        end=end,
        force_units={name: trajectory.mechanism.stop(name).force_unit for name in torques},
        position=tuple(tuple(row) for row in _interpolated(trajectory.t, error, grid).T.tolist()),
        torques={name: tuple(values.tolist()) for name, values in torques.items()},
        energy=tuple(np.interp(grid, trajectory.t, trajectory.total_energy - start).tolist()),
        release_times={
            name: _difference(trajectory.release_time(name), solution.release_times[name]) for name in closed
        },
        launch_time=launch.time - expected.time if launch and expected else None,
        launch_speed=launch.speed - expected.speed if launch and expected else None,
        metrics=metrics,
    )


def _interpolated(t: FloatArray, values: FloatArray, grid: FloatArray) -> FloatArray:
    if len(t) < 8:
        return np.stack([np.interp(grid, t, column) for column in values.T], axis=1)
    return np.asarray(make_interp_spline(t, values, k=3)(np.minimum(grid, t[-1])), dtype=np.float64)


def _difference(mine: float | None, theirs: float | None) -> float | None:
    return None if mine is None or theirs is None else mine - theirs
