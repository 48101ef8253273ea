"""The stops of a built Exudyn system: what its connectors and sensors say of their gaps and forces.

Exudyn's rotations are positive anticlockwise, the mechanism's angles clockwise.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ...models.arrays import ComplexArray, FloatArray
from ...models.stops import AnyStop, PointStop, Stop
from .lines import on_wall
from .sensors import Values, rotation, turned

ROUNDING = (
    1e-15  # [rad] of the difference of two angles of some radians; [m per m] of a point's position
)

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

        A constraint's equation includes its offset; the offset of a spring is its preload, and no
        gap.
        """
        return -self.sense * float(output("Displacement" if self.spring else "ConstraintEquation"))

    def rounding(self, values: Values) -> float:
        """Rounding error of the gap [rad]."""
        return ROUNDING


@dataclass(frozen=True)
class PointContact:
    """A stop on a point: a line of the ground or of another body that the point is on, without friction."""

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
        return ROUNDING * max(
            1.0, float(np.abs(values(("stop", self.stop.name, "Position"))).max())
        )

    def _along_normal(self, local: FloatArray, values: Values) -> FloatArray:
        angle = rotation(self.stop.body, values) - rotation(self.stop.relative_to, values)
        return turned(local, angle) @ np.array(self.stop.normal)


UnilateralConstraint = AngleLimit | PointContact


def gap(stop: AnyStop, values: Values) -> float:
    """Gap of a stop by the bodies' coordinates, of one row of sensors [rad, m]."""
    if isinstance(stop, PointStop):
        return _along(stop, on_wall(stop).place(values)) - stop.offset
    return _turn(stop, lambda body: float(rotation(body, values)[0])) - stop.limit


def gap_speed(stop: AnyStop, values: Values) -> float:
    """Speed of a stop's gap, of one row of sensors [rad/s, m/s]."""
    if isinstance(stop, PointStop):
        return _along(stop, on_wall(stop).speed(values))
    return _turn(stop, lambda body: float(rotation(body, values, "Coordinates_t")[0]))


def gap_acceleration(stop: AnyStop, values: Values, rotations: Mapping[str, float]) -> float:
    """Acceleration of a stop's gap [rad/s^2, m/s^2]; `rotations` are the bodies' rotational accelerations [rad/s^2]."""
    if isinstance(stop, PointStop):
        return _along(
            stop, on_wall(stop).acceleration(values, rotations.get(stop.relative_to, 0.0))
        )
    return _turn(stop, lambda body: rotations.get(body, 0.0))


def _along(stop: PointStop, place: ComplexArray) -> float:
    return stop.normal[0] * float(place[0].real) + stop.normal[1] * float(place[0].imag)


def _turn(stop: Stop, rotation_of: Callable[[str], float]) -> float:
    """The relative angle that a stop is on, clockwise and in its sense, or a derivative of it."""
    return -stop.sense * (rotation_of(stop.body) - rotation_of(stop.relative_to))
