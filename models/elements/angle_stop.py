"""A stop on a relative angle."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from ..functions import AngleFunction
from ..spec import Name, Real, Vector
from .base import GROUND, BaseStop, Basic, Feature, Geometry


class Stop(BaseStop):
    """A unilateral constraint on a relative angle.

    Its gap is sense * (angle - angle of the other) - limit >= 0.

    Its torque is the generalised force conjugate to the gap: >= 0 while it pushes, 0 when open.
    """

    gap_unit: ClassVar[str] = "rad"
    speed_unit: ClassVar[str] = "rad/s"
    force_unit: ClassVar[str] = "N m"
    effort: ClassVar[Literal["torque", "force"]] = "torque"
    position_field: ClassVar[Literal["limit", "offset"]] = "limit"

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
        return (self.body, self.relative_to)

    @property
    def features(self) -> tuple[Feature | Basic, ...]:
        return (Basic.STOP, Basic.REBOUND) if self.restitution else (Basic.STOP,)

    def component(
        self, angle: Callable[[str], float], point: Callable[[str, Vector], complex]
    ) -> float:
        """The relative angle, or its derivative, in the sense of the gap; linear in the motion."""
        first, second = (0.0 if body == GROUND else angle(body) for body in self.bodies)
        return self.sense * (first - second)

    def gap(self, geometry: Geometry) -> AngleFunction:
        angle = geometry.angle(self.body, self.relative_to)
        row = self.sense * angle.coefficients
        row.flags.writeable = False  # shared by all callers
        return AngleFunction(self.sense * angle.constant - self.limit, row)
