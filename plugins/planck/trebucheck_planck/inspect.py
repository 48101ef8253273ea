"""The built planck.js world, read back from its bodies and joints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from trebucheck.engines.inspection import Inspection, State
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import FreeJoint
from trebucheck.models.mechanism import Body, Mechanism
from trebucheck.models.problem import Problem
from trebucheck_toolkit.node_samples import NodeSamples
from trebucheck_toolkit.node_scene import MIRROR, Json, NodeScene
from trebucheck_toolkit.read_back import HeldBody, held_inspection, held_joint, held_mechanism

from .bridge import PLANCK


def inspect(mechanism: Mechanism, states: Sequence[State], settings: Json) -> Inspection:
    """Inspect the built world in each state, without masses moved along pins for the motion."""
    scene = NodeScene(mechanism, "planck")
    # Stops play no part in what is read back, nor do duration and step.
    described = scene.description(
        Problem.model_construct(mechanism=mechanism), timestep=1.0, steps=0
    )
    read = NodeSamples(
        scene, np.zeros(1), PLANCK.move(described | settings | {"stops": [], "readBack": True})
    )
    start = read.recording()
    return held_inspection(_held(scene, read.told[0]), start.q[0], start.u[0], states)


def _held(scene: NodeScene, told: FloatArray) -> Mechanism:
    """The mechanism that planck.js holds: four numbers of each body, six of each joint, gravity."""
    mechanism = scene.mechanism
    joints = [joint for joint in mechanism.joints if not isinstance(joint, FreeJoint)]
    bodies, ends, gravity = np.split(told, [4 * len(mechanism.bodies), len(told) - 2])
    rows = zip(mechanism.bodies, bodies.reshape(-1, 4), strict=True)
    return held_mechanism(
        mechanism,
        {body.name: _body(body, row) for body, row in rows},
        {
            joint.name: held_joint(scene, joint, row[:2], row[2:4], row[4:])
            for joint, row in zip(joints, ends.reshape(len(joints), 6), strict=True)
        },
        gravity * MIRROR,
    )


def _body(body: Body, told: FloatArray) -> HeldBody:
    mass, inertia, *centre = told.tolist()
    return mass, inertia, np.add(body.centre, centre)
