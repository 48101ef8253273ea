"""The world that an engine in Node.js has built, in single states.

Such engines tell neither mass matrix nor accelerations. What they hold of a mechanism is read back:
masses, inertias, centres, anchors, axes, gravity; accelerations and torques are those of the
equations of motion of the mechanism that this describes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from trebucheck.engines.inspection import Dynamics, Inspection, State
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import GROUND, AnyJoint, FreeJoint, PrismaticJoint, SlotJoint
from trebucheck.models.mechanism import Body, Mechanism
from trebucheck.reference.equations import Equations

from .node_samples import NodeSamples
from .node_scene import MIRROR, NodeScene, turned


def inspected(samples: NodeSamples, built: FloatArray, states: Sequence[State]) -> Inspection:
    """Inspect a built world in each state.

    Args:
        samples: its bodies at the start.
        built: what it holds, in the scene's axes: of each body mass [kg], inertia [kg m^2] and
            centre of mass [m] in its frame; of each joint that holds anything both anchors [m] and
            its axis, zeros where it has none; gravity [m/s^2].
        states: of the mechanism, with the stops that are closed.
    """
    start, held = samples.recording(), _held(samples.scene, built)
    equations = Equations(held)
    return Inspection(
        start=start.q[0],
        start_speeds=start.u[0],
        dynamics=tuple(_dynamics(equations, state) for state in states),
        total_mass=float(sum(body.mass for body in held.bodies)),
    )


def _dynamics(equations: Equations, state: State) -> Dynamics:
    accelerations, multipliers = equations.solve(state.q, state.u, state.closed)
    return Dynamics(
        accelerations=accelerations,
        stop_torques=dict(
            zip(state.closed, multipliers[equations.n_loops :].tolist(), strict=True)
        ),
        mass_matrix=equations.mass_matrix(state.q),
        forces=equations.forces(state.q, state.u),
    )


def _held(scene: NodeScene, told: FloatArray) -> Mechanism:
    """The mechanism that the world holds: four numbers of each body, six of each joint, gravity."""
    mechanism = scene.mechanism
    joints = [joint for joint in mechanism.joints if not isinstance(joint, FreeJoint)]
    bodies, ends, gravity = np.split(told, [4 * len(mechanism.bodies), len(told) - 2])
    rows = dict(zip([joint.name for joint in joints], ends.reshape(len(joints), 6), strict=True))
    size = float(np.hypot(*gravity))
    changed: dict[str, Any] = {
        "bodies": tuple(map(_body, mechanism.bodies, bodies.reshape(-1, 4))),
        "joints": tuple(
            _joint(scene, joint, rows[joint.name]) if joint.name in rows else joint
            for joint in mechanism.joints
        ),
        "gravity": size,
        "gravity_direction": tuple((gravity * MIRROR / size).tolist())
        if size
        else mechanism.gravity_direction,
    }
    # Not validated: rounding does not close the loops to the digits that are asked of a
    # description.
    return mechanism.model_copy(update=changed)


def _body(body: Body, told: FloatArray) -> Body:
    mass, inertia, *centre = told.tolist()
    return body.model_copy(
        update={"mass": mass, "inertia": inertia, "centre": tuple(np.add(body.centre, centre))}
    )


def _joint(scene: NodeScene, joint: AnyJoint, told: FloatArray) -> AnyJoint:
    """Joint with the world's anchors and axis, in the frames of the mechanism's bodies."""
    changed: dict[str, Any] = {}
    for field, body, anchor in (
        ("parent_point", joint.parent, told[:2]),
        ("child_point", joint.child, told[2:4]),
    ):
        centre = (0.0, 0.0) if body == GROUND else scene.mechanism.body(body).centre
        changed[field] = tuple((np.array(centre) + _unturned(scene, body, anchor)).tolist())
    if isinstance(joint, PrismaticJoint | SlotJoint):
        changed["axis"] = tuple(_unturned(scene, joint.parent, told[4:]).tolist())
    return joint.model_copy(update=changed)


def _unturned(scene: NodeScene, body: str, vector: FloatArray) -> FloatArray:
    """A vector of the world's frame of a body in the mechanism's."""
    return turned(-scene.angles[body], vector) * MIRROR
