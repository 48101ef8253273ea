"""The Newton model of a mechanism: an articulation in the x-y plane, turning about -z (clockwise).

A slide is a prismatic joint; where the child turns as well, it is onto a link almost without mass,
which a revolute joint follows.
"""

from __future__ import annotations

import math
from typing import Any

import newton
import numpy as np
import warp as wp
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import GROUND, AnyJoint
from trebucheck.models.mechanism import Body, Mechanism
from trebucheck_toolkit.joint_coordinates import JointCoordinates

_CLOCKWISE = (0.0, 0.0, -1.0)
# Least mass of a carrier, relative to its body's, and least inertia, relative to m d^2 with d the
# centre's distance.
_LEAST = 1e-9


class Built:
    """Model of a mechanism; `bodies` and `joints` are Newton's indices by mechanism names."""

    def __init__(
        self, mechanism: Mechanism, limits: dict[int, tuple[float, float]], frequency: float
    ) -> None:
        """Build the model, with ranges of its coordinates and the limits' frequency [rad/s]."""
        self.mechanism, self.coordinates = mechanism, JointCoordinates(mechanism)
        self.limits, self.frequency = limits, frequency
        self.builder: Any = newton.ModelBuilder(gravity=(*mechanism.gravity_vector, 0.0))
        self.bodies = {GROUND: -1}
        self.joints: list[int] = []
        self.moving = 0
        for body, joint in self.coordinates.links:
            self._add(body, joint)
        self.builder.add_articulation(self.joints)
        self.model: Any = self.builder.finalize(device="cpu")

    def _add(self, body: Body, joint: AnyJoint) -> None:
        parent, turn, place = self.bodies[joint.parent], joint.turned_by or 0.0, joint.parent_point
        slides = list(joint.free_directions)
        for k, direction in enumerate(slides):
            last = k == len(slides) - 1 and body.angle is None
            child = self._link(body) if last else self._carrier(body, f"{joint.name} {k}")
            # The axis is in the joint's frame, which may be turned from the parent's.
            axis = direction * complex(math.cos(turn), math.sin(turn))
            ends = _ends(turn, place, joint.child_point if last else (0.0, 0.0))
            axis_in_space = (axis.real, axis.imag, 0.0)
            self.joints.append(
                self.builder.add_joint_prismatic(
                    parent, child, axis=axis_in_space, **ends, **self._range(body, joint)
                )
            )
            parent, turn, place = child, 0.0, (0.0, 0.0)
        if body.angle is not None:
            ends = _ends(turn, place, joint.child_point)
            child = self._link(body)
            self.joints.append(
                self.builder.add_joint_revolute(
                    parent, child, axis=_CLOCKWISE, **ends, **self._range(body, joint)
                )
            )
        elif not slides:
            self.joints.append(
                self.builder.add_joint_fixed(
                    parent, self._link(body), **_ends(turn, place, joint.child_point)
                )
            )

    def _range(self, body: Body, joint: AnyJoint) -> dict[str, float]:
        """Limit arguments of a joint, critically damped for its body alone; empty without limit."""
        index, self.moving = self.moving, self.moving + 1
        if index not in self.limits:
            return {"armature": 0.0}
        (low, high), arm = self.limits[index], math.dist(body.centre, joint.child_point)
        inertia = body.inertia + body.mass * arm**2
        ends = {"limit_lower": max(low, -1e6), "limit_upper": min(high, 1e6)}
        return {
            "armature": 0.0,
            "limit_ke": inertia * self.frequency**2,
            "limit_kd": 2 * inertia * self.frequency,
            **ends,
        }

    def _link(self, body: Body) -> int:
        centre = body.centre
        inertia = max(body.inertia, _LEAST * body.mass * max(math.hypot(*centre), 1e-3) ** 2)
        # Newton corrects inertias of flat bodies, whose two add up to the third, by rounding.
        moment = inertia * np.eye(3)
        found = int(
            self.builder.add_link(
                mass=body.mass,
                com=wp.vec3(*centre, 0.0),
                inertia=wp.mat33(moment.tolist()),
                label=body.name,
            )
        )
        self.bodies[body.name] = found
        return found

    def _carrier(self, body: Body, name: str) -> int:
        mass = _LEAST * body.mass
        return int(
            self.builder.add_link(
                mass=mass, inertia=wp.mat33((mass * np.eye(3)).tolist()), label=name
            )
        )


def _ends(turn: float, place: tuple[float, float], child: tuple[float, float]) -> dict[str, Any]:
    """Frames of a joint in its parent, turned clockwise by an angle, and in its child."""
    turned = wp.quat_from_axis_angle(wp.vec3(0.0, 0.0, 1.0), -turn)
    return {
        "parent_xform": wp.transform(wp.vec3(*place, 0.0), turned),
        "child_xform": wp.transform(wp.vec3(*child, 0.0), wp.quat_identity()),
    }


def turn_of(quaternion: FloatArray) -> FloatArray:
    """Rotation in the plane of a quaternion (x, y, z, w) about z."""
    z, w = quaternion[2:]
    cos, sin = w * w - z * z, 2 * z * w
    return np.array([[cos, -sin], [sin, cos]])
