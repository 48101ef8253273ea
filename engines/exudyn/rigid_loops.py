"""Conditions of loops that need not be built because bodies are held to each other without them.

Exudyn's multipliers are those of conditions that do not depend on each other. Conditions that
follow from others contradict them by the drift of the positions, and Newton's iteration does not
get below that.
"""

from __future__ import annotations

import numpy as np

from ...models.arrays import FloatArray
from ...models.joints import AnyJoint
from ...models.kinematics import Kinematics, initial_state
from ...models.mechanism import Mechanism
from .conditioning import DEPENDENT, LoopConstraints

_AWAY = 0.1  # [rad, m] of positions beside the start, where what a singular position at the start does is gone
_WELL_HELD = 1e-3  # of the largest singular value: the least one of the conditions that are left
_FOLLOWS = 1e-9  # of a row: what others leave of it


def implied_angles(mechanism: Mechanism) -> frozenset[str]:
    """Loop joints that hold the angle of two bodies that the other conditions already hold to each other.

    Such bodies do not move relative to each other, so that this is so in all positions. The forces
    of the joints between them, which are not unique, are those without the torque of that joint.
    None is left out where the loops hold the gap of a closed stop: which of all these is redundant
    is then decided by the forces.
    """
    kinematics = Kinematics(mechanism)
    if not any(joint.turned_by is not None for joint in mechanism.loop_joints):
        return frozenset()
    positions, left_out = _positions(kinematics), set[str]()
    if any(
        _holds(kinematics.loop_jacobian(q), kinematics.gap_jacobian(stop.name, q)[None])
        for stop in mechanism.stops
        for q in positions
        if stop.closed
    ):
        return frozenset()
    for joint in reversed(mechanism.loop_joints):
        candidates = left_out | {joint.name}
        if joint.turned_by is not None and all(
            _is_implied(kinematics, q, joint, candidates) for q in positions
        ):
            left_out = candidates
    return frozenset(left_out)


def built_rows(
    kinematics: Kinematics, q: FloatArray, left_out: frozenset[str] | set[str]
) -> FloatArray:
    """Jacobian of the loops' conditions but for the angles of some joints, shape (n, n_q)."""
    keep: list[bool] = []
    for joint in kinematics.mechanism.loop_joints:
        keep += [True] * len(joint.held_directions)
        keep += [joint.name not in left_out] * (joint.turned_by is not None)
    return kinematics.loop_jacobian(q)[np.array(keep, dtype=bool)]


def _positions(kinematics: Kinematics) -> list[FloatArray]:
    """The start, and positions to both sides of it in which loops are closed."""
    q, u = initial_state(kinematics.mechanism)
    rows = kinematics.loop_jacobian(q)
    away = np.cos(np.arange(len(q)))
    away -= np.linalg.pinv(rows, rcond=DEPENDENT) @ (rows @ away)
    constraints = LoopConstraints(kinematics, ())
    return [q, *(constraints.projected(q + sign * _AWAY * away, u)[0] for sign in (1, -1))]


def _is_implied(kinematics: Kinematics, q: FloatArray, joint: AnyJoint, left_out: set[str]) -> bool:
    """Whether the child does not move relative to the parent although its angle is not held."""
    rows = built_rows(kinematics, q, left_out)
    values = np.linalg.svd(rows, compute_uv=False)
    held = values[values > DEPENDENT * values[0]]
    return bool(held.min(initial=np.inf) > _WELL_HELD * values[0]) and _holds(
        rows, _relative_motion(kinematics, q, joint)
    )


def _holds(rows: FloatArray, moved: FloatArray) -> bool:
    """Whether quantities with a Jacobian `moved` do not change while conditions with a Jacobian `rows` are met."""
    rest = moved - moved @ np.linalg.pinv(rows, rcond=DEPENDENT) @ rows
    return bool(np.abs(rest).max() <= _FOLLOWS * np.abs(moved).max())


def _relative_motion(kinematics: Kinematics, q: FloatArray, joint: AnyJoint) -> FloatArray:
    """Jacobian of a joint's relative angle and of its child's point in the parent's frame, shape (3, n_q)."""
    vector, rates = (
        kinematics.between(joint.child, joint.child_point, joint.parent, joint.parent_point),
        kinematics.rates(q),
    )
    along = [
        kinematics.component(axis, joint.parent, vector).jacobian(q, rates)
        for axis in (1.0 + 0.0j, 1.0j)
    ]
    return np.stack([kinematics.angle(joint.child, joint.parent).coefficients, *along])
