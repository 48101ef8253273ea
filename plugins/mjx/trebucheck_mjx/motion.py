"""Motion of a mechanism by MJX, stops and loops by multipliers, in mechanism coordinates."""

from __future__ import annotations

import numpy as np
from trebucheck.engines.events import Contacts
from trebucheck.models.arrays import FloatArray
from trebucheck.models.mechanism import Mechanism
from trebucheck_toolkit.constrained import ConstrainedDynamics, Solved, subtree_sums
from trebucheck_toolkit.event_driver import Observation
from trebucheck_toolkit.schemes import State

from .build import Built
from .read import Reader


class Model:
    """MJX's forward dynamics of the tree alone."""

    def __init__(self, mechanism: Mechanism, timestep: float) -> None:
        alone = {"stops": (), "force_elements": (), "joints": mechanism.tree_joints}
        self.built = Built(mechanism.model_copy(update=alone), timestep, double=True)
        self.reader = Reader(self.built)
        self._place: FloatArray | None = None
        """Where the mass matrix was last found; arrays of states are not written into."""
        self._mass = np.zeros((0, 0))

    def accelerations(self, q: FloatArray, u: FloatArray, applied: FloatArray) -> FloatArray:
        """MJX's, nothing held."""
        a, mass = self.built.dynamics(q, u, applied)
        self._place, self._mass = q, mass
        return self.built.sums @ a

    def mass_matrix(self, q: FloatArray) -> FloatArray:
        """MJX's."""
        if self._place is not q:
            self.accelerations(q, np.zeros_like(q), np.zeros_like(q))
        return self.built.differences.T @ self._mass @ self.built.differences


class Motion(ConstrainedDynamics):
    """The tree moved by MJX's RK4 while nothing is held, else by RK4 on its accelerations."""

    def __init__(self, mechanism: Mechanism, timestep: float) -> None:
        self.mjx = Model(mechanism, timestep)
        super().__init__(mechanism, self.mjx)
        self.plain = not (mechanism.loop_joints or mechanism.force_elements)

    def advance(self, state: State, step: float, held: Contacts) -> State:
        """The state a step [s] later, contacts and loops held."""
        if held or not self.plain:
            return self.stepped(state, step, held, "RK4")
        return self.mjx.built.stepped(*state, step)

    def observe(self, q: FloatArray, u: FloatArray, solved: Solved) -> Observation:
        """Points, energies and joint forces, as MJX has them."""
        seen = self.mjx.built.forward(q, u, solved.generalized)
        shown = self.mjx.reader.observe(seen, q, u)
        others = subtree_sums(self.mechanism, self.forces_on_bodies(q, u, solved))
        return Observation(
            points=shown.points,
            kinetic_energy=shown.kinetic_energy,
            potential_energy=shown.potential_energy + float(self.applied.potential_energy(q)),
            reactions={name: force - others[name] for name, force in shown.reactions.items()}
            | dict(solved.loops),
        )
