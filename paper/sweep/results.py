"""What the sweep over the fulcrum's place finds, as data: the paper's Sec. V and its Fig. 5."""

from __future__ import annotations

from pydantic import Field

from ...models.spec import Real, Spec, Vector
from ..evidence.results import EngineValue, Quantity


class Curve(Spec):
    """Launch speed at 45 degrees against l1, under two laws of a stop (Fig. 5)."""

    l1: tuple[Real, ...] = Field(description="[m]")
    release_once: tuple[Real | None, ...] = Field(description="a rest can only push [m/s]; None: no launch")
    bilateral: tuple[Real | None, ...] = Field(
        description="a rest is held, pulling too, until its torque comes to zero [m/s]; None: no launch"
    )
    times: tuple[Real | None, ...] = Field(description="of the launch, under release-once [s]")


class Peak(Spec):
    """Where the launch is fastest."""

    l1: Quantity
    speed: Quantity
    lever_ratio: Real = Field(description="l1 / l2")
    interior: bool = Field(description="whether it lies inside the swept range")


class Position(Spec):
    """One place of the fulcrum."""

    l1: Real = Field(description="[m]")
    lever_ratio: Real = Field(description="l1 / l2")
    arm_torque: Real = Field(description="of gravity about the fulcrum at the start, positive clockwise [N m]")
    arm_acceleration: Real = Field(description="of theta at the start [rad/s^2]")
    counterweight_acceleration: Vector = Field(description="at the start, x and y [m/s^2]")
    rest_torques: dict[str, Real] = Field(description="at the start, both held; negative: would have to pull [N m]")
    release_times: dict[str, Real | None] = Field(description="of the rests, under release-once [s]")
    furthest_back: Real = Field(description="least of theta - theta(0) up to the launch [rad]; 0: never backward")
    launch_time: Real | None = Field(description="[s]")
    speed: Quantity | None = Field(description="at the launch, under release-once [m/s]")
    bilateral_speed: Real | None = Field(description="at the launch, under the bilateral law [m/s]")
    engines: tuple[EngineValue, ...] = Field(default=(), description="launch speed of each engine's tuned preset [m/s]")
    engines_furthest_back: tuple[EngineValue, ...] = Field(default=(), description="as `furthest_back` [rad]")


class Backward(Spec):
    """Where on the beam the machine would start to fall backward: the zero of gravity's torque about the fulcrum."""

    l1: Real | None = Field(description="below it the arm turns backward [m]; None: nowhere on the beam")
    counterweight_past_pivot: Real | None = Field(description="below it the counterweight starts behind it [m]")
    least_torque: Real = Field(description="of gravity about the fulcrum at the start, over the swept range [N m]")
    furthest_back: Real = Field(description="least theta - theta(0) before the launch, over all positions [rad]")


class Neighbourhood(Spec):
    """A point of the curve against its neighbours on the paper's grid: whether anything happens there."""

    l1: Real = Field(description="[m]")
    step: Real = Field(description="of the grid [m]")
    speed: Real = Field(description="[m/s]")
    from_neighbours: Real = Field(description="interpolated from the neighbours alone [m/s]")
    second_difference: Real = Field(description="over one step, divided by its square [m/s per m^2]")
    second_derivative: Real = Field(description="of the curve around it, the point itself left out [m/s per m^2]")


class Swing(Spec):
    """The machine with both rests held, pulling too: one rigid body that swings about the fulcrum for ever."""

    l1: Real = Field(description="[m]")
    largest_angle: Real = Field(description="of theta [rad]")
    period: Real = Field(description="of its swing [s]")
    largest_torque: Real = Field(description="of the hanger's rest, over the whole swing [N m]")
    zeros: tuple[Real, ...] = Field(description="of that torque, within one period [s]; empty: it never comes to zero")


class Regime(Spec):
    """Where the hanger's rest would begin to have to pull at the start."""

    l1: Quantity | None = Field(description="zero of the hanger's torque at the start, in closed form [m]; None: none")
    root: Real | None = Field(default=None, description="the same by root finding on the equations of motion [m]")
    needed: Real | None = Field(default=None, description="acceleration across the hanger that the arm imposes [m/s^2]")
    available: Real | None = Field(default=None, description="gravity's component across the hanger [m/s^2]")
    below: Position | None = Field(default=None, description="a hair below it")
    above: Position | None = Field(default=None, description="a hair above it")
    swing: Swing | None = Field(
        default=None,
        description="just above it, taken in the paper's order: both held until the hanger's torque is zero",
    )


class Trend(Spec):
    """A straight line through the curve."""

    start: Real = Field(description="l1 [m]")
    end: Real = Field(description="l1 [m]")
    slope: Real = Field(description="[m/s per m]")
    determination: Real = Field(description="R^2 of the line")
    largest_residual: Real = Field(description="[m/s]")
    falling: bool = Field(description="whether the speed falls everywhere")
    steepest: Real = Field(description="[m/s per m]")
    flattest: Real = Field(description="[m/s per m]")


class RootSearch(Spec):
    """Newton's search for the zero of the hanger's torque, both rests held, from one guess for all places."""

    guess: Real = Field(description="[s]")
    lowest: Real | None = Field(description="from here on up to the regime change it finds the first zero [m]")
    later_zero: int = Field(description="places below that where it ends on a later zero")
    no_zero: int = Field(description="places below that where it ends on none, or on one before the start")
    fails_at: tuple[Real, ...] = Field(description="of the places asked for, those where it misses the first zero [m]")


class WrongZero(Spec):
    """What follows when the hanger's rest is held until the second zero of its torque, not the first."""

    l1: Real = Field(description="[m]")
    release_times: dict[str, Real | None] = Field(description="[s]")
    crossings: tuple[Vector, ...] = Field(
        description="time [s] and speed [m/s] when the velocity stands on the 45 deg line, negative: thrown backward"
    )


class EarlyCrossing(Spec):
    """The velocity on the 45 deg line while the sling's rest still holds."""

    l1: Real = Field(description="[m]")
    time: Real = Field(description="[s]")
    speed: Real = Field(description="[m/s]; negative: along the line backward")


class Artefact(Spec):
    """Whether ways to compute it wrongly account for what the paper shows below its threshold, and at single points.

    Nothing of the paper's program is published: what is found here can only be compatible with it.
    """

    threshold: Real = Field(description="printed [m]")
    step: Real = Field(description="between the places that are searched [m]")
    searches: tuple[RootSearch, ...]
    matching_guess: Real | None = Field(description="guess from which the search first fails at the threshold [s]")
    matching_search: RootSearch | None
    wrong_zeros: tuple[WrongZero, ...]
    early_crossings: tuple[EarlyCrossing, ...]


class Sweep(Spec):
    """All of it."""

    beam: Real = Field(description="l1 + l2 [m]")
    start: Real = Field(description="of l1 [m]")
    end: Real = Field(description="of l1 [m]")
    curve: Curve
    peak: Peak
    positions: tuple[Position, ...] = Field(description="in order of l1; engines at some of them")
    backward: Backward
    suspect: Neighbourhood = Field(description="at the isolated zero of the paper's plot")
    regime: Regime
    trend: Trend = Field(description="from the paper's peak to the regime change")
    artefact: Artefact
    seconds: Real = Field(description="wall time [s]")

    def position(self, l1: float) -> Position | None:
        """The looked-at place nearest to within a nanometre, if it is one of them."""
        return next((p for p in self.positions if abs(p.l1 - l1) < 1e-9), None)
