"""Forces of the joints by Newton's law, and which of them are not unique."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ..models.arrays import FloatArray, as_vectors
from ..models.elements import GROUND, STOPS, ElementTable, PointStop, Stop
from ..models.errors import UnsupportedProblemError
from ..models.kinematics import Kinematics
from ..models.mechanism import Mechanism
from .equations import Equations

_TAKES_PART = 1e-6  # of the largest component of multipliers that exert no force


def joint_reactions(
    kinematics: Kinematics,
    q: FloatArray,
    needed: Mapping[str, FloatArray],
    loop_multipliers: FloatArray,
    stop_torques: Mapping[str, FloatArray],
) -> dict[str, FloatArray]:
    """Force on each joint's child, world frame [N], shape (n, 2), by Newton's law for its subtree.

    Args:
        q: coordinates, shape (n, n_q).
        needed: force that each body's momentum needs beyond gravity and force elements [N], shape
        (n, 2).
        loop_multipliers: shape (n, n_loops) [N or N m].
        stop_torques: of all stops [N m, N of one on a point], shape (n,).
    """

    def in_world(body: str, direction: complex) -> FloatArray:
        return as_vectors(kinematics.in_world(body, direction, q))

    pushes = {name: torque[:, None] for name, torque in stop_torques.items()}
    multipliers = iter(loop_multipliers.T[:, :, None])
    return distributed(kinematics.mechanism, needed, multipliers, pushes, in_world)


def distributed(
    mechanism: Mechanism,
    needed: Mapping[str, Any],
    multipliers: Iterator[Any],
    pushes: Mapping[str, Any],
    in_world: Callable[[str, complex], Any],
) -> dict[str, Any]:
    """Force on each joint's child, by Newton's law for its subtree, in any kind of vectors [N].

    Args:
        mechanism: whose joints and stops act.
        needed: force that each body's momentum needs beyond gravity and force elements.
        multipliers: of the loop joints' constraints and the couplers, in their order [N or N m].
        pushes: torques of all stops [N m, N of one on a point].
        in_world: the vector in the world of a direction in the frame of a body, or the ground.
    """
    left = dict(needed)

    def act(body: str, other: str, force: Any) -> None:
        """Take a known force on a body, and the opposite one on another, off what they need."""
        for name, sign in ((body, -1.0), (other, 1.0)):
            if name in left:
                left[name] = left[name] + sign * force

    loops = dict[str, Any]()
    for joint in mechanism.loop_joints:
        frame = joint.parent if joint.free_directions else GROUND
        parts = (next(multipliers) * in_world(frame, held) for held in joint.held_directions)
        force: Any = sum(parts)
        if joint.holds_angle:
            next(multipliers)  # a torque
        loops[joint.name] = force
        act(joint.child, joint.parent, force)
    slides = {slide.coordinate: slide for slide in mechanism.slides}
    for coupler in mechanism.couplers:
        multiplier = next(multipliers)
        for name, weight in coupler.weights.items():
            if name in slides:  # what it does to an angle is a torque
                joint, along = slides[name].joint, slides[name].direction
                act(joint.child, joint.parent, weight * multiplier * in_world(joint.parent, along))
    for stop in mechanism.stops:
        normal = _NORMALS[stop](in_world, stop)
        if normal is not None:
            act(stop.body, stop.relative_to, pushes[stop.name] * normal)
    joints = mechanism.tree_joints
    for joint in reversed(joints):  # from the tips to the ground
        if joint.parent != GROUND:
            left[joint.parent] = left[joint.parent] + left[joint.child]
    return {joint.name: left[joint.child] for joint in joints if joint.held_directions} | loops


_NORMALS: ElementTable[Callable[[Callable[[str, complex], Any], Any], Any]] = ElementTable(
    "The reference's joint forces",
    STOPS,
    {
        Stop: lambda in_world, stop: None,  # a torque needs no force of a joint
        PointStop: lambda in_world, stop: in_world(stop.relative_to, complex(*stop.normal)),
    },
)


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
    stops = {stop.name: np.zeros(len(null)) for stop in mechanism.stops} | dict(
        zip(closed, null.T[n_l:], strict=True)
    )
    still = {body.name: np.zeros((len(null), 2)) for body in mechanism.bodies}
    states = np.broadcast_to(q, (len(null), len(q)))
    forces = joint_reactions(equations.kinematics, states, still, null[:, :n_l], stops)
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
        f"{what} needs constraints that are independent of each other; here the forces of "
        f"{', '.join(joints + stops)} are not unique."
    )
