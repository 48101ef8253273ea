"""The scene of a mechanism: bodies about their centres of mass, and joints between them, as node/move.cjs reads it.

Rapier's angles are anticlockwise: the scene is the mirror image with y downwards, where clockwise ones are so. Every
body stands at the angle 0 at the start, so that its limits are measured from there.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from trebucheck.models.arrays import FloatArray
from trebucheck.models.errors import UnsupportedProblemError
from trebucheck.models.force_elements import AnyForceElement, ConstantForce, ConstantTorque, SpringDamper
from trebucheck.models.joints import GROUND, AnyJoint, FreeJoint, PinJoint, SlotJoint, WeldJoint
from trebucheck.models.kinematics import Kinematics, initial_state
from trebucheck.models.mechanism import Body, Mechanism
from trebucheck.models.stops import AnyStop, Stop

Json = dict[str, Any]
Vector = tuple[float, float]
MIRROR = np.array([1.0, -1.0])


def turned(angle: float | FloatArray, vector: FloatArray) -> FloatArray:
    """A mirrored vector turned by an angle, shape (..., 2)."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.stack([cos * vector[0] - sin * vector[1], sin * vector[0] + cos * vector[1]], axis=-1)


class Built:
    """A mechanism's scene; carriages of slots come after its bodies."""

    def __init__(self, mechanism: Mechanism, carriage: float) -> None:
        """Make the scene.

        Args:
            mechanism: what is built; each body has an inertia.
            carriage: mass of the body in a slot, as a part of that of the body it carries.
        """
        self.mechanism, self.carriage = mechanism, carriage
        self.kinematics, (self.q, self.u) = Kinematics(mechanism), initial_state(mechanism)
        self.index = {GROUND: -1} | {body.name: i for i, body in enumerate(mechanism.bodies)}
        self.angles = {name: float(self.kinematics.angle(name).value(self.q)) for name in self.index}
        self.bodies = [self._body(body) for body in mechanism.bodies]
        self.joints: list[Json] = []
        self.pins: dict[tuple[str, str], int] = {}
        for joint in mechanism.joints:
            self._join(joint)

    def scene(self, once: bool) -> Json:
        """All that node/move.cjs reads of it; under release-once open stops are left out."""
        stops = [stop for stop in self.mechanism.stops if stop.closed or not once]
        return {
            "bodies": self.bodies,
            "joints": self.joints,
            "stops": [self._stop(stop) for stop in stops],
            "once": once,
            "gravity": (np.array(self.mechanism.gravity_vector) * MIRROR).tolist(),
            "loads": [self._load(element) for element in self.mechanism.force_elements],
        }

    def offset(self, body: str, point: Vector) -> FloatArray:
        """From a body's centre of mass to a point of it, at the start; of the ground the point."""
        centre = (0.0, 0.0) if body == GROUND else self.mechanism.body(body).centre
        return turned(self.angles[body], np.subtract(point, centre) * MIRROR)

    def axis(self, joint: AnyJoint) -> FloatArray:
        """Of a slide, at the start."""
        direction = joint.free_directions[0]
        return turned(self.angles[joint.parent], np.array([direction.real, direction.imag]) * MIRROR)

    def _body(self, body: Body) -> Json:
        row = self.kinematics.point(body.name, body.centre)
        return {
            "position": (self.kinematics.position(row, self.q) * MIRROR).tolist(),
            "velocity": (self.kinematics.velocity(row, self.q, self.u) * MIRROR).tolist(),
            "speed": float(self.kinematics.angle(body.name).coefficients @ self.u),
            "mass": body.mass,
            "inertia": body.inertia,
        }

    def _lever(self, body: Body) -> float:
        points = [joint.child_point for joint in self.mechanism.joints if joint.child == body.name]
        points += [joint.parent_point for joint in self.mechanism.joints if joint.parent == body.name]
        return max(float(np.hypot(*np.subtract(point, body.centre))) for point in points) or 1.0

    def _join(self, joint: AnyJoint) -> None:
        if isinstance(joint, FreeJoint):
            return
        own: Json = {"a": self.index[joint.parent], "b": self.index[joint.child]}
        own["pointA"] = self.offset(joint.parent, joint.parent_point).tolist()
        own["pointB"] = self.offset(joint.child, joint.child_point).tolist()
        if isinstance(joint, PinJoint | SlotJoint):
            if isinstance(joint, SlotJoint):
                rider = self._add_carriage(joint)
                self.joints.append(own | {"kind": "slide", "axis": self.axis(joint).tolist()} | rider)
                own |= {"a": rider["b"], "pointA": [0.0, 0.0]}
            self.pins[joint.parent, joint.child] = len(self.joints)
            self.joints.append(own | {"kind": "pin"})
        elif isinstance(joint, WeldJoint):
            self.joints.append(own | {"kind": "weld"})
        else:
            self.joints.append(own | {"kind": "slide", "axis": self.axis(joint).tolist()})

    def _add_carriage(self, joint: SlotJoint) -> Json:
        """A small body in a slot, which the child is pinned to: Rapier has no joint that both slides and turns."""
        row, child = self.kinematics.point(joint.child, joint.child_point), self.mechanism.body(joint.child)
        mass = self.carriage * child.mass
        self.bodies.append({
            "position": (self.kinematics.position(row, self.q) * MIRROR).tolist(),
            "velocity": (self.kinematics.velocity(row, self.q, self.u) * MIRROR).tolist(),
            "speed": float(self.kinematics.angle(joint.parent).coefficients @ self.u),
            "mass": mass,
            "inertia": mass * self._lever(child) ** 2,
        })  # fmt: skip
        return {"b": len(self.bodies) - 1, "pointB": [0.0, 0.0]}

    def _stop(self, stop: AnyStop) -> Json:
        """The limit of a pin: side 1 is the least of the child's angle less the parent's, from the start."""
        for (parent, child), joint in self.pins.items():
            if isinstance(stop, Stop) and {parent, child} == {stop.body, stop.relative_to}:
                side = stop.sense if child == stop.body else -stop.sense
                between = self.angles[stop.body] - self.angles[stop.relative_to]
                gap = 0.0 if stop.closed else stop.sense * between - stop.limit
                return {"joint": joint, "side": side, "angle": -side * gap}
        raise UnsupportedProblemError(f"rapier has limits on pins alone, and stop {stop.name!r} is on none.")

    def _load(self, element: AnyForceElement) -> Json:
        own: Json = {"kind": element.kind, "body": self.index[element.body]}
        if isinstance(element, ConstantForce):
            force = (np.array(element.force) * MIRROR).tolist()
            return own | {"point": self.offset(element.body, element.point).tolist(), "force": force}
        return own | {"other": self.index[element.relative_to]} | dict(self._pair(element))

    def _pair(self, element: Any) -> Iterator[tuple[str, Any]]:
        yield "torque", element.torque if isinstance(element, ConstantTorque) else 0.0
        held = not isinstance(element, ConstantTorque)
        yield "stiffness", element.stiffness if held else 0.0
        yield "damping", element.damping if held else 0.0
        if isinstance(element, SpringDamper):
            yield "rest", element.rest_length
            yield "point", self.offset(element.body, element.point).tolist()
            yield "otherPoint", self.offset(element.relative_to, element.relative_point).tolist()
        else:
            start = self.angles[element.body] - self.angles[element.relative_to]
            yield "rest", element.rest_angle - start if held else 0.0
