"""Readings of a Box2D world in its present state, as quantities of the mechanism."""

from __future__ import annotations

import numpy as np
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import GROUND, AnyJoint, FreeJoint
from trebucheck_toolkit.event_driver import Observation
from trebucheck_toolkit.schemes import State

from .build import Built, turned


class Reader:
    """Reads coordinates, points and energies."""

    def __init__(self, built: Built) -> None:
        self.built, self.mechanism = built, built.mechanism

    def state(self) -> State:
        """Angles clockwise, slides along their axes from Box2D's points and their speeds."""
        q, u = dict[str, float](), dict[str, float]()
        for body in self.mechanism.bodies:
            if body.angle is not None:
                q[body.angle] = -self.built.bodies[body.name].angle
                u[body.angle] = -self.built.bodies[body.name].angularVelocity
        for joint in self.mechanism.tree_joints:
            child, parent = (
                self.point(joint.child, joint.child_point),
                self.point(joint.parent, joint.parent_point),
            )
            apart, speed = child[0] - parent[0], child[1] - parent[1]
            turning = self.turning(joint.parent)
            for name, direction in zip(joint.slides, joint.free_directions, strict=True):
                axis = turned(self.angle(joint.parent)) @ np.array([direction.real, direction.imag])
                q[name] = float(axis @ apart)
                u[name] = float(axis @ speed + turning * (np.array([-axis[1], axis[0]]) @ apart))
        names = self.mechanism.coordinates
        return np.array([q[name] for name in names]), np.array([u[name] for name in names])

    def look(self) -> Observation:
        """Points, energies and the drift of joints."""
        kinetic = potential = 0.0
        gravity = np.array(self.mechanism.gravity_vector)
        for body in self.mechanism.bodies:
            made = self.built.bodies[body.name]
            speed = np.array(made.linearVelocity)
            kinetic += 0.5 * (
                made.mass * float(speed @ speed) + made.inertia * made.angularVelocity**2
            )
            potential -= made.mass * float(gravity @ np.array(made.worldCenter))
        return Observation(
            points={
                each.name: self.point(each.body, each.point) for each in self.mechanism.markers
            },
            kinetic_energy=kinetic,
            potential_energy=potential,
            gaps={
                joint.name: self._gap(joint)
                for joint in self.mechanism.joints
                if not isinstance(joint, FreeJoint)
            },
        )

    def _gap(self, joint: AnyJoint) -> float:
        apart = (
            self.point(joint.child, joint.child_point)[0]
            - self.point(joint.parent, joint.parent_point)[0]
        )
        held = [
            turned(self.angle(joint.parent)) @ np.array([complex(d).real, complex(d).imag])
            for d in joint.held_directions
        ]
        return float(np.linalg.norm([direction @ apart for direction in held]))

    def angle(self, name: str) -> float:
        """Angle of a body, anticlockwise [rad]."""
        return float(self.built.bodies[name].angle)

    def turning(self, name: str) -> float:
        """Angular velocity of a body, anticlockwise [rad/s]."""
        return float(self.built.bodies[name].angularVelocity)

    def point(self, name: str, point: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
        """Position and velocity of a body's point, from Box2D's of its centre."""
        made = self.built.bodies[name]
        arm = turned(made.angle) @ np.array(self.built.anchor(name, point))
        if name == GROUND:
            return arm, np.zeros(2)
        return np.array(made.worldCenter) + arm, np.array(
            made.linearVelocity
        ) + made.angularVelocity * np.array([-arm[1], arm[0]])
