"""How far a trajectory is from the reference: pure functions, the reference read at the trajectory's own times.

No sample of an engine is interpolated, but for the launch, which falls between two samples (a polynomial through
the eight samples around it, :mod:`...models.launch`). Two engines seldom sample the same times: between them, the error
against the reference, which is small and smooth, is interpolated linearly to the other engine's times, so that only a
small part of it is lost. The reference itself cancels in the difference.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.integrate import trapezoid

from ...models.arrays import BoolArray, FloatArray
from ...models.launch import Launch
from ...models.problem import StopLaw
from ...models.trajectory import Trajectory
from ...reference.solution import Solution
from .results import Metric, Pair

_RELEASE_GUARD = 1.5  # steps around a release in which 'settled' torques are not compared


@dataclass(frozen=True)
class Comparison:
    """A trajectory beside the reference at the same times, cut at the end of the compared motion."""

    trajectory: Trajectory
    reference: Trajectory
    solution: Solution
    end: float
    keep: BoolArray

    @property
    def t(self) -> FloatArray:
        """Compared times [s]."""
        return self.trajectory.t[self.keep]

    def distance(self, values: FloatArray, reference: FloatArray) -> FloatArray:
        """|values - reference| at the compared times; Euclidean over a trailing axis, if there is one."""
        difference = (values - reference)[self.keep]
        return np.abs(difference) if difference.ndim == 1 else np.linalg.norm(difference, axis=-1)


def against(trajectory: Trajectory, solution: Solution, end: float, reference: Trajectory | None = None) -> Comparison:
    """Set a trajectory beside the reference, from the start to `end` [s].

    Args:
        reference: at the trajectory's times, where it is known already.
    """
    reference = reference or solution.trajectory(trajectory.t)
    return Comparison(trajectory, reference, solution, end, trajectory.t <= end)


def measure(
    trajectory: Trajectory, solution: Solution, end: float, reference: Trajectory | None = None
) -> tuple[Metric, ...]:
    """Every metric the trajectory's content allows.

    Args:
        end: end of the compared motion, the reference's launch by default of the suite [s].
        reference: at the trajectory's times, where it is known already.
    """
    c = against(trajectory, solution, end, reference)
    return tuple(
        metric
        for part in (_positions, _coordinates, _launch, _releases, _torques, _reactions, _energy, _constraints)
        for metric in part(c)
    )


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _positions(c: Comparison) -> Iterator[Metric]:
    for name, motion in c.trajectory.markers.items():
        error = c.distance(motion.position, c.reference.marker(name).position)
        yield Metric(name="position_max", subject=name, value=error.max(), unit="m")
        yield Metric(name="position_rms", subject=name, value=_rms(error), unit="m")
        error = c.distance(motion.velocity, c.reference.marker(name).velocity)
        yield Metric(name="velocity_max", subject=name, value=error.max(), unit="m/s")


def _coordinates(c: Comparison) -> Iterator[Metric]:
    n_bodies = len(c.trajectory.mechanism.bodies)
    for i, name in enumerate(c.trajectory.mechanism.coordinates):
        error = c.distance(c.trajectory.q[:, i], c.reference.q[:, i])
        kind, unit = ("angle_max", "rad") if i < n_bodies else ("slide_max", "m")
        yield Metric(name=kind, subject=name, value=error.max(), unit=unit)


def _launch(c: Comparison) -> Iterator[Metric]:
    expected = c.solution.launch
    if expected is None or expected.time > c.end or "projectile" not in c.trajectory.markers:
        return
    launch = c.trajectory.launch()
    note = None if launch else "the engine's projectile does not come to the launch angle"
    time = None if launch is None else launch.time - expected.time
    speed = None if launch is None else launch.speed - expected.speed
    yield Metric(name="launch_time", value=time, unit="s", note=note)
    yield Metric(name="launch_speed", value=speed, unit="m/s", note=note)


def _releases(c: Comparison) -> Iterator[Metric]:
    for stop in c.trajectory.mechanism.stops:
        if not stop.closed:
            continue  # it can only open after an impact, which is another event
        released, expected = c.trajectory.release_time(stop.name), c.reference.release_time(stop.name)
        released, expected = _up_to(c.end, released), _up_to(c.end, expected)
        if released is None and expected is None:
            continue
        if released is None or expected is None:
            note = f"released at {_format_time(released)} by the engine, at {_format_time(expected)} by the reference"
            yield Metric(name="release_time", subject=stop.name, value=None, unit="s", note=note)
        else:
            yield Metric(name="release_time", subject=stop.name, value=released - expected, unit="s")


def _up_to(end: float, time: float | None) -> float | None:
    return time if time is not None and time <= end else None


def _format_time(time: float | None) -> str:
    return "no time before the end" if time is None else f"{time:.9g} s"


def _torques(c: Comparison) -> Iterator[Metric]:
    settled = _away_from_releases(c)
    for name, torque in c.trajectory.stop_torques.items():
        expected = c.reference.stop_torque(name)
        stop = c.trajectory.mechanism.stop(name)
        if not stop.closed:
            continue
        error = c.distance(torque, expected)
        impulse = trapezoid(torque[c.keep], c.t) - trapezoid(expected[c.keep], c.t)
        yield Metric(name="stop_torque_max", subject=name, value=error.max(), unit=stop.force_unit)
        if settled.any():
            yield Metric(name="stop_torque_settled", subject=name, value=error[settled].max(), unit=stop.force_unit)
        yield Metric(name="stop_impulse", subject=name, value=float(impulse), unit=f"{stop.force_unit} s")


def _away_from_releases(c: Comparison) -> BoolArray:
    """Which compared samples are further than one and a half steps from any release, either's."""
    step = float(np.median(np.diff(c.trajectory.t)))
    away = np.ones(len(c.t), dtype=bool)
    times = [*c.trajectory.release_times.values(), *c.reference.release_times.values()]
    for time in times:
        if time is not None:
            away &= np.abs(c.t - time) > _RELEASE_GUARD * step
    return away


def _reactions(c: Comparison) -> Iterator[Metric]:
    for name, force in c.trajectory.joint_reactions.items():
        error = c.distance(force, c.reference.joint_reaction(name))
        scale = np.linalg.norm(c.reference.joint_reaction(name)[c.keep], axis=1).max()
        yield Metric(name="joint_reaction_max", subject=name, value=error.max(), unit="N")
        yield Metric(name="joint_reaction_relative", subject=name, value=error.max() / scale, unit="1")


def _energy(c: Comparison) -> Iterator[Metric]:
    start = float(c.reference.total_energy[0])  # every trajectory begins at t = 0
    drift = float(np.abs(c.trajectory.total_energy[c.keep] - start).max())
    if start != 0:
        yield Metric(name="energy_drift", value=drift / abs(start), unit="1")
    kinetic = float(c.reference.kinetic_energy[c.keep].max())
    if kinetic > 0:
        yield Metric(name="energy_drift_kinetic", value=drift / kinetic, unit="1")
    yield from _momentum(c)


def _momentum(c: Comparison) -> Iterator[Metric]:
    """Where the machine may slide along x nothing pushes it that way: its momentum along x is an invariant."""
    slides = c.trajectory.mechanism.slides
    pushed = [stop for stop in c.trajectory.mechanism.point_stops if stop.normal[0] != 0]
    if len(slides) != 1 or slides[0].axis != (1.0, 0.0) or pushed or c.trajectory.mechanism.loop_joints:
        return
    moved = np.abs(c.trajectory.momentum[c.keep, 0] - c.reference.momentum[0, 0]).max()
    yield Metric(name="horizontal_momentum", value=float(moved), unit="kg m/s")


def _constraints(c: Comparison) -> Iterator[Metric]:
    for stop in c.trajectory.mechanism.stops:
        gap = c.trajectory.stop_gap(stop.name)[c.keep]
        if stop.closed:
            # Held until the earlier of the two releases: in between, the two differ by the release time.
            times = [c.end, c.trajectory.release_time(stop.name), c.reference.release_time(stop.name)]
            held = c.t <= min(time for time in times if time is not None)
            yield Metric(name="stop_gap_held", subject=stop.name, value=np.abs(gap[held]).max(), unit=stop.gap_unit)
    yield from _complementarity(c)
    for name, gap in c.trajectory.joint_gaps.items():
        yield Metric(name="joint_gap_max", subject=name, value=np.abs(gap[c.keep]).max(), unit="m")


def _complementarity(c: Comparison) -> Iterator[Metric]:
    """How well gap >= 0, torque >= 0 and torque * gap = 0 hold: the law of a stop that can close again."""
    if c.trajectory.provenance.stop_law != StopLaw.UNILATERAL.value:
        return
    for name, torque in c.trajectory.stop_torques.items():
        gap = c.trajectory.stop_gap(name)[c.keep]
        peak, unit = float(torque[c.keep].max()), c.trajectory.mechanism.stop(name).gap_unit
        yield Metric(name="stop_penetration", subject=name, value=max(0.0, -float(gap.min())), unit=unit)
        if peak > 0:
            product = float(np.abs(torque[c.keep] * gap).max()) / peak
            yield Metric(name="complementarity", subject=name, value=product, unit=unit)


_MARKER = "projectile"


@dataclass(frozen=True)
class Compared:
    """What one run contributes to its pairs."""

    t: FloatArray
    """[s], shape (n,)."""
    error: FloatArray | None
    """Position of the projectile minus the reference's [m], shape (n, 2); None without a projectile."""
    release_times: dict[str, float | None]
    launch: Launch | None

    @classmethod
    def of(cls, trajectory: Trajectory, reference: Trajectory) -> Compared:
        """Of a trajectory and the reference at its times."""
        thrown = _MARKER in trajectory.markers
        error = trajectory.marker(_MARKER).position - reference.marker(_MARKER).position if thrown else None
        launch = trajectory.launch() if thrown else None
        return cls(trajectory.t, error, dict(trajectory.release_times), launch)


def pair_of(model: str, labels: tuple[str, str], first: Compared, second: Compared, end: float) -> Pair:
    """Two runs of one machine up to `end` [s], at the times of the one that has fewer."""
    speeds = [run.launch.speed for run in (first, second) if run.launch]
    return Pair(
        model=model,
        first=labels[0],
        second=labels[1],
        position_max=_position_difference(first, second, end),
        release_time_max=_release_difference(first, second),
        launch_speed=speeds[0] - speeds[1] if len(speeds) == 2 else None,
    )


def _position_difference(first: Compared, second: Compared, end: float) -> float | None:
    coarse, fine = sorted((first, second), key=lambda run: len(run.t))
    if coarse.error is None or fine.error is None:
        return None
    t = coarse.t[coarse.t <= min(end, fine.t[-1])]
    interpolated = np.stack([np.interp(t, fine.t, fine.error[:, axis]) for axis in (0, 1)], axis=1)
    return float(np.linalg.norm(coarse.error[: len(t)] - interpolated, axis=1).max())


def _release_difference(first: Compared, second: Compared) -> float | None:
    differences: list[float] = []
    for name, first_time in first.release_times.items():
        second_time = second.release_times.get(name)
        if (first_time is None) != (second_time is None):
            return None
        if first_time is not None and second_time is not None:
            differences.append(abs(first_time - second_time))
    return max(differences, default=None)
