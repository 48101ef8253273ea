"""The release of the projectile, at a time, at an angle or for the longest range, and its flight.

The flight goes through vacuum or air to the landing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from pydantic import Field
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, minimize_scalar

from ...models.arrays import FloatArray
from ...models.elements import GROUND
from ...models.errors import InputError
from ...models.launch import LAUNCH_ANGLE
from ...models.mechanism import Mechanism
from ...models.problem import StopLaw
from ...models.spec import NonNegative, Positive, Real, Spec
from ..solution import Solution
from ..solver import characteristic_time, solve_until

FINE, COARSE = 1e-13, 1e-7
"""Relative local errors of a flight that counts, and of one that is only ranked among others."""
LEVEL = 1e-12  # Rounding of a direction [rad]

# Durations of the motions, in characteristic times; Table I's sweep ends at 2.5.
_SPANS = (3.0, 6.0, 12.0)
_SCAN = 400  # releases tried over a sweep: some 3 ms apart, where the peak is tens of ms wide
_CANDIDATES = 3  # highest peaks of the scan that are refined
_DOWN = -math.pi / 2


class Air(Spec):
    """Still air of one density, and how the projectile meets it; none by default."""

    density: NonNegative = Field(default=0.0, description="[kg/m^3]")
    drag_area: NonNegative = Field(
        default=0.0, description="drag coefficient times cross-section, C_d A [m^2]"
    )

    @classmethod
    def around(cls, density: float, drag_coefficient: float, area: float) -> Self:
        """Make it from the drag coefficient [1] and the cross-section [m^2] apart."""
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
    "moon": World(name="moon", gravity=1.62, density=0.0),
    "mars": World(name="mars", gravity=3.71, density=0.02),
    "earth": World(name="earth", gravity=9.81, density=1.2),
    "venus": World(name="venus", gravity=8.87, density=65.0),
}


def world(name: str) -> World:
    """The place of that name, in any case; InputError with a list of all if there is none."""
    if name.lower() not in WORLDS:
        raise InputError(f"there is no body {name!r}; there are: {', '.join(WORLDS)}.")
    return WORLDS[name.lower()]


class Surroundings(Spec):
    """Forces on a projectile in flight, and where it lands."""

    gravity: Positive = Field(description="downwards [m/s^2]; without it nothing lands")
    drag: NonNegative = Field(
        default=0.0, description="k of the deceleration k |v| v [1/m], see Air.drag"
    )
    ground: Real = Field(default=0.0, description="world y at which it lands [m]")
    origin: Real = Field(default=0.0, description="world x from which the range is measured [m]")


@dataclass(frozen=True)
class Release:
    """The projectile as it is let go."""

    time: float  # [s]
    position: tuple[float, float]  # world [m]
    velocity: tuple[float, float]  # world [m/s]
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
    apex_height: float  # largest world y [m]
    time: float  # from release to landing [s]
    impact_velocity: tuple[float, float]  # [m/s]
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
    """Size of a mechanism's gravity [m/s^2]; InputError unless it is downwards."""
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
    if surroundings.drag > 0:
        flight = drag_flight(release, surroundings)
        if flight is None:
            raise _never_lands(release, surroundings)
        return flight
    (x, y), (vx, vy), g = release.position, release.velocity, surroundings.gravity
    time = float(fall_time(np.array(y), np.array(vy), surroundings))
    if math.isnan(time):
        raise _never_lands(release, surroundings)

    def state(t: FloatArray) -> FloatArray:
        height = y + vy * t - 0.5 * g * t * t
        return np.stack([x + vx * t, height, np.full_like(t, vx), vy - g * t], axis=-1)

    apex = y + max(vy, 0.0) ** 2 / (2 * g)
    distance, impact = x + vx * time - surroundings.origin, (vx, vy - g * time)
    return Flight(release, distance, apex, time, impact, state)


def _never_lands(release: Release, surroundings: Surroundings) -> InputError:
    return InputError(
        f"a projectile released at y = {release.position[1]:.6g} m with "
        f"{release.velocity[1]:.6g} m/s upwards never comes up to the landing height y = "
        f"{surroundings.ground:.6g} m; a lower one is needed."
    )


def fall_time(y: FloatArray, vy: FloatArray, surroundings: Surroundings) -> FloatArray:
    """Later root of y + vy t - g t^2/2 = ground [s], without cancellation; NaN without one."""
    g, above = surroundings.gravity, y - surroundings.ground
    with np.errstate(invalid="ignore", divide="ignore"):
        root = np.sqrt(vy * vy + 2 * g * above)
        time = np.where(vy >= 0, (vy + root) / g, 2 * above / (root - vy))
        return np.where(time >= 0, time, np.nan)


def _fall(start: FloatArray, surroundings: Surroundings, tolerance: float) -> list[Any] | None:
    """Legs through air up to the apex, then down, from (x, y, vx, vy), or that and its variation.

    The height y is monotone in each, so no landing is missed. None where it never lands.
    """
    drag, gravity, ground = surroundings.drag, surroundings.gravity, surroundings.ground

    def rates(_: float, y: FloatArray) -> FloatArray:
        """Rates of y: a = -k |v| v - g, and its variation."""
        velocity, speed = y[2:4], math.hypot(y[2], y[3])
        rates = np.empty_like(y)
        rates[:2] = velocity
        rates[2:4] = -drag * speed * velocity
        rates[3] -= gravity
        if len(y) > 4:
            change = y[6:8]
            along = velocity * (velocity @ change) / speed if speed else 0.0
            rates[4:6] = change
            rates[6:8] = -drag * (speed * change + along)
        return rates

    def leg(start: FloatArray, until: Callable[[float, FloatArray], float]) -> Any:
        """Integrate until a function of time and state falls through zero."""
        setattr(until, "terminal", True)  # noqa: B010  SciPy reads attributes of the function
        setattr(until, "direction", -1.0)  # noqa: B010
        return solve_ivp(
            rates,
            (0.0, np.inf),
            start,
            "DOP853",
            dense_output=True,
            events=until,
            rtol=tolerance,
            atol=10 * tolerance,
        )

    rise = [leg(start, lambda _, y: y[3])] if start[3] > 0 else []
    top = rise[0].y[:, -1] if rise else start
    if top[1] < ground:
        return None
    return [*rise, leg(top, lambda _, y: y[1] - ground)]


def drag_flight(
    release: Release, surroundings: Surroundings, tolerance: float = FINE
) -> Flight | None:
    """The flight through air to a relative local error; None where it never lands."""
    legs = _fall(np.array([*release.position, *release.velocity]), surroundings, tolerance)
    if legs is None:
        return None
    ends = np.cumsum([leg.t[-1] for leg in legs])
    landing, apex = legs[-1].y[:, -1], float(legs[-1].y[1, 0])

    def state(t: FloatArray) -> FloatArray:
        if len(legs) == 1:
            return np.asarray(legs[0].sol(np.maximum(t, 0.0))).T
        last = np.asarray(legs[1].sol(np.maximum(t - ends[0], 0.0))).T
        return np.where((t < ends[0])[:, None], np.asarray(legs[0].sol(t)).T, last)

    distance, impact = float(landing[0]) - surroundings.origin, landing[2:].tolist()
    return Flight(release, distance, apex, float(ends[-1]), (impact[0], impact[1]), state)


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
    else:
        legs = _fall(np.array([*release.position, *release.velocity, *change]), surroundings, FINE)
        if legs is None:
            raise _never_lands(release, surroundings)
        vx, vy, dx, dy = legs[-1].y[2:6, -1]
    return float(dx - vx / vy * dy) if vy else math.nan


class Projectile:
    """A marker of a continuous motion, as what is thrown; InputError without that marker."""

    def __init__(self, solution: Solution, name: str = "projectile") -> None:
        self.solution, self.name = solution, name
        self.mechanism = mechanism = solution.problem.mechanism
        marker = mechanism.marker(name)
        if marker is None:
            names = [marker.name for marker in mechanism.markers]
            raise InputError(
                f"the mechanism has no marker {name!r} to throw; it has: {names or 'none'}."
            )
        self.marker = marker
        self.body = mechanism.body(marker.body)
        """The body that carries it: a sling, say."""
        self.mass = mechanism.thrown_mass(marker)
        """[kg]; None where it is not known."""
        parent = mechanism.joint_of(marker.body).parent
        self.arm = None if parent == GROUND else parent
        """Body that its own one hangs on, as a sling on an arm; None on the ground."""
        self.end = solution.segments[-1].end
        """End of the motion [s]."""

    @property
    def opened(self) -> float:
        """Time when the last stop of its own body opened [s]; 0 where none did."""
        stops = [stop.name for stop in self.mechanism.stops if stop.body == self.body.name]
        return max((self.solution.release_times[name] or 0.0 for name in stops), default=0.0)

    def sweep(self) -> tuple[float, float]:
        """First sweep [s]: from the opening of its stop to where its velocity points straight down.

        The motion after the first sweep is chaotic, so no result relies on it.
        """
        turned = self.solution.launch_at(_DOWN, self.name)
        return self.opened, self.end if turned is None else turned.time

    def states(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position [m], velocity [m/s] and acceleration [m/s^2] at times t [s], each (n, 2)."""
        motion, kinematics = self.solution.motion(t), self.solution.equations.kinematics
        return kinematics.point_motion(self.marker, motion.q, motion.u, motion.a)

    def sling_angle(self, t: FloatArray) -> FloatArray:
        """Angle of its body relative to that body's parent (phi - theta) [rad], shape (n,).

        InputError if its body hangs on the ground, so that there is no such angle.
        """
        if self.arm is None:
            raise InputError(
                f"there is no sling angle: the {self.name} is part of the {self.body.name!r}, "
                "which hangs on no other body; a release angle or a release time is needed."
            )
        angle = self.solution.equations.kinematics.angle(self.body.name, self.arm)
        return angle.value(self.solution.motion(t).q)

    def release_at(self, time: float) -> Release:
        """Release at a time [s]; InputError outside the motion."""
        if not 0 <= time <= self.end:
            raise InputError(
                f"release time = {time!r} s must lie within the motion, from 0 to {self.end:.6g} s."
            )
        position, velocity, acceleration = (part[0] for part in self.states(np.array([time])))
        pairs = [(float(v[0]), float(v[1])) for v in (position, velocity, acceleration)]
        return Release(float(time), *pairs)

    def release_at_angle(self, angle: float = LAUNCH_ANGLE) -> Release:
        """Release when the velocity first falls to an angle above the horizontal [rad].

        InputError if it never does.
        """
        launch = self.solution.launch_at(angle, self.name)
        if launch is None:
            raise InputError(
                f"the {self.name}'s velocity never comes down to {math.degrees(angle):.6g} deg "
                f"above the horizontal within {self.end:.6g} s; another release angle, or a "
                "release time, is needed."
            )
        return self.release_at(launch.time)

    def release_at_sling_angle(self, angle: float) -> Release:
        """Release when :meth:`sling_angle` first comes to a value [rad], its rest having opened.

        InputError, with the angles it takes in its first sweep, if it never does or has no sling.
        """
        start, end = self.sweep()
        times = np.linspace(start, end, 4 * _SCAN)
        reached = self.sling_angle(times)
        beyond = np.flatnonzero(np.diff(np.sign(reached - angle)) != 0)
        if not len(beyond):
            low, high = math.degrees(reached.min()), math.degrees(reached.max())
            raise InputError(
                f"sling angle = {math.degrees(angle):.6g} deg is never reached: once free, the "
                f"{self.body.name} takes {low:.6g} to {high:.6g} deg from its arm in the first "
                "sweep."
            )

        def excess(t: float) -> float:
            return float(self.sling_angle(np.array([t]))[0]) - angle

        before, after = times[beyond[0] : beyond[0] + 2]
        return self.release_at(float(brentq(excess, before, after, xtol=1e-15, rtol=1e-15)))

    def best_release(
        self, surroundings: Surroundings, until: float | None = None
    ) -> Release | None:
        """Release of the first sweep with the largest range; None where none lands.

        All the sweep is scanned, and the highest peaks are refined by the root of
        :func:`range_rate`.

        Args:
            until: end of the search [s]; of the first sweep if left out.
        """
        start, end = self.sweep()
        last = end if until is None else until
        impacts = np.array([time for time, _ in self.solution.impacts if start < time <= last])
        sides = np.append(np.nextafter(impacts, start), impacts)  # the range may jump there
        times = np.union1d(np.linspace(start, last, _SCAN), sides)
        ranges = self._scan(times, surroundings)
        outside = np.concatenate([[-np.inf], ranges, [-np.inf]])
        is_peak = (ranges >= outside[:-2]) & (ranges >= outside[2:]) & np.isfinite(ranges)
        peaks = np.flatnonzero(is_peak)
        highest = peaks[np.argsort(-ranges[peaks], kind="stable")][:_CANDIDATES]
        candidates = [self._refined(times, int(i), surroundings) for i in highest]
        return max(candidates, key=lambda release: fly(release, surroundings).range, default=None)

    def _scan(self, times: FloatArray, surroundings: Surroundings) -> FloatArray:
        """Ranges [m], shape (n,); -inf where nothing lands, or drag rules the best out.

        Drag turns no velocity, so y'' = -g / vx^2 along x: with drag vx falls and the path lies
        below the parabola (above none of it), so the range in vacuum bounds it, as the release's
        own x does for a throw backwards.
        """
        position, velocity, _ = self.states(times)
        fall = fall_time(position[:, 1], velocity[:, 1], surroundings)
        vacuum = position[:, 0] + velocity[:, 0] * fall - surroundings.origin
        vacuum = np.nan_to_num(vacuum, nan=-np.inf)
        if surroundings.drag == 0:
            return vacuum
        ranges, best = np.full(len(times), -np.inf), -np.inf
        backwards = position[:, 0] - surroundings.origin
        bounds = np.where(np.isfinite(vacuum), np.maximum(vacuum, backwards), -np.inf)
        for i in np.argsort(-bounds, kind="stable"):
            if bounds[i] <= best:
                break
            place, speed = tuple(position[i].tolist()), tuple(velocity[i].tolist())
            flight = drag_flight(Release(float(times[i]), place, speed), surroundings, COARSE)
            if flight is not None:
                ranges[i], best = flight.range, max(best, flight.range)
        return ranges

    def _refined(self, times: FloatArray, i: int, surroundings: Surroundings) -> Release:
        """The peak next to a scanned time, as the root of the range's rate."""
        low, high = float(times[max(i - 1, 0)]), float(times[min(i + 1, len(times) - 1)])

        def rate(t: float) -> float:
            return range_rate(self.release_at(t), surroundings)

        def loss(t: float) -> float:
            return -fly(self.release_at(t), surroundings).range

        try:
            if rate(low) > 0 > rate(high):
                return self.release_at(float(brentq(rate, low, high, xtol=1e-13, rtol=1e-15)))
            peak: Any = minimize_scalar(
                loss, bounds=(low, high), method="bounded", options={"xatol": 1e-12}
            )
            return self.release_at(float(min((float(peak.x), float(times[i])), key=loss)))
        except InputError:  # beside the peak nothing lands: the scanned time is the last that does
            return self.release_at(float(times[i]))


def swing(
    mechanism: Mechanism,
    release_time: float | None = None,
    stop_law: StopLaw = StopLaw.RELEASE_ONCE,
    spans: tuple[float, ...] = _SPANS,
) -> Projectile:
    """The motion until the first sweep and the release are over, or the longest one solved.

    Args:
        mechanism: with a projectile.
        release_time: [s].
        stop_law: of its stops.
        spans: durations that are tried in turn, in characteristic times.

    Raises:
        InputError: the mechanism has no projectile or no gravity.
        SimulationError: the integrator's step size collapsed.
    """
    scale = characteristic_time(mechanism)

    def complete(solution: Solution) -> bool:
        projectile = Projectile(solution)
        return projectile.sweep()[1] < projectile.end and not (release_time or 0.0) > projectile.end

    return Projectile(solve_until(mechanism, (span * scale for span in spans), complete, stop_law))
