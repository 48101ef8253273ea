"""A trajectory's deviation from the reference as one array, every kind of quantity in units of its size.

Deviations grow towards the launch, and late ones look alike whatever their cause. So all times are weighted alike: the
deviation at a time is divided by its largest value up to then.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...models.arrays import FloatArray
from ...models.trajectory import Trajectory

_FAINT = 1e-4  # of the largest: earlier than this, rounding and steps are most of a deviation


@dataclass(frozen=True)
class Channels:
    """The components of a deviation and their sizes; the same for all trajectories that are compared."""

    markers: tuple[str, ...]
    torques: tuple[str, ...]
    reactions: tuple[str, ...]
    reach: float
    """[m]"""
    speed: float
    """[m/s]"""
    torque: dict[str, float]
    """Of each stop, the largest of its kind: those on angles [N m], those on points [N]."""
    force: float
    """[N]"""
    energy: float
    """[J]"""

    @classmethod
    def of(cls, trajectory: Trajectory, reference: Trajectory) -> Channels:
        """Those that both have, measured by the reference."""
        markers = tuple(name for name in trajectory.markers if name in reference.markers)
        torques = tuple(s.name for s in reference.mechanism.stops if s.closed and s.name in trajectory.stop_torques)
        reactions = tuple(name for name in trajectory.joint_reactions if name in reference.joint_reactions)
        return cls(
            markers=markers,
            torques=torques,
            reactions=reactions,
            reach=max(_largest(reference.markers[name].position) for name in markers),
            speed=max(_largest(reference.markers[name].velocity) for name in markers) or 1.0,
            torque=_sizes(reference, torques),
            force=max((_largest(reference.joint_reactions[name]) for name in reactions), default=0.0) or 1.0,
            energy=_largest(reference.kinetic_energy) or 1.0,
        )

    def stacked(self, one: Trajectory, other: Trajectory) -> FloatArray:
        """One minus the other at the same times, shape (n, n_channels)."""
        parts = [(one.markers[n].position - other.markers[n].position) / self.reach for n in self.markers]
        parts += [(one.markers[n].velocity - other.markers[n].velocity) / self.speed for n in self.markers]
        parts += [((_torque(one, n) - _torque(other, n)) / self.torque[n])[:, None] for n in self.torques]
        parts += [(_reaction(one, n) - _reaction(other, n)) / self.force for n in self.reactions]
        energies = ((one.kinetic_energy - other.kinetic_energy), (one.potential_energy - other.potential_energy))
        parts += [(energy / self.energy)[:, None] for energy in energies]
        return np.concatenate(parts, axis=1)


def weights(deviation: FloatArray) -> FloatArray:
    """Of each time: one over how large the deviation has become by then, shape (n, 1)."""
    grown = np.maximum.accumulate(np.abs(deviation).max(axis=1))
    return 1.0 / np.maximum(grown, _FAINT * (grown[-1] or 1.0))[:, None]


def _sizes(reference: Trajectory, stops: tuple[str, ...]) -> dict[str, float]:
    units = {name: reference.mechanism.stop(name).force_unit for name in stops}
    peaks = {name: _largest(reference.stop_torques[name]) for name in stops}
    return {name: max(peaks[other] for other in stops if units[other] == units[name]) or 1.0 for name in stops}


def _largest(values: FloatArray) -> float:
    return float(np.abs(values).max())


def _torque(trajectory: Trajectory, name: str) -> FloatArray:
    """A suspect may have lost the stop."""
    return trajectory.stop_torques.get(name, np.zeros(len(trajectory.t)))


def _reaction(trajectory: Trajectory, name: str) -> FloatArray:
    """A suspect may have lost the joint."""
    return trajectory.joint_reactions.get(name, np.zeros((len(trajectory.t), 2)))
