"""A linear spring, damper and constant force along the slide of a joint."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from ..arrays import FloatArray
from ..functions import AngleFunction
from ..spec import Name, NonNegative, Real
from .base import Feature, Geometry, LinearElement


class SlideSpringDamper(LinearElement):
    """A linear spring, damper and constant force along the slide of a joint of the tree.

    With the slide coordinate x and its rate v the force on the body along the slide is
    f0 - k (x - x0) - c v [N], and the opposite on the other one.
    """

    feature: ClassVar[Feature] = Feature.SLIDE_SPRING

    kind: Literal["slide-spring-damper"] = "slide-spring-damper"
    coordinate: Name = Field(description="name of the slide coordinate of the body's joint")
    stiffness: NonNegative = Field(default=0.0, description="k [N/m]")
    damping: NonNegative = Field(default=0.0, description="c [N s/m]")
    rest_position: Real = Field(default=0.0, description="x0 [m]")
    force: Real = Field(default=0.0, description="f0, constant, along the slide [N]")

    @property
    def dissipates(self) -> bool:
        return self.damping > 0

    @property
    def linear_law(self) -> tuple[float, float]:
        return self.stiffness, self.damping

    @property
    def works(self) -> bool:
        return self.dissipates or self.force != 0

    @property
    def slide(self) -> str:
        return self.coordinate

    def effort(self, along: AngleFunction, q: FloatArray, u: FloatArray) -> FloatArray:
        """Force f0 - k (x - x0) - c v on the body along the slide [N], shape (...,)."""
        spring = self.force - self.stiffness * (along.value(q) - self.rest_position)
        return spring - self.damping * (u @ along.coefficients)

    def potential_energy(
        self, geometry: Geometry, direction: AngleFunction, q: FloatArray
    ) -> FloatArray:
        """Energy k (x - x0)^2 / 2 [J]."""
        return 0.5 * self.stiffness * (direction.value(q) - self.rest_position) ** 2

    def stiffness_at(self, geometry: Geometry, q: FloatArray) -> float:
        return self.stiffness

    def power(
        self, geometry: Geometry, direction: AngleFunction, q: FloatArray, u: FloatArray
    ) -> FloatArray:
        """Power of the damper and of the constant force, (f0 - c v) v [W]."""
        rate = u @ direction.coefficients
        return np.asarray((self.force - self.damping * rate) * rate)
