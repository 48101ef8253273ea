"""Stops on points and joints that close loops, as MJCF: what holds a point of a body besides the joint of its tree.

A stop on a point is a frictionless contact of a ball with a plane, or with a box on a body that
moves. A slot that closes a loop is two of them, a ball between the two planes of a rail. A pin that
closes a loop is a `connect` equality of two sites, and an angle that a loop's weld or slider holds
is an equality of a tendon over hinges. Each hangs on a body of its own without mass or joint,
welded where the point is: MuJoCo then scales the softness of the contact with the inertia that is
felt there and not at the centre of mass, and a force sensor has a place to stand.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

from ..elements import GROUND, AnyJoint, PointStop
from ..errors import UnsupportedProblemError
from ..mechanism import Body, Mechanism
from ..spec import Vector
from .appearance import reach_of
from .text import from_origin, number, numbers, spatial
from .tree import add_angle_tendon, start_angles

RAIL_SIDES = ("left", "right")
"""Of a slot, seen along its axis."""


def torque_sensor(stop: str) -> str:
    """Name of the sensor of a stop's torque [N m], of a stop on a point's force [N]."""
    return f"{stop}/torque"


def force_sensor(joint: str) -> str:
    """Name of the sensor of a joint's force [N], in the frame of its child."""
    return f"{joint}/force"


def rail_contact(slot: str, side: str) -> str:
    """Name of the contact of a slot that closes a loop with one of its two sides."""
    return f"{slot}/{side}"


_THICKNESS = 4.0  # radii of a ball: half of it is that of a wall on a moving body
_BEYOND = 1e4  # lengths of the machine: half the extent of such a wall, which no point comes to the end of


@dataclass(frozen=True)
class Wall:
    """A half-plane that a point of a body must not enter."""

    name: str
    """Of the contact."""
    holder: str
    """Name of the stop or joint."""
    body: str
    """That has the wall, or 'ground'."""
    normal: Vector
    offset: float
    """Distance from the origin of the body's frame along the normal [m]."""
    visible: bool

    @property
    def geoms(self) -> dict[str, str]:
        """The contact's plane and ball."""
        return {"geom1": f"{self.name}/wall", "geom2": f"{self.holder}/ball"}


@dataclass(frozen=True)
class Points:
    """Elements for all held points of a mechanism.

    Raises:
        UnsupportedProblemError: a stop is on a point of a body, or the ground, against the same
            one.
    """

    mechanism: Mechanism

    def __post_init__(self) -> None:
        for stop in self.mechanism.point_stops:
            if stop.body == stop.relative_to:
                message = f"stop {stop.name!r} holds a point of {stop.body!r} against {stop.body!r} itself."
                raise UnsupportedProblemError(message)

    @cached_property
    def reach(self) -> float:
        """A length no point of the machine is farther from its ground joints [m]."""
        return reach_of(self.mechanism)

    @cached_property
    def slots(self) -> tuple[AnyJoint, ...]:
        """Slots and sliders that close loops."""
        return tuple(joint for joint in self.mechanism.loop_joints if joint.free_directions)

    @cached_property
    def pins(self) -> tuple[AnyJoint, ...]:
        """Pins and welds that close loops."""
        return tuple(joint for joint in self.mechanism.loop_joints if not joint.free_directions)

    @cached_property
    def turned(self) -> tuple[AnyJoint, ...]:
        """Joints that close loops and hold an angle."""
        return tuple(joint for joint in self.mechanism.loop_joints if joint.holds_angle)

    @cached_property
    def walls(self) -> tuple[Wall, ...]:
        """One a stop, two a slot."""
        return (
            *(_wall(stop) for stop in self.mechanism.point_stops),
            *(s for j in self.slots for s in _sides(j)),
        )

    def add_defaults(self, default: ET.Element, solref: str, solimp: str, margin: float) -> None:
        """Softness of contacts and equalities; the margin [m] is that of a machine of a metre."""
        soft = {"solref": solref, "solimp": solimp}
        if self.walls:
            near = margin * max(1.0, self.reach)  # what rounding makes of a gap of zero
            ET.SubElement(default, "pair", soft, condim="1", margin=number(near))
        if self.pins or self.turned:
            ET.SubElement(default, "equality", soft)

    def add_ground(self, world: ET.Element) -> None:
        """What the ground has: planes that balls run on, anchors, and points that walls of bodies come up against.

        The planes are behind the points' own half-planes by the radius of the balls.
        """
        size, radius = round(1.5 * self.reach, 3), self._radius
        for wall in self.walls:
            if wall.body != GROUND:
                continue
            behind = wall.offset - radius
            ET.SubElement(
                world, "geom", group="4", name=wall.geoms["geom1"], type="plane", size=numbers(size, 0.1 * size, size),
                pos=spatial((wall.normal[0] * behind, wall.normal[1] * behind)), zaxis=spatial(wall.normal),
            )  # fmt: skip
        self._add_anchors(world, GROUND, (0.0, 0.0))
        self._add_balls(world, GROUND, (0.0, 0.0))

    def _add_boxes(self, element: ET.Element, body: str, origin: Vector) -> None:
        """Walls on a body that moves, where MuJoCo has no planes; the point is never beyond their ends."""
        thickness, beyond = _THICKNESS * self._radius, _BEYOND * self.reach
        for wall in self.walls:
            if wall.body == body:
                behind = wall.offset - self._radius - thickness
                centre = wall.normal[0] * behind, wall.normal[1] * behind
                ET.SubElement(
                    element, "geom", group="4", name=wall.geoms["geom1"], type="box",
                    size=numbers(beyond, beyond, thickness), pos=from_origin(origin, centre),
                    zaxis=spatial(wall.normal),
                )  # fmt: skip

    def _add_anchors(self, element: ET.Element, body: str, origin: Vector) -> None:
        """On a body, sites to which pins that close loops tie others."""
        for pin in self.pins:
            if pin.parent == body:
                ET.SubElement(
                    element,
                    "site",
                    name=f"{pin.name}/anchor",
                    pos=from_origin(origin, pin.parent_point),
                )

    def _add_balls(self, element: ET.Element, body: str, origin: Vector) -> None:
        for stop in self.mechanism.point_stops:
            if stop.body == body:
                self._add_ball(self._point(element, stop.name, origin, stop.point), stop.name)

    def add_points(self, element: ET.Element, body: Body, origin: Vector) -> None:
        """The held points of a body, each a body without mass, and its walls."""
        self._add_boxes(element, body.name, origin)
        self._add_anchors(element, body.name, origin)
        self._add_balls(element, body.name, origin)
        for joint in self.mechanism.loop_joints:
            if joint.child == body.name:
                point = self._point(element, joint.name, origin, joint.child_point)
                ET.SubElement(point, "site", name=f"{joint.name}/joint")
                if joint.free_directions:
                    self._add_ball(point, joint.name)

    def add_constraints(self, root: ET.Element, timestep: float) -> None:
        """Contacts and equalities."""
        if self.walls:
            contact = ET.SubElement(root, "contact")
            for wall in self.walls:
                pair = ET.SubElement(contact, "pair", wall.geoms, name=wall.name)
                if not wall.visible:
                    pair.set("margin", number(felt_from(self.mechanism, timestep)))
        if self.pins or self.turned:
            equality = ET.SubElement(root, "equality")
            for pin in self.pins:
                sites = {"site1": f"{pin.name}/joint", "site2": f"{pin.name}/anchor"}
                ET.SubElement(equality, "connect", sites, name=pin.name)
            for joint in self.turned:
                held = f"{numbers(self._turned_too_little(joint))} 0 0 0 0"
                ET.SubElement(
                    equality, "tendon", name=_angle(joint), tendon1=_angle(joint), polycoef=held
                )

    def add_tendons(self, tendon: ET.Element) -> None:
        """Angles that joints that close loops hold."""
        for joint in self.turned:
            add_angle_tendon(
                tendon, self.mechanism, (joint.child, joint.parent), name=_angle(joint)
            )

    def _turned_too_little(self, joint: AnyJoint) -> float:
        """By how much the start misses the angle that a joint that closes a loop holds [rad]: rounding."""
        angles = start_angles(self.mechanism)
        missing = (joint.turned_by or 0.0) - (angles[joint.child] - angles[joint.parent])
        return math.remainder(missing, 2 * math.pi)

    def add_stop_sensor(self, sensor: ET.Element, stop: PointStop) -> None:
        """The force of a stop on a point: first of the three components in the contact's frame [N]."""
        ET.SubElement(
            sensor, "contact", _wall(stop).geoms, name=torque_sensor(stop.name), data="force"
        )

    def add_force_sensors(self, sensor: ET.Element) -> None:
        """Forces of the joints that close loops."""
        for joint in self.mechanism.loop_joints:
            ET.SubElement(
                sensor, "force", name=force_sensor(joint.name), site=f"{joint.name}/joint"
            )

    @cached_property
    def _radius(self) -> float:
        return round(0.01 * self.reach, 6)

    def _point(self, element: ET.Element, name: str, origin: Vector, point: Vector) -> ET.Element:
        return ET.SubElement(element, "body", name=f"{name}/point", pos=from_origin(origin, point))

    def _add_ball(self, element: ET.Element, name: str) -> None:
        ET.SubElement(
            element,
            "geom",
            name=f"{name}/ball",
            type="sphere",
            group="4",
            size=number(self._radius),
        )


def _angle(joint: AnyJoint) -> str:
    """Name of the tendon and the equality of the angle that a joint holds."""
    return f"{joint.name}/angle"


def _wall(stop: PointStop) -> Wall:
    return Wall(stop.name, stop.name, stop.relative_to, stop.normal, stop.offset, visible=True)


def _sides(slot: AnyJoint) -> Iterator[Wall]:
    """The two walls of a slot, the left one pushing to the right."""
    (axis,) = slot.free_directions
    left = (-axis.imag, axis.real)
    for side, sense in zip(RAIL_SIDES, (-1, 1), strict=True):
        normal = (sense * left[0], sense * left[1])
        offset = normal[0] * slot.parent_point[0] + normal[1] * slot.parent_point[1]
        yield Wall(
            rail_contact(slot.name, side), slot.name, slot.parent, normal, offset, visible=False
        )


def felt_from(mechanism: Mechanism, timestep: float) -> float:
    """How near a wall is felt [m] where that shall not matter: it scales with what a step's curvature moves a point by.

    Both walls of a slot are pressed in by it. As long as both push they are one two-sided
    constraint without play: with a stiffness of 1/timestep^2, up to accelerations of some 1e4 of
    that named here. The forces that cancel cost five digits of sixteen.
    """
    return 10.0 * max(mechanism.gravity, reach_of(mechanism)) * timestep**2
