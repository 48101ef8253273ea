"""Readings of an OpenSim model in a state."""

from __future__ import annotations

import numpy as np
import opensim as osim
from trebucheck.models.arrays import FloatArray
from trebucheck_toolkit.event_driver import Observation

from .build import Built, in_space


class Reader:
    """Reads points, energies and reactions of a built model."""

    def __init__(self, built: Built) -> None:
        self.built = built

    def observe(self, state: osim.State) -> Observation:
        """Readings of the model; reactions without what acts on the bodies beyond their joints."""
        model, mechanism = self.built.model, self.built.mechanism
        model.realizeAcceleration(state)
        return Observation(
            points={m.name: self._point(state, m.body, m.point) for m in mechanism.markers},
            kinetic_energy=model.calcKineticEnergy(state),
            potential_energy=model.calcPotentialEnergy(state),
            reactions={
                j.name: self._reaction(state, j.name)
                for j in mechanism.tree_joints
                if j.held_directions
            },
        )

    def centre(self, state: osim.State, body: str) -> FloatArray:
        """World position of a body's centre of mass [m]."""
        return self._point(state, body, self.built.mechanism.body(body).centre)[0]

    def _point(
        self, state: osim.State, body: str, point: tuple[float, float]
    ) -> tuple[FloatArray, FloatArray]:
        link, place = self.built.bodies[body], in_space(point)
        at, velocity = (
            link.findStationLocationInGround(state, place),
            link.findStationVelocityInGround(state, place),
        )
        return _plane(at), _plane(velocity)

    def _reaction(self, state: osim.State, joint: str) -> FloatArray:
        return _plane(self.built.joints[joint].calcReactionOnChildExpressedInGround(state).get(1))


def _plane(vector: osim.Vec3) -> FloatArray:
    return np.array([vector.get(0), vector.get(1)])
