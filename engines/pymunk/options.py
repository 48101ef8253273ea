"""Numerical options of the pymunk adapter; defaults are the assisted preset. Needs no pymunk."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal, Self

from pydantic import Field, JsonValue, model_validator

from ...models.spec import NonNegative, Positive, Real
from ..units import ScaledOptions

ITERATIONS = 10
"""Default of Chipmunk's `Space.iterations`."""
ERROR_BIAS = 0.0017970074436457143
"""Default of Chipmunk's `Constraint.error_bias`: a tenth is undone in 1/60 s."""

HALF_IN_A_MILLISECOND = 1e-300
"""Share of an error left after a second, of which half is undone in a step of 1e-3 s."""

_Share = Annotated[Real, Field(ge=0, le=1)]
Joints = Literal["rods", "documented"]
ONLY_WITH: Mapping[Joints, Mapping[str, JsonValue]] = {
    "rods": {
        "leapfrog": False,
        "hold_lengths": False,
        "locate_releases": False,
        "pivot_mass": 1.0,
        "scaled_units": False,
    },
    "documented": {
        "groove_error_bias": None,
        "slot_error_bias": None,
        "slot_pin_error_bias": None,
        "limit_error_bias": None,
        "collision_slop": None,
        "collision_bias": None,
    },
}
"""Options that one kind of joints has alone, each with its value where it does nothing."""
ALONE: Mapping[str, JsonValue] = {"joints": "documented", **ONLY_WITH["rods"]}
"""Options with which trebucheck takes no part in a run."""


class PymunkOptions(ScaledOptions):
    """Numerical options; their ranges are checked as in every :class:`EngineOptions`."""

    joints: Joints = Field(
        default="rods",
        description="'documented': the joints, limits, springs and collisions of pymunk's "
        "documentation, as they are; 'rods': trebucheck's representation, with stops that it "
        "switches and forces that it adds",
    )
    iterations: int = Field(
        default=200, ge=1, le=100_000, description="passes of the impulse solver in a step"
    )
    start_iterations: int = Field(
        default=5_000,
        ge=1,
        le=1_000_000,
        description="passes in the first step, which has no impulses to start from",
    )
    error_bias: _Share = Field(
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

    groove_error_bias: _Share | None = Field(
        default=None,
        description="the same of joints along a line; None: as of other joints",
    )
    slot_error_bias: _Share | None = Field(
        default=None,
        description="the same of joints along a line in a mechanism with loops, none of whose "
        "bodies has two of them; None: as of joints along a line",
    )
    slot_pin_error_bias: _Share | None = Field(
        default=None,
        description="the same of the other joints of such a mechanism; None: as of other joints",
    )
    limit_error_bias: _Share | None = Field(
        default=None,
        description="the same of stops on angles that stay in the model, which have no force in a "
        "step that begins without an error; None: as of other joints",
    )
    collision_slop: NonNegative | None = Field(
        default=None,
        description="overlap of a point and its wall that is let be [m]; None: pymunk's own",
    )
    collision_bias: _Share | None = Field(
        default=None,
        description="share of an overlap left after a second; None: pymunk's own",
    )

    @model_validator(mode="after")
    def _has_joints_of_its_options(self) -> Self:
        for joints, options in ONLY_WITH.items():
            for name, neutral in options.items():
                if joints != self.joints and getattr(self, name) != neutral:
                    raise ValueError(
                        f"{name} = {getattr(self, name)!r} does nothing with joints = "
                        f"{self.joints!r}: {neutral!r} is needed there, or joints = {joints!r}"
                    )
        return self

    def in_time_unit(self, unit: float) -> Self:
        """The same options for a model whose unit of time is so many seconds."""
        return self.model_copy(
            update={"timestep": self.timestep / unit, "error_bias": self.error_bias**unit}
        )
