"""Stops: unilateral constraints on a relative angle, or on a point against a straight wall."""

from __future__ import annotations

import cmath
from collections.abc import Callable
from typing import Annotated, ClassVar, Literal, Self, cast

from pydantic import Discriminator, Field, Tag, model_validator

from .joints import GROUND, refuse_other_lengths
from .spec import Name, Real, Spec, Vector


class Stop(Spec):
    """A unilateral constraint on a relative angle: gap = sense * (angle - angle of the other) - limit >= 0.

    Its torque is the generalised force conjugate to the gap: >= 0 while it pushes, 0 when open.
    """

    gap_unit: ClassVar[str] = "rad"
    speed_unit: ClassVar[str] = "rad/s"
    force_unit: ClassVar[str] = "N m"
    effort: ClassVar[Literal["torque", "force"]] = "torque"
    """What it pushes with."""
    position_field: ClassVar[Literal["limit", "offset"]] = "limit"
    """Name of the field that holds its position."""

    name: Name
    body: Name
    relative_to: Name = GROUND
    sense: Literal[1, -1]
    limit: Real = Field(description="[rad]")
    closed: bool = Field(description="whether it touches at the start")
    restitution: Annotated[Real, Field(ge=0, le=1)] = Field(
        default=0.0,
        description="gap speed after an impact over the one before, under the unilateral law",
    )

    @property
    def bodies(self) -> tuple[str, ...]:
        """The bodies it acts between."""
        return (self.body, self.relative_to)

    @property
    def position(self) -> float:
        """Its limit [rad]."""
        return self.limit

    def component(
        self, angle: Callable[[str], float], point: Callable[[str, Vector], complex]
    ) -> float:
        """The component of a motion along the gap, which is linear in it.

        Of angles and places it is gap + position, of velocities the gap's speed, of accelerations
        the gap's acceleration; so the gap of any stop follows from how bodies turn and points move,
        in whatever coordinates.

        Args:
            angle: of a body other than the ground, positive clockwise [rad], or its derivative.
            point: of a body and a point in its frame: where it is in the world, x + i y [m], or its
                derivative.
        """
        own, other = (0.0 if body == GROUND else angle(body) for body in self.bodies)
        return self.sense * (own - other)


class PointStop(Spec):
    """A unilateral constraint on where a point may be: gap = normal . position - offset >= 0, a half-plane.

    A trough, a floor, a wall without friction; or the straight side of another body, in whose frame
    position, normal and offset then are. Its force is along the normal: >= 0 while it pushes, 0
    when open.
    """

    gap_unit: ClassVar[str] = "m"
    speed_unit: ClassVar[str] = "m/s"
    force_unit: ClassVar[str] = "N"
    effort: ClassVar[Literal["torque", "force"]] = "force"
    """What it pushes with."""
    position_field: ClassVar[Literal["limit", "offset"]] = "offset"
    """Name of the field that holds its position."""

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
        """The bodies it acts between; the one it acts on alone where the wall is the ground's."""
        return (self.body,) if self.relative_to == GROUND else (self.body, self.relative_to)

    @property
    def position(self) -> float:
        """Its offset [m]."""
        return self.offset

    def component(
        self, angle: Callable[[str], float], point: Callable[[str, Vector], complex]
    ) -> float:
        """The component of a motion along the gap, as for a :class:`Stop`: here that of the point along the normal.

        Of a wall that moves this is true of places alone, for the gap is not linear in the bodies'
        motion.
        """
        at, normal = point(self.body, self.point), complex(*self.normal)
        if self.relative_to != GROUND:
            at -= point(self.relative_to, (0.0, 0.0))
            normal *= cmath.exp(-1j * angle(self.relative_to))
        return normal.real * at.real + normal.imag * at.imag


def _tag_of_stop(value: object) -> str:
    if isinstance(value, dict):
        return (
            "point stop"
            if {"point", "normal", "offset"} & cast("dict[str, object]", value).keys()
            else "stop"
        )
    return "point stop" if isinstance(value, PointStop) else "stop"


# Distinguished by their fields: a `kind` would change the content, and so the hash, of every
# mechanism there is.
AnyStop = Annotated[
    Annotated[Stop, Tag("stop")] | Annotated[PointStop, Tag("point stop")],
    Discriminator(_tag_of_stop),
]
