"""The built Box2D world, read back from its bodies and joints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from trebucheck.engines.inspection import Inspection, State
from trebucheck.models.arrays import FloatArray
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem
from trebucheck_toolkit.node_scene import MIRROR
from trebucheck_toolkit.read_back import HeldBody, held_inspection, held_joint, held_mechanism

from .alone import Plan


def inspect(mechanism: Mechanism, states: Sequence[State], options: Any) -> Inspection:
    """Inspect the built world in each state, without stops, which play no part in what is read."""
    bare = mechanism.model_copy(update={"stops": ()})
    plan = Plan(Problem(bare, duration=options.timestep), options, as_described=True)
    built: dict[str, Any] = {}
    exec(plan.program(), built)
    bodies: dict[str, HeldBody] = {}
    for body in mechanism.bodies:
        data = built["bodies"][body.name].mass_data
        bodies[body.name] = data.mass, data.rotational_inertia, np.add(body.centre, data.center)
    joints: dict[str, dict[str, FloatArray]] = {}
    for joint in mechanism.joints:
        if made := built["joints"].get(joint.name):
            anchors = np.array([made.local_anchor_a, made.local_anchor_b]) * MIRROR
            joints[joint.name] = held_joint(plan.scene, joint, *anchors)
    gravity = plan.pace**2 * np.array(built["world"].gravity)
    held = held_mechanism(mechanism, bodies, joints, gravity)
    start, start_speeds = built["q"][0], built["u"][0]
    built.clear()  # its functions hold it, and Box2D has room for 128 worlds
    return held_inspection(held, start, start_speeds, states, roundoff=2.0**-24)
