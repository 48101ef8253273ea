"""Readings of a Drake plant in a context."""

from __future__ import annotations

from typing import Any

import numpy as np
from trebucheck.models.arrays import FloatArray
from trebucheck_toolkit.event_driver import Observation

from .build import Built, in_space


class Reader:
    """Reads points, energies and reactions of a built plant."""

    def __init__(self, built: Built) -> None:
        self.built, self.plant = built, built.plant

    def observe(self, context: Any, forces: Any = None) -> Observation:
        """Readings of the plant; reactions by `reaction_forces`, without what acts beyond.

        Args:
            context: the plant's.
            forces: what `reaction_forces` gives, if it has been evaluated.
        """
        if forces is None:
            forces = self.plant.get_reaction_forces_output_port().Eval(context)
        mechanism = self.built.mechanism
        return Observation(
            points={m.name: self._point(context, m.body, m.point) for m in mechanism.markers},
            kinetic_energy=float(self.plant.CalcKineticEnergy(context)),
            potential_energy=float(self.plant.CalcPotentialEnergy(context)),
            reactions=self._reactions(context, forces),
        )

    def centre(self, context: Any, body: str) -> FloatArray:
        """World position of a body's centre of mass [m]."""
        return self._point(context, body, self.built.mechanism.body(body).centre)[0]

    def _point(
        self, context: Any, body: str, point: tuple[float, float]
    ) -> tuple[FloatArray, FloatArray]:
        link, place = self.built.bodies[body], in_space(point)
        pose = self.plant.EvalBodyPoseInWorld(context, link)
        motion = self.plant.EvalBodySpatialVelocityInWorld(context, link)
        arm = pose.rotation() @ place
        turning = motion.rotational()[2] * np.array([-arm[1], arm[0]])
        return (pose.translation() + arm)[:2], motion.translational()[:2] + turning

    def _reactions(self, context: Any, forces: Any) -> dict[str, FloatArray]:
        found: dict[str, FloatArray] = {}
        for joint in self.built.mechanism.tree_joints:
            if joint.held_directions:
                carrier = self.built.carriers[joint.name]
                turned = carrier.frame_on_child().CalcPoseInWorld(context).rotation()
                found[joint.name] = (turned @ forces[int(carrier.index())].translational())[:2]
        return found
