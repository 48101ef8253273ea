"""A mechanism as OpenSim moves it; states are in the mechanism's coordinates."""

from __future__ import annotations

import numpy as np
import opensim as osim
from trebucheck.engines.events import Contacts
from trebucheck.models.arrays import FloatArray
from trebucheck.models.mechanism import Mechanism
from trebucheck_toolkit.constrained import ConstrainedDynamics, Solved, subtree_sums
from trebucheck_toolkit.event_driver import Observation
from trebucheck_toolkit.schemes import State

from .build import Built
from .read import Reader


class Model:
    """OpenSim's forward dynamics."""

    def __init__(self, built: Built) -> None:
        self.built = built

    def accelerations(self, q: FloatArray, u: FloatArray, applied: FloatArray) -> FloatArray:
        """Simbody's, nothing held."""
        built = self.built
        built.place(q, u, built.state)
        built.apply(applied, built.state)
        built.model.realizeAcceleration(built.state)
        rates = built.state.getUDot()
        return built.coordinates.mechanism_speeds(
            np.array([rates.get(int(k)) for k in built.places])
        )

    def mass_matrix(self, q: FloatArray) -> FloatArray:
        """Simbody's."""
        built, matrix = self.built, osim.Matrix()
        built.place(q, np.zeros_like(q), built.state)
        built.model.realizeVelocity(built.state)
        built.model.getMatterSubsystem().calcM(built.state, matrix)
        return built.coordinates.mass_matrix(matrix.to_numpy()[np.ix_(built.places, built.places)])


class Motion(ConstrainedDynamics):
    """The model moved by one of Simbody's integrators, coordinates locked while their stops hold.

    Where something else is held (a stop on a point or on no joint, a loop), or springs act,
    accelerations are integrated by RK4: a model made in Python has no forces of its own making.
    """

    def __init__(
        self, mechanism: Mechanism, integrator: str, accuracy: float, timestep: float
    ) -> None:
        self.opensim = Model(Built(mechanism))
        self.reader = Reader(self.opensim.built)
        super().__init__(mechanism, self.opensim)
        self.method = getattr(osim.Manager, f"IntegratorMethod_{integrator}")
        self.accuracy, self.timestep = accuracy, timestep
        limits = {stop.name: self.opensim.built.coordinates.limit(stop) for stop in mechanism.stops}
        self.limits = {name: limit for name, limit in limits.items() if limit is not None}
        self.plain = not (mechanism.loop_joints or mechanism.force_elements)

    def advance(self, state: State, step: float, held: Contacts) -> State:
        """The state a step [s] later, contacts and loops held."""
        if not self.plain or any(name not in self.limits for name in held):
            return self.stepped(state, step, held, "RK4")
        built = self.opensim.built
        before = osim.State(built.state)
        built.place(*state, before)
        built.apply(np.zeros(len(state[0])), before)
        for name in held:
            built.moving[self.limits[name].index].setLocked(before, True)
        return self.projected(*built.coordinates_of(self.integrated(before, step)), held)

    def integrated(self, before: osim.State, step: float) -> osim.State:
        """The state a step [s] later by the integrator."""
        before.setTime(0.0)
        manager = osim.Manager(self.opensim.built.model)
        manager.setIntegratorMethod(self.method)
        manager.setIntegratorAccuracy(self.accuracy)
        manager.setIntegratorMaximumStepSize(self.timestep)
        manager.setPerformAnalyses(False)
        manager.setWriteToStorage(False)
        manager.initialize(before)
        return osim.State(manager.integrate(step))  # its own state ends with the manager

    def observe(self, q: FloatArray, u: FloatArray, solved: Solved) -> Observation:
        """Points, energies and joint reactions, as OpenSim has them."""
        built = self.opensim.built
        built.place(q, u, built.state)
        built.apply(solved.generalized, built.state)
        seen = self.reader.observe(built.state)
        others = subtree_sums(self.mechanism, self.forces_on_bodies(q, u, solved))
        return Observation(
            points=seen.points,
            kinetic_energy=seen.kinetic_energy,
            potential_energy=seen.potential_energy + float(self.applied.potential_energy(q)),
            reactions={name: force - others[name] for name, force in seen.reactions.items()}
            | dict(solved.loops),
        )
