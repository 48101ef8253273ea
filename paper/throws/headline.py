"""The figures of a throw that the paper's numbers are held against, read from any motion in the same way."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from scipy.optimize import brentq

from ...models.kinematics import Kinematics
from ...models.machines.trebuchet import ARM_STOP, COUNTERWEIGHT, PROJECTILE
from ...models.mechanism import Mechanism
from ...models.trajectory import Trajectory
from ...reference.certification.quantities import BEYOND_LAUNCH, Key, Motion, Plan, figures, vacuum_range
from .multipliers import shapes

GRIDS = (0.005, 0.01)
"""Steps [s] of the release times the paper samples the range at: by its text, and by the caption of its Fig. 4."""

SIDEWAYS, SLANT = "sideways (counterweight), launch", "slant (counterweight), launch"
FASTEST_ANGLE = "velocity_angle, fastest"
"""Names of figures added here."""

_SCAN = 0.01  # [s] in which the arm cannot come to its stop and back
_LOOK = 1.0  # [s] after the launch in which the arm's arrival at its stop is looked for

Figures = dict[str, float]
"""Values by name; a name is that of a certificate's figure, or one of those added here."""


def read(motion: Motion, trajectory: Trajectory) -> Figures:
    """Every figure the motion has, SI units and radians.

    Args:
        motion: the continuous motion.
        trajectory: the same motion at times of its own, a little past the launch at least.
    """
    found = {label(key): value for key, value in figures(motion, _plan(trajectory.mechanism, motion)).items()}
    for part in (_of_the_launch, _of_the_counterweight, _of_the_best_release, _of_the_arm):
        found |= dict(part(motion, trajectory, found))
    return found | dict(_along(motion, trajectory)) | shapes(trajectory)


def label(key: Key) -> str:
    """The name of a figure, as certificates label theirs."""
    subject = "" if key.subject is None else f" ({key.subject})"
    return f"{key.name}{subject}, {key.at}" if key.at else f"{key.name}{subject}"


def _plan(mechanism: Mechanism, motion: Motion) -> Plan:
    end = math.inf if motion.launch is None else motion.launch.time
    released = tuple(name for name, time in motion.release_times.items() if time is not None and time <= end)
    return Plan(mechanism, released, {}, (), motion.launch is not None)


_Found = Iterator[tuple[str, float]]


def _of_the_launch(motion: Motion, trajectory: Trajectory, found: Figures) -> _Found:
    if motion.launch is None:
        return
    time, mechanism = motion.launch.time, trajectory.mechanism
    body = next(marker.body for marker in mechanism.markers if marker.name == COUNTERWEIGHT)
    speed = math.hypot(*motion.marker(COUNTERWEIGHT, time)[1])
    yield "kinetic_energy (counterweight), launch", 0.5 * mechanism.body(body).mass * speed**2
    q, u = motion.state(time)
    yield "potential_energy, launch", float(Kinematics(mechanism).potential_energy(q))
    if mechanism.slides:
        yield "pivot_speed, launch", float(u[-1])
    best = found.get("best_range, longest range")
    if best is not None:
        yield "range gain, longest range", best - found["range, launch"]
    for step in GRIDS:
        yield f"best release on a grid, {step:g} s", _best_on_grid(motion, mechanism.gravity, time, step)


def _best_on_grid(motion: Motion, gravity: float, launch: float, step: float) -> float:
    """Time k step of the longest range near the launch [s]."""
    first, last = math.ceil((launch - BEYOND_LAUNCH) / step), math.floor((launch + BEYOND_LAUNCH) / step)
    times = [k * step for k in range(first, last + 1)]
    ranges = [vacuum_range(motion, gravity, time) for time in times]
    return times[int(np.nanargmax(ranges))]


def _of_the_counterweight(motion: Motion, trajectory: Trajectory, found: Figures) -> _Found:
    """How far it has travelled sideways by the launch, all turns counted, and how far out per metre fallen."""
    if motion.launch is None:
        return
    end = motion.launch.time
    before = trajectory.t[trajectory.t < end]
    vx = trajectory.marker(COUNTERWEIGHT).velocity[: len(before), 0]
    turns = [_turn(motion, float(before[i]), float(before[i + 1])) for i in np.flatnonzero(vx[:-1] * vx[1:] < 0)]
    path = np.array([motion.marker(COUNTERWEIGHT, t)[0] for t in (float(before[0]), *turns, end)])
    yield SIDEWAYS, float(np.abs(np.diff(path[:, 0])).sum())
    fallen = float(path[0, 1] - path[-1, 1])
    if fallen > 0:
        yield SLANT, float(path[:, 0].max() - path[0, 0]) / fallen


def _turn(motion: Motion, start: float, end: float) -> float:
    """When the counterweight turns back [s]."""

    def sideways(t: float) -> float:
        return float(motion.marker(COUNTERWEIGHT, t)[1][0])

    # A spline through an engine's samples may have the sign's change just outside: then either sample will do.
    return float(brentq(sideways, start, end, xtol=1e-15)) if sideways(start) * sideways(end) < 0 else start


def _of_the_best_release(motion: Motion, trajectory: Trajectory, found: Figures) -> _Found:
    time = found.get("best_release_time, longest range")
    if time is None:
        return
    names = trajectory.mechanism.coordinates
    q, _ = motion.state(time)
    for name, value in zip(names, q, strict=True):
        yield f"coordinate ({name}), longest range", float(value)
    body = next(marker.body for marker in trajectory.mechanism.markers if marker.name == PROJECTILE)
    along = q[[b.name for b in trajectory.mechanism.bodies].index(body)]
    vx, vy = motion.marker(PROJECTILE, time)[1]
    # Absolute angles are positive clockwise, so that the sling points along (cos phi, -sin phi).
    forward = math.atan2(vy, vx) + float(along)
    yield "velocity to sling, longest range", abs(math.remainder(forward, 2 * math.pi))
    if "largest_ratio_time, fastest" in found:
        vx, vy = motion.marker(PROJECTILE, found["largest_ratio_time, fastest"])[1]
        yield FASTEST_ANGLE, math.atan2(vy, vx)
        yield "fastest after longest range", found["largest_ratio_time, fastest"] - time


def _of_the_arm(motion: Motion, trajectory: Trajectory, found: Figures) -> _Found:
    """When the arm comes to where its stop is: the paper's third constraint."""
    if motion.launch is None or ARM_STOP not in {stop.name for stop in trajectory.mechanism.stops}:
        return
    kinematics, start = Kinematics(trajectory.mechanism), motion.launch.time

    def gap(t: float) -> float:
        return float(kinematics.gap(ARM_STOP, motion.state(t)[0]))

    times = np.arange(start, min(float(trajectory.t[-1]), start + _LOOK), _SCAN)
    beyond = next((i for i, t in enumerate(times) if gap(float(t)) <= 0), None)
    if beyond:
        time = float(brentq(gap, float(times[beyond - 1]), float(times[beyond]), xtol=1e-15, rtol=1e-15))
        yield "arm at its stop", time
        yield "arm at its stop after launch", time - start
    elif beyond == 0:
        yield "arm at its stop after launch", -math.inf


def _along(motion: Motion, trajectory: Trajectory) -> _Found:
    """Largest departures on the way to the launch, from what should not change at all."""
    end = trajectory.t[-1] if motion.launch is None else motion.launch.time
    energy = trajectory.total_energy[trajectory.t <= end]
    yield "energy drift", float(np.abs(energy - energy[0]).max())
    yield "energy drift, share", float(np.abs(energy / energy[0] - 1).max())
    closed = [stop.name for stop in trajectory.mechanism.stops if stop.closed]
    times = [time for name in closed if (time := motion.release_times[name]) is not None]
    if times:
        rigid = trajectory.t <= min(times)
        yield "bend before the first release", max(float(np.abs(trajectory.stop_gap(n)[rigid]).max()) for n in closed)
