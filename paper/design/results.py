"""What the search for a rolling machine whose peak and best angle coincide finds, as data."""

from __future__ import annotations

from enum import StrEnum
from typing import Literal

from pydantic import Field

from ...models.machines.parameters import TrebuchetParameters
from ...models.spec import Real, Spec
from ..results import EngineValue, Quantity


class Reading(StrEnum):
    """What the projectile's largest kinetic energy is to coincide with."""

    RANGE_OPTIMAL = "range-optimal release"
    """The machine's own best angle."""
    FORTY_FIVE = "velocity at 45 degrees"
    """The simpler reading."""


class Throwing(Spec):
    """One rolling machine's first sweep, by the reference."""

    parameters: TrebuchetParameters
    lever_ratio: Real = Field(description="l1 / l2")
    fastest_time: Real = Field(description="of the projectile's largest kinetic energy [s]")
    best_time: Real = Field(description="of the range-optimal release [s]")
    launch_time: Real = Field(description="of the velocity at 45 degrees [s]")
    largest_speed: Real = Field(description="[m/s]")
    speed: Real = Field(description="at the range-optimal release [m/s]")
    angle: Real = Field(description="there, above the horizontal [rad]")
    range: Real = Field(description="from the fulcrum's x at the start to y = 0 [m]")
    ratio: Real = Field(description="the paper's R there: kinetic over total energy")
    available_energy: Real = Field(description="from the start down to its lowest position of all [J]")
    efficiency: Real = Field(description="kinetic energy there over the available energy")
    arm_angle: Real = Field(description="theta at the range-optimal release [rad]; the third constraint is at 3 pi / 2")
    sling_release: Real = Field(description="when the sling's rest opens [s]")
    rest_torques: dict[str, Real] = Field(description="largest torque of each rest [N m]")
    lowest: dict[str, Real] = Field(description="least y of projectile and counterweight up to the release [m]")

    @property
    def gap(self) -> float:
        """Largest kinetic energy after the range-optimal release [s]."""
        return self.fastest_time - self.best_time


class Bounds(Spec):
    """What may be chosen, and between which values."""

    r: tuple[Real, Real] = Field(default=(2.0, 12.0), description="sling [m]")
    h: tuple[Real, Real] = Field(default=(2.0, 14.0), description="hanger [m]")
    l1: tuple[Real, Real] = Field(default=(7.0, 13.0), description="arm on the sling's side [m]")


class Optimality(Spec):
    """First and second order conditions of the design, checked on what is reported."""

    residual: Real = Field(description="|projected gradient of the Lagrangian| over |gradient of the objective|")
    multiplier: Real | None = Field(description="of the coincidence; [m of range per s] where range is the objective")
    neighbours: tuple[Real, ...] = Field(
        description="objective at neighbours that also coincide, minus the design's own: all negative at a maximum"
    )
    active: tuple[str, ...] = Field(description="bounds it stands on, such as 'h at 14'; empty: it lies inside")
    starts: int = Field(description="starts of the search")
    reached: int = Field(description="of those, how many came to this design, within 0.1 % of each length")


class CoincidingDesign(Spec):
    """A rolling machine whose largest kinetic energy comes at its best release."""

    name: str
    objective: Literal["range", "nearness"] = Field(
        description="largest range, or least relative change of r, h and l1 from the paper's machine"
    )
    reading: Reading
    throwing: Throwing
    difference: Quantity = Field(description="largest kinetic energy after the release it is to coincide with [s]")
    change: Real = Field(description="root sum square of the relative changes of r, h and l1")
    optimality: Optimality
    warnings: tuple[str, ...] = Field(description="what a builder should know: slack slings, lifting wheels, stops met")
    engines: dict[str, tuple[EngineValue, ...]] = Field(
        default_factory=dict,
        description="by figure: largest_ratio_time, best_release_time, best_release_angle, "
        "best_release_speed, best_range",
    )


class Design(Spec):
    """The paper's open question, answered."""

    bounds: Bounds
    constraints: tuple[str, ...] = Field(description="what was asked of a design besides, in words")
    paper_rolling: Throwing
    paper_fixed: Throwing
    designs: tuple[CoincidingDesign, ...] = Field(description="those that were found; empty: no start led to one")
    unconstrained: Throwing | None = Field(description="largest range within the bounds, whatever the times")
    seconds: Real = Field(description="wall time [s]")

    def named(self, name: str) -> CoincidingDesign | None:
        """The design of that name."""
        return next((design for design in self.designs if design.name == name), None)
