"""Joints of a planar mechanism: which motions of a child's point and angle its parent holds."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from .spec import Name, Real, Spec, Vector, as_complex

GROUND = "ground"
_UNIT = 1e-12  # by which the square of a direction's length may differ from 1


def refuse_other_lengths(what: str, direction: Vector) -> None:
    """Raise ValueError if a direction has not length 1; `what` begins the sentence."""
    if abs(direction[0] ** 2 + direction[1] ** 2 - 1.0) > _UNIT:
        raise ValueError(f"{what} must have length 1")


class _Joint(Spec):
    """What every joint has. Directions are complex, x + i y, in the parent's frame."""

    holds_angle: ClassVar[bool] = False
    """Whether the child turns with the parent."""
    name: Name
    parent: Name = Field(description="a body, or 'ground'")
    child: Name
    parent_point: Vector = Field(description="in the parent's frame [m]")
    child_point: Vector = Field(description="in the child's frame [m]")

    @property
    def free_directions(self) -> tuple[complex, ...]:
        """Directions in which the child's point slides."""
        return ()

    @property
    def held_directions(self) -> tuple[complex, ...]:
        """Directions in which the child's point is held."""
        return (1.0, 1j)

    @property
    def slides(self) -> tuple[str, ...]:
        """Names of its slide coordinates, one a free direction; none where it closes a loop."""
        return ()

    @property
    def turned_by(self) -> float | None:
        """The child's angle less the parent's [rad]; None where it is free."""
        return None


class PinJoint(_Joint):
    """Two points of two bodies coincide."""

    kind: Literal["pin"] = "pin"


class WeldJoint(_Joint):
    """Two points of two bodies coincide, and the angle between the bodies is constant."""

    holds_angle: ClassVar[bool] = True

    kind: Literal["weld"] = "weld"
    angle: Real = Field(default=0.0, description="the child's angle less the parent's [rad]")

    @property
    def turned_by(self) -> float:
        """The child's angle less the parent's [rad]."""
        return self.angle


class _SlidingJoint(_Joint):
    """A point of the child slides along a straight line of the parent."""

    parent: Name = Field(default=GROUND, description="the body with the line, or 'ground'")
    parent_point: Vector = Field(
        description="a point of the line, where its coordinate is zero [m]"
    )
    axis: Vector = Field(description="direction of the line in the parent's frame, length 1")
    coordinate: Name | None = Field(
        default=None, description="name of its slide coordinate; none where it closes a loop"
    )

    @model_validator(mode="after")
    def _axis_has_length_one(self) -> Self:
        refuse_other_lengths(f"axis of {self.name!r}", self.axis)
        return self

    @property
    def free_directions(self) -> tuple[complex, ...]:
        """Along the line."""
        return (as_complex(self.axis),)

    @property
    def held_directions(self) -> tuple[complex, ...]:
        """Across the line."""
        return (1j * as_complex(self.axis),)

    @property
    def slides(self) -> tuple[str, ...]:
        """Its coordinate's name."""
        return () if self.coordinate is None else (self.coordinate,)


class SlotJoint(_SlidingJoint):
    """A point of a body slides along a straight slot in another body or in the ground (pin in slot)."""

    kind: Literal["pin-in-slot"] = "pin-in-slot"


class PrismaticJoint(_SlidingJoint):
    """A body slides along a straight line of another one, or of the ground, without turning relative to it."""

    holds_angle: ClassVar[bool] = True

    kind: Literal["prismatic"] = "prismatic"
    angle: Real = Field(default=0.0, description="the child's angle less the parent's [rad]")

    @property
    def turned_by(self) -> float:
        """The child's angle less the parent's [rad]."""
        return self.angle


class FreeJoint(_Joint):
    """No constraint: the coordinates of a body that nothing holds, the world position of one of its points."""

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
                f"parent of {self.name!r} is {self.parent!r}; a free joint has the ground as its parent"
            )
        return self

    @property
    def free_directions(self) -> tuple[complex, ...]:
        """Along x and y."""
        return (1.0, 1j)

    @property
    def held_directions(self) -> tuple[complex, ...]:
        """None."""
        return ()

    @property
    def slides(self) -> tuple[str, ...]:
        """Names of both coordinates."""
        return self.coordinates


AnyJoint = PinJoint | WeldJoint | SlotJoint | PrismaticJoint | FreeJoint
Joint = Annotated[AnyJoint, Field(discriminator="kind")]
