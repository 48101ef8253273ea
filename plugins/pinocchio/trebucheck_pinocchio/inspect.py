"""The built Pinocchio model in single states."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from trebucheck.engines.inspection import Dynamics, Inspection, State
from trebucheck.models.kinematics import initial_state
from trebucheck.models.mechanism import Mechanism

from .motion import Motion


def inspect(mechanism: Mechanism, states: Sequence[State]) -> Inspection:
    """Inspect the built model in each state."""
    motion = Motion(mechanism, "RK4")
    q, u = initial_state(mechanism)
    to, model = motion.pinocchio.coordinates, motion.pinocchio.model
    return Inspection(
        start=to.mechanism_positions(to.positions(q)),
        start_speeds=to.mechanism_speeds(to.speeds(u)),
        dynamics=tuple(_dynamics(motion, state) for state in states),
        total_mass=float(sum(inertia.mass for inertia in model.inertias)),
    )


def _dynamics(motion: Motion, state: State) -> Dynamics:
    solved = motion.solve(state.q, state.u, state.closed)
    model, data, built = motion.pinocchio.model, motion.pinocchio.data, motion.pinocchio.built
    pin.framesForwardKinematics(model, data, built.coordinates.positions(state.q))
    return Dynamics(
        accelerations=solved.accelerations,
        stop_torques=solved.contacts,
        mass_matrix=motion.pinocchio.mass_matrix(state.q),
        forces=motion.applied.generalized(state.q, state.u)
        - motion.pinocchio.bias(state.q, state.u),
        centres={
            name: np.array(data.oMf[frame].translation[:2]) for name, frame in built.centres.items()
        },
        stop_gaps={name: float(motion.kinematics.gap(name, state.q)) for name in state.closed},
    )
