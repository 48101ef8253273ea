"""A mechanism as Drake's discrete plant moves it, with joint limits of its own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from trebucheck.engines.protocol import Recording
from trebucheck.models.applied_forces import AppliedForces
from trebucheck.models.kinematics import Kinematics, initial_state
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem
from trebucheck_toolkit.constrained import subtree_sums
from trebucheck_toolkit.event_driver import Observation
from trebucheck_toolkit.joint_coordinates import Limit
from trebucheck_toolkit.joint_tree import JointLimits
from trebucheck_toolkit.plain_run import plain_run
from trebucheck_toolkit.schemes import State

from .build import Built
from .read import Reader

# Of the largest reaction: what is left of a torque about an axis where nothing acts.
_ROUNDING = 1e-10


def run(problem: Problem, timestep: float) -> Recording:
    """Simulate a problem.

    Raises:
        UnsupportedProblemError: the mechanism has elements whose forces a discrete plant does not
            tell.
    """
    return plain_run(problem, Motion(problem.mechanism, timestep), "drake", timestep)


class Motion:
    """The discrete plant in its present state."""

    def __init__(self, mechanism: Mechanism, timestep: float) -> None:
        self.mechanism, self.built = mechanism, Built(mechanism, timestep)
        self.limited = _limits(self.built)
        # Outputs are those of the present state, not of the last step.
        self.plant = self.built.plant
        self.plant.SetUseSampledOutputPorts(False)
        self.built.finalize()
        self.reader = Reader(self.built)
        self.applied = AppliedForces(Kinematics(mechanism))
        self.context: Any = self.plant.CreateDefaultContext()
        q, u = initial_state(mechanism)
        built, to = self.built, self.built.coordinates
        self.plant.SetPositions(self.context, built.in_order(to.positions(q), built.positions))
        self.plant.SetVelocities(self.context, built.in_order(to.speeds(u), built.speeds))
        self._apply()

    def state(self) -> State:
        """The mechanism's coordinates and speeds."""
        return self.built.coordinates_of(self.plant.GetPositionsAndVelocities(self.context))

    def step(self) -> None:
        """One step of the plant, under the springs and motors of its start."""
        after = self.plant.AllocateDiscreteVariables()
        self.plant.CalcForcedDiscreteVariableUpdate(self.context, after)
        self.context.SetDiscreteState(after)
        self._apply()

    def _apply(self) -> None:
        forces = self.built.coordinates.forces(self.applied.generalized(*self.state()))
        port = self.plant.get_applied_generalized_force_input_port()
        port.FixValue(self.context, self.built.in_order(forces, self.built.speeds))

    def contacts(self) -> Mapping[str, float]:
        """Torques of the limits: reaction torques about the joint axes, with z opposed to them."""
        forces = self.plant.get_reaction_forces_output_port().Eval(self.context)
        rounding = _ROUNDING * max(
            (float(np.abs(force.get_coeffs()).max()) for force in forces), default=0.0
        )
        torques = {
            name: -sense * float(forces[int(joint.index())].rotational()[2])
            for name, (joint, sense) in self.limited.items()
        }
        return {name: torque if torque > rounding else 0.0 for name, torque in torques.items()}

    def observe(self) -> Observation:
        """Readings of the plant."""
        q, u = self.state()
        seen = self.reader.observe(self.context)
        others = subtree_sums(self.mechanism, self.applied.on_bodies(q, u))
        return Observation(
            points=seen.points,
            kinetic_energy=seen.kinetic_energy,
            potential_energy=seen.potential_energy + float(self.applied.potential_energy(q)),
            reactions={name: force - others[name] for name, force in seen.reactions.items()},
        )


def _limits(built: Built) -> dict[str, tuple[Any, int]]:
    """Set the limits of the plant's joints; return each stop's joint and sense of turning."""
    limits = JointLimits(built.coordinates, "drake's discrete plant").limits
    for index, (low, high) in Limit.ranges(limits.values()).items():
        built.moving[index].set_position_limits([low], [high])
    return {name: (built.moving[limit.index], limit.sense) for name, limit in limits.items()}
