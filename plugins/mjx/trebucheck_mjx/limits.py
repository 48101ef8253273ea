"""A mechanism as MJX moves it with limits of its own, in single precision."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from trebucheck.models.kinematics import Kinematics, initial_state
from trebucheck.models.mechanism import Mechanism
from trebucheck_toolkit.event_driver import Observation
from trebucheck_toolkit.schemes import State

from .build import Built
from .read import Reader


class LimitedMotion:
    """The model with joint limits, in its present state."""

    def __init__(self, mechanism: Mechanism, timestep: float, *, double: bool) -> None:
        """Build it."""
        self.built = Built(mechanism, timestep, double=double)
        self.reader, self.mechanism = Reader(self.built), mechanism
        self.kinematics = Kinematics(mechanism)
        self.nothing = np.zeros(len(mechanism.coordinates))
        self.present = initial_state(mechanism)
        self._look()

    def step(self) -> None:
        """One step of MJX."""
        self.present = self.built.stepped(*self.present, self.built.timestep)
        self._look()

    def _look(self) -> None:
        self.seen = self.built.forward(*self.present, self.nothing)

    def state(self) -> State:
        """The mechanism's coordinates and speeds."""
        return self.present

    def contacts(self) -> Mapping[str, float]:
        """Torques of the limits: MJX's constraint forces, by the rows of their gaps."""
        kinematics, q = self.kinematics, self.present[0]
        names = [stop.name for stop in self.mechanism.stops]
        rows = np.reshape(
            [kinematics.gap_jacobian(name, q) @ self.built.sums for name in names], (-1, len(q))
        )
        torques = np.linalg.lstsq(rows.T, self.seen.constraint)[0] if names else []
        return {name: max(0.0, float(torque)) for name, torque in zip(names, torques, strict=True)}

    def observe(self) -> Observation:
        """Readings of the model."""
        return self.reader.observe(self.seen, *self.present)
