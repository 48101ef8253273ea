"""A constant torque between two bodies: a motor."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from ..arrays import FloatArray
from ..functions import AngleFunction
from ..spec import Real
from .base import Feature, Geometry, TorqueElement


class ConstantTorque(TorqueElement):
    """A constant torque on a body, and the opposite one on another: a motor."""

    feature: ClassVar[Feature] = Feature.TORQUE

    kind: Literal["constant-torque"] = "constant-torque"
    torque: Real = Field(description="on the body, clockwise positive [N m]")

    @property
    def linear_law(self) -> tuple[float, float]:
        return 0.0, 0.0

    def torque_on_body(self, angle: AngleFunction, q: FloatArray, u: FloatArray) -> FloatArray:
        """The torque in each state [N m], shape (...,)."""
        return self.torque + np.zeros(q.shape[:-1])

    def power(
        self, geometry: Geometry, direction: AngleFunction, q: FloatArray, u: FloatArray
    ) -> FloatArray:
        """T w [W]."""
        return self.torque * (u @ direction.coefficients)
