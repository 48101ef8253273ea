"""The built planck.js world in single states."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from trebucheck.engines.inspection import Inspection, State
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem
from trebucheck_toolkit.node_inspect import inspected
from trebucheck_toolkit.node_samples import NodeSamples
from trebucheck_toolkit.node_scene import Json, NodeScene

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
    return inspected(read, read.told[0], states, roundoff=2.0**-53)
