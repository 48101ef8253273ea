"""A weld: two bodies move as one."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from ..spec import Real
from .base import BaseJoint, Basic, Feature


class WeldJoint(BaseJoint):
    """Two points of two bodies coincide, and the angle between the bodies is constant."""

    holds_angle: ClassVar[bool] = True

    kind: Literal["weld"] = "weld"
    angle: Real = Field(default=0.0, description="the child's angle less the parent's [rad]")

    @property
    def features(self) -> tuple[Feature | Basic, ...]:
        return (Feature.WELD,)

    @property
    def turned_by(self) -> float:
        return self.angle
