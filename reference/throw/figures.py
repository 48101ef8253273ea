"""Figures of a throw as data, and the motion behind them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

from pydantic import Field

from ...models.errors import InputError
from ...models.mechanism import Mechanism
from ...models.shown import Reported
from ...models.spec import Positive, Real, Spec
from ..solution import Solution
from .flight import Air, Flight, Surroundings
from .members import MemberForce, SupportForce
from .release import Projectile

FORMAT = "trebucheck-throw-1"

Held = Literal["velocity", "sling", "time"]
"""What a release keeps when the machine changes: the angle of its velocity, or of its sling, or its time."""


class LaunchFigures(Spec):
    """The projectile as it is let go; places are measured from where the fulcrum stands at the start."""

    time: Real = Field(description="[s]")
    speed: Real = Field(description="[m/s]")
    angle: Real = Field(description="of the velocity above the horizontal [rad]")
    x: Real = Field(description="[m]")
    y: Real = Field(description="upwards [m]")
    sling_angle: Real | None = Field(
        description="from the arm, phi - theta [rad]; None where there is no sling"
    )
    kinetic_energy: Real | None = Field(
        description="of the projectile [J]; None where its mass is not its own"
    )
    energy_ratio: Real | None = Field(
        description="the paper's R: kinetic over total energy; None without a positive E"
    )


class FlightFigures(Spec):
    """From the release to the landing; places are measured from where the fulcrum stands at the start."""

    range: Real = Field(description="x of the landing [m]")
    apex_height: Real = Field(description="highest y [m]")
    time: Real = Field(description="[s]")
    impact_speed: Real = Field(description="[m/s]")
    impact_angle: Real = Field(description="of the velocity below the horizontal [rad]")


class RestFigures(Spec):
    """A stop that is closed at the start."""

    name: str
    start_torque: Real = Field(description="[N m], or the force of a stop on a point [N]")
    release_time: Real | None = Field(
        description="when it opens [s]; None if not before the release"
    )


class Sensitivity(Spec):
    """Derivatives of the release, flying through vacuum, by one number of the machine.

    With the number what chose the release is held: an angle of the velocity or of the sling, or
    else its time.
    """

    name: str
    value: Real = Field(description="of the parameter [its unit]")
    unit: str
    launch_time: Real = Field(description="[s per unit]")
    launch_speed: Real = Field(description="[m/s per unit]")
    launch_angle: Real = Field(
        default=0.0, description="of the velocity above the horizontal [rad per unit]"
    )
    range: Real | None = Field(description="[m per unit]; None where it does not land")


class Throw(Reported, Spec):
    """Everything about one throw, in SI units and radians."""

    format: Literal["trebucheck-throw-1"] = FORMAT
    mechanism: Mechanism
    released: str = Field(description="how the release was chosen")
    air: Air
    gravity: Positive = Field(description="[m/s^2]")
    height: Real = Field(description="of the landing above the fulcrum at the start [m]")
    total_energy: Real = Field(description="at the start, zero of potential at y = 0 [J]")
    launch: LaunchFigures
    flight: FlightFigures
    best_launch: LaunchFigures | None = Field(
        description="the release of the first sweep that flies farthest"
    )
    best_flight: FlightFigures | None
    rests: tuple[RestFigures, ...]
    members: tuple[MemberForce, ...] = Field(description="up to the release")
    supports: tuple[SupportForce, ...] = Field(description="up to the release")
    warnings: tuple[str, ...] = ()
    sensitivities: tuple[Sensitivity, ...] = ()

    @cached_property
    def performance(self) -> Performance:
        """The continuous motion and the flights behind the figures.

        Raises:
            InputError: the throw was read from a file, which holds only figures.
        """
        raise InputError(
            "this throw was read from a file and has no motion to show; tb.throw makes it again."
        )

    def __getstate__(self) -> dict[Any, Any]:
        """Without the motion, whose parts are functions."""
        state = super().__getstate__()
        return {
            **state,
            "__dict__": {k: v for k, v in state["__dict__"].items() if k != "performance"},
        }

    def headline(self) -> str:
        """The range, and how it was let go."""
        return f"Throw of {self.mechanism.name!r}: range {self.flight.range:.6g} m, released {self.released}"

    def rows(self) -> Iterator[dict[str, object]]:
        """The release chosen, and the best one: figures of launch and flight."""
        for name, launch, flight in (
            ("chosen", self.launch, self.flight), ("best", self.best_launch, self.best_flight)
        ):  # fmt: skip
            if launch is not None and flight is not None:
                launched = {f"launch_{key}": value for key, value in launch}
                yield {
                    "release": name,
                    **launched,
                    **{f"flight_{key}": value for key, value in flight},
                }

    @property
    def gain(self) -> float | None:
        """What the best release would add to the range [m]."""
        return None if self.best_flight is None else self.best_flight.range - self.flight.range


@dataclass(frozen=True, eq=False)
class Performance:
    """A throw with the continuous motion and flights behind its figures; its figures are what is compared."""

    throw: Throw
    projectile: Projectile
    surroundings: Surroundings
    flight: Flight
    best: Flight | None
    held: Held
    """What chose the release."""

    @property
    def solution(self) -> Solution:
        """The machine's motion."""
        return self.projectile.solution
