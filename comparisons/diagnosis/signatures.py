"""A trajectory's deviation from the reference as one array, every kind of quantity in units of its size.

Deviations grow towards the launch, and late ones look alike whatever their cause. So all times are weighted alike: the
deviation at a time is divided by its largest value up to then. A suspect's signature, the effect of one mistake on the
reference, is an array of the same kind, fitted to the deviation by least squares. Mistakes of reading a right motion
have their signatures here; those of mechanisms follow from :mod:`.suspects`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ...models.arrays import FloatArray, IndexArray
from ...models.trajectory import PointMotion, Trajectory
from ...reference.solution import Solution

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


@dataclass(frozen=True)
class Match:
    """A suspect's signature fitted to a deviation."""

    factor: float
    """Of the signature."""
    explained: float
    """1 - |deviation - factor signature| / |deviation|; negative where the suspect makes it worse."""


def match(deviation: FloatArray, signature: FloatArray, fixed: bool = False) -> Match:
    """Fit a signature to a deviation, both flat vectors in units of their size.

    Args:
        deviation, signature: of one shape.
        fixed: the signature counts as it is, its factor is 1.
    """
    size, length = float(np.linalg.norm(deviation)), float(signature @ signature)
    if size == 0.0 or length == 0.0 or not np.isfinite(length):
        return Match(0.0, 0.0)
    factor = 1.0 if fixed else float(signature @ deviation) / length
    left = float(np.linalg.norm(deviation - factor * signature))
    return Match(factor, 1.0 - left / size)


_SMALL = 1e-6
_INSTANT = 1e-6  # [s]


@dataclass(frozen=True)
class Reading:
    """A mistake of a small size, and how that size is formatted."""

    name: str
    wrong: Trajectory
    amount: Callable[[float], str]
    """From the fitted factor to text."""


def readings(solution: Solution, reference: Trajectory, step: float) -> Iterator[Reading]:
    """Readings of the reference that are wrong in one way.

    Args:
        reference: at the engine's times.
        step: the engine's [s].
    """
    for name, torque in reference.stop_torques.items():
        if torque.any():
            wrong = replace(reference, stop_torques={**reference.stop_torques, name: torque * (1 + _SMALL)})
            yield Reading(f"scale of the {name}'s {reference.mechanism.stop(name).effort}", wrong, _scale)
    scaled = {name: torque * (1 + _SMALL) for name, torque in reference.stop_torques.items()}
    yield Reading("scale of all stop torques", replace(reference, stop_torques=scaled), _scale)
    for name, force in reference.joint_reactions.items():
        wrong = replace(reference, joint_reactions={**reference.joint_reactions, name: force * (1 + _SMALL)})
        yield Reading(f"scale of the {name}'s force", wrong, _scale)
    for name, marker in reference.markers.items():
        longer = PointMotion(marker.position * (1 + _SMALL), marker.velocity * (1 + _SMALL))
        yield Reading(f"scale of the {name}", replace(reference, markers={**reference.markers, name: longer}), _scale)
    yield from _late(solution, reference, step)


def _late(solution: Solution, reference: Trajectory, step: float) -> Iterator[Reading]:
    """Everything, or one kind of quantity, read at another time."""
    end = solution.segments[-1].end
    later = solution.trajectory(np.minimum(reference.t + _INSTANT, end))

    def shift_text(factor: float) -> str:
        shift = factor * _INSTANT
        return f"{shift:+.3g} s, {shift / step:+.3g} steps"

    yield Reading("time shifted", replace(later, t=reference.t), shift_text)
    moved = {n: PointMotion(m.position, later.markers[n].velocity) for n, m in reference.markers.items()}
    yield Reading("velocities shifted in time", replace(reference, markers=moved), shift_text)
    moved = {n: PointMotion(later.markers[n].position, m.velocity) for n, m in reference.markers.items()}
    yield Reading("positions shifted in time", replace(reference, markers=moved), shift_text)
    yield Reading("torques shifted in time", replace(reference, stop_torques=later.stop_torques), shift_text)
    yield Reading("forces shifted in time", replace(reference, joint_reactions=later.joint_reactions), shift_text)
    yield Reading("kinetic energy shifted in time", replace(reference, kinetic_energy=later.kinetic_energy), shift_text)


def _scale(factor: float) -> str:
    value = 1.0 + factor * _SMALL
    return "wrong sign" if abs(value + 1.0) < 1e-3 else f"times {value:.6g}"


def thinned(trajectory: Trajectory, keep: IndexArray) -> Trajectory:
    """The trajectory at some of its samples only."""
    return replace(
        trajectory,
        t=trajectory.t[keep],
        q=trajectory.q[keep],
        u=trajectory.u[keep],
        markers={n: PointMotion(m.position[keep], m.velocity[keep]) for n, m in trajectory.markers.items()},
        kinetic_energy=trajectory.kinetic_energy[keep],
        potential_energy=trajectory.potential_energy[keep],
        stop_torques={n: torque[keep] for n, torque in trajectory.stop_torques.items()},
        joint_reactions={n: force[keep] for n, force in trajectory.joint_reactions.items()},
        joint_gaps={n: gap[keep] for n, gap in trajectory.joint_gaps.items()},
    )
