"""What Table II says about the drag area, as data; SI units and radians throughout."""

from __future__ import annotations

from enum import StrEnum

from pydantic import Field

from ...models.mechanism import Mechanism
from ...models.spec import NonNegative, Positive, Real, Spec


class AngleReading(StrEnum):
    """What the printed angle of release is an angle of."""

    VELOCITY = "of the velocity"
    ACROSS_SLING = "across the sling"
    """Of the normal to the sling: the paper adds 90 deg to phi, as if the sling's pin stood still."""


class GravityReading(StrEnum):
    """Where the planet's own g is taken."""

    THROW_AND_FLIGHT = "in the throw and the flight"
    FLIGHT_ONLY = "in the flight only"


class PrintedAngle(Spec):
    """A row of Table II."""

    world: str
    gravity: Positive = Field(description="[m/s^2]")
    density: NonNegative = Field(description="of its air [kg/m^3]")
    printed: str = Field(description="best angle of release as printed [deg]")
    value: Real = Field(description="[rad]")
    half: Positive = Field(description="half a unit of the last printed digit [rad]")


class DragInterval(Spec):
    """Drag areas C_d A [m^2] that do something, from `low` to `high`."""

    low: NonNegative
    high: NonNegative | None = Field(description="None: without end")


class GridPoint(Spec):
    """A point of the paper's grid of release times, n * step."""

    time: Real = Field(description="[s]")
    angle: Real = Field(description="[rad]")
    drag_areas: DragInterval | None = Field(
        description="with which it throws farther than its neighbours; None: with no drag area, as drag only ever "
        "favours later releases"
    )
    agrees: bool = Field(description="whether its angle is the printed one, to the printed digits")


class WorldOnGrid(Spec):
    """One world's printed angle against a grid of release times."""

    world: str
    nearest: GridPoint = Field(description="of those that some drag area makes the best: nearest to the printed angle")
    beside: tuple[GridPoint, ...] = Field(description="those on either side of the printed angle")
    any_phase: DragInterval | None = Field(
        description="drag areas with which the printed angle is the best of some grid of this step, wherever it "
        "starts; None: of none"
    )


class GridReading(Spec):
    """All worlds against grids of one step."""

    step: Positive = Field(description="[s]")
    root_mean_square: NonNegative = Field(description="of the nearest points' misses [rad]")
    worlds: tuple[WorldOnGrid, ...]
    shared: DragInterval | None = Field(
        description="drag areas that make every world's nearest point the best of the grid that starts at t = 0"
    )
    agreeing: tuple[str, ...] = Field(description="worlds whose nearest point has the printed angle")
    shared_by_agreeing: DragInterval | None = Field(description="drag areas that suit all of those")
    any_phase: DragInterval | None = Field(
        description="drag areas that suit every world if each one's grid may start where it likes"
    )


class WorldFit(Spec):
    """One world's printed angle against the best release, found without a grid."""

    world: str
    vacuum_time: Real = Field(description="of the best release without air [s]")
    vacuum_angle: Real = Field(description="[rad]")
    drag_area: NonNegative | None = Field(
        description="that gives the printed angle [m^2]; None where none does, or any drag area gives the same"
    )
    drag_areas: DragInterval | None = Field(description="that give the printed digits; None where none does")
    common_angle: Real = Field(description="with the reading's common drag area [rad]")
    agrees: bool = Field(description="whether that is the printed angle, to the printed digits")


class AngleCurve(Spec):
    """Best angle of release against drag area."""

    world: str
    drag_areas: tuple[Real, ...] = Field(description="[m^2]")
    angles: tuple[Real, ...] = Field(description="[rad]")
    times: tuple[Real, ...] = Field(description="of release [s]")


class Reading(Spec):
    """Table II under one reading of what its angles are and where g was changed."""

    angle: AngleReading
    gravity: GravityReading
    worlds: tuple[WorldFit, ...]
    shared: DragInterval | None = Field(description="drag areas that give every printed angle; None: no one does")
    common_drag_area: NonNegative = Field(description="least squares over the printed angles [m^2]")
    root_mean_square: NonNegative = Field(description="of the misses with it [rad]")
    curves: tuple[AngleCurve, ...]
    grids: tuple[GridReading, ...]


class DragStudy(Spec):
    """Table II under all readings."""

    mechanism: Mechanism
    projectile_mass: Positive = Field(description="[kg]")
    printed: tuple[PrintedAngle, ...]
    readings: tuple[Reading, ...]
    findings: tuple[str, ...] = Field(description="what one drag area can and cannot match, in sentences")
    seconds: NonNegative = Field(description="processor time [s]")
