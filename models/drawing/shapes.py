"""What a drawing is made of: points that move with bodies, and shapes over indices of these points.

Every renderer (canvas in a page, SVG, raster) draws the same shapes from the positions of the
points alone. So the drawing of a run with magnified deviations is that of the points z + k (z' -
z), z the reference's and z' the run's.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from ..arrays import FloatArray, as_vectors
from ..joints import GROUND
from ..kinematics import Kinematics, PointCoefficients
from ..mechanism import Mechanism

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
"""What is drawn again for each run, over the reference."""

Box = tuple[float, float, float, float]
"""Least x and y, greatest x and y [m]."""


@dataclass(frozen=True)
class Point:
    """A point of a body, or at an arm from it that turns with another body's frame."""

    body: str
    at: complex
    """In the body's frame [m]."""
    frame: str = GROUND
    arm: complex = 0j
    """In the frame of `frame` [m]."""

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
    points: tuple[Point, ...]
    shapes: tuple[Shape, ...]
    markers: dict[str, int]
    """Index of each marker's point, by name."""
    compared: tuple[int, ...]
    """Indices of the points whose distance from the reference's counts: the markers', or without any, of the bodies'
    centres of mass."""
    joints: dict[str, int]
    """Index of the point at which each joint's force acts."""
    stops: dict[str, tuple[int, int]]
    """Index of the point at which each stop acts; for one on a point also of a point along its normal, else the same
    index again."""
    box: Box
    size: float
    """A length [m] of the whole, from which the sizes of symbols follow."""

    @cached_property
    def kinematics(self) -> Kinematics:
        """Of the mechanism."""
        return Kinematics(self.mechanism)

    @cached_property
    def rows(self) -> tuple[PointCoefficients, ...]:
        """Coefficients of the points' positions."""
        return tuple(point.coefficients(self.kinematics) for point in self.points)

    def positions(self, q: FloatArray) -> FloatArray:
        """World positions [m] in states q of shape (n, n_q); shape (n, n_points, 2)."""
        return positions(self.kinematics, self.rows, q)

    def deviations(self, q: FloatArray, d: FloatArray) -> FloatArray:
        """Positions in states q + d less those in q [m], shape (n, n_points, 2), to the digits of d.

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
