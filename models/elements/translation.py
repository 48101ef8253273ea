"""A joint that holds the angle of a body alone: the body moves without turning."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from ..spec import Real
from .base import Basic, Feature
from .free import FreeJoint


class TranslationJoint(FreeJoint):
    """A body moves in the plane without turning: two slides in the world.

    Its coordinates are the world position of one of its points.
    """

    holds_angle: ClassVar[bool] = True

    kind: Literal["translation"] = "translation"  # type: ignore[assignment]
    angle: Real = Field(default=0.0, description="the body's angle [rad]")

    @property
    def features(self) -> tuple[Feature | Basic, ...]:
        return (Feature.TRANSLATION,)

    @property
    def turned_by(self) -> float:
        return self.angle
