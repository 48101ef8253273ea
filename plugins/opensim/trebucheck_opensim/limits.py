"""A mechanism as OpenSim moves it with coordinate limit forces for its stops."""

from __future__ import annotations

import math
from collections.abc import Mapping

import opensim as osim
from trebucheck.models.arrays import FloatArray
from trebucheck.models.errors import UnsupportedProblemError
from trebucheck.models.kinematics import initial_state
from trebucheck.models.mechanism import Mechanism
from trebucheck_toolkit.event_driver import Observation
from trebucheck_toolkit.joint_coordinates import Limit
from trebucheck_toolkit.schemes import State

from .build import Built
from .motion import Motion

_FAR = 1e6  # [degrees] a limit that is never reached
_DEGREE = 180.0 / math.pi


class LimitedMotion:
    """The model with coordinate limit forces, in its present state."""

    def __init__(
        self, mechanism: Mechanism, motion: Motion, stiffness: float, damping: float, width: float
    ) -> None:
        """Build it.

        Args:
            mechanism: what is to be moved.
            motion: whose integrator is taken.
            stiffness: of the limits [N m/degree].
            damping: of the limits [N m s/degree].
            width: of their transition to the full stiffness [degrees].

        Raises:
            UnsupportedProblemError: a stop is on no joint.
        """
        self.motion, self.limits = motion, motion.limits
        for stop in mechanism.stops:
            if stop.name not in self.limits:
                raise UnsupportedProblemError(
                    f"opensim has limits on joints alone, and stop {stop.name!r} is on none."
                )
        self.stiffness, self.damping, self.width = stiffness, damping, width
        self.forces: dict[str, osim.CoordinateLimitForce] = {}
        motion.opensim.built = self.built = Built(mechanism, self._add)
        motion.reader.built = self.built
        self.present = self.built.state
        self._place(*initial_state(mechanism))

    def _add(self, built: Built) -> None:
        for name, limit in self.limits.items():
            self.forces[name] = self._force(f"freedom_{limit.index}", limit)
            self.forces[name].setName(f"limit_{len(self.forces)}")
            built.model.addForce(self.forces[name])

    def _force(self, coordinate: str, limit: Limit) -> osim.CoordinateLimitForce:
        lower, end = limit.sense > 0, limit.value * _DEGREE
        upper_end, lower_end = (_FAR, end) if lower else (end, -_FAR)
        k = self.stiffness
        return osim.CoordinateLimitForce(
            coordinate, upper_end, k, lower_end, k, self.damping, self.width, False
        )

    def step(self) -> None:
        """One interval of the integrator."""
        after = self.motion.integrated(osim.State(self.present), self.motion.timestep)
        # A copied state keeps the places of bodies that its original had: the numbers are set anew.
        self._place(*self.built.coordinates_of(after))

    def _place(self, q: FloatArray, u: FloatArray) -> None:
        self.built.place(q, u, self.present)
        self.built.model.realizeAcceleration(self.present)

    def state(self) -> State:
        """The mechanism's coordinates and speeds."""
        return self.built.coordinates_of(self.present)

    def contacts(self) -> Mapping[str, float]:
        """Torques of the limits."""
        torques = {name: force.calcLimitForce(self.present) for name, force in self.forces.items()}
        return {
            name: max(0.0, self.limits[name].sense * torque) for name, torque in torques.items()
        }

    def observe(self) -> Observation:
        """Readings of the model."""
        return self.motion.reader.observe(self.present)
