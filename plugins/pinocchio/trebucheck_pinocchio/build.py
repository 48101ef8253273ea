"""The Pinocchio model of a mechanism: a joint tree in the x-y plane, turning about -z (clockwise).

Each body is on the last of its joints: a prismatic one for every slide, then a revolute one if it
turns. That joint's frame has the body's directions and lies at its `child_point`. A welded body is
part of the joint of its parent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from trebucheck.models.elements import GROUND, AnyJoint
from trebucheck.models.mechanism import Body, Mechanism
from trebucheck_toolkit.joint_coordinates import JointCoordinates

_CLOCKWISE = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True)
class Place:
    """Pose of a body's frame."""

    joint: int
    """Pinocchio's joint that carries the body."""
    frame: Any
    """Placement of the body in the frame of that joint (SE3)."""


class Built:
    """A mechanism's model with its data."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self.coordinates = JointCoordinates(mechanism)
        self.model: Any = pin.Model()
        self.model.gravity.linear = np.array([*mechanism.gravity_vector, 0.0])
        self.places = {GROUND: Place(0, pin.SE3.Identity())}
        # Pinocchio takes a subtree for a range of joints: bodies are added depth first.
        for body, joint in self.coordinates.links:
            self._add(body, joint)
        self.markers = {m.name: self._add_frame(m.name, m.body, m.point) for m in mechanism.markers}
        self.centres = {
            b.name: self._add_frame(f"centre of {b.name}", b.name, b.centre)
            for b in mechanism.bodies
        }
        self.data: Any = self.model.createData()

    def _add(self, body: Body, joint: AnyJoint) -> None:
        parent = self.places[joint.parent]
        at = parent.frame * pin.SE3(_turned(joint.turned_by or 0.0), _in_space(joint.parent_point))
        carrier = parent.joint
        for direction in joint.free_directions:
            axis = (
                at.rotation.T @ parent.frame.rotation @ _in_space((direction.real, direction.imag))
            )
            carrier = self._add_joint(
                carrier, pin.JointModelPrismaticUnaligned(axis), at, joint.name
            )
            at = pin.SE3.Identity()
        if body.angle is not None:
            carrier = self._add_joint(
                carrier, pin.JointModelRevoluteUnaligned(_CLOCKWISE), at, joint.name
            )
            at = pin.SE3.Identity()
        frame = at * pin.SE3(np.eye(3), -_in_space(joint.child_point))
        inertia = pin.Inertia(body.mass, _in_space(body.centre), np.diag([0.0, 0.0, body.inertia]))
        self.model.appendBodyToJoint(carrier, inertia, frame)
        self.places[body.name] = Place(carrier, frame)

    def _add_joint(self, parent: int, model: Any, at: Any, name: str) -> int:
        return int(self.model.addJoint(parent, model, at, f"{name} {self.model.njoints}"))

    def _add_frame(self, name: str, body: str, point: tuple[float, float]) -> int:
        place = self.places[body]
        at = place.frame * pin.SE3(np.eye(3), _in_space(point))
        return int(self.model.addFrame(pin.Frame(name, place.joint, 0, at, pin.FrameType.OP_FRAME)))


def _in_space(point: tuple[float, float]) -> Any:
    return np.array([*point, 0.0])


def _turned(angle: float) -> Any:
    """Rotation by an angle, positive clockwise [rad]."""
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
