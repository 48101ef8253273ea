"""The numerical options of the pymunk adapter; the defaults are the tuned preset."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field

from ...models.spec import Positive, Real
from ..protocol import EngineOptions


class PymunkOptions(EngineOptions):
    """Numerical options; their ranges are checked as in every :class:`EngineOptions`."""

    iterations: int = Field(
        default=200, ge=1, le=100_000, description="passes of the impulse solver in a step"
    )
    start_iterations: int = Field(
        default=5_000,
        ge=1,
        le=1_000_000,
        description="passes in the first step, which has no impulses to start from",
    )
    error_bias: Annotated[Real, Field(ge=0, le=1)] = Field(
        default=0.0,
        description="share of a joint's error left after a second; 0: all of it is undone in a "
        "step",
    )
    leapfrog: bool = Field(
        default=True,
        description="start half a step ahead in velocity, and read velocities at half steps",
    )
    hold_lengths: bool = Field(
        default=True,
        description="set rods shorter by what the curvature of their motion lengthens them in a "
        "step",
    )
    locate_releases: bool = Field(
        default=True,
        description="release where the torque is foreseen to vanish, not a step after it has",
    )
    pivot_mass: Positive = Field(
        default=1e4,
        ge=1,
        le=1e9,
        description="mass given to a body pinned to the ground, in multiples of its own",
    )

    def in_time_unit(self, unit: float) -> Self:
        """The same options for a model whose unit of time is so many seconds."""
        return self.model_copy(
            update={"timestep": self.timestep / unit, "error_bias": self.error_bias**unit}
        )
