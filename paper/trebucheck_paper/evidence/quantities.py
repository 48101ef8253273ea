"""Quantities of a throw that the paper's numbers are compared with, read from any motion."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.polynomial import Polynomial
from scipy.optimize import brentq
from trebucheck.api.mechanics import (
    ARM_STOP,
    BEYOND_LAUNCH,
    COUNTERWEIGHT,
    PROJECTILE,
    FloatArray,
    Key,
    Kinematics,
    Mechanism,
    Motion,
    Plan,
    StopLaw,
    Trajectory,
    read_quantities,
    vacuum_range,
)

from .claims import CAPTION_STEP, TIME_STEP

_SCAN = 0.01  # [s] in which the arm cannot come to its stop and back
_LOOK = 1.0  # [s] after the launch in which the arm's arrival at its stop is looked for
_FEWEST = 8  # samples below which a fit of three coefficients says nothing
# Samples beside a kink, and share of the shorter phase, that its slopes are fitted to at least.
_NEAR, _PART = (50, 0.2)
_DEGREE = 5  # of these fits: the curve bends, so that a line's slope would be one of its middle
_DIRECT = {
    "release_time": "release_time",
    "stop_torque": "stop_torque_max",
    "launch_speed": "launch_speed",
}


@dataclass(frozen=True)
class ThrowQuantity:
    """One quantity of a throw; two are the same if name, unit and law are."""

    name: str
    """Name as in certificates, if they have it."""
    unit: str
    """SI; '' where there is none."""
    law: StopLaw = StopLaw.RELEASE_ONCE
    """Law of the stops in the motion it is read from."""
    metric: str | None = field(default=None, compare=False)
    """Metric whose tolerance is this quantity's own; None: there is none."""
    follows_position: bool = field(default=True, compare=False)
    """Whether a tolerance of the projectile's position may be carried over to it."""

    def of(self, machine: str) -> Formula:
        """Its value for a machine."""
        return Formula(self.unit, lambda values: values[machine, self])

    def under(self, law: StopLaw) -> ThrowQuantity:
        """The same quantity of the motion under another law of the stops."""
        return replace(self, law=law)

    def __str__(self) -> str:
        return (
            self.name
            if self.law is StopLaw.RELEASE_ONCE
            else f"{self.name} ({self.law.value} stops)"
        )


Readings = dict[ThrowQuantity, float]
"""Values of one machine's quantities, SI units and radians."""
Values = Mapping[tuple[str, ThrowQuantity], float]
"""Values by machine and quantity."""


@dataclass(frozen=True)
class Formula:
    """A number computed from quantities of the throws, with its unit."""

    unit: str
    value: Callable[[Values], float]

    def __sub__(self, other: Formula) -> Formula:
        return Formula(self.unit, lambda values: self.value(values) - other.value(values))

    def __truediv__(self, other: Formula) -> Formula:
        return Formula("", lambda values: self.value(values) / other.value(values))

    def plus(self, shift: float) -> Formula:
        """Shifted by a constant."""
        return Formula(self.unit, lambda values: self.value(values) + shift)

    def times(self, factor: float, unit: str | None = None) -> Formula:
        """Quantity in another unit, or a multiple of it."""
        return Formula(
            self.unit if unit is None else unit, lambda values: factor * self.value(values)
        )


def certified(key: Key) -> ThrowQuantity:
    """The quantity that certificates hold under a key."""
    subject = "" if key.subject is None else f" ({key.subject})"
    label = f"{key.name}{subject}, {key.at}" if key.at else f"{key.name}{subject}"
    unit = "" if key.unit == "1" else key.unit
    return ThrowQuantity(
        label, unit, metric=_DIRECT.get(key.name), follows_position=key.name != "stop_torque"
    )


def release_time(stop: str) -> ThrowQuantity:
    """Time when a stop opens."""
    return certified(Key("release_time", stop, "", "s"))


def start_torque(stop: str) -> ThrowQuantity:
    """Torque of a stop at the start."""
    return certified(Key("stop_torque", stop, "start", "N m"))


def _shape(name: str, stop: str) -> ThrowQuantity:
    return ThrowQuantity(f"{name} ({stop})", "", follows_position=False)


def parabola(stop: str) -> ThrowQuantity:
    """R^2 of a parabola through a stop's torque up to the first release."""
    return _shape("parabola", stop)


def climb(stop: str) -> ThrowQuantity:
    """Largest rise of a stop's torque before the first release, relative to its start."""
    return _shape("climb", stop)


def line(stop: str) -> ThrowQuantity:
    """R^2 of a line through a stop's torque between the releases."""
    return _shape("line", stop)


def steepening(stop: str) -> ThrowQuantity:
    """Slope of a stop's torque just after the other's release over its slope just before."""
    return _shape("steepening", stop)


# Held by certificates.
LAUNCH_TIME, LAUNCH_SPEED = (
    certified(Key("launch_time", None, "", "s")),
    certified(Key("launch_speed", None, "", "m/s")),
)
RANGE, ENERGY_RATIO = (
    certified(Key("range", None, "launch", "m")),
    certified(Key("energy_ratio", None, "launch", "1")),
)
TOTAL_ENERGY = certified(Key("total_energy", None, "start", "J"))
BEST_TIME = certified(Key("best_release_time", None, "longest range", "s"))
BEST_ANGLE = certified(Key("best_release_angle", None, "longest range", "rad"))
BEST_SPEED = certified(Key("best_release_speed", None, "longest range", "m/s"))
BEST_RANGE = certified(Key("best_range", None, "longest range", "m"))
FASTEST_TIME = certified(Key("largest_ratio_time", None, "fastest", "s"))
LARGEST_RATIO = certified(Key("largest_ratio", None, "fastest", "1"))
RIGHTMOST = certified(Key("position_x_max", COUNTERWEIGHT, "before launch", "m"))

# At the launch, at 45 degrees.
COUNTERWEIGHT_ENERGY = ThrowQuantity("kinetic_energy (counterweight), launch", "J")
POTENTIAL_ENERGY = ThrowQuantity("potential_energy, launch", "J")
PIVOT_SPEED = ThrowQuantity("pivot_speed, launch", "m/s")
RANGE_GAIN = ThrowQuantity("range gain, longest range", "m")
"""Longest range less that at 45 degrees."""
SIDEWAYS = ThrowQuantity("sideways (counterweight), launch", "m")
"""Path of the counterweight along x, all turns counted."""
SLANT = ThrowQuantity("slant (counterweight), launch", "")
"""Largest way of the counterweight along x per metre fallen."""

# At the release of the longest range, and where the projectile is fastest.
BEST_PHI = ThrowQuantity("coordinate (phi), longest range", "rad")
TO_SLING = ThrowQuantity("velocity to sling, longest range", "rad")
FASTEST_ANGLE = ThrowQuantity("velocity_angle, fastest", "rad")
FASTEST_DELAY = ThrowQuantity("fastest after longest range", "s")

# The arm's stop, and what should not change at all.
ARM_ARRIVAL, ARM_DELAY = (
    ThrowQuantity("arm at its stop", "s"),
    ThrowQuantity("arm at its stop after launch", "s"),
)
FIRST_BLOW = ThrowQuantity("arm stop acts", "s", StopLaw.UNILATERAL)
ENERGY_DRIFT = ThrowQuantity("energy drift", "J", metric="energy_balance", follows_position=False)
BEND = ThrowQuantity("bend before the first release", "rad")
"""Largest gap of the stops that are closed at the start, before the first of them opens."""


def grid_release(step: float) -> ThrowQuantity:
    """Time of the longest range among the multiples of a step [s]."""
    return ThrowQuantity(f"best release on a grid, {step:g} s", "s")


_Values = Iterator[tuple[ThrowQuantity, float]]


def read(motion: Motion, trajectory: Trajectory) -> Readings:
    """Quantities that the motion has.

    Args:
        motion: the continuous motion.
        trajectory: the same motion at times of its own, a little past the launch at least.
    """
    readings = read_certified(motion, trajectory.mechanism)
    for part in (_of_the_launch, _of_the_counterweight, _of_the_best_release, _of_the_arm):
        readings |= dict(part(motion, trajectory, readings))
    return readings | dict(_along(motion, trajectory)) | dict(_shapes(trajectory))


def read_certified(motion: Motion, mechanism: Mechanism) -> Readings:
    """The quantities that certificates hold, but for those at fixed instants."""
    end = math.inf if motion.launch is None else motion.launch.time
    released = tuple(
        name for name, time in motion.release_times.items() if time is not None and time <= end
    )
    plan = Plan(mechanism, released, {}, (), motion.launch is not None)
    return {certified(key): value for key, value in read_quantities(motion, plan).items()}


def _of_the_launch(motion: Motion, trajectory: Trajectory, readings: Readings) -> _Values:
    if motion.launch is None:
        return
    time, mechanism = motion.launch.time, trajectory.mechanism
    body = next(marker.body for marker in mechanism.markers if marker.name == COUNTERWEIGHT)
    speed = math.hypot(*motion.marker(COUNTERWEIGHT, time)[1])
    yield COUNTERWEIGHT_ENERGY, 0.5 * mechanism.body(body).mass * speed**2
    q, u = motion.state(time)
    yield POTENTIAL_ENERGY, float(Kinematics(mechanism).potential_energy(q))
    if mechanism.slides:
        yield PIVOT_SPEED, float(u[-1])
    best = readings.get(BEST_RANGE)
    if best is not None:
        yield RANGE_GAIN, best - readings[RANGE]
    for step in (TIME_STEP, CAPTION_STEP):
        yield grid_release(step), _best_on_grid(motion, mechanism.gravity, time, step)


def vacuum_ranges(trajectory: Trajectory) -> FloatArray:
    """Range without drag for a release at each sample [m], NaN if y = 0 is never reached again."""
    (x, y), (vx, vy) = (
        trajectory.marker(PROJECTILE).position.T,
        trajectory.marker(PROJECTILE).velocity.T,
    )
    g = trajectory.mechanism.gravity
    with np.errstate(invalid="ignore"):
        return x + vx * (vy + np.sqrt(vy**2 + 2 * g * y)) / g


def _best_on_grid(motion: Motion, gravity: float, launch: float, step: float) -> float:
    """Time k step of the longest range near the launch [s]."""
    first, last = (
        math.ceil((launch - BEYOND_LAUNCH) / step),
        math.floor((launch + BEYOND_LAUNCH) / step),
    )
    times = [k * step for k in range(first, last + 1)]
    ranges = [vacuum_range(motion, gravity, time) for time in times]
    return times[int(np.nanargmax(ranges))]


def _of_the_counterweight(motion: Motion, trajectory: Trajectory, readings: Readings) -> _Values:
    if motion.launch is None:
        return
    end = motion.launch.time
    before = trajectory.t[trajectory.t < end]
    vx = trajectory.marker(COUNTERWEIGHT).velocity[: len(before), 0]
    turns = [
        _turn(motion, float(before[i]), float(before[i + 1]))
        for i in np.flatnonzero(vx[:-1] * vx[1:] < 0)
    ]
    path = np.array([motion.marker(COUNTERWEIGHT, t)[0] for t in (float(before[0]), *turns, end)])
    yield SIDEWAYS, float(np.abs(np.diff(path[:, 0])).sum())
    fallen = float(path[0, 1] - path[-1, 1])
    if fallen > 0:
        yield SLANT, float(path[:, 0].max() - path[0, 0]) / fallen


def _turn(motion: Motion, start: float, end: float) -> float:
    """Time when the counterweight turns back [s]."""

    def sideways(t: float) -> float:
        return float(motion.marker(COUNTERWEIGHT, t)[1][0])

    # A spline through an engine's samples may have the sign's change just outside: then either
    # sample will do.
    return (
        float(brentq(sideways, start, end, xtol=1e-15))
        if sideways(start) * sideways(end) < 0
        else start
    )


def _of_the_best_release(motion: Motion, trajectory: Trajectory, readings: Readings) -> _Values:
    time = readings.get(BEST_TIME)
    if time is None:
        return
    mechanism = trajectory.mechanism
    q, _ = motion.state(time)
    yield BEST_PHI, float(q[mechanism.coordinates.index("phi")])
    body = next(marker.body for marker in mechanism.markers if marker.name == PROJECTILE)
    along = q[[b.name for b in mechanism.bodies].index(body)]
    vx, vy = motion.marker(PROJECTILE, time)[1]
    # Absolute angles are positive clockwise, so that the sling points along (cos phi, -sin phi).
    forward = math.atan2(vy, vx) + float(along)
    yield TO_SLING, abs(math.remainder(forward, 2 * math.pi))
    if FASTEST_TIME in readings:
        vx, vy = motion.marker(PROJECTILE, readings[FASTEST_TIME])[1]
        yield FASTEST_ANGLE, math.atan2(vy, vx)
        yield FASTEST_DELAY, readings[FASTEST_TIME] - time


def _of_the_arm(motion: Motion, trajectory: Trajectory, readings: Readings) -> _Values:
    """Time when the arm comes to where its stop is: the paper's third constraint."""
    if motion.launch is None or ARM_STOP not in {stop.name for stop in trajectory.mechanism.stops}:
        return
    kinematics, start = Kinematics(trajectory.mechanism), motion.launch.time

    def gap(t: float) -> float:
        return float(kinematics.gap(ARM_STOP, motion.state(t)[0]))

    times = np.arange(start, min(float(trajectory.t[-1]), start + _LOOK), _SCAN)
    beyond = next((i for i, t in enumerate(times) if gap(float(t)) <= 0), None)
    if beyond:
        time = float(
            brentq(gap, float(times[beyond - 1]), float(times[beyond]), xtol=1e-15, rtol=1e-15)
        )
        yield ARM_ARRIVAL, time
        yield ARM_DELAY, time - start
    elif beyond == 0:
        yield ARM_DELAY, -math.inf


def _along(motion: Motion, trajectory: Trajectory) -> _Values:
    """Largest departures on the way to the launch, from what should not change at all."""
    end = trajectory.t[-1] if motion.launch is None else motion.launch.time
    energy = trajectory.total_energy[trajectory.t <= end]
    yield ENERGY_DRIFT, float(np.abs(energy - energy[0]).max())
    closed = [stop.name for stop in trajectory.mechanism.stops if stop.closed]
    times = [time for name in closed if (time := motion.release_times[name]) is not None]
    if times:
        rigid = trajectory.t <= min(times)
        yield BEND, max(float(np.abs(trajectory.stop_gap(n)[rigid]).max()) for n in closed)


class Fit(NamedTuple):
    """A polynomial fitted to samples."""

    polynomial: Polynomial
    determination: float
    """R^2: the share of the samples' variance that it accounts for."""


def fit(t: FloatArray, values: FloatArray, degree: int) -> Fit | None:
    """Least-squares polynomial through samples, shape (n,) each; None if too few or constant."""
    variance = float(np.var(values)) if len(t) >= _FEWEST else 0.0
    if not variance > 0:
        return None
    polynomial = Polynomial.fit(t, values, degree)
    return Fit(polynomial, 1.0 - float(np.mean((values - polynomial(t)) ** 2)) / variance)


def _shapes(trajectory: Trajectory) -> _Values:
    """Shapes of the initial stops' torques, up to the first release and between the releases."""
    closed = [
        stop.name
        for stop in trajectory.mechanism.stops
        if stop.closed and stop.name in trajectory.stop_torques
    ]
    released = {
        name: time for name in closed if (time := trajectory.release_times.get(name)) is not None
    }
    ordered = sorted(released, key=lambda name: released[name])
    if len(ordered) < 2:
        return
    first, last = released[ordered[0]], released[ordered[-1]]
    for name in ordered:
        yield from _before_release(trajectory, name, first)
    yield from _between_releases(trajectory, ordered[-1], first, last)


def _samples(
    trajectory: Trajectory, name: str, start: float, end: float
) -> tuple[FloatArray, FloatArray]:
    inside = (trajectory.t >= start) & (trajectory.t < end)
    return trajectory.t[inside], trajectory.stop_torque(name)[inside]


def _before_release(trajectory: Trajectory, name: str, end: float) -> _Values:
    t, torque = _samples(trajectory, name, 0.0, end)
    fitted = fit(t, torque, 2)
    if fitted is not None:
        yield parabola(name), fitted.determination
        yield (
            climb(name),
            float(np.max(torque - np.minimum.accumulate(torque))) / abs(float(torque[0])),
        )


def _between_releases(trajectory: Trajectory, name: str, start: float, end: float) -> _Values:
    after = fit(*_samples(trajectory, name, start, end), 1)
    if after is not None:
        yield line(name), after.determination
    near = max(_NEAR * float(np.median(np.diff(trajectory.t))), _PART * min(start, end - start))
    sides = [
        fit(*_samples(trajectory, name, *side), _DEGREE)
        for side in ((start - near, start), (start, start + near))
    ]
    slopes = [float(side.polynomial.deriv()(start)) for side in sides if side is not None]
    if len(slopes) == 2:
        yield steepening(name), slopes[1] / slopes[0]
