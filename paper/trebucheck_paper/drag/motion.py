"""Releases of a throw, the drag areas that make one of them the best, and sampling grids."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property

import numpy as np
from pydantic import Field
from scipy.optimize import brentq
from trebucheck.api.mechanics import (
    Air,
    FloatArray,
    InputError,
    NonNegative,
    PinJoint,
    Positive,
    Projectile,
    Real,
    Release,
    Spec,
    Surroundings,
    World,
    drag_flight,
    fly,
    range_rate,
)

_SCAN = 800  # instants of the last part of the sweep between which an angle is looked for
_JUST = 2.5e-4  # [s] a peak 50 ms wide is symmetrical to 1e-7 s over this: 1e-4 deg
_FLIGHT = 1e-8  # relative local error: some 1e-5 m, which moves a peak by less than 1e-7 s
_RESOLVED = 1e-4  # of a drag area, reported with three digits
_GROWTH = 4.0
_MOST = 12  # times the drag area is raised by that factor; drag is then a million times the weight


class AngleReading(StrEnum):
    """Meaning of the printed angle of release."""

    VELOCITY = "of the velocity"
    ACROSS_SLING = "across the sling"
    """Normal to the sling: the paper adds 90 deg to phi, as if the sling's pin stood still."""


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
        description="with which it throws farther than its neighbours; None: with no drag area, as "
        "drag only ever favours later releases"
    )
    agrees: bool = Field(description="whether its angle is the printed one, to the printed digits")


class WorldOnGrid(Spec):
    """One world's printed angle against a grid of release times."""

    world: str
    nearest: GridPoint = Field(
        description="of those that some drag area makes the best: nearest to the printed angle"
    )
    beside: tuple[GridPoint, ...] = Field(description="those on either side of the printed angle")
    any_phase: DragInterval | None = Field(
        description="drag areas with which the printed angle is the best of some grid of this "
        "step, wherever it starts; None: of none"
    )


class GridReading(Spec):
    """Worlds against grids of one step."""

    step: Positive = Field(description="[s]")
    root_mean_square: NonNegative = Field(description="of the nearest points' misses [rad]")
    worlds: tuple[WorldOnGrid, ...]
    shared: DragInterval | None = Field(
        description="drag areas that make every world's nearest point the best of the grid that "
        "starts at t = 0"
    )
    agreeing: tuple[str, ...] = Field(
        description="worlds whose nearest point has the printed angle"
    )
    shared_by_agreeing: DragInterval | None = Field(description="drag areas that suit all of those")
    any_phase: DragInterval | None = Field(
        description="drag areas that suit every world if each one's grid may start where it likes"
    )


@dataclass(frozen=True)
class Throwing:
    """A throw and the world its projectile flies in; drag areas C_d A in m^2 throughout."""

    projectile: Projectile
    world: World
    _known: dict[tuple[float, float], float] = field(
        default_factory=dict[tuple[float, float], float]
    )

    @cached_property
    def mass(self) -> float:
        """Mass of the projectile [kg].

        Raises:
            InputError: the projectile is no body's centre, so that it has no mass of its own.
        """
        if self.projectile.mass is None:
            raise InputError(
                f"the marker {self.projectile.name!r} has no mass of its own, so drag has nothing "
                "to slow."
            )
        return self.projectile.mass

    def surroundings(self, drag_area: float = 0.0) -> Surroundings:
        """Its air and gravity; landing at the height of the world's origin."""
        air = Air(density=self.world.density, drag_area=drag_area)
        return Surroundings(gravity=self.world.gravity, drag=air.drag(self.mass))

    @cached_property
    def vacuum(self) -> Release:
        """The best release without air.

        Raises:
            InputError: no release comes down at the fulcrum's height.
        """
        best = self.projectile.best_release(self.surroundings())
        if best is None:
            raise InputError(
                f"no release of the throw on {self.world.name} comes back to the fulcrum's height."
            )
        return best

    def angle(self, times: FloatArray, reading: AngleReading) -> FloatArray:
        """Angles of releases at times [s], shape (n,) [rad], continuous along them."""
        if reading is AngleReading.VELOCITY:
            velocity = self.projectile.states(times)[1]
            return np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))
        return np.unwrap(self._across(times))

    def _across(self, times: FloatArray) -> FloatArray:
        """Normal to the sling on the side it turns to: the throw by the sling's turning alone."""
        mechanism = self.projectile.solution.problem.mechanism
        motion, body = self.projectile.solution.motion(times), self.projectile.body
        index = [b.name for b in mechanism.bodies].index(body.name)
        joint = mechanism.tree_joints[index]
        foot = joint.child_point if isinstance(joint, PinJoint) else body.centre
        along = math.atan2(
            self.projectile.marker.point[1] - foot[1], self.projectile.marker.point[0] - foot[0]
        )
        # Angles count clockwise, so a growing one turns the sling by -90 deg from where it points.
        across = along - motion.q[:, index] - np.sign(motion.u[:, index]) * math.pi / 2
        return np.angle(np.exp(1j * across))

    def time_of(self, angle: float, reading: AngleReading) -> float | None:
        """Time when the angle [rad] is last met in the first forward swing [s]; None if never."""
        times, angles = self._sweep(reading)
        below = np.flatnonzero((angles[:-1] > angle) & (angles[1:] <= angle))
        if not len(below):
            return None
        i = int(below[-1])

        def beyond(t: float) -> float:
            return float(
                self.angle(np.array([float(times[i]), t]), reading)[1]
                - anchor
                - (angle - float(angles[i]))
            )

        anchor = float(self.angle(times[i : i + 1], reading)[0])
        return float(brentq(beyond, float(times[i]), float(times[i + 1]), xtol=1e-12))

    def _sweep(self, reading: AngleReading) -> tuple[FloatArray, FloatArray]:
        start, end = self.projectile.sweep()
        times = np.linspace(start, end, _SCAN)
        angles = self.angle(times, reading)
        # Unwrapped from the far end back, whose velocity points down: -90 deg, not -90 deg and some
        # turns.
        return times, angles - 2 * math.pi * round(float(angles[-1]) / (2 * math.pi))

    def optimal_with(self, time: float) -> float:
        """Drag area that makes a release at that time [s] the best one of those around it.

        0 where a later one is better even without air, infinite where none makes it late enough.
        """
        return self.indifferent(time - _JUST, time + _JUST)

    def indifferent(self, early: float, late: float) -> float:
        """Drag area at which two releases [s] fly equally far; beyond it the later one is better.

        0 where that is so without air, infinite where it never is.
        """
        if (
            early,
            late,
        ) not in self._known:  # each reading of the angle needs the same neighbours on a grid

            def gain(drag_area: float) -> float:
                first, second = (self.range(release, drag_area) for release in both)
                return second - first

            both = [self.projectile.release_at(time) for time in (early, late)]
            self._known[early, late] = self._root(gain)
        return self._known[early, late]

    def best(self, drag_area: float, near: float, within: float) -> Release:
        """Best release with a drag area, searched within some seconds of a time [s] close to it."""

        def rate(t: float) -> float:
            return range_rate(self.projectile.release_at(t), self.surroundings(drag_area))

        if drag_area * self.world.density == 0:
            return self.vacuum
        return self.projectile.release_at(
            float(brentq(rate, near - within, near + within, xtol=1e-9))
        )

    def range(self, release: Release, drag_area: float = 0.0) -> float:
        """Range of a release with a drag area [m].

        Raises:
            InputError: the projectile never comes up to the fulcrum's height.
        """
        surroundings = self.surroundings(drag_area)
        flight = (
            fly(release, surroundings)
            if surroundings.drag == 0
            else drag_flight(release, surroundings, _FLIGHT)
        )
        if flight is None:
            raise InputError(
                f"a release at {release.time:.6g} s never comes up to the fulcrum's height."
            )
        return flight.range

    def _root(self, rising: Callable[[float], float]) -> float:
        """Drag area where a function becomes positive: 0 if without air, infinite if never."""
        if rising(0.0) > 0:
            return 0.0
        if self.world.density == 0:
            return math.inf
        low, high = 0.0, self._first_try
        for _ in range(_MOST):
            if rising(high) > 0:
                return float(
                    brentq(rising, low, high, xtol=high * _RESOLVED / _GROWTH, rtol=_RESOLVED)
                )
            low, high = high, high * _GROWTH
        return math.inf

    @cached_property
    def _first_try(self) -> float:
        """Drag is then a tenth of the weight at the release."""
        return 0.2 * self.mass * self.world.gravity / (self.world.density * self.vacuum.speed**2)


def interval(low: float, high: float) -> DragInterval | None:
    """Drag areas from `low` to `high` [m^2]; None if `high` is 0 (later is always better)."""
    return (
        DragInterval(low=low, high=None if math.isinf(high) else high)
        if high > 0 and math.isfinite(low)
        else None
    )


def common(intervals: Sequence[DragInterval | None]) -> DragInterval | None:
    """Intersection of all intervals; None if they share nothing or one of them is empty."""
    nonempty = [each for each in intervals if each is not None]
    if len(nonempty) < len(intervals) or not nonempty:
        return None
    low = max(each.low for each in nonempty)
    high = min(math.inf if each.high is None else each.high for each in nonempty)
    return interval(low, high) if low <= high else None


def on_grid(
    throwings: Sequence[Throwing],
    printed: Sequence[PrintedAngle],
    step: float,
    reading: AngleReading,
) -> GridReading:
    """Hold every world against the grid n * step [s]."""
    rows = list(zip(throwings, printed, strict=True))
    worlds = [_OnGrid(throwing, row, step, reading).world() for throwing, row in rows]
    agreeing = [each for each in worlds if each.nearest.agrees]
    misses = np.array(
        [each.nearest.angle - row.value for each, row in zip(worlds, printed, strict=True)]
    )
    return GridReading(
        step=step,
        root_mean_square=float(np.sqrt(np.mean(misses**2))),
        worlds=tuple(worlds),
        shared=common([each.nearest.drag_areas for each in worlds]),
        agreeing=tuple(each.world for each in agreeing),
        shared_by_agreeing=common([each.nearest.drag_areas for each in agreeing]),
        any_phase=common([each.any_phase for each in worlds]),
    )


class _OnGrid:
    """One world against one grid."""

    def __init__(
        self, throwing: Throwing, row: PrintedAngle, step: float, reading: AngleReading
    ) -> None:
        self.throwing, self.row, self.step, self.reading = throwing, row, step, reading

    def world(self) -> WorldOnGrid:
        at = self.throwing.time_of(self.row.value, self.reading)
        beside = [] if at is None else [math.floor(at / self.step), math.floor(at / self.step) + 1]
        points = {n: self.point(n) for n in {*beside, self.first}}
        # Air moves the best point to later ones only: where there is some, and it is wanted, any
        # later one will do.
        able = [point for point in points.values() if point.drag_areas is not None]
        return WorldOnGrid(
            world=self.row.world,
            nearest=min(able, key=lambda point: abs(point.angle - self.row.value)),
            beside=tuple(points[n] for n in beside),
            any_phase=self.any_phase(),
        )

    @property
    def first(self) -> int:
        """Best grid point without air: one of the two beside the only peak of the range."""
        below = math.floor(self.throwing.vacuum.time / self.step)
        return below + int(
            self.throwing.indifferent(below * self.step, (below + 1) * self.step) == 0
        )

    def point(self, n: int) -> GridPoint:
        at = n * self.step
        angle = math.remainder(
            float(self.throwing.angle(np.array([at]), self.reading)[0]), 2 * math.pi
        )
        return GridPoint(
            time=at,
            angle=angle,
            drag_areas=interval(
                self.throwing.indifferent((n - 1) * self.step, at),
                self.throwing.indifferent(at, (n + 1) * self.step),
            ),
            agrees=abs(angle - self.row.value) <= self.row.half,
        )

    def between(self, early: float, late: float) -> DragInterval | None:
        """Drag areas that make some release between two times [s] better than its neighbours."""
        low = self.throwing.indifferent(early - self.step, early)
        return interval(low, self.throwing.indifferent(late, late + self.step))

    def any_phase(self) -> DragInterval | None:
        early = self.throwing.time_of(self.row.value + self.row.half, self.reading)
        late = self.throwing.time_of(self.row.value - self.row.half, self.reading)
        return None if early is None or late is None else self.between(early, late)
