"""A torsion spring whose torque grows with the cube of the angle as well."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from ..force_elements import TwoBodyForceElement
from ..spec import NonNegative, Real


class CubicTorsionSpring(TwoBodyForceElement):
    """A nonlinear spring on a relative angle: Duffing's, which hardens.

    With the angle b of the body less that of the other the torque on the body is
    -(k (b - b0) + k3 (b - b0)^3) [N m], and the opposite on the other one; clockwise positive, as
    angles are. Its energy is k (b - b0)^2 / 2 + k3 (b - b0)^4 / 4 [J].
    """

    kind: Literal["cubic-torsion-spring"] = "cubic-torsion-spring"
    stiffness: NonNegative = Field(default=0.0, description="k [N m/rad]")
    cubic_stiffness: NonNegative = Field(default=0.0, description="k3 [N m/rad^3]")
    rest_angle: Real = Field(default=0.0, description="b0 [rad]")
