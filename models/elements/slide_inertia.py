"""The inertia of a drive along a slide: MuJoCo's armature of a slide joint, an inerter."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from ..arrays import ComplexArray, FloatArray
from ..functions import AngleFunction
from ..spec import Name, NonNegative
from .base import Feature, Geometry, LinearElement


class SlideInertia(LinearElement):
    """Inertia that moves with the slide of a joint of the tree, such as a geared drive's.

    With the rate v of the slide it adds J v^2 / 2 to the kinetic energy: the reflected inertia of
    the motor of a rack or a screw, which has no weight. The force on the body along the slide is
    -J dv/dt [N], and the opposite on the other one.
    """

    feature: ClassVar[Feature] = Feature.SLIDE_INERTIA

    kind: Literal["slide-inertia"] = "slide-inertia"
    coordinate: Name = Field(description="name of the slide coordinate of the body's joint")
    inertia: NonNegative = Field(description="J, along the slide [kg]")

    @property
    def linear_law(self) -> tuple[float, float]:
        return 0.0, 0.0

    @property
    def slide(self) -> str:
        return self.coordinate

    def effort(self, along: AngleFunction, q: FloatArray, u: FloatArray) -> FloatArray:
        """None without accelerations: its part of the mass matrix is on their side [N]."""
        return np.zeros(q.shape[:-1])

    def inertial_forces(
        self, geometry: Geometry, direction: AngleFunction, q: FloatArray, a: FloatArray
    ) -> Iterator[tuple[str, ComplexArray]]:
        """Force -J dv/dt along the slide on the body, the opposite on the other one [N]."""
        return self.along_slide(geometry, q, -self.inertia * (a @ direction.coefficients))

    def mass_matrix(self, geometry: Geometry) -> FloatArray:
        """J g g^T with the gradient g of the slide [kg], shape (..., n_q, n_q)."""
        return self.direction(geometry).outer(self.inertia)
