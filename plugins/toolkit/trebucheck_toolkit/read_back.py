"""Model checks of engines that tell neither mass matrix nor accelerations.

What an engine holds of a mechanism is read back from its bodies and joints: masses, inertias,
centres of mass, anchors, axes, gravity. Accelerations and torques are those of the equations of
motion of the mechanism that this describes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from trebucheck.engines.inspection import Dynamics, Inspection, State
from trebucheck.engines.rotors import rotors_of
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import GROUND, AnyJoint, PrismaticJoint, SlotJoint
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.spec import Vector
from trebucheck.reference.equations import Equations

from .node_scene import MIRROR, NodeScene, turned

HeldBody = tuple[float, float, Sequence[float]]
"""Mass [kg], inertia about the centre of mass [kg m^2], and that centre in the body's frame [m]."""


def held_mechanism(
    mechanism: Mechanism,
    bodies: Mapping[str, HeldBody],
    joints: Mapping[str, Mapping[str, Sequence[float] | FloatArray]],
    gravity: FloatArray,
) -> Mechanism:
    """The mechanism that an engine holds.

    Args:
        mechanism: what was built.
        bodies: what is read of them, by their names; inertias with those of rotors.
        joints: `parent_point`, `child_point` and perhaps `axis` of joints by their names, in the
            frames of the mechanism's bodies.
        gravity: in the world [m/s^2], shape (2,).

    Returns:
        A mechanism that is not validated: rounding does not close the loops to the digits that are
        asked of a description.
    """
    size, rotors = float(np.hypot(*gravity)), rotors_of(mechanism, "the engine")
    changed_bodies = {
        name: {
            "mass": mass,
            "inertia": inertia - rotors.get(name, 0.0),
            "centre": _vector(centre),
        }
        for name, (mass, inertia, centre) in bodies.items()
    }
    changed_joints = {
        name: {field: _vector(value) for field, value in fields.items()}
        for name, fields in joints.items()
    }
    direction = _vector(gravity / size) if size else mechanism.gravity_direction
    return mechanism.model_copy(
        update={
            "bodies": tuple(
                body.model_copy(update=changed_bodies[body.name]) for body in mechanism.bodies
            ),
            "joints": tuple(
                joint.model_copy(update=changed_joints.get(joint.name, {}))
                for joint in mechanism.joints
            ),
            "gravity": size,
            "gravity_direction": direction,
        }
    )


def held_joint(
    scene: NodeScene,
    joint: AnyJoint,
    parent_anchor: FloatArray,
    child_anchor: FloatArray,
    axis: FloatArray | None = None,
) -> dict[str, FloatArray]:
    """A joint's points and axis in the frames of the mechanism's bodies.

    Args:
        scene: what was built.
        joint: of the mechanism.
        parent_anchor: in the scene's frame of the parent [m], shape (2,).
        child_anchor: in that of the child.
        axis: in that of the parent; None: it is not read.
    """
    found: dict[str, FloatArray] = {}
    for field, body, anchor in (
        ("parent_point", joint.parent, parent_anchor),
        ("child_point", joint.child, child_anchor),
    ):
        centre = (0.0, 0.0) if body == GROUND else scene.mechanism.body(body).centre
        found[field] = np.array(centre) + _unturned(scene, body, anchor)
    if axis is not None and isinstance(joint, PrismaticJoint | SlotJoint):
        found["axis"] = _unturned(scene, joint.parent, axis)
    return found


def held_inspection(
    held: Mechanism,
    start: FloatArray,
    start_speeds: FloatArray,
    states: Sequence[State],
    roundoff: float = 2.0**-53,
) -> Inspection:
    """The inspection of a held mechanism in each state.

    Args:
        held: by :func:`held_mechanism`.
        start: coordinates at the start, as the engine has them.
        start_speeds: their speeds.
        states: where it is inspected.
        roundoff: unit roundoff of the engine's numbers.
    """
    equations = Equations(held)
    return Inspection(
        start=start,
        start_speeds=start_speeds,
        dynamics=tuple(_dynamics(equations, state) for state in states),
        total_mass=float(sum(body.mass for body in held.bodies)),
        roundoff=roundoff,
    )


def _unturned(scene: NodeScene, body: str, vector: FloatArray) -> FloatArray:
    """A vector of a scene's frame of a body in the mechanism's."""
    return turned(-scene.angles[body], vector) * MIRROR


def _vector(values: Sequence[float] | FloatArray) -> Vector:
    x, y = values
    return float(x), float(y)


def _dynamics(equations: Equations, state: State) -> Dynamics:
    mechanism, q, u = equations.mechanism, state.q, state.u
    accelerations, multipliers = equations.solve(q, u, state.closed)
    k = equations.kinematics
    torques = multipliers[equations.n_loops :].tolist()
    return Dynamics(
        accelerations=accelerations,
        stop_torques=dict(zip(state.closed, torques, strict=True)),
        mass_matrix=equations.mass_matrix(q),
        forces=equations.forces(q, u),
        centres={
            body.name: k.position(k.point(body.name, body.centre), q) for body in mechanism.bodies
        },
        joint_gaps=_joint_gaps(k, q),
    )


def _joint_gaps(kinematics: Kinematics, q: FloatArray) -> dict[str, float]:
    """How far the joints that close loops are apart along what they hold [m]."""
    residual, gaps = iter(kinematics.loop_residual(q).tolist()), dict[str, float]()
    for joint in kinematics.mechanism.loop_joints:
        gaps[joint.name] = math.hypot(*(next(residual) for _ in joint.held_directions))
        if joint.turned_by is not None:
            next(residual)  # an angle
    return gaps
