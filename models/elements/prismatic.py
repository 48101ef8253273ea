"""A prismatic joint: a body slides along a line without turning."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from ..spec import Real
from .base import Basic, Feature, SlidingJoint


class PrismaticJoint(SlidingJoint):
    """A body slides along a straight line of another one, or of the ground, without turning."""

    holds_angle: ClassVar[bool] = True

    kind: Literal["prismatic"] = "prismatic"
    angle: Real = Field(default=0.0, description="the child's angle less the parent's [rad]")

    @property
    def features(self) -> tuple[Feature | Basic, ...]:
        return (Feature.PRISMATIC,)

    @property
    def turned_by(self) -> float:
        return self.angle
