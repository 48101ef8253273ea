"""The stops of a built Exudyn system: what its connectors and sensors say of their gaps and forces.

Exudyn's rotations are positive anticlockwise, the mechanism's angles clockwise.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ...models.arrays import FloatArray
from ...models.stops import AnyStop, PointStop, Stop

ROUNDING = 1e-15  # [rad] of the difference of two angles of some radians; [m per m] of a point's position

SensorKey = tuple[str, str, str]
"""Kind of item (body, marker, joint, stop), its name, the quantity as Exudyn calls it."""

Values = Callable[[SensorKey], FloatArray]
"""Values of a sensor, shape (n, components): over a table, or one row of the present."""

Output = Callable[[str], Any]
"""An output variable of a connector at the current state, by its name."""


@dataclass(frozen=True)
class Spring:
    """A stop as a spring and damper between two rotations, or between a point and its line."""

    stiffness: float
    """[N m/rad, N/m]"""
    damping: float = 0.0
    """[N m s/rad, N s/m]"""
    torque: float = 0.0
    """With the gap closed and at rest [N m, N]."""


@dataclass(frozen=True)
class AngleLimit:
    """A stop on a relative angle: a connector of two rotations."""

    force_sensor: ClassVar[str] = "Force"
    """Exudyn's name of the connector's force."""

    stop: Stop
    spring: Spring | None

    @property
    def sense(self) -> int:
        """Sign of the connector's displacement that closes the gap: 1 or -1."""
        return self.stop.sense

    def torque(self, values: Values) -> FloatArray:
        """Torque while it is active [N m], shape (n,)."""
        return self.stop.sense * values(("stop", self.stop.name, self.force_sensor))[:, 0]

    def connector_gap(self, output: Output, values: Values) -> float:
        """Gap by the connector's own measure at the current state [rad].

        A constraint's equation includes its offset; the offset of a spring is its preload, and no gap.
        """
        return -self.sense * float(output("Displacement" if self.spring else "ConstraintEquation"))

    def rounding(self, values: Values) -> float:
        """Rounding error of the gap [rad]."""
        return ROUNDING


@dataclass(frozen=True)
class PointContact:
    """A stop on a point: a line of the ground that the point is on, without friction."""

    force_sensor: ClassVar[str] = "ForceLocal"
    sense: ClassVar[int] = 1

    stop: PointStop
    spring: Spring | None

    def torque(self, values: Values) -> FloatArray:
        """Force along the normal while it is active [N], shape (n,); that of a constraint is in the body's frame."""
        force = values(("stop", self.stop.name, self.force_sensor))
        return force[:, 0] if self.spring else self._along_normal(force, values)

    def connector_gap(self, output: Output, values: Values) -> float:
        """Gap by the connector's displacement at the current state [m]; that of a constraint is in the body's frame."""
        displacement = output("DisplacementLocal")
        if self.spring:
            return -float(displacement)
        return -float(self._along_normal(np.atleast_2d(displacement), values)[0])

    def rounding(self, values: Values) -> float:
        """Rounding error of the gap [m]."""
        return ROUNDING * max(1.0, float(np.abs(values(("stop", self.stop.name, "Position"))).max()))

    def _along_normal(self, local: FloatArray, values: Values) -> FloatArray:
        rotation = values(("body", self.stop.body, "CoordinatesTotal"))[:, 2]
        return turned(local, rotation) @ np.array(self.stop.normal)


UnilateralConstraint = AngleLimit | PointContact


def gap(stop: AnyStop, values: Values) -> float:
    """Gap of a stop by the bodies' coordinates, of one row of sensors [rad, m]."""
    return _component(stop, values, "CoordinatesTotal", "Position") - stop.position


def gap_speed(stop: AnyStop, values: Values) -> float:
    """Speed of a stop's gap, of one row of sensors [rad/s, m/s]."""
    return _component(stop, values, "Coordinates_t", "Velocity")


def gap_acceleration(stop: AnyStop, values: Values, rotations: Mapping[str, float]) -> float:
    """Acceleration of a stop's gap [rad/s^2, m/s^2]; `rotations` are the bodies' rotational accelerations [rad/s^2]."""
    return stop.component(lambda body: -rotations[body], lambda _body, _local: _point(stop, values, "Acceleration"))


def _component(stop: AnyStop, values: Values, of_body: str, of_point: str) -> float:
    return stop.component(
        lambda body: -float(values(("body", body, of_body))[0, 2]), lambda _body, _local: _point(stop, values, of_point)
    )


def _point(stop: AnyStop, values: Values, quantity: str) -> complex:
    return complex(*values(("stop", stop.name, quantity))[0, :2])


def turned(local: FloatArray, rotation: FloatArray) -> FloatArray:
    """Vectors of a body's frame in the world's, shape (n, 2); rotations [rad] anticlockwise, shape (n,)."""
    world = (local[:, 0] + 1j * local[:, 1]) * np.exp(1j * rotation)
    return np.stack([world.real, world.imag], axis=-1)
