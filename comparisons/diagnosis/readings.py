"""Wrong readings of a right motion: the effect of each mistake on a trajectory."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ...models.arrays import IndexArray
from ...models.trajectory import PointMotion, Trajectory
from ...reference.solution import Solution

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
