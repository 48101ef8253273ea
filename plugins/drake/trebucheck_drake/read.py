"""Readings of a Drake plant in a context."""

from __future__ import annotations

from typing import Any

import numpy as np
from trebucheck.models.arrays import FloatArray
from trebucheck_toolkit.event_driver import Observation

from .build import Built


class Reader:
    """Reads points, energies and reactions of a built plant."""

    def __init__(self, built: Built) -> None:
        self.built, self.plant = built, built.plant
        self._markers = [(m.name, m.body, np.array(m.point)) for m in built.mechanism.markers]
        self._held = [
            (joint.name, built.carriers[joint.name], int(built.carriers[joint.name].index()))
            for joint in built.mechanism.tree_joints
            if joint.held_directions
        ]

    def observe(self, context: Any, forces: Any = None) -> Observation:
        """Readings of the plant; reactions by `reaction_forces`, without what acts beyond.

        Args:
            context: the plant's.
            forces: what `reaction_forces` gives, if it has been evaluated.
        """
        if forces is None:
            forces = self.plant.get_reaction_forces_output_port().Eval(context)
        return Observation(
            points={name: self._point(context, *place) for name, *place in self._markers},
            kinetic_energy=float(self.plant.CalcKineticEnergy(context)),
            potential_energy=float(self.plant.CalcPotentialEnergy(context)),
            reactions=self._reactions(context, forces),
        )

    def centre(self, context: Any, body: str) -> FloatArray:
        """World position of a body's centre of mass [m]."""
        return self._point(context, body, np.array(self.built.mechanism.body(body).centre))[0]

    def _point(self, context: Any, body: str, point: FloatArray) -> tuple[FloatArray, FloatArray]:
        link = self.built.bodies[body]
        pose = self.plant.EvalBodyPoseInWorld(context, link)
        motion = self.plant.EvalBodySpatialVelocityInWorld(context, link)
        arm = in_plane(pose.rotation()) @ point
        turning = motion.rotational()[2] * np.array([-arm[1], arm[0]])
        return pose.translation()[:2] + arm, motion.translational()[:2] + turning

    def _reactions(self, context: Any, forces: Any) -> dict[str, FloatArray]:
        return {
            name: in_plane(carrier.frame_on_child().CalcPoseInWorld(context).rotation())
            @ forces[index].translational()[:2]
            for name, carrier, index in self._held
        }


def in_plane(turned: Any) -> FloatArray:
    """A rotation about z as a matrix; it is faster than Drake's product with a vector."""
    return turned.matrix()[:2, :2]
