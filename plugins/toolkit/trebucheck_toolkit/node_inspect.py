"""The world that an engine in Node.js has built, in single states, as :mod:`.read_back` has it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from trebucheck.engines.inspection import Inspection, State
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import FreeJoint
from trebucheck.models.mechanism import Body, Mechanism

from .node_samples import NodeSamples
from .node_scene import MIRROR, NodeScene
from .read_back import HeldBody, held_inspection, held_joint, held_mechanism


def inspected(
    samples: NodeSamples, built: FloatArray, states: Sequence[State], roundoff: float
) -> Inspection:
    """Inspect a built world in each state.

    Args:
        samples: its bodies at the start.
        built: what it holds, in the scene's axes: of each body mass [kg], inertia [kg m^2] and
            centre of mass [m] in its frame; of each joint that holds anything both anchors [m] and
            its axis, zeros where it has none, and no numbers where the engine does not tell it;
            gravity [m/s^2].
        states: of the mechanism, with the stops that are closed.
        roundoff: unit roundoff of the numbers that it holds.
    """
    start = samples.recording()
    held = _held(samples.scene, built)
    return held_inspection(held, start.q[0], start.u[0], states, roundoff=roundoff)


def _held(scene: NodeScene, told: FloatArray) -> Mechanism:
    """The mechanism that the world holds: four numbers of each body, six of each joint, gravity."""
    mechanism = scene.mechanism
    joints = [joint for joint in mechanism.joints if not isinstance(joint, FreeJoint)]
    bodies, ends, gravity = np.split(told, [4 * len(mechanism.bodies), len(told) - 2])
    rows = zip(mechanism.bodies, bodies.reshape(-1, 4), strict=True)
    return held_mechanism(
        mechanism,
        {body.name: _body(body, row) for body, row in rows},
        {
            joint.name: held_joint(
                scene, joint, row[:2], row[2:4], None if np.isnan(row[4:]).any() else row[4:]
            )
            for joint, row in zip(joints, ends.reshape(len(joints), 6), strict=True)
        },
        gravity * MIRROR,
    )


def _body(body: Body, told: FloatArray) -> HeldBody:
    mass, inertia, *centre = told.tolist()
    return mass, inertia, np.add(body.centre, centre).tolist()
