"""The built Box2D world, read back from its bodies and joints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from trebucheck.engines.inspection import Inspection, State
from trebucheck.models.elements import AnyJoint
from trebucheck.models.mechanism import Body, Mechanism
from trebucheck_toolkit.read_back import HeldBody, held_inspection, held_mechanism

from .build import Built, Plan
from .read import Reader


def inspect(mechanism: Mechanism, states: Sequence[State]) -> Inspection:
    """Inspect the built world in each state, without masses moved along pins for the motion."""
    built = Built(Plan(mechanism))
    held = held_mechanism(
        mechanism,
        {body.name: _body(built, body) for body in mechanism.bodies},
        {
            joint.name: _joint(built, joint)
            for joint in mechanism.joints
            if joint.name in built.joints
        },
        np.array(built.world.gravity),
    )
    return held_inspection(
        held, *Reader(built).state(), states, float(np.finfo(np.float32).eps / 2)
    )


def _body(built: Built, body: Body) -> HeldBody:
    data = built.bodies[body.name].massData
    return data.mass, data.I, np.array(body.centre) + np.array(data.center)


def _joint(built: Built, joint: AnyJoint) -> dict[str, np.ndarray]:
    """Box2D's anchors, in the frames of the mechanism's bodies."""
    made = built.joints[joint.name]
    return {
        field: np.array(built.centres[body]) + np.array(anchor)
        for field, body, anchor in (
            ("parent_point", joint.parent, made.bodyA.GetLocalPoint(made.anchorA)),
            ("child_point", joint.child, made.bodyB.GetLocalPoint(made.anchorB)),
        )
    }
