"""The release of the projectile: at a time, at an angle, or for the longest range."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from ...models.arrays import FloatArray
from ...models.elements import GROUND
from ...models.errors import InputError
from ...models.launch import LAUNCH_ANGLE
from ...models.mechanism import Body, Marker, Mechanism
from ...models.problem import StopLaw
from ..solution import Solution
from ..solver import characteristic_time, solve_until
from .flight import COARSE, Release, Surroundings, drag_flight, fall_time, fly, range_rate

# Durations of the motions, in characteristic times; Table I's sweep ends at 2.5.
_SPANS = (3.0, 6.0, 12.0)
_SCAN = 400  # releases tried over a sweep: some 3 ms apart, where the peak is tens of ms wide
_CANDIDATES = 3  # highest peaks of the scan that are refined
_DOWN = -math.pi / 2


@dataclass(frozen=True)
class Projectile:
    """A marker of a continuous motion, as what is thrown.

    Raises:
        InputError: the mechanism has no marker of that name.
    """

    solution: Solution
    name: str = "projectile"

    def __post_init__(self) -> None:
        names = [marker.name for marker in self.mechanism.markers]
        if self.name not in names:
            raise InputError(
                f"the mechanism has no marker {self.name!r} to throw; it has: {names or 'none'}."
            )

    @property
    def mechanism(self) -> Mechanism:
        """The machine that throws."""
        return self.solution.problem.mechanism

    @cached_property
    def marker(self) -> Marker:
        """The point that is thrown."""
        return next(marker for marker in self.mechanism.markers if marker.name == self.name)

    @cached_property
    def body(self) -> Body:
        """The body that carries it: a sling, say."""
        return self.mechanism.body(self.marker.body)

    @property
    def mass(self) -> float | None:
        """Mass of what is thrown [kg]; None where it is not known."""
        return self.mechanism.thrown_mass(self.marker)

    @property
    def opened(self) -> float:
        """When the last stop of its own body opened [s]; 0 where none did."""
        stops = [stop.name for stop in self.mechanism.stops if stop.body == self.body.name]
        return max(
            (time for name in stops if (time := self.solution.release_times[name]) is not None),
            default=0.0,
        )

    @property
    def end(self) -> float:
        """End of the motion [s]."""
        return self.solution.segments[-1].end

    def sweep(self) -> tuple[float, float]:
        """First sweep [s]: from the opening of its stop to where its velocity points straight down.

        The motion after the first sweep is chaotic, so no result relies on it.
        """
        turned = self.solution.launch_at(_DOWN, self.name)
        return self.opened, self.end if turned is None else turned.time

    def states(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position [m], velocity [m/s] and acceleration [m/s^2] at times t [s], each (n, 2)."""
        motion = self.solution.motion(t)
        return self.solution.equations.kinematics.point_motion(
            self.marker, motion.q, motion.u, motion.a
        )

    @property
    def arm(self) -> str | None:
        """Body that its own one hangs on, as a sling on an arm; None on the ground."""
        parent = self.mechanism.joint_of(self.body.name).parent
        return None if parent == GROUND else parent

    def sling_angle(self, t: FloatArray) -> FloatArray:
        """Angle of its body relative to that body's parent (phi - theta) [rad], shape (n,).

        Raises:
            InputError: it is part of a body that hangs on the ground, so there is no such angle.
        """
        if self.arm is None:
            raise InputError(
                f"there is no sling angle: the {self.name} is part of the {self.body.name!r}, "
                "which hangs on no other body; a release angle or a release time is needed."
            )
        return self.solution.equations.kinematics.angle(self.body.name, self.arm).value(
            self.solution.motion(t).q
        )

    def release_at(self, time: float) -> Release:
        """Release at a time [s].

        Raises:
            InputError: the time lies outside the motion.
        """
        if not 0 <= time <= self.end:
            raise InputError(
                f"release time = {time!r} s must lie within the motion, from 0 to {self.end:.6g} s."
            )
        position, velocity, acceleration = (part[0] for part in self.states(np.array([time])))
        pairs = [(float(v[0]), float(v[1])) for v in (position, velocity, acceleration)]
        return Release(float(time), *pairs)

    def release_at_angle(self, angle: float = LAUNCH_ANGLE) -> Release:
        """Release when the velocity first falls to an angle above the horizontal [rad].

        Raises:
            InputError: it never does.
        """
        launch = self.solution.launch_at(angle, self.name)
        if launch is None:
            raise InputError(
                f"the {self.name}'s velocity never comes down to {math.degrees(angle):.6g} deg "
                "above the horizontal "
                f"within {self.end:.6g} s; another release angle, or a release time, is needed."
            )
        return self.release_at(launch.time)

    def release_at_sling_angle(self, angle: float) -> Release:
        """Release when :meth:`sling_angle` first comes to a value [rad], its rest having opened.

        Raises:
            InputError: it never does, and the sentence gives the angles it takes in its first
                sweep; or there is no sling.
        """
        start, end = self.sweep()
        times = np.linspace(start, end, 4 * _SCAN)
        reached = self.sling_angle(times)
        beyond = np.flatnonzero(np.diff(np.sign(reached - angle)) != 0)
        if not len(beyond):
            low, high = math.degrees(reached.min()), math.degrees(reached.max())
            raise InputError(
                f"sling angle = {math.degrees(angle):.6g} deg is never reached: once free, the "
                f"{self.body.name} takes "
                f"{low:.6g} to {high:.6g} deg from its arm in the first sweep."
            )
        near = times[beyond[0] : beyond[0] + 2]
        time = brentq(
            lambda t: float(self.sling_angle(np.array([t]))[0]) - angle,
            *near,
            xtol=1e-15,
            rtol=1e-15,
        )
        return self.release_at(float(time))

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
        peaks = np.flatnonzero(
            (ranges >= outside[:-2]) & (ranges >= outside[2:]) & np.isfinite(ranges)
        )
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
        vacuum = np.nan_to_num(
            position[:, 0] + velocity[:, 0] * fall - surroundings.origin, nan=-np.inf
        )
        if surroundings.drag == 0:
            return vacuum
        ranges, best = np.full(len(times), -np.inf), -np.inf
        bounds = np.where(
            np.isfinite(vacuum), np.maximum(vacuum, position[:, 0] - surroundings.origin), -np.inf
        )
        for i in np.argsort(-bounds, kind="stable"):
            if bounds[i] <= best:
                break
            release = Release(
                float(times[i]), tuple(position[i].tolist()), tuple(velocity[i].tolist())
            )
            flight = drag_flight(release, surroundings, COARSE)
            ranges[i] = -np.inf if flight is None else flight.range
            best = max(best, float(ranges[i]))
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
