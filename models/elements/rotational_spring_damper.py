"""A linear spring and damper on a relative angle."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from ..arrays import FloatArray
from ..functions import AngleFunction
from ..spec import NonNegative, Real
from .base import Feature, Geometry, TorqueElement


class RotationalSpringDamper(TorqueElement):
    """A linear spring and damper on a relative angle.

    With the angle b of the body less that of the other and its rate w the torque on the body is
    -(k (b - b0) + c w) [N m], and the opposite on the other one; clockwise positive, as angles are.
    """

    feature: ClassVar[Feature] = Feature.ROTATIONAL_SPRING

    kind: Literal["rotational-spring-damper"] = "rotational-spring-damper"
    stiffness: NonNegative = Field(default=0.0, description="k [N m/rad]")
    damping: NonNegative = Field(default=0.0, description="c [N m s/rad]")
    rest_angle: Real = Field(default=0.0, description="b0 [rad]")

    @property
    def dissipates(self) -> bool:
        return self.damping > 0

    @property
    def linear_law(self) -> tuple[float, float]:
        return self.stiffness, self.damping

    @property
    def works(self) -> bool:
        return self.dissipates

    def torque_on_body(self, angle: AngleFunction, q: FloatArray, u: FloatArray) -> FloatArray:
        """-(k (b - b0) + c w) [N m]."""
        spring = -self.stiffness * (angle.value(q) - self.rest_angle)
        return spring - self.damping * (u @ angle.coefficients)

    def potential_energy(
        self, geometry: Geometry, direction: AngleFunction, q: FloatArray
    ) -> FloatArray:
        """Energy k (b - b0)^2 / 2 [J]."""
        return 0.5 * self.stiffness * (direction.value(q) - self.rest_angle) ** 2

    def stiffness_at(self, geometry: Geometry, q: FloatArray) -> float:
        return self.stiffness

    def power(
        self, geometry: Geometry, direction: AngleFunction, q: FloatArray, u: FloatArray
    ) -> FloatArray:
        """Power of the damper, -c w^2 [W]."""
        return -self.damping * (u @ direction.coefficients) ** 2
