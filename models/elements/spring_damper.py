"""A linear spring and damper between two points."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from ..arrays import ComplexArray, FloatArray
from ..functions import PointCoefficients
from ..spec import NonNegative, Vector
from .base import GROUND, Feature, Geometry, TwoBodyForceElement

_COINCIDENT = 1e-12  # [m] points that are closer have no direction from one to the other


class SpringDamper(TwoBodyForceElement):
    """A linear spring and damper between two points, along the line that joins them.

    With the distance l of the points and its rate v it pulls them together with k (l - l0) + c v
    [N].
    """

    feature: ClassVar[Feature] = Feature.SPRING
    acts_along: ClassVar[Literal["vector", "angle", "point"]] = "vector"

    kind: Literal["spring-damper"] = "spring-damper"
    point: Vector = Field(description="of the body, in its frame [m]")
    relative_point: Vector = Field(description="of the other body, in its frame [m]")
    stiffness: NonNegative = Field(default=0.0, description="k [N/m]")
    damping: NonNegative = Field(default=0.0, description="c [N s/m]")
    rest_length: NonNegative = Field(default=0.0, description="l0 [m]")

    @property
    def ends(self) -> tuple[tuple[str, Vector], ...]:
        """Bodies with their points, the body's own first."""
        return (self.body, self.point), (self.relative_to, self.relative_point)

    @property
    def dissipates(self) -> bool:
        return self.damping > 0

    @property
    def works(self) -> bool:
        return self.dissipates

    @property
    def pushes_along_x(self) -> bool:
        """Tell whether it acts on the mechanism from outside: whether one end is on the ground."""
        return GROUND in self.bodies

    def refuse_start(
        self, angle: Callable[[str], float], point: Callable[[str, Vector], complex]
    ) -> None:
        if not (self.rest_length or self.damping):
            return
        vector = point(self.body, self.point) - point(self.relative_to, self.relative_point)
        if abs(vector) <= _COINCIDENT:
            raise ValueError(
                f"the points of {self.name!r} coincide at the start: "
                "its force has no direction there"
            )

    def direction(self, geometry: Geometry) -> PointCoefficients:
        return geometry.between(self.body, self.point, self.relative_to, self.relative_point)

    def pull(self, vector: ComplexArray, speed: ComplexArray) -> ComplexArray:
        """Force on the body's point, x + i y [N].

        Without damping and rest length it is smooth where the points meet.

        Args:
            vector: from the other body's point to the body's, x + i y [m].
            speed: its derivative [m/s]; or the component along the vector, as a real number.
        """
        force = -self.stiffness * vector
        if self.rest_length or self.damping:
            size = self.stiffness * self.rest_length - self.damping * _stretching(vector, speed)
            force = force + size * vector / np.abs(vector)
        return force

    def generalized(
        self,
        geometry: Geometry,
        direction: PointCoefficients,
        q: FloatArray,
        u: FloatArray,
        rates: ComplexArray,
    ) -> FloatArray:
        gradient = geometry.gradient(direction.coefficients, q, rates)
        force = self.pull(geometry.vector(direction, q), np.sum(gradient * u, axis=-1))
        return (force.conj()[..., None] * gradient).real

    def body_forces(
        self, geometry: Geometry, direction: PointCoefficients, q: FloatArray, u: FloatArray
    ) -> Iterator[tuple[str, ComplexArray]]:
        force = self.pull(geometry.vector(direction, q), geometry.rate(direction, q, u))
        yield self.body, force
        yield self.relative_to, -force

    def potential_energy(
        self, geometry: Geometry, direction: PointCoefficients, q: FloatArray
    ) -> FloatArray:
        """Energy k (l - l0)^2 / 2 [J]."""
        stretch = np.abs(geometry.vector(direction, q)) - self.rest_length
        return 0.5 * self.stiffness * stretch**2

    def stiffness_at(self, geometry: Geometry, q: FloatArray) -> float:
        return self.stiffness

    def power(
        self, geometry: Geometry, direction: PointCoefficients, q: FloatArray, u: FloatArray
    ) -> FloatArray | float:
        """Power of the damper, -c v^2 [W]."""
        if not self.damping:
            return 0.0
        rate = _stretching(geometry.vector(direction, q), geometry.rate(direction, q, u))
        return -(self.damping * rate**2)


def _stretching(vector: ComplexArray, speed: ComplexArray) -> FloatArray:
    """Rate of a vector's length [m/s]."""
    return (vector.conj() * speed).real / np.abs(vector)
