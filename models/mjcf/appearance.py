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

from ..arrays import ComplexArray
from ..elements import GROUND, AnyJoint
from ..kinematics import Kinematics
from ..mechanism import Body, Mechanism
from ..spec import Vector
from .tree import add, number, numbers

WOOD, IRON, ROPE = "0.60 0.38 0.18 1", "0.22 0.23 0.26 1", "0.96 0.62 0.10 1"
STONE, BOX = "0.50 0.48 0.46 1", "0.52 0.33 0.20 1"
_WOODS = (WOOD, "0.68 0.50 0.28 1", "0.47 0.30 0.16 1")
_LEAST_SHARE = 0.01  # of a body's mass, below which a point mass in it is not drawn
_HEAVY = 8.0  # times the lightest mass: drawn as a box, on an iron rod instead of a rope


def distinct(points: list[complex], centre: complex, size: float) -> list[complex]:
    """Select the points that are not the centre."""
    return [point for point in points if abs(point - centre) > 1e-9 * size]


def on_a_line(points: ComplexArray) -> bool:
    """Tell whether points lie on one straight line."""
    spread = np.stack([points.real, points.imag], axis=1)
    values = np.linalg.svd(spread - spread.mean(axis=0), compute_uv=False)
    return bool(values[-1] <= 1e-9 * values[0])


def loaded_rod(body: Body, a: complex, b: complex) -> tuple[float, float, float] | None:
    """Mass of a uniform rod from a to b and of points at a and b, in parts of a body's.

    Mass, centre and inertia of the three are the body's; None where that needs a negative mass.
    """
    length = abs(b - a)
    middle = ((complex(*body.centre) - a) / (b - a)).real
    inertia = body.inertia / (body.mass * length**2) + middle**2
    # mass, first and second moment about a, all in parts of the body's mass and the length
    moments = np.array([[1.0, 1.0, 1.0], [0.5, 0.0, 1.0], [1 / 3, 0.0, 1.0]])
    rod, at_a, at_b = np.linalg.solve(moments, [1.0, middle, inertia])
    return None if min(rod, at_a, at_b) < -1e-6 else (float(rod), float(at_a), float(at_b))


def _members(joint: AnyJoint) -> tuple[tuple[str, Vector], tuple[str, Vector]]:
    """The two bodies of a joint, and its point on each."""
    return (joint.parent, joint.parent_point), (joint.child, joint.child_point)


def points_of(mechanism: Mechanism, body: str) -> list[Vector]:
    """Points of a body that anything is attached to."""
    points = [member for joint in mechanism.joints for member in _members(joint)]
    for element in mechanism.force_elements:
        points += element.ends
    points += [(item.body, item.point) for item in (*mechanism.markers, *mechanism.point_stops)]
    return [point for name, point in points if name == body]


def reach_of(mechanism: Mechanism) -> float:
    """A length no point of the machine is farther from its ground joints [m]; never zero."""
    kinematics, n_bodies = Kinematics(mechanism), len(mechanism.angles)
    points = [(body.name, body.centre) for body in mechanism.bodies]
    points += [(item.body, item.point) for item in (*mechanism.markers, *mechanism.point_stops)]
    points += [member for joint in mechanism.loop_joints for member in _members(joint)]
    rows = [kinematics.point(*point) for point in points]
    return round(max(float(abs(row.coefficients[:n_bodies]).sum()) for row in rows), 3) or 1.0


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

    def part(self, share: float, digits: int = 3) -> float:
        """A share of the reach [m]."""
        return round(share * self.reach, digits)

    @cached_property
    def lumps(self) -> tuple[Lump, ...]:
        """Point masses."""
        return tuple(lump for body in self.mechanism.bodies for lump in self._lumps(body))

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
        near = max(points, key=lambda point: abs(point - far))
        _, *shares = loaded_rod(body, near, far) or (0.0, 0.0, 0.0)
        for end, share in zip((near, far), shares, strict=True):
            if share > _LEAST_SHARE:
                yield Lump(body.name, (end.real, end.imag), share * body.mass)

    def half_size(self, lump: Lump) -> float:
        """Half the width of what a point mass is drawn as [m]."""
        heaviest = max(other.mass for other in self.lumps)
        return self.part(max(0.028, 0.055 * (lump.mass / heaviest) ** (1 / 3)))

    def lane(self, joint: AnyJoint) -> float:
        """Distance of the wheels and rails of a slot from the plane of motion [m]."""
        slots = [other for other in self.mechanism.joints if other.free_directions]
        return self.part(0.075 + 0.03 * slots.index(joint))

    @property
    def wheel(self) -> float:
        """Radius of a wheel [m]."""
        return self.part(0.05)

    def disc(self, body: Body) -> float:
        """Radius of a body that nothing hangs on: that of a uniform disc, if there is room [m]."""
        return round(min(math.sqrt(2 * body.inertia / body.mass), 0.25 * self.reach), 6)

    def add(self, element: ET.Element, body: Body, origin: Vector) -> None:
        """Add the shapes of a body, in its frame, whose origin is at its joint."""
        shapes = Shapes(element, origin)
        lumps = [lump for lump in self.lumps if lump.body == body.name]
        least = _HEAVY * min((lump.mass for lump in self.lumps), default=0.0)
        self._add_rods(shapes, body, heavy=any(lump.mass >= least for lump in lumps))
        thrown, point = self.thrown or ("", (0.0, 0.0))
        for lump in lumps:
            if lump.body == thrown and math.dist(lump.point, point) < 1e-9 * self.reach:
                continue
            if lump.mass >= least:
                shapes.box(lump.point, self.half_size(lump), BOX)
            else:
                shapes.ball(lump.point, self.half_size(lump), STONE)
        for joint in self.mechanism.joints:
            if joint.child == body.name and joint.held_directions:
                self._add_bearing(shapes, joint)

    def _add_rods(self, shapes: Shapes, body: Body, *, heavy: bool) -> None:
        """Add rods from the joint to what hangs on the body: beams, or a point mass's holder."""
        mechanism = self.mechanism
        points = [
            joint.parent_point for joint in mechanism.tree_joints if joint.parent == body.name
        ]
        for joint in mechanism.loop_joints:
            points += [point for name, point in _members(joint) if name == body.name]
        points += [lump.point for lump in self.lumps if lump.body == body.name]
        if not points:
            points = [marker.point for marker in mechanism.markers if marker.body == body.name]
        points = dict.fromkeys(points or [body.centre])
        ends = [point for point in points if math.dist(point, shapes.origin) > 0]
        if body.inertia == 0:
            look, thickness = (IRON, 0.007) if heavy else (ROPE, 0.005)
        else:
            look, thickness = _WOODS[mechanism.bodies.index(body) % len(_WOODS)], 0.018
            if not ends:
                shapes.disc(body.centre, self.disc(body), self.part(0.01, 6), look)
        # Ropes are on both sides of the arm that they lie along.
        sides = (-0.023, 0.023) if look == ROPE else (0.0,)
        for end in ends:
            for side in sides:
                radius = self.part(thickness, 6)
                shapes.rod(shapes.origin, end, radius, look, self.part(side, 6))

    def _add_bearing(self, shapes: Shapes, joint: AnyJoint) -> None:
        """The pin of a joint; of a slot, two wheels on an axle."""
        thin, point = self.part(0.012, 6), joint.child_point
        if not joint.free_directions or joint.parent != GROUND:
            shapes.disc(point, thin, self.part(0.028, 6), IRON)
            return
        lane, half = self.lane(joint), self.part(0.008, 6)
        shapes.disc(point, thin, lane, IRON)
        if any((lump.body, lump.point) == (joint.child, point) for lump in self.lumps):
            return  # the mass itself slides between the guides
        for side in (-lane, lane):
            shapes.disc(point, self.wheel, half, WOOD, side)
            shapes.disc(point, thin, round(1.3 * half, 6), IRON, side)
            # Two bars through the middle of the wheel, on its face.
            face = side - half if side < 0 else side + half
            for x, y in ((0.85 * self.wheel, 0.0), (0.0, 0.85 * self.wheel)):
                ends = (point[0] - x, point[1] - y), (point[0] + x, point[1] + y)
                shapes.rod(*ends, round(0.12 * self.wheel, 6), IRON, face)


@dataclass(frozen=True)
class Shapes:
    """Geoms of an element; points are in the frame of the body, of the ground in the world."""

    element: ET.Element
    origin: Vector = (0.0, 0.0)
    """Origin of the element's frame, in that of the body [m]."""

    def _at(self, point: Vector, side: float = 0.0) -> str:
        x, z = point[0] - self.origin[0], point[1] - self.origin[1]
        return numbers(round(x, 6), side, round(z, 6))

    def rod(self, a: Vector, b: Vector, radius: float, look: str, side: float = 0.0) -> None:
        """A capsule between two points."""
        ends = f"{self._at(a, side)} {self._at(b, side)}"
        add(self.element, "geom", type="capsule", fromto=ends, size=radius, rgba=look)

    def ball(self, point: Vector, radius: float, look: str) -> None:
        """A sphere."""
        add(self.element, "geom", type="sphere", pos=self._at(point), size=radius, rgba=look)

    def box(self, point: Vector, half: float, look: str) -> None:
        """A cube, with iron bands around it."""
        cube, place = (half, half, half), self._at(point)
        band = round(1.04 * half, 6), round(1.04 * half, 6), round(0.12 * half, 6)
        add(self.element, "geom", type="box", pos=place, size=cube, rgba=look)
        x, y, up = place.split()
        for z in (-0.6 * half, 0.6 * half):
            place = f"{x} {y} {number(round(float(up) + z, 6))}"
            add(self.element, "geom", type="box", pos=place, size=band, rgba=IRON)

    def disc(self, point: Vector, radius: float, half: float, look: str, side: float = 0.0) -> None:
        """A cylinder across the plane of motion."""
        add(
            self.element, "geom", type="cylinder", pos=self._at(point, side), zaxis="0 1 0",
            size=(radius, half), rgba=look,
        )  # fmt: skip

    def slab(
        self, centre: Vector, sizes: tuple[float, float, float], angle: float, look: str
    ) -> None:
        """A box of half sizes along, across and up, turned counter-clockwise by an angle [rad]."""
        add(
            self.element, "geom", type="box", pos=self._at(centre), size=sizes,
            euler=(0, round(-angle, 6), 0), rgba=look,
        )  # fmt: skip
