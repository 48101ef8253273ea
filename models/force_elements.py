"""Force elements: springs, dampers, constant forces and torques between bodies, or between a body and the ground."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from .joints import GROUND
from .spec import Name, NonNegative, Real, Spec, Vector


class _ForceElement(Spec):
    name: Name
    body: Name

    @property
    def bodies(self) -> tuple[str, ...]:
        """The bodies it acts between; 'ground' may be one."""
        return (self.body,)


class TwoBodyForceElement(_ForceElement):
    """A force element between a body and another one, or the ground."""

    relative_to: Name = Field(default=GROUND, description="the other body, or 'ground'")

    @property
    def bodies(self) -> tuple[str, ...]:
        """The bodies it acts between; 'ground' may be one."""
        return (self.body, self.relative_to)

    @model_validator(mode="after")
    def _acts_between_two(self) -> Self:
        if self.body == self.relative_to:
            raise ValueError(
                f"{self.name!r} acts between {self.body!r} and itself; two bodies are needed"
            )
        return self


class SpringDamper(TwoBodyForceElement):
    """A linear spring and damper between two points, along the line that joins them.

    With the distance l of the points and its rate v it pulls them together with k (l - l0) + c v
    [N].
    """

    kind: Literal["spring-damper"] = "spring-damper"
    point: Vector = Field(description="of the body, in its frame [m]")
    relative_point: Vector = Field(description="of the other body, in its frame [m]")
    stiffness: NonNegative = Field(default=0.0, description="k [N/m]")
    damping: NonNegative = Field(default=0.0, description="c [N s/m]")
    rest_length: NonNegative = Field(default=0.0, description="l0 [m]")


class RotationalSpringDamper(TwoBodyForceElement):
    """A linear spring and damper on a relative angle.

    With the angle b of the body less that of the other and its rate w the torque on the body is
    -(k (b - b0) + c w) [N m], and the opposite on the other one; clockwise positive, as angles are.
    """

    kind: Literal["rotational-spring-damper"] = "rotational-spring-damper"
    stiffness: NonNegative = Field(default=0.0, description="k [N m/rad]")
    damping: NonNegative = Field(default=0.0, description="c [N m s/rad]")
    rest_angle: Real = Field(default=0.0, description="b0 [rad]")


class ConstantForce(_ForceElement):
    """A force of constant size and direction on a point of a body."""

    kind: Literal["constant-force"] = "constant-force"
    point: Vector = Field(description="of the body, in its frame [m]")
    force: Vector = Field(description="in the world's directions [N]")


class ConstantTorque(TwoBodyForceElement):
    """A constant torque on a body, and the opposite one on another: a motor."""

    kind: Literal["constant-torque"] = "constant-torque"
    torque: Real = Field(description="on the body, clockwise positive [N m]")


AnyForceElement = SpringDamper | RotationalSpringDamper | ConstantForce | ConstantTorque
ForceElement = Annotated[AnyForceElement, Field(discriminator="kind")]
