"""The projectile after its release, through vacuum or air, to its landing."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from pydantic import Field
from scipy.integrate import solve_ivp

from ...models.arrays import FloatArray
from ...models.errors import InputError
from ...models.mechanism import Mechanism
from ...models.spec import NonNegative, Positive, Real, Spec

FINE, COARSE = 1e-13, 1e-7
"""Relative local errors of a flight that counts, and of one that is only ranked among others."""
LEVEL = 1e-12
"""Rounding of a direction [rad]."""


class Air(Spec):
    """Still air of one density, and how the projectile meets it; none by default.

    Raises:
        InputError: a value is negative or not finite.
    """

    density: NonNegative = Field(default=0.0, description="[kg/m^3]")
    drag_area: NonNegative = Field(
        default=0.0, description="drag coefficient times cross-section, C_d A [m^2]"
    )

    @classmethod
    def around(cls, density: float, drag_coefficient: float, area: float) -> Self:
        """From the drag coefficient [1] and the cross-section [m^2] apart.

        Raises:
            InputError: a value is negative or not finite.
        """
        if drag_coefficient < 0 or area < 0:
            raise InputError(
                f"drag_coefficient = {drag_coefficient!r} and area = {area!r} must not be negative."
            )
        return cls(density=density, drag_area=drag_coefficient * area)

    def drag(self, mass: float) -> float:
        """Constant k = rho C_d A / (2 m) [1/m], with which the drag's deceleration is k |v| v."""
        return 0.5 * self.density * self.drag_area / mass


class World(Spec):
    """A place to throw at: the paper's Table II."""

    name: str
    gravity: Positive = Field(description="[m/s^2]")
    density: NonNegative = Field(description="of its air [kg/m^3]")


WORLDS = {
    name: World(name=name, gravity=gravity, density=density)
    for name, gravity, density in (
        ("moon", 1.62, 0.0),
        ("mars", 3.71, 0.02),
        ("earth", 9.81, 1.2),
        ("venus", 8.87, 65.0),
    )
}


def world(name: str) -> World:
    """The place of that name, in any case.

    Raises:
        InputError: there is none; the sentence lists those there are.
    """
    if name.lower() not in WORLDS:
        raise InputError(f"there is no body {name!r}; there are: {', '.join(WORLDS)}.")
    return WORLDS[name.lower()]


class Surroundings(Spec):
    """Forces on a projectile in flight, and where it lands.

    Raises:
        InputError: a value is not finite or outside its range.
    """

    gravity: Positive = Field(description="downwards [m/s^2]; without it nothing lands")
    drag: NonNegative = Field(
        default=0.0, description="k of the deceleration k |v| v [1/m], see Air.drag"
    )
    ground: Real = Field(default=0.0, description="world y at which it lands [m]")
    origin: Real = Field(default=0.0, description="world x from which the range is measured [m]")


@dataclass(frozen=True)
class Release:
    """The projectile as it is let go."""

    time: float
    """[s]"""
    position: tuple[float, float]
    """World [m]."""
    velocity: tuple[float, float]
    """World [m/s]."""
    acceleration: tuple[float, float] = (0.0, 0.0)
    """Of the projectile still on its machine, world [m/s^2]: what a later release would change."""

    @property
    def speed(self) -> float:
        """[m/s]."""
        return math.hypot(*self.velocity)

    @property
    def angle(self) -> float:
        """Angle of the velocity above the horizontal, in (-pi, pi] [rad]."""
        return math.atan2(self.velocity[1], self.velocity[0])


@dataclass(frozen=True)
class Flight:
    """Flight from the release to where the projectile comes down to the ground's height."""

    release: Release
    range: float
    """Horizontal distance of the landing from the surroundings' origin [m]; negative behind it."""
    apex_height: float
    """Largest world y [m]."""
    time: float
    """From release to landing [s]."""
    impact_velocity: tuple[float, float]
    """[m/s]."""
    state: Callable[[FloatArray], FloatArray]
    """States (x, y, vx, vy), shape (n, 4), at times since the release [s], shape (n,)."""

    @property
    def impact_speed(self) -> float:
        """[m/s]."""
        return math.hypot(*self.impact_velocity)

    @property
    def impact_angle(self) -> float:
        """Angle of the velocity at the landing below the horizontal, in [0, pi/2] [rad]."""
        return math.atan2(-self.impact_velocity[1], abs(self.impact_velocity[0]))

    def path(self, n: int = 200) -> FloatArray:
        """World positions [m] at n equal intervals from release to landing, shape (n, 2)."""
        return self.state(np.linspace(0.0, self.time, n))[:, :2]


def downwards(mechanism: Mechanism) -> float:
    """Size of a mechanism's gravity [m/s^2], which must be downwards for a flight.

    Raises:
        InputError: its direction is another one.
    """
    if math.dist(mechanism.gravity_direction, (0.0, -1.0)) > LEVEL:
        raise InputError(
            f"gravity_direction = {mechanism.gravity_direction!r} of {mechanism.name!r} must be "
            "(0, -1) for a throw: "
            "range and height are measured along x and y; turn the mechanism's points instead."
        )
    return mechanism.gravity


def fly(release: Release, surroundings: Surroundings) -> Flight:
    """The flight: in closed form without drag, else by DOP853 with apex and landing as its events.

    Raises:
        InputError: the projectile never comes up to the ground's height.
    """
    if surroundings.drag == 0:
        flight = _vacuum_flight(release, surroundings)
    else:
        flight = drag_flight(release, surroundings)
    if flight is None:
        raise InputError(
            f"a projectile released at y = {release.position[1]:.6g} m with "
            f"{release.velocity[1]:.6g} m/s upwards never comes up to the landing height y = "
            f"{surroundings.ground:.6g} m; a lower one is needed."
        )
    return flight


def fall_time(y: FloatArray, vy: FloatArray, surroundings: Surroundings) -> FloatArray:
    """Later root of y + vy t - g t^2/2 = ground [s], without cancellation; NaN without one."""
    g, above = surroundings.gravity, y - surroundings.ground
    with np.errstate(invalid="ignore", divide="ignore"):
        root = np.sqrt(vy * vy + 2 * g * above)
        time = np.where(vy >= 0, (vy + root) / g, 2 * above / (root - vy))
        return np.where(time >= 0, time, np.nan)


def _vacuum_flight(release: Release, surroundings: Surroundings) -> Flight | None:
    (x, y), (vx, vy), g = release.position, release.velocity, surroundings.gravity
    time = float(fall_time(np.array(y), np.array(vy), surroundings))
    if math.isnan(time):
        return None

    def state(t: FloatArray) -> FloatArray:
        return np.stack(
            [x + vx * t, y + vy * t - 0.5 * g * t * t, np.full_like(t, vx), vy - g * t], axis=-1
        )

    apex = y + max(vy, 0.0) ** 2 / (2 * g)
    return Flight(
        release, x + vx * time - surroundings.origin, apex, time, (vx, vy - g * time), state
    )


@dataclass(frozen=True)
class _Fall:
    """Flight through air: y is (x, y, vx, vy), or that and its variation."""

    surroundings: Surroundings
    tolerance: float

    def rates(self, _: float, y: FloatArray) -> FloatArray:
        """Rates of y: a = -k |v| v - g, and its variation."""
        k, velocity, speed = self.surroundings.drag, y[2:4], math.hypot(y[2], y[3])
        rates = np.empty_like(y)
        rates[:2] = velocity
        rates[2:4] = -k * speed * velocity
        rates[3] -= self.surroundings.gravity
        if len(y) > 4:
            change = y[6:8]
            along = velocity * (velocity @ change) / speed if speed else 0.0
            rates[4:6] = change
            rates[6:8] = -k * (speed * change + along)
        return rates

    def leg(self, start: FloatArray, until: Callable[[float, FloatArray], float]) -> Any:
        """Integrate until a function of time and state falls through zero."""
        setattr(until, "terminal", True)  # noqa: B010  SciPy reads attributes of the function
        setattr(until, "direction", -1.0)  # noqa: B010
        return solve_ivp(
            self.rates, (0.0, np.inf), start, "DOP853", dense_output=True, events=until,
            rtol=self.tolerance, atol=10 * self.tolerance,
        )  # fmt: skip

    def legs(self, start: FloatArray) -> list[Any] | None:
        """Integrate up to the apex, then down: y is monotone in each, so no landing is missed."""
        rise = [self.leg(start, lambda _, y: y[3])] if start[3] > 0 else []
        top = rise[0].y[:, -1] if rise else start
        if top[1] < self.surroundings.ground:
            return None
        return [*rise, self.leg(top, lambda _, y: y[1] - self.surroundings.ground)]


def drag_flight(
    release: Release, surroundings: Surroundings, tolerance: float = FINE
) -> Flight | None:
    """The flight through air to a relative local error; None where it never lands."""
    legs = _Fall(surroundings, tolerance).legs(np.array([*release.position, *release.velocity]))
    if legs is None:
        return None
    ends = np.cumsum([leg.t[-1] for leg in legs])
    landing, apex = legs[-1].y[:, -1], float(legs[-1].y[1, 0])

    def state(t: FloatArray) -> FloatArray:
        falling = len(legs) > 1
        last = np.asarray(legs[-1].sol(np.maximum(t - (ends[0] if falling else 0.0), 0.0))).T
        if falling:
            return np.where((t < ends[0])[:, None], np.asarray(legs[0].sol(t)).T, last)
        return last

    impact = (float(landing[2]), float(landing[3]))
    return Flight(
        release, float(landing[0]) - surroundings.origin, apex, float(ends[-1]), impact, state
    )


def range_rate(release: Release, surroundings: Surroundings) -> float:
    """Change of the range per second of later release [m/s], by the variation of the flight.

    With d the variation at the unchanged time of landing, dR = dx - (vx/vy) dy. NaN of a flight
    that only touches the ground's height, level, where there is no such rate.

    Raises:
        InputError: the projectile never comes up to the ground's height.
    """
    change = np.array([*release.velocity, *release.acceleration])
    if surroundings.drag == 0:
        flight = fly(release, surroundings)
        dx, dy = change[:2] + change[2:] * flight.time
        vx, vy = flight.impact_velocity
        return float(dx - vx / vy * dy) if vy else math.nan
    legs = _Fall(surroundings, FINE).legs(np.array([*release.position, *release.velocity, *change]))
    if legs is None:
        return float(fly(release, surroundings).range)  # says why there is none
    landing = legs[-1].y[:, -1]
    return float(landing[4] - landing[2] / landing[3] * landing[5]) if landing[3] else math.nan
