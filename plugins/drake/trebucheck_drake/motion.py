"""A mechanism as Drake's continuous plant moves it; states are in the mechanism's coordinates."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydrake.multibody.tree import MultibodyForces
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import BasicVector, DiagramBuilder, LeafSystem
from trebucheck.engines.events import Contacts
from trebucheck.models.applied_forces import AppliedForces
from trebucheck.models.arrays import FloatArray
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.mechanism import Mechanism
from trebucheck_toolkit.constrained import ConstrainedDynamics, Solved, subtree_sums
from trebucheck_toolkit.event_driver import Observation
from trebucheck_toolkit.schemes import State

from .build import Built
from .read import Reader

_LEAST = 0.125
"""Least part of a step of a mechanism with loops that error control goes down to."""


class Model:
    """Drake's forward dynamics, in a context of its own."""

    def __init__(self, built: Built) -> None:
        self.built, self.plant = built, built.plant
        self.context: Any = self.plant.CreateDefaultContext()
        self.port: Any = self.plant.get_applied_generalized_force_input_port()
        self.rows = np.ix_(built.speeds, built.speeds)
        self._placed: FloatArray | None = None

    def place(self, q: FloatArray, u: FloatArray) -> None:
        """Set the context's state."""
        to, built = self.built.coordinates, self.built
        self._placed = q
        self.plant.SetPositions(self.context, built.in_order(to.positions(q), built.positions))
        self.plant.SetVelocities(self.context, built.in_order(to.speeds(u), built.speeds))

    def apply(self, generalized: FloatArray) -> None:
        """Set the generalized forces on the mechanism's coordinates [N m, N]."""
        self.port.FixValue(self.context, self.joint_forces(generalized))

    def joint_forces(self, generalized: FloatArray) -> FloatArray:
        """Drake's joint forces of generalized forces on the mechanism's coordinates."""
        return self.built.in_order(self.built.coordinates.forces(generalized), self.built.speeds)

    def accelerations(self, q: FloatArray, u: FloatArray, applied: FloatArray) -> FloatArray:
        """Accelerations by Drake's articulated-body algorithm."""
        self.place(q, u)
        self.apply(applied)
        rates = self.plant.EvalTimeDerivatives(self.context).CopyToVector()[
            self.plant.num_positions() :
        ]
        return self.built.coordinates.mechanism_speeds(rates[self.built.speeds])

    def forces(self, q: FloatArray, u: FloatArray) -> FloatArray:
        """Generalized forces of gravity and of Drake's springs, less its bias forces."""
        self.place(q, u)
        of_elements = MultibodyForces(self.plant)
        self.plant.CalcForceElementsContribution(self.context, of_elements)
        found = self.plant.CalcGeneralizedForces(self.context, of_elements)
        found -= self.plant.CalcBiasTerm(self.context)
        return np.linalg.solve(self.built.coordinates.sums.T, found[self.built.speeds])

    def mass_matrix(self, q: FloatArray) -> FloatArray:
        """Drake's."""
        if self._placed is not q:  # it has nothing to do with the speeds
            self.place(q, np.zeros_like(q))
        return self.built.coordinates.mass_matrix(
            self.plant.CalcMassMatrix(self.context)[self.rows]
        )


class Held(LeafSystem):
    """Gives a plant the forces of springs, motors and of what is held, from its state."""

    def __init__(self, motion: Motion) -> None:
        LeafSystem.__init__(self)
        self.motion, self.held, plant = motion, (), motion.drake.plant
        n = plant.num_velocities()
        self.DeclareVectorInputPort("state", BasicVector(plant.num_multibody_states()))
        self.DeclareVectorOutputPort("forces", BasicVector(n), self._forces)

    def _forces(self, context: Any, output: Any) -> None:
        if not self.held and self.motion.plain:  # asked for a dozen times a step
            output.SetZero()
            return
        output.SetFromVector(self.motion.forces(self.get_input_port().Eval(context), self.held))


class Motion(ConstrainedDynamics):
    """The plant moved by one of Drake's integrators, stops and loops held by multipliers."""

    def __init__(
        self, mechanism: Mechanism, integrator: str, accuracy: float, timestep: float
    ) -> None:
        self.timestep, built = timestep, Built(mechanism)
        built.add_springs()
        built.finalize()
        self.drake = Model(built)
        self.reader = Reader(built)
        super().__init__(mechanism, self.drake)
        self.applied = AppliedForces(Kinematics(built.pushed))  # Drake counts its own springs
        self.loops = bool(mechanism.loop_joints)
        self.plain = not (self.loops or built.pushed.force_elements)
        builder, self.system = DiagramBuilder(), Held(self)
        plant = builder.AddSystem(built.plant)
        builder.AddSystem(self.system)
        builder.Connect(plant.get_state_output_port(), self.system.get_input_port())
        builder.Connect(
            self.system.get_output_port(), plant.get_applied_generalized_force_input_port()
        )
        self.simulator: Any = Simulator(builder.Build())
        config = SimulatorConfig(
            integration_scheme=integrator,
            # The difference of rounded times may be longer than the time step: Drake would then add
            # a step of some 1e-20 s, which costs as much as any.
            max_step_size=2.0 * timestep,
            accuracy=accuracy,
            use_error_control=True,
        )
        ApplySimulatorConfig(config, self.simulator)
        if self.loops:  # at a singular position no step is small enough: it has to be stepped over
            self.simulator.get_mutable_integrator().set_throw_on_minimum_step_size_violation(False)
        none = np.full(built.plant.num_multibody_states(), np.nan)
        self._given: tuple[FloatArray, State] = none, (none, none)
        """State of Drake's that the last step began in, and the same in the mechanism's terms."""
        self.state_context: Any = plant.GetMyMutableContextFromRoot(
            self.simulator.get_mutable_context()
        )

    def forces(self, state: FloatArray, held: Contacts) -> FloatArray:
        """Drake's joint forces of springs, motors, and of what is held, in a state of its own."""
        given, at = self._given
        # What has been solved in the state that a step begins in is not solved again.
        q, u = at if (state == given).all() else self.drake.built.coordinates_of(state)
        if held or self.loops:
            return self.drake.joint_forces(self.solve(q, u, held).generalized)
        return self.drake.joint_forces(self.applied.generalized(q, u))

    def advance(self, state: State, step: float, held: Contacts) -> State:
        """The state a step [s] later by Drake's integrator, contacts and loops held."""
        built, plant, to = self.drake.built, self.drake.plant, self.drake.built.coordinates
        self.system.held = held
        context = self.simulator.get_mutable_context()
        context.SetTime(0.0)
        plant.SetPositions(
            self.state_context, built.in_order(to.positions(state[0]), built.positions)
        )
        plant.SetVelocities(self.state_context, built.in_order(to.speeds(state[1]), built.speeds))
        self._given = plant.get_state_output_port().Eval(self.state_context).copy(), state
        integrator: Any = self.simulator.get_mutable_integrator()
        integrator.request_initial_step_size_target(step)
        if self.loops:
            integrator.set_requested_minimum_step_size(_LEAST * step)
        self.simulator.Initialize()
        self.simulator.AdvanceTo(step)
        after = built.coordinates_of(plant.get_state_output_port().Eval(self.state_context))
        return self.projected(*after, held)

    def observe(self, q: FloatArray, u: FloatArray, solved: Solved) -> Observation:
        """Points, energies and joint forces, as Drake has them."""
        self.drake.place(q, u)
        self.drake.apply(solved.generalized)
        seen = self.reader.observe(self.drake.context)
        others = subtree_sums(self.mechanism, self.forces_on_bodies(q, u, solved))
        return Observation(
            points=seen.points,
            kinetic_energy=seen.kinetic_energy,
            potential_energy=seen.potential_energy + float(self.applied.potential_energy(q)),
            reactions={name: force - others[name] for name, force in seen.reactions.items()}
            | dict(solved.loops),
        )
