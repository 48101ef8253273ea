"""An engine's samples as a continuous motion, so that its quantities are read as the reference's own are."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from ..models.arrays import FloatArray
from ..models.launch import Launch
from ..models.trajectory import Trajectory
from ..reference.certification.quantities import PointState

_DEGREE = 5  # error ~ step^6: far below that of any engine, at the steps they are run with
_CROWDED = 0.5  # of the median step: samples closer than this (a release inside a step) unsettle a spline


class SampledMotion:
    """A trajectory read at any time (a `Motion` of the reference's `quantities`).

    Positions, velocities and coordinates are quintic splines through the samples; an acceleration is the derivative
    of the velocity's spline. Torques and energies, which have kinks, are read linearly.
    """

    def __init__(self, trajectory: Trajectory) -> None:
        self.trajectory = trajectory
        t = trajectory.t
        self._kept = np.concatenate([[True], np.diff(t) > _CROWDED * float(np.median(np.diff(t)))])
        self._launch = trajectory.launch()
        self._splines: dict[tuple[str, str], BSpline] = {}

    @property
    def release_times(self) -> Mapping[str, float | None]:
        """When each stop opened [s]."""
        return self.trajectory.release_times

    @property
    def launch(self) -> Launch | None:
        """The launch at 45 degrees."""
        return self._launch

    def state(self, t: float) -> tuple[FloatArray, FloatArray]:
        """Q and u."""
        q, u = self._spline("", "q", self.trajectory.q), self._spline("", "u", self.trajectory.u)
        return np.asarray(q(t)), np.asarray(u(t))

    def marker(self, name: str, t: float) -> PointState:
        """Position, velocity and acceleration of a marker, each (2,)."""
        motion = self.trajectory.marker(name)
        position = self._spline(name, "position", motion.position)
        velocity = self._spline(name, "velocity", motion.velocity)
        return np.asarray(position(t)), np.asarray(velocity(t)), np.asarray(velocity(t, 1))

    def stop_torques(self, t: float) -> Mapping[str, float]:
        """Torque of every stop [N m]; NaN for one the engine does not show."""
        shown = self.trajectory.stop_torques
        return {
            stop.name: float(np.interp(t, self.trajectory.t, shown[stop.name])) if stop.name in shown else np.nan
            for stop in self.trajectory.mechanism.stops
        }

    def energy(self, t: float) -> float:
        """Total energy [J]."""
        return float(np.interp(t, self.trajectory.t, self.trajectory.total_energy))

    def _spline(self, name: str, what: str, values: FloatArray) -> BSpline:
        if (name, what) not in self._splines:
            kept = self._kept
            self._splines[name, what] = make_interp_spline(self.trajectory.t[kept], values[kept], k=_DEGREE)
        return self._splines[name, what]
