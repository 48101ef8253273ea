"""The drawing of a mechanism in the making: its motion, its points and shapes so far, and the sizes of symbols."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..arrays import ComplexArray, FloatArray
from ..force_elements import ConstantForce, SpringDamper
from ..joints import GROUND, AnyJoint, FreeJoint
from ..kinematics import Kinematics
from ..mechanism import Mechanism
from ..spec import Vector
from .shapes import Kind, Point, Role, Shape, positions


@dataclass
class Sketch:
    """Points and shapes of a mechanism, collected."""

    mechanism: Mechanism
    q: FloatArray
    """Its motion, shape (n, n_q): extents of guides, walls and the whole follow from it."""
    points: dict[Point, int] = field(default_factory=dict[Point, int])
    shapes: list[Shape] = field(default_factory=list[Shape])

    def point(self, body: str, at: complex, frame: str = GROUND, arm: complex = 0j) -> int:
        """Index of a point; the same for the same point."""
        return self.points.setdefault(
            Point(body, complex(at), frame, complex(arm)), len(self.points)
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
        """Of the mechanism."""
        return Kinematics(self.mechanism)

    @cached_property
    def down(self) -> complex:
        """Direction of gravity, in the world."""
        return complex(*self.mechanism.gravity_direction)

    @cached_property
    def size(self) -> float:
        """The longer side of what the bodies' points and centres sweep [m]; of a point that rests, 1."""
        points = [(name, at) for name, ats in self.outlines.items() for at in ats]
        points += [(body.name, complex(*body.centre)) for body in self.mechanism.bodies]
        xy = positions(
            self.kinematics, (Point(*each).coefficients(self.kinematics) for each in points), self.q
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
        mechanism, found = self.mechanism, list[tuple[str, complex]]()
        for joint in mechanism.joints:
            if not isinstance(joint, FreeJoint):
                found.append((joint.child, complex(*joint.child_point)))
                found += [(joint.parent, at) for at in self.guide(joint)]
        found += [
            (each.body, complex(*each.point))
            for each in (*mechanism.markers, *mechanism.point_stops)
        ]
        for element in mechanism.force_elements:
            if isinstance(element, (SpringDamper, ConstantForce)):
                found.append((element.body, complex(*element.point)))
            if isinstance(element, SpringDamper):
                found.append((element.relative_to, complex(*element.relative_point)))
        return found

    def guide(self, joint: AnyJoint) -> list[complex]:
        """Ends of the part of a joint's line that the motion uses, in the parent's frame; of a pin, its point."""
        at = complex(*joint.parent_point)
        if isinstance(joint, FreeJoint) or not joint.free_directions:
            return [at]
        (axis,) = joint.free_directions
        along = self.component(
            axis, joint.parent, joint.child, joint.child_point, joint.parent_point
        )
        return [at + axis * along.min(), at + axis * along.max()]

    def component(
        self, direction: complex, of: str, body: str, point: Vector, origin: Vector = (0.0, 0.0)
    ) -> FloatArray:
        """How far a body's point is along a direction of another body's frame, during the motion [m]."""
        vector = self.kinematics.between(body, point, of, origin)
        return self.kinematics.component(direction, of, vector).value(self.q)

    def hinge(self, body: str, other: str) -> tuple[complex, AnyJoint]:
        """Where a body turns against another one, in its own frame: at their joint, or else at its joint in the tree.

        The joint comes with it.
        """
        joints = self.mechanism.joints
        both = {body, other}
        joint = next(
            (j for j in joints if {j.parent, j.child} == both), self.mechanism.joint_of(body)
        )
        return complex(*(joint.child_point if joint.child == body else joint.parent_point)), joint

    def positions(self) -> FloatArray:
        """Of all points so far, during the motion [m], shape (n, n_points, 2)."""
        return positions(
            self.kinematics, (p.coefficients(self.kinematics) for p in self.points), self.q
        )


def distinct(points: list[complex], centre: complex, size: float) -> list[complex]:
    """Those of the points that are not the centre."""
    return [point for point in points if abs(point - centre) > 1e-9 * size]


def on_a_line(points: ComplexArray) -> bool:
    """Whether points lie on one straight line."""
    spread = np.stack([points.real, points.imag], axis=1)
    values = np.linalg.svd(spread - spread.mean(axis=0), compute_uv=False)
    return bool(values[-1] <= 1e-9 * values[0])
