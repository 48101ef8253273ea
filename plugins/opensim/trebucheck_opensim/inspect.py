"""The built OpenSim model in single states."""

from __future__ import annotations

from collections.abc import Sequence

from trebucheck.engines.inspection import Dynamics, Inspection, State
from trebucheck.models.kinematics import initial_state
from trebucheck.models.mechanism import Mechanism

from .motion import Motion


def inspect(mechanism: Mechanism, states: Sequence[State]) -> Inspection:
    """Inspect the built model in each state."""
    motion = Motion(mechanism, "RungeKuttaMerson", 1e-11, 1e-3)
    built = motion.opensim.built
    built.place(*initial_state(mechanism), built.state)
    start, start_speeds = built.coordinates_of(built.state)
    return Inspection(
        start=start,
        start_speeds=start_speeds,
        dynamics=tuple(_dynamics(motion, state) for state in states),
        total_mass=float(built.model.getTotalMass(built.state)),
    )


def _dynamics(motion: Motion, state: State) -> Dynamics:
    solved = motion.solve(state.q, state.u, state.closed)
    applied = motion.applied.generalized(state.q, state.u)
    # Simbody tells accelerations: what makes them is the mass matrix times these.
    free, mass = (
        motion.opensim.accelerations(state.q, state.u, applied),
        motion.opensim.mass_matrix(state.q),
    )
    built = motion.opensim.built
    built.model.realizeVelocity(built.state)
    return Dynamics(
        accelerations=solved.accelerations,
        stop_torques=solved.contacts,
        mass_matrix=mass,
        forces=mass @ free,
        centres={
            body.name: motion.reader.centre(built.state, body.name)
            for body in motion.mechanism.bodies
        },
        stop_gaps={name: float(motion.kinematics.gap(name, state.q)) for name in state.closed},
    )
