"""Parts of a drawing: points that move with bodies, and shapes over indices of these points.

Every renderer (canvas in a page, SVG, raster) draws the same shapes from the positions of the
points alone. So the drawing of a run with magnified deviations is that of the points z + k (z' -
z), z the reference's and z' the run's.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np

from ....models.arrays import ComplexArray, FloatArray, as_vectors
from ....models.elements import (
    FORCE_ELEMENTS,
    GROUND,
    AnyJoint,
    ConstantForce,
    ConstantTorque,
    CubicTorsionSpring,
    ElementTable,
    RotationalSpringDamper,
    SpringDamper,
)
from ....models.kinematics import Kinematics, PointCoefficients
from ....models.mechanism import Mechanism
from ....models.spec import Vector

Kind = Literal["line", "area", "disc", "hatch", "between", "spiral", "wheel", "arrow", "turn"]
"""How a shape is drawn:

line, area: through its points, open or closed, `size` the width of the stroke.
disc: around a point, `size` its radius.
hatch: a line of two points with short strokes on its right-hand side, `size` their distance.
between: the polyline `path`, in parts of the way from the first point to the second and metres to
the left of it.
spiral: about the first point from the direction of the second to that of the third, `size` the
outer radius.
wheel: about the first point, turned by its way from the second along the direction to the third,
`size` the radius.
arrow: from the first point to the second, `size` the length of its head.
turn: an arc with a head about a point, `size` the radius, `path[0][0]` the sweep [rad], clockwise
positive.
"""
Role = Literal[
    "ground",
    "guide",
    "stop",
    "rope",
    "body",
    "spring",
    "damper",
    "mass",
    "centre",
    "joint",
    "load",
    "marker",
]
ROLES: tuple[Role, ...] = Role.__args__
"""From what is drawn first, farthest behind, to what is drawn last."""
MOVING: frozenset[Role] = frozenset({"rope", "body", "mass", "spring", "damper", "marker"})
"""Roles that are drawn again for each run, over the reference."""
Box = tuple[float, float, float, float]
"""Least x and y, greatest x and y [m]."""


@dataclass(frozen=True)
class FramePoint:
    """A point of a body, or at an arm from it that turns with another body's frame."""

    body: str
    at: complex
    """Place in the body's frame [m]."""
    frame: str = GROUND
    arm: complex = 0j
    """Vector in the frame of `frame` [m]."""

    def coefficients(self, kinematics: Kinematics) -> PointCoefficients:
        """Its position's coefficients."""
        row = kinematics.point(self.body, (self.at.real, self.at.imag))
        arm = kinematics.between(self.frame, (self.arm.real, self.arm.imag), self.frame, (0.0, 0.0))
        return PointCoefficients(row.offset + arm.offset, row.coefficients + arm.coefficients)


@dataclass(frozen=True)
class Shape:
    """A shape over indices of points; lengths in metres."""

    kind: Kind
    role: Role
    points: tuple[int, ...]
    size: float = 0.0
    path: tuple[tuple[float, float], ...] = ()
    stop: str = ""
    """The stop that it shows; it is gone when that has opened for good."""


@dataclass(frozen=True)
class Drawing:
    """A mechanism's points and shapes, and the part of the plane that its motion needs."""

    mechanism: Mechanism
    points: tuple[FramePoint, ...]
    shapes: tuple[Shape, ...]
    markers: dict[str, int]
    """Index of each marker's point, by name."""
    compared: tuple[int, ...]
    """Indices of the points whose distance from the reference's counts: the markers', else the
    bodies' centres of mass."""
    joints: dict[str, int]
    """Index of the point at which each joint's force acts."""
    stops: dict[str, tuple[int, int]]
    """Index of the point at which each stop acts; for a stop on a point also of a point along its
    normal, else the same index again."""
    box: Box
    size: float
    """A length [m] of the whole, from which the sizes of symbols follow."""

    @cached_property
    def kinematics(self) -> Kinematics:
        """Kinematics of the mechanism."""
        return Kinematics(self.mechanism)

    @cached_property
    def rows(self) -> tuple[PointCoefficients, ...]:
        """Coefficients of the points' positions."""
        return tuple(point.coefficients(self.kinematics) for point in self.points)

    def positions(self, q: FloatArray) -> FloatArray:
        """World positions [m] in states q of shape (n, n_q); shape (n, n_points, 2)."""
        return positions(self.kinematics, self.rows, q)

    def deviations(self, q: FloatArray, d: FloatArray) -> FloatArray:
        """Positions in states q + d less those in q [m], (n, n_points, 2), to the digits of d.

        Subtracting the positions would leave the rounding of q + d; exp(-i d) - 1 is formed as
        -2 sin^2(d / 2) - i sin(d) instead.
        """
        kinematics = self.kinematics
        turned = -2.0 * np.sin(d / 2) ** 2 - 1j * np.sin(d)
        phasors = np.exp(-1j * q)
        change = np.where(kinematics.is_angle > 0, phasors * turned, d)
        for k, c in kinematics.carried:
            change[..., k] = phasors[..., c] * (
                (q[..., k] + d[..., k]) * turned[..., c] + d[..., k]
            )
        coefficients = np.array([row.coefficients for row in self.rows])
        return as_vectors(change @ coefficients.T)


def positions(
    kinematics: Kinematics, rows: Iterable[PointCoefficients], q: FloatArray
) -> FloatArray:
    """World positions [m] of points in states q of shape (n, n_q); shape (n, n_points, 2)."""
    rows = tuple(rows)
    offsets = np.array([row.offset for row in rows])
    return as_vectors(
        offsets + kinematics.phasors(q) @ np.array([row.coefficients for row in rows]).T
    )


_FIXED_AT: ElementTable[Callable[[Any], Sequence[tuple[str, Vector]]]] = ElementTable(
    "the drawing",
    FORCE_ELEMENTS,
    {
        SpringDamper: lambda e: ((e.body, e.point), (e.relative_to, e.relative_point)),
        ConstantForce: lambda e: ((e.body, e.point),),
        RotationalSpringDamper: lambda e: (),
        CubicTorsionSpring: lambda e: (),
        ConstantTorque: lambda e: (),
    },
)


@dataclass
class Sketch:
    """Points and shapes of a mechanism, collected."""

    mechanism: Mechanism
    q: FloatArray
    """Its motion, shape (n, n_q): extents of guides, walls and the whole follow from it."""
    points: dict[FramePoint, int] = field(default_factory=dict[FramePoint, int])
    shapes: list[Shape] = field(default_factory=list[Shape])

    def point(self, body: str, at: complex, frame: str = GROUND, arm: complex = 0j) -> int:
        """Index of a point; the same for the same point."""
        return self.points.setdefault(
            FramePoint(body, complex(at), frame, complex(arm)), len(self.points)
        )

    def add(
        self,
        kind: Kind,
        role: Role,
        points: tuple[int, ...],
        size: float = 0.0,
        path: tuple[tuple[float, float], ...] = (),
        stop: str = "",
    ) -> None:
        """Add a shape."""
        self.shapes.append(Shape(kind, role, points, size, path, stop))

    @cached_property
    def kinematics(self) -> Kinematics:
        """Kinematics of the mechanism."""
        return Kinematics(self.mechanism)

    @cached_property
    def down(self) -> complex:
        """Direction of gravity, in the world."""
        return complex(*self.mechanism.gravity_direction)

    @cached_property
    def size(self) -> float:
        """Longer side of what the bodies' points and centres sweep [m]; 1 for a point at rest."""
        points = [(name, at) for name, ats in self.outlines.items() for at in ats]
        points += [(body.name, complex(*body.centre)) for body in self.mechanism.bodies]
        xy = positions(
            self.kinematics,
            (FramePoint(*each).coefficients(self.kinematics) for each in points),
            self.q,
        )
        flat = xy.reshape(-1, 2)
        spread = float(np.max(flat.max(axis=0) - flat.min(axis=0)))
        return spread if math.isfinite(spread) and spread > 0 else 1.0

    @cached_property
    def outlines(self) -> dict[str, list[complex]]:
        """Points of each body, and of the ground, at which something is fixed, each once."""
        points: dict[str, list[complex]] = {body.name: [] for body in self.mechanism.bodies} | {
            GROUND: []
        }
        for name, at in self._attachments():
            if not any(abs(at - other) <= 1e-12 * (1 + abs(at)) for other in points[name]):
                points[name].append(at)
        return points

    def _attachments(self) -> list[tuple[str, complex]]:
        """Bodies and points at which joints, markers, stops and force elements are fixed."""
        mechanism = self.mechanism
        fixed: list[tuple[str, complex]] = []
        for joint in mechanism.joints:
            if joint.held_directions:
                fixed.append((joint.child, complex(*joint.child_point)))
                fixed += [(joint.parent, at) for at in self.guide(joint)]
        for each in (*mechanism.markers, *mechanism.point_stops):
            fixed.append((each.body, complex(*each.point)))
        for element in mechanism.force_elements:
            fixed += [(body, complex(*at)) for body, at in _FIXED_AT[element](element)]
        return fixed

    def guide(self, joint: AnyJoint) -> list[complex]:
        """Ends of what the motion uses of a joint's line, in the parent's frame; a pin's point."""
        at = complex(*joint.parent_point)
        if len(joint.free_directions) != 1:
            return [at]
        (axis,) = joint.free_directions
        along = self.component(
            axis, joint.parent, joint.child, joint.child_point, joint.parent_point
        )
        return [at + axis * along.min(), at + axis * along.max()]

    def component(
        self, direction: complex, of: str, body: str, point: Vector, origin: Vector = (0.0, 0.0)
    ) -> FloatArray:
        """A body's point along a direction of another body's frame, during the motion [m]."""
        vector = self.kinematics.between(body, point, of, origin)
        return self.kinematics.component(direction, of, vector).value(self.q)

    def hinge(self, body: str, other: str) -> tuple[complex, AnyJoint]:
        """Where a body turns against another one, in its frame: their joint, or else its own one.

        The joint comes with it.
        """
        joints = self.mechanism.joints
        both = {body, other}
        joint = next(
            (j for j in joints if {j.parent, j.child} == both), self.mechanism.joint_of(body)
        )
        return complex(*(joint.child_point if joint.child == body else joint.parent_point)), joint

    def positions(self) -> FloatArray:
        """Positions of all points so far, during the motion [m], shape (n, n_points, 2)."""
        return positions(
            self.kinematics, (p.coefficients(self.kinematics) for p in self.points), self.q
        )


_MOST_HATCHES = 400


def polylines(shape: Shape, z: ComplexArray) -> list[ComplexArray]:
    """Lines of a shape [m], x + i y; none of a disc and the rim of a wheel, which are circles.

    Args:
        shape: but for arrows and turns.
        z: positions of the shape's points.
    """
    if shape.kind == "area":
        return [np.append(z, z[0])]
    if shape.kind == "line":
        return [z]
    if shape.kind == "between":
        return [_between(shape, *z)]
    if shape.kind == "spiral":
        return [_spiral(shape.size, *z)]
    if shape.kind == "wheel":
        return _spokes(shape.size, *z)
    return _hatch(shape.size, *z) if shape.kind == "hatch" else []


def _between(shape: Shape, a: complex, b: complex) -> ComplexArray:
    way = np.array(shape.path)
    length = abs(b - a) or math.inf
    return a + way[:, 0] * (b - a) + 1j * way[:, 1] * (b - a) / length


def _spiral(size: float, centre: complex, a: complex, b: complex) -> ComplexArray:
    start = cmath.phase(a - centre)
    part = np.linspace(0.0, 1.0, 61)
    sweep = cmath.phase(b - centre) - start + 4 * math.pi
    return np.asarray(
        centre + size * (0.25 + 0.75 * part) * np.exp(1j * (start + sweep * part)),
        dtype=np.complex128,
    )


def _spokes(size: float, centre: complex, origin: complex, along: complex) -> list[ComplexArray]:
    direction = (along - origin) / abs(along - origin)
    rolled = ((centre - origin) * direction.conjugate()).real / size
    arms = (0.92 * size * cmath.exp(1j * (k * math.pi / 3 - rolled)) for k in range(3))
    return [np.array([centre - arm, centre + arm]) for arm in arms]


def _hatch(size: float, a: complex, b: complex) -> list[ComplexArray]:
    length = abs(b - a)
    count = min(max(round(length / size), 1), _MOST_HATCHES)
    stroke = 0.75 * size * (1 + 1j) * (b - a) / (length or 1.0)
    feet = (a + (k + 1) / count * (b - a) for k in range(count))
    return [np.array([a, b]), *(np.array([foot, foot - stroke]) for foot in feet)]
