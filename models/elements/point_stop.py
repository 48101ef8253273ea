"""A stop on a point: a wall, a floor, a trough, or the straight side of another body."""

from __future__ import annotations

import cmath
from collections.abc import Callable
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from ..functions import LineFunction, PointFunction
from ..spec import Name, Real, Vector, as_complex
from .base import GROUND, BaseStop, Basic, Feature, Geometry, refuse_other_lengths


class PointStop(BaseStop):
    """A unilateral constraint that keeps a point in a half-plane.

    Its gap is normal . position - offset >= 0.

    A trough, a floor, a wall without friction; or the straight side of another body, in whose frame
    position, normal and offset then are. Its force is along the normal: >= 0 while it pushes, 0
    when open.
    """

    gap_unit: ClassVar[str] = "m"
    speed_unit: ClassVar[str] = "m/s"
    force_unit: ClassVar[str] = "N"
    effort: ClassVar[Literal["torque", "force"]] = "force"
    position_field: ClassVar[Literal["limit", "offset"]] = "offset"

    name: Name
    body: Name
    point: Vector = Field(description="of the body, in its frame [m]")
    relative_to: Name = Field(
        default=GROUND,
        exclude_if=lambda body: body == GROUND,
        description="the body with the wall, or 'ground'",
    )
    normal: Vector = Field(
        description="from the wall towards where the point may be, in the wall's frame, length 1"
    )
    offset: Real = Field(
        description="distance of the wall from its frame's origin along the normal [m]"
    )
    closed: bool = Field(description="whether it touches at the start")
    restitution: Annotated[Real, Field(ge=0, le=1)] = Field(
        default=0.0,
        description="gap speed after an impact over the one before, under the unilateral law",
    )

    @model_validator(mode="after")
    def _normal_has_length_one(self) -> Self:
        refuse_other_lengths(f"normal of {self.name!r}", self.normal)
        return self

    @property
    def bodies(self) -> tuple[str, ...]:
        return (self.body,) if self.relative_to == GROUND else (self.body, self.relative_to)

    @property
    def features(self) -> tuple[Feature | Basic, ...]:
        features: tuple[Feature | Basic, ...] = (Basic.POINT_STOP,)
        if self.relative_to != GROUND:
            features += (Feature.MOVING_WALL,)
        if self.restitution:
            features += (Basic.REBOUND,)
        return features

    def component(
        self, angle: Callable[[str], float], point: Callable[[str, Vector], complex]
    ) -> float:
        """The point's component along the normal.

        Of a wall that moves only places may be given, for the gap is not linear in the motion.
        """
        at, normal = point(self.body, self.point), complex(*self.normal)
        if self.relative_to != GROUND:
            at -= point(self.relative_to, (0.0, 0.0))
            normal *= cmath.exp(-1j * angle(self.relative_to))
        return normal.real * at.real + normal.imag * at.imag

    def gap(self, geometry: Geometry) -> PointFunction | LineFunction:
        vector = geometry.between(self.body, self.point, self.relative_to, (0.0, 0.0))
        return geometry.component(as_complex(self.normal), self.relative_to, vector, -self.offset)
