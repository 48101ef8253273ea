"""A trajectory's deviation from the reference as one array, every kind of quantity in units of its size.

Deviations grow towards the launch, and late ones look alike whatever their cause. So all times are
weighted alike: the deviation at a time is divided by its largest value up to then. A suspect's
signature, the effect of one mistake on the reference, is an array of the same kind, fitted to the
deviation by least squares.
"""

from __future__ import annotations

import math
from collections.abc import Container, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ...models.arrays import FloatArray, IndexArray
from ...models.trajectory import PointMotion, Trajectory

ENERGIES = ("kinetic energy", "potential energy")
_FAINT = 1e-4  # of the largest: earlier than this, rounding and steps are most of a deviation


def _values(trajectory: Trajectory) -> dict[str, FloatArray]:
    """All that a trajectory tells, by name as a report has it, each of shape (n, n_components)."""
    stops = {
        s.name: s.effort
        for s in trajectory.mechanism.stops
        if s.closed and s.name in trajectory.stop_torques
    }
    return {
        "coordinates": trajectory.q,
        "speeds of coordinates": trajectory.u,
        **{
            f"position of the {name}": marker.position
            for name, marker in trajectory.markers.items()
        },
        **{
            f"velocity of the {name}": marker.velocity
            for name, marker in trajectory.markers.items()
        },
        **{
            f"{effort} of the {name}": trajectory.stop_torques[name][:, None]
            for name, effort in stops.items()
        },
        **{f"force of the {name}": force for name, force in trajectory.joint_reactions.items()},
        "kinetic energy": trajectory.kinetic_energy[:, None],
        "potential energy": trajectory.potential_energy[:, None],
    }


def _sizes(trajectory: Trajectory) -> dict[str, float | FloatArray]:
    """The size of each of them in its own motion."""
    n_angles = len(trajectory.mechanism.angles)
    markers = trajectory.markers.items()
    reach = max((_largest(m.position) for _, m in markers), default=0.0) or 1.0
    speed = (
        max((_largest(m.velocity) for _, m in markers), default=0.0)
        or _largest(trajectory.u)
        or 1.0
    )
    force = max((_largest(f) for f in trajectory.joint_reactions.values()), default=0.0) or 1.0
    energy = _largest(trajectory.kinetic_energy) or 1.0
    is_angle = np.arange(trajectory.q.shape[1]) < n_angles
    rate = _largest(trajectory.u[:, :n_angles]) or 1.0
    return {
        "coordinates": np.where(is_angle, 1.0, reach),
        "speeds of coordinates": np.where(is_angle, rate, speed),
        **{f"position of the {name}": reach for name, _ in markers},
        **{f"velocity of the {name}": speed for name, _ in markers},
        **_stops(trajectory),
        **{f"force of the {name}": force for name in trajectory.joint_reactions},
        "kinetic energy": energy,
        # Of a slow motion it is much the larger: in parts of the kinetic one it would outweigh all
        # else.
        "potential energy": max(energy, _largest(trajectory.potential_energy)),
    }


def _stops(trajectory: Trajectory) -> dict[str, float]:
    """Torques and forces of the stops that are closed at the start, in parts of the largest of their unit."""
    stops = [
        s for s in trajectory.mechanism.stops if s.closed and s.name in trajectory.stop_torques
    ]
    peak = {s.force_unit: 0.0 for s in stops}
    for stop in stops:
        peak[stop.force_unit] = max(
            peak[stop.force_unit], _largest(trajectory.stop_torques[stop.name])
        )
    return {f"{s.effort} of the {s.name}": peak[s.force_unit] or 1.0 for s in stops}


def _largest(values: FloatArray) -> float:
    return float(np.abs(values).max(initial=0.0))


@dataclass(frozen=True)
class Channels:
    """The quantities of a deviation and their sizes; the same for all trajectories that are compared."""

    sizes: Mapping[str, float | FloatArray]
    """By quantity, of the reference; of energies that of the larger of the two motions."""
    unusable: Mapping[str, float]
    """Quantities that are not finite, and from which time on [s]."""

    @classmethod
    def of(
        cls, trajectory: Trajectory, reference: Trajectory, told: Container[str] | None = None
    ) -> Channels:
        """Those that both have, at the same times, and of them those that are told."""
        given, right = _values(trajectory), _values(reference)
        given = (
            given if told is None else {name: each for name, each in given.items() if name in told}
        )
        common = [
            name for name in right if name in given and given[name].shape == right[name].shape
        ]
        finite = {name: np.isfinite(given[name]).all(axis=1) for name in common}
        unusable = {
            name: float(trajectory.t[np.argmin(ok)]) for name, ok in finite.items() if not ok.all()
        }
        own, others = _sizes(reference), _sizes(trajectory)
        sizes = {name: own[name] for name in common if name not in unusable}
        # An energy goes with the square of a speed: one that is much too large would outweigh the
        # speeds themselves.
        larger = {name: max(sizes[name], others[name]) for name in ENERGIES if name in sizes}
        sizes |= {name: size for name, size in larger.items() if math.isfinite(size)}
        return cls(sizes, unusable)

    def parts(self, one: Trajectory, other: Trajectory) -> dict[str, FloatArray]:
        """One minus the other at the same times in units of their size, each of shape (n, n_components)."""
        first, second = _values(one), _values(other)
        # A suspect may have lost the stop or the joint: then it carries nothing.
        return {
            name: (first.get(name, 0.0) - second[name]) / size for name, size in self.sizes.items()
        }

    def stacked(self, one: Trajectory, other: Trajectory) -> FloatArray:
        """All parts beside each other, shape (n, n_channels)."""
        return np.concatenate(list(self.parts(one, other).values()), axis=1)


def weights(deviation: FloatArray) -> FloatArray:
    """Of each time: one over how large the deviation has become by then, shape (n, 1)."""
    grown = np.maximum.accumulate(np.abs(deviation).max(axis=1))
    return 1.0 / np.maximum(grown, _FAINT * (grown[-1] or 1.0))[:, None]


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


def fit(deviation: FloatArray, signatures: FloatArray) -> tuple[FloatArray, float]:
    """Fit several signatures at once by least squares: their factors, and the share that they explain.

    Args:
        deviation: shape (m,).
        signatures: shape (n, m).
    """
    size, lengths = float(np.linalg.norm(deviation)), np.linalg.norm(signatures, axis=1)
    if size == 0.0 or not lengths.all() or not np.isfinite(lengths).all():
        return np.zeros(len(signatures)), 0.0
    factors = (
        np.linalg.lstsq((signatures / lengths[:, None]).T, deviation, rcond=1e-10)[0] / lengths
    )
    return factors, 1.0 - float(np.linalg.norm(deviation - factors @ signatures)) / size


def thinned(trajectory: Trajectory, keep: IndexArray) -> Trajectory:
    """The trajectory at some of its samples only."""
    return replace(
        trajectory,
        t=trajectory.t[keep],
        q=trajectory.q[keep],
        u=trajectory.u[keep],
        markers={
            n: PointMotion(m.position[keep], m.velocity[keep])
            for n, m in trajectory.markers.items()
        },
        kinetic_energy=trajectory.kinetic_energy[keep],
        potential_energy=trajectory.potential_energy[keep],
        stop_torques={n: torque[keep] for n, torque in trajectory.stop_torques.items()},
        joint_reactions={n: force[keep] for n, force in trajectory.joint_reactions.items()},
        joint_gaps={n: gap[keep] for n, gap in trajectory.joint_gaps.items()},
    )
