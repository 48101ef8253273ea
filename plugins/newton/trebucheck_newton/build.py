"""The Newton model of a mechanism: an articulation in the x-y plane, turning about -z (clockwise).

A slide is a prismatic joint; where the child turns as well, it is onto a link almost without mass,
which a revolute joint follows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
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


@dataclass(frozen=True)
class JointSpring:
    """A spring with a damper on a joint's turn, as Newton's joints have them."""

    stiffness: float  # [N m/rad]
    rest: float  # [rad]
    damping: float  # [N m s/rad]


class Built:
    """Model of a mechanism; `bodies` and `joints` are Newton's indices by mechanism names."""

    def __init__(
        self,
        mechanism: Mechanism,
        limits: Mapping[int, tuple[float, float]],
        frequency: float | None,
        springs: Mapping[int, JointSpring] = MappingProxyType({}),
        *,
        whole_joints: bool = False,
    ) -> None:
        """Build the model.

        Args:
            mechanism: what is built.
            limits: ranges of its coordinates.
            frequency: of the limits [rad/s]; None: their stiffness and damping are Newton's own.
            springs: on turns, by the coordinates' index.
            whole_joints: whether slides and the turn of a body are one joint, without links
                between them.
        """
        self.mechanism, self.coordinates = mechanism, JointCoordinates(mechanism)
        self.limits, self.frequency, self.springs = limits, frequency, springs
        self.builder: Any = newton.ModelBuilder(gravity=(*mechanism.gravity_vector, 0.0))
        self.calls: list[Call] = []
        """Methods of the builder that were called."""
        self.bodies = {GROUND: -1}
        self.joints: list[int] = []
        self.moving = 0
        for body, joint in self.coordinates.links:
            if whole_joints and joint.free_directions and body.angle is not None:
                self._add_whole(body, joint)
            else:
                self._add(body, joint)
        self.builder.add_articulation(self.joints)
        self.model: Any = self.builder.finalize(device="cpu")

    def _call(self, method: str, **arguments: Any) -> int:
        self.calls.append(Call(method, arguments))
        return int(self.calls[-1].made(self.builder))

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
                self._call(
                    "add_joint_prismatic",
                    parent=parent,
                    child=child,
                    axis=axis_in_space,
                    **ends,
                    **self._range(body, joint),
                )
            )
            parent, turn, place = child, 0.0, (0.0, 0.0)
        if body.angle is not None:
            ends = _ends(turn, place, joint.child_point)
            child = self._link(body)
            self.joints.append(
                self._call(
                    "add_joint_revolute",
                    parent=parent,
                    child=child,
                    axis=_CLOCKWISE,
                    **ends,
                    **self._range(body, joint),
                )
            )
        elif not slides:
            ends = _ends(turn, place, joint.child_point)
            child = self._link(body)
            self.joints.append(self._call("add_joint_fixed", parent=parent, child=child, **ends))

    def _add_whole(self, body: Body, joint: AnyJoint) -> None:
        """Add slides and the turn of a body as one joint."""
        slides = [
            {"axis": (each.real, each.imag, 0.0), **self._range(body, joint)}
            for each in joint.free_directions
        ]
        turns = [{"axis": _CLOCKWISE, **self._range(body, joint)}]
        ends = _ends(0.0, joint.parent_point, joint.child_point)
        parent, child = self.bodies[joint.parent], self._link(body)
        self.joints.append(
            self._call(
                "add_joint_d6",
                parent=parent,
                child=child,
                linear_axes=slides,
                angular_axes=turns,
                **ends,
            )
        )

    def _range(self, body: Body, joint: AnyJoint) -> dict[str, float]:
        """Limit arguments of a joint, critically damped for its body alone; empty without limit."""
        index, self.moving = self.moving, self.moving + 1
        own: dict[str, float] = {"armature": 0.0}
        if index in self.springs:
            spring = self.springs[index]
            own |= {"stiffness": spring.stiffness, "rest_q": spring.rest, "damping": spring.damping}
        if index not in self.limits:
            return own
        (low, high), arm = self.limits[index], math.dist(body.centre, joint.child_point)
        inertia = body.inertia + body.mass * arm**2
        own |= {"limit_lower": max(low, -1e6), "limit_upper": min(high, 1e6)}
        if self.frequency is not None:
            own |= {
                "limit_ke": inertia * self.frequency**2,
                "limit_kd": 2 * inertia * self.frequency,
            }
        return own

    def _link(self, body: Body) -> int:
        centre = body.centre
        inertia = max(body.inertia, _LEAST * body.mass * max(math.hypot(*centre), 1e-3) ** 2)
        # Newton corrects inertias of flat bodies, whose two add up to the third, by rounding.
        found = self._call(
            "add_link",
            mass=body.mass,
            com=(*centre, 0.0),
            inertia=(inertia * np.eye(3)).tolist(),
            label=body.name,
        )
        self.bodies[body.name] = found
        return found

    def _carrier(self, body: Body, name: str) -> int:
        mass = _LEAST * body.mass
        return self._call("add_link", mass=mass, inertia=(mass * np.eye(3)).tolist(), label=name)


@dataclass(frozen=True)
class Call:
    """A call of a method of Newton's builder: numbers, and frames as places and clockwise turns."""

    method: str
    arguments: Mapping[str, Any]

    def made(self, builder: Any) -> Any:
        """Call it."""
        given = {
            name: _MADE[name](value) if name in _MADE else value
            for name, value in self.arguments.items()
        }
        return getattr(builder, self.method)(**given)

    @property
    def text(self) -> str:
        """The call as a line of Python."""
        given = (
            f"{name}={_WRITTEN[name](value) if name in _WRITTEN else repr(value)}"
            for name, value in self.arguments.items()
        )
        return f"{self.method}({', '.join(given)})"


_Frame = tuple[tuple[float, float], float]


def _made_frame(frame: _Frame) -> Any:
    place, turn = frame
    turned = wp.quat_from_axis_angle(wp.vec3(0.0, 0.0, 1.0), -turn)
    return wp.transform(wp.vec3(*place, 0.0), turned if turn else wp.quat_identity())


def _written_frame(frame: _Frame) -> str:
    (x, y), turn = frame
    turned = "wp.quat_identity()"
    if turn:
        turned = f"wp.quat_from_axis_angle(wp.vec3(0.0, 0.0, 1.0), {-turn!r})"
    return f"wp.transform(wp.vec3({float(x)!r}, {float(y)!r}, 0.0), {turned})"


def _made_axes(axes: list[dict[str, Any]]) -> list[Any]:
    return [newton.ModelBuilder.JointDofConfig(**axis) for axis in axes]


def _written_axes(axes: list[dict[str, Any]]) -> str:
    arguments = (", ".join(f"{name}={value!r}" for name, value in axis.items()) for axis in axes)
    return f"[{', '.join(f'newton.ModelBuilder.JointDofConfig({each})' for each in arguments)}]"


_MADE: Mapping[str, Callable[[Any], Any]] = {
    "parent_xform": _made_frame,
    "child_xform": _made_frame,
    "inertia": wp.mat33,
    "com": lambda place: wp.vec3(*place),
    "linear_axes": _made_axes,
    "angular_axes": _made_axes,
}
_WRITTEN: Mapping[str, Callable[[Any], str]] = {
    "parent_xform": _written_frame,
    "child_xform": _written_frame,
    "inertia": lambda moment: f"wp.mat33({moment!r})",
    "com": lambda place: f"wp.vec3{tuple(map(float, place))!r}",
    "linear_axes": _written_axes,
    "angular_axes": _written_axes,
}


def _ends(turn: float, place: tuple[float, float], child: tuple[float, float]) -> dict[str, Any]:
    """Frames of a joint in its parent, turned clockwise by an angle, and in its child."""
    return {"parent_xform": (place, turn), "child_xform": (child, 0.0)}


def turn_of(quaternion: FloatArray) -> FloatArray:
    """Rotation in the plane of a quaternion (x, y, z, w) about z."""
    z, w = quaternion[2:]
    cos, sin = w * w - z * z, 2 * z * w
    return np.array([[cos, -sin], [sin, cos]])
