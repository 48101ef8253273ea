"""Readings of an MJX model in a state: sensors, and energies by mass matrix and centres."""

from __future__ import annotations

import numpy as np
from trebucheck.engines.mujoco.read import IN_PLANE
from trebucheck.models.arrays import FloatArray
from trebucheck.models.mjcf.writer import mjcf_names, position_sensor, velocity_sensor
from trebucheck_toolkit.event_driver import Observation

from .build import Built, Seen


class Reader:
    """Reads points, energies and reactions of a built model."""

    def __init__(self, built: Built) -> None:
        self.built = built
        self.names = mjcf_names(built.mechanism)

    def observe(self, seen: Seen, q: FloatArray, u: FloatArray) -> Observation:
        """Readings of the model; reactions without what acts on the bodies beyond their joints."""
        mechanism, model = self.built.mechanism, self.built.model
        _, v = self.built.joint_state(q, u)
        weight = model.body_mass[:, None] * model.opt.gravity
        return Observation(
            points={
                m.name: (
                    self._value(seen, position_sensor(m.name)),
                    self._value(seen, velocity_sensor(m.name)),
                )
                for m in mechanism.markers
            },
            kinetic_energy=float(0.5 * v @ seen.mass @ v),
            potential_energy=-float(np.sum(weight * seen.centres)),
            reactions={
                joint.name: seen.internal[self._body(joint.child)][IN_PLANE]
                for joint in mechanism.tree_joints
                if joint.held_directions
            },
        )

    def centre(self, seen: Seen, body: str) -> FloatArray:
        """World position of a body's centre of mass [m]."""
        return seen.centres[self._body(body)][IN_PLANE]

    def _value(self, seen: Seen, sensor: str) -> FloatArray:
        start = int(self.built.model.sensor(self.names[sensor]).adr[0])
        return seen.sensors[start : start + 3][IN_PLANE]

    def _body(self, name: str) -> int:
        return int(self.built.model.body(self.names[name]).id)
