"""Forces of the joints: by Newton's law from accelerations and multipliers, and which of them are not unique."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..models.arrays import FloatArray
from ..models.errors import UnsupportedProblemError
from ..models.mechanism import Mechanism, SlotJoint
from .equations import Equations

_TAKES_PART = 1e-6  # of the largest component of multipliers that exert no force


def joint_reactions(
    mechanism: Mechanism,
    needed: Mapping[str, FloatArray],
    loop_multipliers: FloatArray,
    stop_torques: Mapping[str, FloatArray],
) -> dict[str, FloatArray]:
    """Force on each joint's child, world frame [N], shape (n, 2), by Newton's law for its subtree.

    Args:
        needed: force that each body's momentum needs beyond gravity [N], shape (n, 2).
        loop_multipliers: shape (n, n_loops) [N].
        stop_torques: of all stops [N m, N of one on a point], shape (n,).
    """
    left = dict(needed)
    loops = _loop_forces(mechanism, loop_multipliers)
    for joint in mechanism.loop_joints:
        left[joint.child] = left[joint.child] - loops[joint.name]
        if joint.parent in left:
            left[joint.parent] = left[joint.parent] + loops[joint.name]
    for stop in mechanism.point_stops:
        if stop.body in left:
            left[stop.body] = left[stop.body] - stop_torques[stop.name][:, None] * np.array(stop.normal)
    tree = {
        joint.name: np.sum([left[body.name] for body in mechanism.subtree(joint.child)], axis=0)
        for joint in mechanism.tree_joints
    }
    return tree | loops


def _loop_forces(mechanism: Mechanism, multipliers: FloatArray) -> dict[str, FloatArray]:
    """Force of each loop joint on its child [N], from its multipliers."""
    forces: dict[str, FloatArray] = {}
    column = 0
    for joint in mechanism.loop_joints:
        if isinstance(joint, SlotJoint):
            normal = np.array([-joint.axis[1], joint.axis[0]])
            forces[joint.name] = multipliers[:, column, None] * normal
            column += 1
        else:
            forces[joint.name] = multipliers[:, column : column + 2]
            column += 2
    return forces


def undetermined_forces(
    equations: Equations, q: FloatArray, closed: Sequence[str]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names of the joints and of the closed stops whose forces are not unique at q, shape (n_q,).

    They are those that change with multipliers which exert no generalized force.
    """
    basis = equations.basis(q, closed)
    if basis is None:
        return (), ()
    mechanism, null, n_l = equations.mechanism, basis.null, equations.n_loops
    stops = {stop.name: np.zeros(len(null)) for stop in mechanism.stops} | dict(zip(closed, null.T[n_l:], strict=True))
    still = {body.name: np.zeros((len(null), 2)) for body in mechanism.bodies}
    forces = joint_reactions(mechanism, still, null[:, :n_l], stops)
    least = _TAKES_PART * np.abs(null).max(initial=0.0)
    joints = tuple(name for name, force in forces.items() if np.abs(force).max(initial=0.0) > least)
    return joints, tuple(name for name in closed if np.abs(stops[name]).max(initial=0.0) > least)


def refuse_dependent(equations: Equations, q: FloatArray, closed: Sequence[str], what: str) -> None:
    """Refuse constraints that depend on each other, where only independent ones can be treated.

    Raises:
        UnsupportedProblemError: the sentence begins with `what`, and names the joints and stops.
    """
    if equations.basis(q, closed) is None:
        return
    joints, stops = undetermined_forces(equations, q, closed)
    raise UnsupportedProblemError(
        f"{what} needs constraints that are independent of each other; here the forces of {', '.join(joints + stops)} "
        "are not unique."
    )
