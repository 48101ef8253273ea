"""Points in the frames of other bodies, which may move themselves: slides along lines, and distances from walls.

With the vector r from the frame's anchor to the point in the world, and the rotation p of the frame
(anticlockwise, as Exudyn's are), the place is r exp(-i p); its speed and acceleration are
derivatives of that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...models.arrays import ComplexArray
from ...models.joints import GROUND, AnyJoint
from ...models.mechanism import Marker
from ...models.spec import Vector
from ...models.stops import PointStop
from .sensors import Values, rotation


@dataclass(frozen=True)
class RelativePoint:
    """A point of a body in the frame of another one (or of the ground), by sensors of both."""

    point: Marker
    """Its name is that of the sensors."""
    kind: str
    """Of the point's sensors; what stands on the ground has none."""
    frame: str
    """The other body."""
    origin: Vector
    """Where the frame's anchor is in it [m]."""

    @property
    def anchor(self) -> Marker:
        """The frame's anchor as a point to observe."""
        return Marker(name=self.point.name, body=self.frame, point=self.origin)

    @property
    def anchor_kind(self) -> str:
        """Of the anchor's sensors."""
        return f"{self.kind} anchor"

    def place(self, values: Values) -> ComplexArray:
        """From the anchor, in the frame [m], shape (n,)."""
        return self._apart(values, "Position") * self._back(values)

    def speed(self, values: Values) -> ComplexArray:
        """Of the place [m/s], shape (n,)."""
        spin = rotation(self.frame, values, "Coordinates_t")
        speed = self._apart(values, "Velocity") - 1j * spin * self._apart(values, "Position")
        return speed * self._back(values)

    def acceleration(self, values: Values, rotational: float) -> ComplexArray:
        """Of the place [m/s^2], shape (n,); `rotational` is the frame's rotational acceleration [rad/s^2]."""
        spin = rotation(self.frame, values, "Coordinates_t")
        turning = 2j * spin * self._apart(values, "Velocity")
        turning = turning + (1j * rotational + spin**2) * self._apart(values, "Position")
        return (self._apart(values, "Acceleration") - turning) * self._back(values)

    def _apart(self, values: Values, quantity: str) -> ComplexArray:
        point = _motion(self.kind, self.point, values, quantity)
        return point - _motion(self.anchor_kind, self.anchor, values, quantity)

    def _back(self, values: Values) -> ComplexArray:
        return np.exp(-1j * rotation(self.frame, values))


def on_joint(joint: AnyJoint) -> RelativePoint:
    """The child's point of a joint from the parent's, in the parent's frame."""
    child = Marker(name=joint.name, body=joint.child, point=joint.child_point)
    return RelativePoint(child, "joint", joint.parent, joint.parent_point)


def on_wall(stop: PointStop) -> RelativePoint:
    """The point of a stop from the origin of the wall's frame, in that."""
    return RelativePoint(
        Marker(name=stop.name, body=stop.body, point=stop.point),
        "stop",
        stop.relative_to,
        (0.0, 0.0),
    )


def _motion(kind: str, point: Marker, values: Values, quantity: str) -> ComplexArray:
    """Position, velocity or acceleration of a point; one of the ground needs no sensor."""
    if point.body == GROUND:
        return np.full(1, complex(*point.point) if quantity == "Position" else 0.0)
    vectors = values((kind, point.name, quantity))
    return vectors[:, 0] + 1j * vectors[:, 1]
