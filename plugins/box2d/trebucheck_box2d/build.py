"""The Box2D world of a mechanism: rigid bodies about their centres of mass, and joints.

Box2D's angles are anticlockwise, and all its numbers are of single precision. What is built is a
plan first: arguments of Box2D's own functions, from which :mod:`.alone` writes a program.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any

import Box2D
import numpy as np
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import (
    GROUND,
    JOINTS,
    AnyJoint,
    AnyStop,
    ElementTable,
    FreeJoint,
    PinJoint,
    PrismaticJoint,
    SlotJoint,
    Stop,
    TranslationJoint,
    WeldJoint,
)
from trebucheck.models.errors import UnsupportedProblemError
from trebucheck.models.kinematics import Kinematics, initial_state
from trebucheck.models.mechanism import Body, Mechanism
from trebucheck_toolkit.joint_coordinates import Limit

Vector = tuple[float, float]
WIDE = 1e6  # [rad] a limit that is never met


@dataclass(frozen=True)
class BodyPlan:
    """A dynamic body, whose frame is at its centre of mass."""

    name: str
    mass: float  # [kg]
    inertia: float  # about the centre of mass [kg m^2]
    arguments: Mapping[str, Any]  # of CreateDynamicBody


@dataclass(frozen=True)
class JointPlan:
    """A joint between two bodies."""

    name: str
    kind: str  # Revolute, Weld, Prismatic or Wheel, as in CreateRevoluteJoint
    parent: str
    child: str
    arguments: Mapping[str, Any]  # of that function, without the bodies


class Plan:
    """Bodies, joints and limits that Box2D is to build for a mechanism.

    Args:
        mechanism: a body without inertia is one that Box2D never turns.
        stops: those that are limits of pins.
        set_back: angle by which limits lie beyond their stops [rad].
        allow_sleep: whether bodies at rest are let sleep.

    Raises:
        UnsupportedProblemError: a stop is on no pin.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        stops: Collection[AnyStop] = (),
        *,
        set_back: float = 0.0,
        allow_sleep: bool = False,
    ) -> None:
        self.mechanism = mechanism
        self.gravity = mechanism.gravity_vector
        self.centres: dict[str, Vector] = {GROUND: (0.0, 0.0)} | {
            b.name: b.centre for b in mechanism.bodies
        }
        self.pins = [joint.name for joint in mechanism.joints if isinstance(joint, PinJoint)]
        """Names of the revolute joints, those that close loops among them."""
        self.limits = {stop.name: self._limit(stop, set_back) for stop in stops}
        """Ends of ranges, anticlockwise; their index is that of a pin."""
        limited = {
            self.pins[index]: {"enableLimit": True, "lowerAngle": low, "upperAngle": high}
            for index, (low, high) in self.ranges(self.limits.values()).items()
        }
        kinematics, (q, u) = Kinematics(mechanism), initial_state(mechanism)
        # Box2D 2.3.10 lets bodies of a world with `doSleep=False` sleep all the same.
        sleep = {} if allow_sleep else {"allowSleep": False}
        self.bodies = [_body(body, kinematics, q, u, sleep) for body in mechanism.bodies]
        self.joints: list[JointPlan] = []
        for joint in mechanism.joints:
            kind, arguments = _JOINTS[joint](joint)
            if kind is not None:
                arguments = self._ends(joint) | arguments | limited.get(joint.name, {})
                self.joints.append(
                    JointPlan(joint.name, kind, joint.parent, joint.child, arguments)
                )

    @staticmethod
    def ranges(limits: Collection[Limit]) -> dict[int, Vector]:
        """Least and greatest angle of each pin with limits [rad]."""
        return {
            index: (max(low, -WIDE), min(high, WIDE))
            for index, (low, high) in Limit.ranges(limits).items()
        }

    def anchor(self, body: str, point: Vector) -> Vector:
        """A point of a body in Box2D's frame, which lies at the centre of mass."""
        centre = self.centres[body]
        return point[0] - centre[0], point[1] - centre[1]

    def place(self, body: str, point: Vector) -> complex:
        """The same as a complex number."""
        return complex(*self.anchor(body, point))

    def direction(self, _: str, vector: Vector) -> complex:
        """A vector of a body in Box2D's frame, which is not turned."""
        return complex(*vector)

    def turn(self, _: str) -> float:
        """Clockwise angle of a body where Box2D's is zero [rad]."""
        return 0.0

    def _limit(self, stop: AnyStop, set_back: float) -> Limit:
        """A stop as the end of a pin's range, anticlockwise, lying beyond it by an angle [rad]."""
        pins = (joint for joint in self.mechanism.joints if isinstance(joint, PinJoint))
        for index, joint in enumerate(pins):
            if isinstance(stop, Stop) and {joint.parent, joint.child} == {
                stop.body,
                stop.relative_to,
            }:
                sense = -stop.sense if stop.body == joint.child else stop.sense
                return Limit(index, sense, sense * (stop.limit + set_back))
        raise UnsupportedProblemError(
            f"our adapter builds stops for box2d as limits of its revolute joints, and stop "
            f"{stop.name!r} is on none."
        )

    def _ends(self, joint: AnyJoint) -> dict[str, Any]:
        return {
            "localAnchorA": self.anchor(joint.parent, joint.parent_point),
            "localAnchorB": self.anchor(joint.child, joint.child_point),
        }


def _body(
    body: Body, kinematics: Kinematics, q: FloatArray, u: FloatArray, more: Mapping[str, Any]
) -> BodyPlan:
    row, angle = kinematics.point(body.name, body.centre), kinematics.angle(body.name)
    arguments = {
        "position": tuple(kinematics.position(row, q).tolist()),
        "angle": -float(angle.value(q)),
        "linearVelocity": tuple(kinematics.velocity(row, q, u).tolist()),
        "angularVelocity": -float(angle.coefficients @ u),
        **more,
    }
    return BodyPlan(body.name, body.mass, body.inertia, arguments)


_Made = tuple[str | None, dict[str, Any]]
"""Kind of a joint, None for none, and arguments of its own."""


def _pin(joint: PinJoint) -> _Made:
    return "Revolute", {"referenceAngle": 0.0}


def _weld(joint: WeldJoint) -> _Made:
    return "Weld", {"referenceAngle": -joint.turned_by}


def _slide(joint: PrismaticJoint) -> _Made:
    return "Prismatic", {"localAxisA": joint.axis, "referenceAngle": -joint.turned_by}


def _slot(joint: SlotJoint) -> _Made:
    # A wheel joint slides along its axis and turns. Without a spring (frequency 0) it multiplies
    # zero by numbers that it has not set (erincatto/box2d#491), which may be no numbers; the force
    # of this one is below rounding.
    return "Wheel", {"localAxisA": joint.axis, "frequencyHz": 1e-9, "dampingRatio": 0.0}


def _free(joint: FreeJoint) -> _Made:
    return None, {}


_JOINTS: ElementTable[Callable[[Any], _Made]] = ElementTable(
    "Box2D's builder",
    JOINTS,
    {
        PinJoint: _pin,
        WeldJoint: _weld,
        PrismaticJoint: _slide,
        SlotJoint: _slot,
        FreeJoint: _free,
    },
    {TranslationJoint: "our adapter builds no joint that holds an angle alone"},
)


class Built:
    """A world made as planned."""

    def __init__(self, plan: Plan) -> None:
        self.plan, self.mechanism, self.centres = plan, plan.mechanism, plan.centres
        self.world: Any = Box2D.b2World(gravity=plan.gravity)
        self.bodies: dict[str, Any] = {GROUND: self.world.CreateStaticBody()}
        for body in plan.bodies:
            made = self.bodies[body.name] = self.world.CreateDynamicBody(**body.arguments)
            made.massData = Box2D.b2MassData(mass=body.mass, center=(0.0, 0.0), I=body.inertia)
        self.joints: dict[str, Any] = {}
        for joint in plan.joints:
            create = getattr(self.world, f"Create{joint.kind}Joint")
            ends = {"bodyA": self.bodies[joint.parent], "bodyB": self.bodies[joint.child]}
            self.joints[joint.name] = create(**ends, **joint.arguments)
        self.pins = [self.joints[name] for name in plan.pins]

    def anchor(self, body: str, point: Vector) -> Vector:
        """A point of a body in Box2D's frame."""
        return self.plan.anchor(body, point)


def turned(angle: float) -> FloatArray:
    """Rotation by an angle, anticlockwise [rad]."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
