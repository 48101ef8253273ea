"""A free joint: the coordinates of a body that nothing holds."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from ..spec import Name, Vector
from .base import GROUND, BaseJoint, Basic, Feature


class FreeJoint(BaseJoint):
    """No constraint; the coordinates of a body are the world position of one of its points."""

    kind: Literal["free"] = "free"
    parent: Name = Field(default=GROUND, description="the ground")
    parent_point: Vector = Field(
        default=(0.0, 0.0), description="where both coordinates are zero [m]"
    )
    child_point: Vector = Field(
        default=(0.0, 0.0), description="whose position they are, in the child's frame [m]"
    )
    coordinates: tuple[Name, Name] = Field(
        description="names of the point's position along x and y"
    )

    @model_validator(mode="after")
    def _moves_in_the_world(self) -> Self:
        if self.parent != GROUND:
            raise ValueError(
                f"parent of {self.name!r} is {self.parent!r}; "
                "a free joint has the ground as its parent"
            )
        return self

    @property
    def features(self) -> tuple[Feature | Basic, ...]:
        return (Feature.FREE_JOINT,)

    @property
    def free_directions(self) -> tuple[complex, ...]:
        return (1.0, 1j)

    @property
    def held_directions(self) -> tuple[complex, ...]:
        return ()

    @property
    def slides(self) -> tuple[str, ...]:
        return self.coordinates
