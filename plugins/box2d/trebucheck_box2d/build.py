"""The Box2D world of a mechanism: rigid bodies about their centres of mass, and joints.

Box2D's angles are anticlockwise, and all its numbers are of single precision.
"""

from __future__ import annotations

from typing import Any

import Box2D
import numpy as np
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import (
    GROUND,
    AnyJoint,
    AnyStop,
    FreeJoint,
    PinJoint,
    Stop,
    WeldJoint,
)
from trebucheck.models.errors import UnsupportedProblemError
from trebucheck.models.kinematics import Kinematics, initial_state
from trebucheck.models.mechanism import Mechanism
from trebucheck_toolkit.joint_coordinates import Limit

Vector = tuple[float, float]
WIDE = 1e6  # [rad] a limit that is never met


class Built:
    """A mechanism's world."""

    def __init__(self, mechanism: Mechanism) -> None:
        """Build the world; a body without inertia is one that Box2D never turns."""
        self.mechanism = mechanism
        self.world: Any = Box2D.b2World(gravity=mechanism.gravity_vector, doSleep=False)
        self.ground: Any = self.world.CreateStaticBody(position=(0.0, 0.0))
        self.bodies: dict[str, Any] = {GROUND: self.ground}
        self.centres: dict[str, Vector] = {GROUND: (0.0, 0.0)} | {
            b.name: b.centre for b in mechanism.bodies
        }
        self._add_bodies()
        self.joints = {
            joint.name: self._joint(joint)
            for joint in mechanism.joints
            if not isinstance(joint, FreeJoint)
        }
        self.pins = [self.joints[joint.name] for joint in self._pins]
        """Revolute joints, those that close loops among them."""

    def anchor(self, body: str, point: Vector) -> Vector:
        """A point of a body in Box2D's frame, which lies at the centre of mass."""
        centre = self.centres[body]
        return point[0] - centre[0], point[1] - centre[1]

    def limit(self, stop: AnyStop, set_back: float = 0.0) -> Limit:
        """A stop as the end of a pin's range, anticlockwise, lying beyond it by an angle [rad].

        Raises:
            UnsupportedProblemError: it is on no pin.
        """
        for index, joint in enumerate(self._pins):
            if isinstance(stop, Stop) and {joint.parent, joint.child} == {
                stop.body,
                stop.relative_to,
            }:
                sense = -stop.sense if stop.body == joint.child else stop.sense
                return Limit(index, sense, sense * (stop.limit + set_back))
        raise UnsupportedProblemError(
            f"box2d has limits on revolute joints alone, and stop {stop.name!r} is on none."
        )

    @property
    def _pins(self) -> list[AnyJoint]:
        return [joint for joint in self.mechanism.joints if isinstance(joint, PinJoint)]

    def _add_bodies(self) -> None:
        mechanism, kinematics = self.mechanism, Kinematics(self.mechanism)
        q, u = initial_state(mechanism)
        for body in mechanism.bodies:
            row, angle = kinematics.point(body.name, body.centre), kinematics.angle(body.name)
            made = self.world.CreateDynamicBody(
                position=kinematics.position(row, q).tolist(),
                angle=-float(angle.value(q)),
                linearVelocity=kinematics.velocity(row, q, u).tolist(),
                angularVelocity=-float(angle.coefficients @ u),
                linearDamping=0.0,
                angularDamping=0.0,
                allowSleep=False,
            )
            made.massData = Box2D.b2MassData(mass=body.mass, center=(0.0, 0.0), I=body.inertia)
            self.bodies[body.name] = made

    def _joint(self, joint: AnyJoint) -> Any:
        first, second = self.bodies[joint.parent], self.bodies[joint.child]
        ends: dict[str, Any] = {
            "bodyA": first,
            "bodyB": second,
            "localAnchorA": self.anchor(joint.parent, joint.parent_point),
            "localAnchorB": self.anchor(joint.child, joint.child_point),
        }
        turned = -(joint.turned_by or 0.0)
        if isinstance(joint, PinJoint):
            return self.world.CreateRevoluteJoint(
                **ends, referenceAngle=0.0, lowerAngle=-WIDE, upperAngle=WIDE
            )
        if isinstance(joint, WeldJoint):
            return self.world.CreateWeldJoint(**ends, referenceAngle=turned)
        if joint.holds_angle:
            return self.world.CreatePrismaticJoint(
                **ends, localAxisA=joint.axis, referenceAngle=turned
            )
        # A wheel joint slides along its axis and turns. Without a spring (frequency 0) it
        # multiplies zero by numbers that it has not set (erincatto/box2d#491), which may be no
        # numbers; the force of this one is below rounding.
        return self.world.CreateWheelJoint(
            **ends, localAxisA=joint.axis, frequencyHz=1e-9, dampingRatio=0.0
        )


def turned(angle: float) -> FloatArray:
    """Rotation by an angle, anticlockwise [rad]."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
