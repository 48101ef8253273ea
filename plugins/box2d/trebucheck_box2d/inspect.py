"""The built Box2D world in single states.

Box2D tells neither mass matrix nor accelerations. What it holds of a mechanism is read back from
its bodies and joints: masses, inertias, centres, anchors, axes, gravity; accelerations and torques
are those of the equations of motion of the mechanism that this describes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from trebucheck.engines.inspection import Dynamics, Inspection, State
from trebucheck.models.elements import AnyJoint, FreeJoint
from trebucheck.models.mechanism import Body, Mechanism
from trebucheck.reference.equations import Equations

from .build import Built, Plan
from .read import Reader


def inspect(mechanism: Mechanism, states: Sequence[State]) -> Inspection:
    """Inspect the built world in each state, without masses moved along pins for the motion."""
    built = Built(Plan(mechanism))
    held = read_back(built)
    equations = Equations(held)
    start, start_speeds = Reader(built).state()
    return Inspection(
        start=start,
        start_speeds=start_speeds,
        dynamics=tuple(_dynamics(equations, state) for state in states),
        total_mass=float(sum(body.mass for body in held.bodies)),
        roundoff=float(np.finfo(np.float32).eps / 2),
    )


def read_back(built: Built) -> Mechanism:
    """The mechanism that Box2D holds."""
    mechanism = built.mechanism
    gravity = np.array(built.world.gravity)
    size = float(np.hypot(*gravity))
    changed: dict[str, Any] = {
        "bodies": tuple(_body(built, body) for body in mechanism.bodies),
        "joints": tuple(_joint(built, joint) for joint in mechanism.joints),
        "gravity": size,
        "gravity_direction": tuple((gravity / size).tolist())
        if size
        else mechanism.gravity_direction,
    }
    # Not validated: single precision does not close the loops to the digits that are asked of a
    # description.
    return mechanism.model_copy(update=changed)


def _body(built: Built, body: Body) -> Body:
    made = built.bodies[body.name]
    data = made.massData
    centre = np.array(body.centre) + np.array(data.center)
    return body.model_copy(
        update={"mass": data.mass, "inertia": data.I, "centre": tuple(centre.tolist())}
    )


def _joint(built: Built, joint: AnyJoint) -> AnyJoint:
    """Joint with Box2D's anchors, in the frames of the mechanism's bodies."""
    if isinstance(joint, FreeJoint):
        return joint
    made, changed = built.joints[joint.name], dict[str, tuple[float, ...]]()
    for field, body, anchor in (
        ("parent_point", joint.parent, made.bodyA.GetLocalPoint(made.anchorA)),
        ("child_point", joint.child, made.bodyB.GetLocalPoint(made.anchorB)),
    ):
        changed[field] = tuple((np.array(built.centres[body]) + np.array(anchor)).tolist())
    return joint.model_copy(update=changed)


def _dynamics(equations: Equations, state: State) -> Dynamics:
    mechanism, q, u = equations.mechanism, state.q, state.u
    accelerations, multipliers = equations.solve(q, u, state.closed)
    k = equations.kinematics
    return Dynamics(
        accelerations=accelerations,
        stop_torques=dict(
            zip(state.closed, multipliers[equations.n_loops :].tolist(), strict=True)
        ),
        mass_matrix=equations.mass_matrix(q),
        forces=equations.forces(q, u),
        centres={
            body.name: k.position(k.point(body.name, body.centre), q) for body in mechanism.bodies
        },
    )
