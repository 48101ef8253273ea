"""A torsion spring whose torque has a cubic term: Duffing's spring."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from ..arrays import FloatArray
from ..functions import AngleFunction
from ..spec import NonNegative, Real
from .base import Feature, Geometry, TorqueElement


class CubicTorsionSpring(TorqueElement):
    """A nonlinear spring on a relative angle: Duffing's, which hardens.

    With the angle b of the body less that of the other the torque on the body is
    -(k (b - b0) + k3 (b - b0)^3) [N m], and the opposite on the other one; clockwise positive, as
    angles are. Its energy is k (b - b0)^2 / 2 + k3 (b - b0)^4 / 4 [J].
    """

    feature: ClassVar[Feature] = Feature.CUBIC_SPRING

    kind: Literal["cubic-torsion-spring"] = "cubic-torsion-spring"
    stiffness: NonNegative = Field(default=0.0, description="k [N m/rad]")
    cubic_stiffness: NonNegative = Field(default=0.0, description="k3 [N m/rad^3]")
    rest_angle: Real = Field(default=0.0, description="b0 [rad]")

    def torque_on_body(self, angle: AngleFunction, q: FloatArray, u: FloatArray) -> FloatArray:
        """-(k (b - b0) + k3 (b - b0)^3) [N m]."""
        turned = angle.value(q) - self.rest_angle
        return -(self.stiffness * turned + self.cubic_stiffness * turned * turned * turned)

    def potential_energy(
        self, geometry: Geometry, direction: AngleFunction, q: FloatArray
    ) -> FloatArray:
        """Energy k (b - b0)^2 / 2 + k3 (b - b0)^4 / 4 [J]."""
        squared = (direction.value(q) - self.rest_angle) ** 2
        return 0.5 * self.stiffness * squared + 0.25 * self.cubic_stiffness * squared * squared

    def stiffness_at(self, geometry: Geometry, q: FloatArray) -> float:
        """K + 3 k3 (b - b0)^2 [N m/rad]."""
        turned = float(self.direction(geometry).value(q)) - self.rest_angle
        return self.stiffness + 3 * self.cubic_stiffness * turned**2
