"""Shapes of bodies in MJCF: beams, ropes, stones, boxes, wheels, without mass or contact.

Sizes are for the eye: they follow from the size of the whole and the cube roots of masses, not from
densities.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..elements import GROUND, AnyJoint
from ..kinematics import Kinematics
from ..mechanism import Body, Mechanism
from ..sketch import distinct, loaded_rod, on_a_line
from ..spec import Vector
from .tree import number, numbers

WOOD, IRON, ROPE = "0.60 0.38 0.18 1", "0.22 0.23 0.26 1", "0.96 0.62 0.10 1"
STONE, BOX = "0.50 0.48 0.46 1", "0.52 0.33 0.20 1"
_WOODS = (WOOD, "0.68 0.50 0.28 1", "0.47 0.30 0.16 1")
_LEAST_SHARE = 0.01  # of a body's mass, below which a point mass in it is not drawn
_HEAVY = 8.0  # times the lightest mass: drawn as a box, on an iron rod instead of a rope


@dataclass(frozen=True)
class Lump:
    """A point mass: of its own, or at the end of a rod."""

    body: str
    point: Vector
    mass: float


@dataclass(frozen=True)
class Appearance:
    """Shapes of a mechanism's bodies; lengths in parts of `reach`."""

    mechanism: Mechanism
    thrown: tuple[str, Vector] | None = None
    """Body and point of a mass that is not drawn, because it is a body of its own."""

    @cached_property
    def reach(self) -> float:
        """A length no point of the mechanism is farther from its ground joints [m]."""
        return reach_of(self.mechanism)

    @cached_property
    def lumps(self) -> tuple[Lump, ...]:
        """All point masses."""
        return tuple(lump for body in self.mechanism.bodies for lump in self._lumps(body))

    def half_size(self, lump: Lump) -> float:
        """Half the width of what a point mass is drawn as [m]."""
        heaviest = max(other.mass for other in self.lumps)
        return round(self.reach * max(0.028, 0.055 * (lump.mass / heaviest) ** (1 / 3)), 3)

    def is_heavy(self, lump: Lump) -> bool:
        """Whether it is drawn as a box."""
        return lump.mass >= _HEAVY * min(other.mass for other in self.lumps)

    def _is_thrown(self, lump: Lump) -> bool:
        body, point = self.thrown or ("", lump.point)
        return lump.body == body and math.dist(lump.point, point) < 1e-9 * self.reach

    def lane(self, joint: AnyJoint) -> float:
        """Distance of the wheels and rails of a slot from the plane of motion [m]."""
        slots = [other for other in self.mechanism.joints if other.free_directions]
        return round((0.075 + 0.03 * slots.index(joint)) * self.reach, 3)

    @property
    def wheel(self) -> float:
        """Radius of a wheel [m]."""
        return round(0.05 * self.reach, 3)

    def disc(self, body: Body) -> float:
        """Radius of a body that nothing hangs on: that of a uniform disc, if there is room [m]."""
        return round(min(math.sqrt(2 * body.inertia / body.mass), 0.25 * self.reach), 6)

    def add(self, element: ET.Element, body: Body, origin: Vector) -> None:
        """Add the shapes of a body, in its frame, whose origin is at its joint."""
        shapes = Shapes(element, origin)
        lumps = [lump for lump in self.lumps if lump.body == body.name]
        self._add_rods(shapes, body, any(map(self.is_heavy, lumps)))
        for lump in lumps:
            if self._is_thrown(lump):
                continue
            if self.is_heavy(lump):
                shapes.box(lump.point, self.half_size(lump), BOX)
            else:
                shapes.ball(lump.point, self.half_size(lump), STONE)
        for joint in self.mechanism.joints:
            if joint.child == body.name and joint.held_directions:
                self._add_bearing(shapes, joint)

    def _add_rods(self, shapes: Shapes, body: Body, heavy: bool) -> None:
        """From the joint to whatever hangs on the body: beams, or what holds a point mass."""
        ends = [
            point
            for point in dict.fromkeys(self._ends(body))
            if math.dist(point, shapes.origin) > 0
        ]
        if body.inertia == 0:
            look, thickness = (IRON, 0.007) if heavy else (ROPE, 0.005)
        else:
            look, thickness = _WOODS[self.mechanism.bodies.index(body) % len(_WOODS)], 0.018
            if not ends:
                shapes.disc(body.centre, self.disc(body), round(0.01 * self.reach, 6), look)
        # On both sides of the arm that it lies along.
        cords = (-0.023, 0.023) if look == ROPE else (0.0,)
        for end in ends:
            for side in cords:
                shapes.rod(
                    shapes.origin,
                    end,
                    round(thickness * self.reach, 6),
                    look,
                    round(side * self.reach, 6),
                )

    def _add_bearing(self, shapes: Shapes, joint: AnyJoint) -> None:
        """The pin of a joint; of a slot, two wheels on an axle."""
        thin = round(0.012 * self.reach, 6)
        if not joint.free_directions or joint.parent != GROUND:
            shapes.disc(joint.child_point, thin, round(0.028 * self.reach, 6), IRON)
            return
        lane, half = self.lane(joint), round(0.008 * self.reach, 6)
        shapes.disc(joint.child_point, thin, lane, IRON)
        if any((lump.body, lump.point) == (joint.child, joint.child_point) for lump in self.lumps):
            return  # the mass itself slides between the guides
        for side in (-lane, lane):
            shapes.disc(joint.child_point, self.wheel, half, WOOD, side)
            shapes.disc(joint.child_point, thin, round(1.3 * half, 6), IRON, side)
            for spoke in ((0.85, 0.0), (0.0, 0.85)):
                shapes.spoke(joint.child_point, self.wheel, spoke, half, side)

    def _ends(self, body: Body) -> list[Vector]:
        """Points of a body worth a rod from its joint."""
        points = [
            joint.parent_point for joint in self.mechanism.tree_joints if joint.parent == body.name
        ]
        for joint in self.mechanism.loop_joints:
            points += [point for name, point in _members(joint) if name == body.name]
        points += [lump.point for lump in self.lumps if lump.body == body.name]
        return (
            points
            or [marker.point for marker in self.mechanism.markers if marker.body == body.name]
            or [body.centre]
        )

    def _lumps(self, body: Body) -> Iterator[Lump]:
        """A point mass, or those at the ends of a uniform rod."""
        if body.inertia == 0:
            yield Lump(body.name, body.centre, body.mass)
            return
        centre = complex(*body.centre)
        points = [complex(*point) for point in points_of(self.mechanism, body.name)]
        points = distinct(list(dict.fromkeys(points)), centre, self.reach)
        if len(points) < 2 or not on_a_line(np.array([*points, centre])):
            return
        far = max(points, key=lambda point: abs(point - points[0]))
        ends = max(points, key=lambda point: abs(point - far)), far
        shares = loaded_rod(body, *ends)
        for end, share in zip(ends, shares[1:] if shares else (), strict=False):
            if share > _LEAST_SHARE:
                yield Lump(body.name, (end.real, end.imag), share * body.mass)


@dataclass(frozen=True)
class Shapes:
    """Geoms of an element; points are in the frame of the body, of the ground in the world."""

    element: ET.Element
    origin: Vector = (0.0, 0.0)
    """Origin of the element's frame, in that of the body [m]."""

    def rod(self, a: Vector, b: Vector, radius: float, look: str, side: float = 0.0) -> None:
        """A capsule between two points."""
        ends = f"{self._at(a, side)} {self._at(b, side)}"
        ET.SubElement(
            self.element, "geom", type="capsule", fromto=ends, size=number(radius), rgba=look
        )

    def ball(self, point: Vector, radius: float, look: str) -> None:
        """A sphere."""
        ET.SubElement(
            self.element, "geom", type="sphere", pos=self._at(point), size=number(radius), rgba=look
        )

    def box(self, point: Vector, half: float, look: str) -> None:
        """A cube, with iron bands around it."""
        band = numbers(round(1.04 * half, 6), round(1.04 * half, 6), round(0.12 * half, 6))
        ET.SubElement(
            self.element,
            "geom",
            type="box",
            pos=self._at(point),
            size=numbers(half, half, half),
            rgba=look,
        )
        for z in (-0.6 * half, 0.6 * half):
            x, y, up = self._at(point).split()
            at = f"{x} {y} {number(round(float(up) + z, 6))}"
            ET.SubElement(self.element, "geom", type="box", pos=at, size=band, rgba=IRON)

    def disc(self, point: Vector, radius: float, half: float, look: str, side: float = 0.0) -> None:
        """A cylinder across the plane of motion."""
        ET.SubElement(
            self.element, "geom", type="cylinder", pos=self._at(point, side), zaxis="0 1 0",
            size=numbers(radius, half), rgba=look,
        )  # fmt: skip

    def spoke(self, point: Vector, radius: float, way: Vector, half: float, side: float) -> None:
        """A bar through the middle of a wheel, on its face."""
        dx, dz = (part * radius for part in way)
        ends = ((point[0] - dx, point[1] - dz), (point[0] + dx, point[1] + dz))
        self.rod(*ends, round(0.12 * radius, 6), IRON, side - half if side < 0 else side + half)

    def slab(
        self, centre: Vector, sizes: tuple[float, float, float], angle: float, look: str
    ) -> None:
        """A box of half sizes along, across and up, turned counter-clockwise by an angle [rad]."""
        ET.SubElement(
            self.element, "geom", type="box", pos=self._at(centre), size=numbers(*sizes),
            euler=numbers(0, round(-angle, 6), 0), rgba=look,
        )  # fmt: skip

    def _at(self, point: Vector, side: float = 0.0) -> str:
        x, z = point[0] - self.origin[0], point[1] - self.origin[1]
        return numbers(round(x, 6), side, round(z, 6))


def _members(joint: AnyJoint) -> tuple[tuple[str, Vector], tuple[str, Vector]]:
    """The two bodies of a joint, and its point on each."""
    return (joint.parent, joint.parent_point), (joint.child, joint.child_point)


def points_of(mechanism: Mechanism, body: str) -> list[Vector]:
    """Points of a body that anything is attached to."""
    points = [
        point for joint in mechanism.joints for name, point in _members(joint) if name == body
    ]
    for element in mechanism.force_elements:
        points += [point for name, point in element.ends if name == body]
    return points + [
        item.point for item in (*mechanism.markers, *mechanism.point_stops) if item.body == body
    ]


def reach_of(mechanism: Mechanism) -> float:
    """A length no point of the machine is farther from its ground joints [m]; never zero."""
    kinematics = Kinematics(mechanism)
    n_bodies = len(mechanism.angles)
    points = [(body.name, body.centre) for body in mechanism.bodies]
    points += [(item.body, item.point) for item in (*mechanism.markers, *mechanism.point_stops)]
    points += [member for joint in mechanism.loop_joints for member in _members(joint)]
    rows = [kinematics.point(*point) for point in points]
    return round(max(float(abs(row.coefficients[:n_bodies]).sum()) for row in rows), 3) or 1.0
