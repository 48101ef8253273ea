"""The built Drake plant in single states."""

from __future__ import annotations

from collections.abc import Sequence

from trebucheck.engines.inspection import Dynamics, Inspection, State
from trebucheck.models.kinematics import initial_state
from trebucheck.models.mechanism import Mechanism

from .motion import Motion


def inspect(mechanism: Mechanism, states: Sequence[State]) -> Inspection:
    """Inspect the built plant in each state."""
    motion = Motion(mechanism, "runge_kutta5", 1e-12, 1e-3)
    q, u = initial_state(mechanism)
    motion.drake.place(q, u)
    plant, context = motion.drake.plant, motion.drake.context
    start, start_speeds = motion.drake.built.coordinates_of(
        plant.get_state_output_port().Eval(context)
    )
    return Inspection(
        start=start,
        start_speeds=start_speeds,
        dynamics=tuple(_dynamics(motion, state) for state in states),
        total_mass=float(plant.CalcTotalMass(context)),
    )


def _dynamics(motion: Motion, state: State) -> Dynamics:
    drake = motion.drake
    solved = motion.solve(state.q, state.u, state.closed)
    mass = drake.mass_matrix(state.q)
    forces = drake.forces(state.q, state.u)
    return Dynamics(
        accelerations=solved.accelerations,
        stop_torques=solved.contacts,
        mass_matrix=mass,
        forces=forces + motion.applied.generalized(state.q, state.u),
        centres={
            body.name: motion.reader.centre(drake.context, body.name)
            for body in motion.mechanism.bodies
        },
        stop_gaps={name: float(motion.kinematics.gap(name, state.q)) for name in state.closed},
    )
