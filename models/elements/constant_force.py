"""A constant force on a point of a body."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from ..arrays import ComplexArray, FloatArray
from ..functions import PointCoefficients
from ..spec import Vector
from .base import BaseForceElement, Feature, Geometry


class ConstantForce(BaseForceElement):
    """A force of constant size and direction on a point of a body."""

    feature: ClassVar[Feature] = Feature.FORCE
    acts_along: ClassVar[Literal["vector", "angle", "point"]] = "point"

    kind: Literal["constant-force"] = "constant-force"
    point: Vector = Field(description="of the body, in its frame [m]")
    force: Vector = Field(description="in the world's directions [N]")

    @property
    def pushes_along_x(self) -> bool:
        return self.force[0] != 0

    def direction(self, geometry: Geometry) -> PointCoefficients:
        return geometry.point(self.body, self.point)

    def generalized(
        self,
        geometry: Geometry,
        direction: PointCoefficients,
        q: FloatArray,
        u: FloatArray,
        rates: ComplexArray,
    ) -> FloatArray:
        """Its generalized forces Re(conj(F) dz/dq) [N m or N], shape (..., n_q)."""
        gradient = geometry.gradient(direction.coefficients, q, rates)
        return self.force[0] * gradient.real + self.force[1] * gradient.imag

    def body_forces(
        self, geometry: Geometry, direction: PointCoefficients, q: FloatArray, u: FloatArray
    ) -> Iterator[tuple[str, ComplexArray]]:
        yield self.body, np.full(q.shape[:-1], complex(*self.force))

    def power(
        self, geometry: Geometry, direction: PointCoefficients, q: FloatArray, u: FloatArray
    ) -> FloatArray:
        """Power on the moving point [W]."""
        return (complex(*self.force).conjugate() * geometry.rate(direction, q, u)).real
