"""The built Box2D world, read back from its bodies and joints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from trebucheck.engines.inspection import Inspection, State
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import GROUND
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem
from trebucheck_toolkit.node_scene import MIRROR, NodeScene, turned
from trebucheck_toolkit.read_back import held_inspection, held_mechanism

from .alone import Plan


def inspect(mechanism: Mechanism, states: Sequence[State], options: Any) -> Inspection:
    """Inspect the built world in each state, without stops, which play no part in what is read."""
    step = options.timestep
    bare = Problem(mechanism.model_copy(update={"stops": ()}), duration=step)
    plan = Plan(bare, options, as_described=True)
    built: dict[str, Any] = {}
    exec(plan.program(), built)
    pace = plan.pace or 1.0
    bodies = {
        body.name: (
            built["bodies"][body.name].mass_data.mass,
            built["bodies"][body.name].mass_data.rotational_inertia,
            _point(plan.scene, body.name, built["bodies"][body.name].mass_data.center),
        )
        for body in mechanism.bodies
    }
    joints = {
        joint.name: {
            "parent_point": _point(plan.scene, joint.parent, made.local_anchor_a),
            "child_point": _point(plan.scene, joint.child, made.local_anchor_b),
        }
        for joint in mechanism.joints
        if (made := built["joints"].get(joint.name))
    }
    gravity = pace**2 * np.array(built["world"].gravity)
    held = held_mechanism(mechanism, bodies, joints, gravity)
    return held_inspection(
        held, built["q"][0], built["u"][0], states, float(np.finfo(np.float32).eps / 2)
    )


def _point(scene: NodeScene, body: str, local: Any) -> FloatArray:
    """A point of Box2D's frame of a body in the mechanism's."""
    centre = (0.0, 0.0) if body == GROUND else scene.mechanism.body(body).centre
    return np.array(centre) + turned(-scene.angles[body], np.array(local) * MIRROR) * MIRROR
