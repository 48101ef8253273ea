"""Samples of a scene's bodies (`node_scene.py`): centres of mass, angles, their rates."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from trebucheck.engines.events import whole_steps
from trebucheck.engines.protocol import Recording
from trebucheck.models.applied_forces import AppliedForces
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import GROUND, AnyJoint, FreeJoint, Stop
from trebucheck.models.spec import Vector
from trebucheck.models.trajectory import PointMotion

from .node_scene import MIRROR, NodeScene, turned


def sample_times(duration: float, timestep: float, *, fit: bool) -> FloatArray:
    """Times of the samples of whole steps [s].

    Args:
        duration: [s].
        timestep: [s].
        fit: whether the steps are a little shorter, so that the last one ends with the duration.
    """
    if fit:
        return np.linspace(0.0, duration, math.ceil(duration / timestep - 1e-9) + 1)
    return timestep * np.arange(whole_steps(duration, timestep) + 1, dtype=np.float64)


def _across(vectors: FloatArray) -> FloatArray:
    """A quarter turn on, shape (..., 2)."""
    return np.stack([-vectors[..., 1], vectors[..., 0]], axis=-1)


@dataclass(frozen=True)
class NodeSamples:
    """A scene's bodies at the times t [s].

    Args:
        scene: what was moved.
        t: shape (n,).
        states: of the bodies: x, y, angle and their rates, shape (n, bodies, 6).
    """

    scene: NodeScene
    t: FloatArray
    states: FloatArray

    def recording(self) -> Recording:
        """A recording from the bodies alone: no forces and no releases."""
        mechanism, (q, u) = self.scene.mechanism, self._coordinates()
        kinetic, potential = self._energies()
        return Recording(
            t=self.t,
            q=q,
            u=u,
            markers={each.name: self._marker(each.body, each.point) for each in mechanism.markers},
            kinetic_energy=kinetic,
            potential_energy=potential + AppliedForces(self.scene.kinematics).potential_energy(q),
            stop_torques={},
            release_times={},
            joint_gaps={
                joint.name: self._gap(joint)
                for joint in mechanism.joints
                if not isinstance(joint, FreeJoint)
            },
            steps=len(self.t) - 1,
        )

    def gap(self, stop: Stop) -> FloatArray:
        """Gap of a stop on an angle [rad]."""
        return (
            stop.sense * (self._angle(stop.body)[0] - self._angle(stop.relative_to)[0]) - stop.limit
        )

    def point(self, body: str, point: Vector) -> tuple[FloatArray, FloatArray]:
        """Place and velocity of a body's point, mirrored."""
        offset = self.scene.offset(body, point)
        if body == GROUND:
            return np.tile(offset, (len(self.t), 1)), np.zeros((len(self.t), 2))
        own = self.states[:, self.scene.index[body]]
        arm = turned(own[:, 2], offset)
        return own[:, :2] + arm, own[:, 3:5] + own[:, 5:] * _across(arm)

    def _angle(self, body: str) -> tuple[FloatArray, FloatArray]:
        """Clockwise, and its rate."""
        if body == GROUND:
            return np.zeros(len(self.t)), np.zeros(len(self.t))
        own = self.states[:, self.scene.index[body]]
        return own[:, 2] + self.scene.angles[body], own[:, 5]

    def _marker(self, body: str, point: Vector) -> PointMotion:
        place, velocity = self.point(body, point)
        return PointMotion(place * MIRROR, velocity * MIRROR)

    def _coordinates(self) -> tuple[FloatArray, FloatArray]:
        mechanism, found = self.scene.mechanism, dict[str, tuple[FloatArray, FloatArray]]()
        for body in mechanism.bodies:
            if body.angle is not None:
                found[body.angle] = self._angle(body.name)
        for joint in mechanism.tree_joints:
            for name, direction in zip(joint.slides, joint.free_directions, strict=True):
                found[name] = self._along(joint, complex(direction))
        q, u = zip(*(found[name] for name in mechanism.coordinates), strict=True)
        return np.stack(q, axis=1), np.stack(u, axis=1)

    def _along(self, joint: AnyJoint, direction: complex) -> tuple[FloatArray, FloatArray]:
        """Distance of a joint's points along a direction of the parent [m], and its rate."""
        (child, velocity), (parent, carrying) = (
            self.point(joint.child, joint.child_point),
            self.point(joint.parent, joint.parent_point),
        )
        angle, speed = self._angle(joint.parent)
        axis, away = (
            turned(angle, np.array([direction.real, direction.imag]) * MIRROR),
            child - parent,
        )
        rate = np.sum((velocity - carrying) * axis, axis=1) + speed * np.sum(
            away * _across(axis), axis=1
        )
        return np.sum(away * axis, axis=1), rate

    def _gap(self, joint: AnyJoint) -> FloatArray:
        held = [self._along(joint, complex(direction))[0] for direction in joint.held_directions]
        return np.sqrt(np.sum(np.square(held), axis=0))

    def _energies(self) -> tuple[FloatArray, FloatArray]:
        """Kinetic energy and that of gravity, by the masses that the engine was given."""
        mechanism = self.scene.mechanism
        own, bodies = (
            self.states[:, : len(mechanism.bodies)],
            self.scene.bodies[: len(mechanism.bodies)],
        )
        mass, inertia = (
            np.array([b["mass"] for b in bodies]),
            np.array([b["inertia"] for b in bodies]),
        )
        kinetic = 0.5 * (np.sum(own[..., 3:5] ** 2, axis=-1) @ mass + own[..., 5] ** 2 @ inertia)
        return kinetic, -(own[..., :2] @ (np.array(mechanism.gravity_vector) * MIRROR)) @ mass
