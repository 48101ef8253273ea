"""The built MJX model in single states."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from trebucheck.engines.inspection import Dynamics, Inspection, State
from trebucheck.models.mechanism import Mechanism

from .motion import Motion


def inspect(mechanism: Mechanism, states: Sequence[State]) -> Inspection:
    """Inspect the built model in each state."""
    motion = Motion(mechanism, 1e-3)
    built = motion.mjx.built
    start, start_speeds = built.coordinates_of(built.data.qpos, built.data.qvel)
    return Inspection(
        start=start,
        start_speeds=start_speeds,
        dynamics=tuple(_dynamics(motion, state) for state in states),
        total_mass=float(built.model.body_mass.sum()),
    )


def _dynamics(motion: Motion, state: State) -> Dynamics:
    solved = motion.solve(state.q, state.u, state.closed)
    built, back = motion.mjx.built, motion.mjx.built.differences
    applied = motion.applied.generalized(state.q, state.u)
    seen, (a, mass) = (
        built.forward(state.q, state.u, applied),
        built.dynamics(state.q, state.u, applied),
    )
    return Dynamics(
        accelerations=solved.accelerations,
        stop_torques=solved.contacts,
        mass_matrix=back.T @ mass @ back,
        # MJX tells accelerations: what makes them is its mass matrix times these.
        forces=back.T @ mass @ a,
        centres={
            body.name: np.array(motion.mjx.reader.centre(seen, body.name))
            for body in motion.mechanism.bodies
        },
        stop_gaps={name: float(motion.kinematics.gap(name, state.q)) for name in state.closed},
    )
