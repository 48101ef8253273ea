"""A mechanism as a DART skeleton: its dynamics, and what it shows."""

from __future__ import annotations

import numpy as np
from trebucheck.models.arrays import FloatArray
from trebucheck.models.mechanism import Mechanism
from trebucheck_toolkit.event_driver import Observation
from trebucheck_toolkit.joint_coordinates import JointCoordinates

from .build import Skeleton


class DartTree:
    """A skeleton in a world of its own."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism, self.coordinates = mechanism, JointCoordinates(mechanism)
        built = Skeleton(self.coordinates)
        self.skeleton, self.bodies, self.place = built.skeleton, built.bodies, built.place
        built.world.addSkeleton(self.skeleton)
        self.world = built.world
        self.markers = {each.name: (each.body, _in_space(each.point)) for each in mechanism.markers}

    # --- Dynamics
    # ---------------------------------------------------------------------------------------------

    def mass_matrix(self, j: FloatArray) -> FloatArray:
        """Mass matrix by `getMassMatrix`."""
        self.skeleton.setPositions(j)
        return np.array(self.skeleton.getMassMatrix())

    def bias(self, j: FloatArray, v: FloatArray) -> FloatArray:
        """Bias forces by `getCoriolisAndGravityForces`."""
        self.place(j, v)
        return np.array(self.skeleton.getCoriolisAndGravityForces())

    def total_mass(self) -> float:
        """Mass of all bodies [kg]."""
        return float(self.skeleton.getMass())

    def centres(self, j: FloatArray) -> dict[str, FloatArray]:
        """Centre of mass of each body in the world [m]."""
        self.skeleton.setPositions(j)
        return {
            each.name: np.array(self.bodies[each.name].getCOM()[:2])
            for each in self.mechanism.bodies
        }

    # --- What it shows
    # ---------------------------------------------------------------------------------------------

    def observe(self, j: FloatArray, v: FloatArray, a: FloatArray) -> Observation:
        """Readings of the skeleton; reactions are the body forces of its inverse dynamics."""
        skeleton = self.skeleton
        self.place(j, v)
        skeleton.setAccelerations(a)
        skeleton.computeInverseDynamics()
        return Observation(
            points={name: self._point(*place) for name, place in self.markers.items()},
            kinetic_energy=float(skeleton.computeKineticEnergy()),
            potential_energy=float(skeleton.computePotentialEnergy()),
            reactions={
                joint.name: self._pose(joint.child)[:2, :2]
                @ self.bodies[joint.child].getBodyForce()[3:5]
                for joint in self.mechanism.tree_joints
            },
        )

    def _pose(self, name: str) -> FloatArray:
        return np.array(self.bodies[name].getWorldTransform().matrix())

    def _point(self, name: str, point: FloatArray) -> tuple[FloatArray, FloatArray]:
        pose = self._pose(name)
        return (pose[:3, :3] @ point + pose[:3, 3])[:2], np.array(
            self.bodies[name].getLinearVelocity(point)[:2]
        )


def _in_space(point: tuple[float, float]) -> FloatArray:
    return np.array([*point, 0.0])
