"""What is read of Rapier's bodies: their centres of mass, angles and the rates of both, back in the world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from trebucheck.engines.protocol import Recording
from trebucheck.models.applied_forces import AppliedForces
from trebucheck.models.arrays import FloatArray
from trebucheck.models.joints import GROUND, AnyJoint, FreeJoint
from trebucheck.models.stops import Stop
from trebucheck.models.trajectory import PointMotion

from .build import MIRROR, Built, Vector, turned

_GROWN = 27.0  # a release is looked back for from a gap of `opening` to this many times that


def _across(vectors: FloatArray) -> FloatArray:
    """A quarter turn on, shape (..., 2)."""
    return np.stack([-vectors[..., 1], vectors[..., 0]], axis=-1)


@dataclass(frozen=True)
class Motion:
    """Samples of the bodies, shape (n, bodies, 6), at the times t [s]."""

    built: Built
    t: FloatArray
    states: FloatArray

    def recording(self, opening: float) -> Recording:
        """What is compared; a stop has opened where its gap exceeds `opening` [rad]."""
        mechanism, (q, u) = self.built.mechanism, self._coordinates()
        closed = [stop for stop in mechanism.stops if stop.closed and isinstance(stop, Stop)]
        kinetic, potential = self._energies()
        return Recording(
            t=self.t,
            q=q,
            u=u,
            markers={each.name: self._marker(each.body, each.point) for each in mechanism.markers},
            kinetic_energy=kinetic,
            potential_energy=potential + AppliedForces(self.built.kinematics).potential_energy(q),
            stop_torques={},
            release_times={stop.name: self._release(stop, opening) for stop in closed},
            joint_gaps={joint.name: self._gap(joint) for joint in mechanism.joints if not isinstance(joint, FreeJoint)},
            steps=len(self.t) - 1,
        )

    def _angle(self, body: str) -> tuple[FloatArray, FloatArray]:
        """Clockwise, and its rate."""
        if body == GROUND:
            return np.zeros(len(self.t)), np.zeros(len(self.t))
        own = self.states[:, self.built.index[body]]
        return own[:, 2] + self.built.angles[body], own[:, 5]

    def _point(self, body: str, point: Vector) -> tuple[FloatArray, FloatArray]:
        """Place and velocity of a body's point, mirrored."""
        offset = self.built.offset(body, point)
        if body == GROUND:
            return np.tile(offset, (len(self.t), 1)), np.zeros((len(self.t), 2))
        own = self.states[:, self.built.index[body]]
        arm = turned(own[:, 2], offset)
        return own[:, :2] + arm, own[:, 3:5] + own[:, 5:] * _across(arm)

    def _marker(self, body: str, point: Vector) -> PointMotion:
        place, velocity = self._point(body, point)
        return PointMotion(place * MIRROR, velocity * MIRROR)

    def _coordinates(self) -> tuple[FloatArray, FloatArray]:
        mechanism, found = self.built.mechanism, dict[str, tuple[FloatArray, FloatArray]]()
        for body in mechanism.bodies:
            if body.angle is not None:
                found[body.angle] = self._angle(body.name)
        for joint in mechanism.tree_joints:
            for name, direction in zip(joint.slides, joint.free_directions, strict=True):
                found[name] = self._along(joint, complex(direction))
        q, u = zip(*(found[name] for name in mechanism.coordinates), strict=True)
        return np.stack(q, axis=1), np.stack(u, axis=1)

    def _along(self, joint: AnyJoint, direction: complex) -> tuple[FloatArray, FloatArray]:
        """From the parent's point to the child's along a direction of the parent [m], and its rate."""
        (child, velocity), (parent, carrying) = (
            self._point(joint.child, joint.child_point),
            self._point(joint.parent, joint.parent_point),
        )
        angle, speed = self._angle(joint.parent)
        axis, away = turned(angle, np.array([direction.real, direction.imag]) * MIRROR), child - parent
        rate = np.sum((velocity - carrying) * axis, axis=1) + speed * np.sum(away * _across(axis), axis=1)
        return np.sum(away * axis, axis=1), rate

    def _gap(self, joint: AnyJoint) -> FloatArray:
        held = [self._along(joint, complex(direction))[0] for direction in joint.held_directions]
        return np.sqrt(np.sum(np.square(held), axis=0))

    def _energies(self) -> tuple[FloatArray, FloatArray]:
        """Kinetic, and potential of gravity, by the masses and inertias that Rapier was given."""
        mechanism = self.built.mechanism
        own, bodies = self.states[:, : len(mechanism.bodies)], self.built.bodies[: len(mechanism.bodies)]
        mass, inertia = np.array([b["mass"] for b in bodies]), np.array([b["inertia"] for b in bodies])
        kinetic = 0.5 * (np.sum(own[..., 3:5] ** 2, axis=-1) @ mass + own[..., 5] ** 2 @ inertia)
        return kinetic, -(own[..., :2] @ (np.array(mechanism.gravity_vector) * MIRROR)) @ mass

    def _release(self, stop: Stop, opening: float) -> float | None:
        """When a gap opened, which Rapier does not tell: the torque has fallen through zero, so it grows by t^3."""
        gap = stop.sense * (self._angle(stop.body)[0] - self._angle(stop.relative_to)[0]) - stop.limit
        if not np.any(gap > opening):
            return None
        first = int(np.argmax(gap > opening))
        beyond = gap[first:] > _GROWN * opening
        last = first + max(int(np.argmax(beyond)) if beyond.any() else len(beyond), 2)
        if last > len(gap):
            return float(self.t[first - 1])
        start = np.polyfit(np.cbrt(gap[first:last]), self.t[first:last], 1)[1]
        return float(np.clip(start, 0.0, self.t[first]))
