"""The quantities of a motion that a certificate holds, read the same way from every computation."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from scipy.optimize import brentq

from ...models.arrays import FloatArray
from ...models.launch import Launch
from ...models.mechanism import Mechanism

PROJECTILE, COUNTERWEIGHT = "projectile", "counterweight"
BEYOND_LAUNCH = 0.1  # [s] the step of machines that swing for some seconds, such as the paper's
PointState = tuple[FloatArray, FloatArray, FloatArray]
"""Position [m], velocity [m/s], acceleration [m/s^2] of a point, each (2,)."""


class Motion(Protocol):
    """A motion as every computation offers it; times are single floats [s]."""

    @property
    def release_times(self) -> Mapping[str, float | None]:
        """When each stop opened [s]."""
        ...

    @property
    def launch(self) -> Launch | None:
        """The launch at 45 degrees."""
        ...

    def state(self, t: float) -> tuple[FloatArray, FloatArray]:
        """Q and u."""
        ...

    def marker(self, name: str, t: float) -> PointState:
        """A marker's position, velocity and acceleration."""
        ...

    def stop_torques(self, t: float) -> Mapping[str, float]:
        """Torque of every stop [N m]."""
        ...

    def energy(self, t: float) -> float:
        """Total energy [J]."""
        ...


class Key(NamedTuple):
    """Which quantity a figure is of."""

    name: str
    subject: str | None
    at: str
    unit: str
    time: float | None = None


@dataclass(frozen=True)
class Plan:
    """Quantities of a machine, decided once, so that every computation yields the same ones."""

    mechanism: Mechanism
    releases: tuple[str, ...]
    halfway: Mapping[str, float]
    """A fixed instant about half way to each release [s]."""
    grid: tuple[float, ...]
    launches: bool
    step: float = BEYOND_LAUNCH
    """Step of the grid of instants, a power of ten [s]; the best release and the largest energy
    ratio are searched up to one step about the launch."""


def grid_step(scale: float) -> float:
    """The largest power of ten below a fifth of a time scale, both [s]."""
    return 10.0 ** math.floor(math.log10(scale / 5))


def plan(mechanism: Mechanism, motion: Motion, end: float, step: float) -> Plan:
    """Quantities of a machine whose motion is known well enough to say which there are.

    Args:
        end: of the certified motion, the launch or the duration [s].
        step: of the grid of instants, a power of ten [s].
    """
    times = {
        name: time
        for name, time in motion.release_times.items()
        if time is not None and time <= end
    }
    # Rounded to a hundredth of the step: all computations must use the same number.
    decimals = -round(math.log10(step))
    least = 10.0 ** -(decimals + 2)
    halfway = {
        name: max(round(time / 2, decimals + 2), least)
        for name, time in times.items()
        if time > 4 * least
    }
    grid = tuple(round(i * step, decimals) for i in range(1, int(end / step) + 1))
    return Plan(mechanism, tuple(times), halfway, grid, motion.launch is not None, step)


def read_quantities(motion: Motion, plan: Plan) -> dict[Key, float]:
    """All quantities of the plan."""
    parts = [_start, _releases, _torques, _grid]
    if plan.launches:
        parts += [_launch, _rightmost, _best_release, _largest_ratio]
    values = {key: float(value) for part in parts for key, value in part(motion, plan)}
    return {key: value for key, value in values.items() if math.isfinite(value)}


_KeyedValues = Iterator[tuple[Key, float]]


def _start(motion: Motion, plan: Plan) -> _KeyedValues:
    torques = motion.stop_torques(0.0)
    for stop in plan.mechanism.stops:
        if stop.closed:
            yield Key("stop_torque", stop.name, "start", stop.force_unit), torques[stop.name]
    yield Key("total_energy", None, "start", "J"), motion.energy(0.0)


def _releases(motion: Motion, plan: Plan) -> _KeyedValues:
    for name in plan.releases:
        time = motion.release_times[name]
        if time is None:
            continue
        yield Key("release_time", name, "", "s"), time
        yield from _coordinates(motion, plan, time, f"release of {name}")


def _coordinates(
    motion: Motion, plan: Plan, time: float, at: str, instant: float | None = None
) -> _KeyedValues:
    q, _ = motion.state(time)
    for i, name in enumerate(plan.mechanism.coordinates):
        unit = "rad" if i < len(plan.mechanism.angles) else "m"
        yield Key("coordinate", name, at, unit, instant), q[i]


def _torques(motion: Motion, plan: Plan) -> _KeyedValues:
    for name, time in plan.halfway.items():
        unit = plan.mechanism.stop(name).force_unit
        yield Key("stop_torque", name, f"{time:g} s", unit, time), motion.stop_torques(time)[name]


def _grid(motion: Motion, plan: Plan) -> _KeyedValues:
    """Where the projectile is; of a mechanism that has none, all coordinates and markers."""
    names = [marker.name for marker in plan.mechanism.markers]
    for time in plan.grid:
        if PROJECTILE not in names:
            yield from _coordinates(motion, plan, time, f"{time:g} s", time)
        for name in [PROJECTILE] if PROJECTILE in names else names:
            yield from _position(motion, name, time, f"{time:g} s", time)


def _position(
    motion: Motion, name: str, time: float, at: str, instant: float | None = None
) -> _KeyedValues:
    x, y = motion.marker(name, time)[0]
    yield Key("position_x", name, at, "m", instant), x
    yield Key("position_y", name, at, "m", instant), y


def _launch(motion: Motion, plan: Plan) -> _KeyedValues:
    launch = motion.launch
    if launch is None:
        return
    yield Key("launch_time", None, "", "s"), launch.time
    yield Key("launch_speed", None, "", "m/s"), launch.speed
    yield from _coordinates(motion, plan, launch.time, "launch")
    yield from _position(motion, PROJECTILE, launch.time, "launch")
    flight = vacuum_range(motion, plan.mechanism.gravity, launch.time)
    yield Key("range", None, "launch", "m"), flight
    ratio = _energy_ratio(motion, plan.mechanism)
    yield Key("energy_ratio", None, "launch", "1"), ratio(launch.time)


def _rightmost(motion: Motion, plan: Plan) -> _KeyedValues:
    launch = motion.launch
    if launch is None or COUNTERWEIGHT not in {marker.name for marker in plan.mechanism.markers}:
        return
    yield Key("position_x", COUNTERWEIGHT, "start", "m"), motion.marker(COUNTERWEIGHT, 0.0)[0][0]

    def x(t: float, derivative: int = 0) -> float:
        return float(motion.marker(COUNTERWEIGHT, t)[derivative][0])

    time = _maximum(x, lambda t: x(t, 1), 0.0, launch.time, plan.step / 10)
    if time is not None:
        farthest = motion.marker(COUNTERWEIGHT, time)[0][0]
        yield Key("position_x_max", COUNTERWEIGHT, "before launch", "m"), farthest


def _best_release(motion: Motion, plan: Plan) -> _KeyedValues:
    """The release with the longest flight without air, near the launch."""
    launch, g = motion.launch, plan.mechanism.gravity
    if launch is None or g == 0:
        return

    def flight(t: float) -> float:
        return vacuum_range(motion, g, t)

    time = _near(motion, launch, plan.step, flight, lambda t: _range_rate(motion, g, t))
    if time is not None:
        _, (vx, vy), _ = motion.marker(PROJECTILE, time)
        yield Key("best_release_time", None, "longest range", "s"), time
        yield Key("best_release_angle", None, "longest range", "rad"), math.atan2(vy, vx)
        yield Key("best_release_speed", None, "longest range", "m/s"), math.hypot(vx, vy)
        yield Key("best_range", None, "longest range", "m"), vacuum_range(motion, g, time)


def _largest_ratio(motion: Motion, plan: Plan) -> _KeyedValues:
    launch = motion.launch
    if launch is None or not motion.energy(0.0):
        return
    ratio = _energy_ratio(motion, plan.mechanism)

    def squared(t: float, derivative: int = 0) -> float:
        return _speed_rate(motion, t)[derivative]

    time = _near(motion, launch, plan.step, squared, lambda t: squared(t, 1))
    if time is not None:
        yield Key("largest_ratio_time", None, "fastest", "s"), time
        yield Key("largest_ratio", None, "fastest", "1"), ratio(time)


def _near(
    motion: Motion,
    launch: Launch,
    step: float,
    value: Callable[[float], float],
    rate: Callable[[float], float],
) -> float | None:
    opened = [
        time for time in motion.release_times.values() if time is not None and time < launch.time
    ]
    before = max(max(opened, default=0.0), launch.time - step)
    return _maximum(value, rate, before, launch.time + step, step / 100)


def _maximum(
    value: Callable[[float], float],
    rate: Callable[[float], float],
    start: float,
    end: float,
    step: float,
) -> float | None:
    """Where a smooth function is largest [s]; None at an end of the interval."""
    times = np.linspace(start, end, max(3, math.ceil((end - start) / step) + 1))
    best = int(np.argmax([value(float(t)) for t in times]))
    if best in (0, len(times) - 1):
        return None
    before, after = float(times[best - 1]), float(times[best + 1])
    if not rate(before) > 0 > rate(after):
        return None
    return float(brentq(rate, before, after, xtol=1e-15, rtol=1e-15))


def vacuum_range(motion: Motion, gravity: float, t: float) -> float:
    """Where a projectile let go at t comes back to y = 0 [m]; NaN where it never does."""
    (x, y), (vx, vy), _ = motion.marker(PROJECTILE, t)
    return float(x + vx * _flight_time(y, vy, gravity))


def _flight_time(y: float, vy: float, gravity: float) -> float:
    under = vy * vy + 2 * gravity * y
    return (vy + math.sqrt(under)) / gravity if under >= 0 and gravity > 0 else math.nan


def _range_rate(motion: Motion, gravity: float, t: float) -> float:
    """dR/dt of :func:`vacuum_range`, R = x + vx T, g T = vy + sqrt(vy^2 + 2 g y)."""
    (_, y), (vx, vy), (ax, ay) = motion.marker(PROJECTILE, t)
    time = _flight_time(y, vy, gravity)
    rate = (ay + (vy * ay + gravity * vy) / math.sqrt(vy * vy + 2 * gravity * y)) / gravity
    return float(vx + ax * time + vx * rate)


def _speed_rate(motion: Motion, t: float) -> tuple[float, float]:
    """Half the squared speed and its derivative."""
    _, v, a = motion.marker(PROJECTILE, t)
    return float(v @ v) / 2, float(v @ a)


def _energy_ratio(motion: Motion, mechanism: Mechanism) -> Callable[[float], float]:
    """The paper's R: kinetic energy of the projectile over the total energy at the start."""
    mass = mechanism.thrown_mass(
        next(marker for marker in mechanism.markers if marker.name == PROJECTILE)
    )
    energy = motion.energy(0.0)
    return lambda t: mass * _speed_rate(motion, t)[0] / energy if mass and energy else math.nan
