"""How far a trajectory is from the reference, read at the trajectory's own times.

No sample of an engine is interpolated, except for the launch, which falls between two samples (a
polynomial through the eight samples around it, :mod:`...models.launch`).

An impact makes speeds and forces jump: between the instants at which the two have it, and within
one and a half steps of either, they are not compared; the instants are.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.integrate import trapezoid

from ...models.arrays import BoolArray, FloatArray
from ...models.kinematics import Kinematics
from ...models.launch import LAUNCH_ANGLE
from ...models.problem import StopLaw
from ...models.trajectory import Trajectory
from ...reference.solution import Solution
from .balance import keeps_horizontal_momentum, reference_balance, sampled_balance
from .impacts import Pair, impact_times, paired
from .results import Metric
from .scales import Scales, away_from_poles, scales_until
from .stretching import PARTED, Stretching, parting

EVENT_GUARD = 1.5
"""Steps around an event within which a sample may fall on its other side."""
THROWN = "projectile"
"""The marker whose launch is measured, unless another one is named."""


@dataclass(frozen=True)
class AlignedRun:
    """A trajectory and the reference at the same times, up to the end of the compared motion."""

    trajectory: Trajectory
    reference: Trajectory
    solution: Solution
    end: float
    keep: BoolArray
    thrown: str = THROWN
    known_scales: Scales | None = None
    invariants_to: float | None = None
    """End of what invariants are compared over [s]; None: the same."""
    stretching: Stretching | None = None
    """Growth of errors of the reference motion to that end, where it is known."""

    @property
    def t(self) -> FloatArray:
        """Compared times [s]."""
        return self.trajectory.t[self.keep]

    @cached_property
    def lasting(self) -> AlignedRun:
        """The same up to the end for invariants, unless there is an impact in between."""
        end = self.invariants_to
        if end is None or any(
            self.end < t <= end for t, _ in (*self.trajectory.impacts, *self.solution.impacts)
        ):
            return self
        return replace(self, end=end, keep=self.trajectory.t <= end, invariants_to=None)

    @cached_property
    def scales(self) -> Scales:
        """Scales of the reference motion up to the end."""
        return self.known_scales or scales_until(self.solution, self.end)

    @cached_property
    def balance(self) -> tuple[FloatArray, FloatArray]:
        """T + V - W (:mod:`.balance`) of the trajectory and of the reference, at its times [J].

        W of samples that begin late is the reference's until then.
        """
        expected = reference_balance(self.solution, self.reference)
        before = float(self.reference.total_energy[0] - expected[0])
        return sampled_balance(self.trajectory)[0] - before, expected

    @cached_property
    def step(self) -> float:
        """Median interval of the samples [s]."""
        return float(np.median(np.diff(self.trajectory.t)))

    @cached_property
    def smooth(self) -> BoolArray:
        """Which compared samples are not at an impact of either."""
        away = np.ones(len(self.t), dtype=bool)
        for first, last in _impact_windows(self):
            guard = EVENT_GUARD * self.step
            away &= (self.t < first - guard) | (self.t > last + guard)
        return away

    @cached_property
    def away(self) -> BoolArray:
        """Which compared samples are not beside a singular position, where forces have a pole."""
        return away_from_poles(self.solution, self.t, self.scales.time)

    def impact_pairs(self, stop: str) -> list[Pair]:
        """Pairs of times of a stop's impacts in both motions (:func:`.impacts.paired`)."""
        times, expected = impact_times(self.trajectory, stop), impact_times(self.solution, stop)
        end = min(float(self.trajectory.t[-1]), self.solution.problem.duration)
        return paired(times, expected, self.step, end)

    def distance(self, values: FloatArray, reference: FloatArray) -> FloatArray:
        """Distance at the compared times; Euclidean over a trailing axis, if there is one."""
        difference = (values - reference)[self.keep]
        return np.abs(difference) if difference.ndim == 1 else np.linalg.norm(difference, axis=-1)

    def largest(
        self,
        name: str,
        values: FloatArray,
        reference: FloatArray,
        unit: str,
        subject: str | None = None,
        *,
        forces: bool = False,
    ) -> Metric:
        """Metric of the largest distance at the compared times away from impacts.

        Forces are compared away from singular positions, too.
        """
        chosen = self.smooth & self.away if forces else self.smooth
        if not chosen.any():
            where = "at an impact or beside a singular position" if forces else "at an impact"
            return not_observed(name, subject, unit, f"every sample is {where}")
        value = float(self.distance(values, reference)[chosen].max())
        return Metric(name=name, subject=subject, value=value, unit=unit)


def against(
    trajectory: Trajectory, solution: Solution, end: float, reference: Trajectory | None = None
) -> AlignedRun:
    """Set a trajectory beside the reference, from the start to `end` [s].

    Args:
        reference: at the trajectory's times, where it is known already.
    """
    reference = reference or solution.trajectory(trajectory.t)
    return AlignedRun(trajectory, reference, solution, end, trajectory.t <= end)


def points(trajectory: Trajectory) -> dict[str, FloatArray]:
    """Positions that are compared [m], shape (n, 2): markers, else the bodies' centres of mass."""
    mechanism = trajectory.mechanism
    if mechanism.markers:
        return {name: motion.position for name, motion in trajectory.markers.items()}
    kinematics = Kinematics(mechanism)
    rows = {body.name: kinematics.point(body.name, body.centre) for body in mechanism.bodies}
    return {name: kinematics.position(row, trajectory.q) for name, row in rows.items()}


def _impact_windows(c: AlignedRun) -> Iterator[tuple[float, float]]:
    """First and last instant of each impact of either; both of an impact that both have."""
    for stop in c.trajectory.mechanism.stops:
        times, expected = impact_times(c.trajectory, stop.name), impact_times(c.solution, stop.name)
        for time in (*times, *expected):
            yield time, time
        for own, other in c.impact_pairs(stop.name):
            if own is not None and other is not None:
                yield min(own, other), max(own, other)


def not_observed(
    name: str, subject: str | None, unit: str, why: str = "the engine does not tell it"
) -> Metric:
    """A metric of what cannot be judged, with the reason."""
    return Metric(name=name, subject=subject, value=None, unit=unit, observed=False, note=why)


# Of each stop: the first ones; further ones pile up in a shorter and shorter time
_COUNTED_IMPACTS = 10
_REDUNDANT = "not unique: constraints are redundant"
_RESOLVED = 0.5  # characteristic times, or of the end: a longer interval leaves motion unseen
SAME_END = 1e-9
"""Part of the end by which an event may lie beyond it and still be within."""


def measure(
    trajectory: Trajectory,
    solution: Solution,
    end: float,
    reference: Trajectory | None = None,
    *,
    scales: Scales | None = None,
    thrown: str = THROWN,
    invariants_to: float | None = None,
    stretching: Stretching | None = None,
) -> tuple[Metric, ...]:
    """Every metric; of what the engine does not observe one that says so.

    Args:
        end: end of the compared motion, the reference's launch by default of the suite [s].
        reference: at the trajectory's times, where it is known already.
        scales: of the reference motion up to the end, where they are known already.
        thrown: marker whose launch is measured.
        invariants_to: end of what invariants are compared over [s], where the motion cannot be
        predicted so long.
        stretching: of the reference motion to that end, for the time of first parting.
    """
    reference = reference or solution.trajectory(trajectory.t)
    motions = (trajectory, reference, solution, end, trajectory.t <= end)
    c = AlignedRun(*motions, thrown, scales, invariants_to, stretching)
    return tuple(metric for part in _PARTS for metric in part(c))


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _positions(c: AlignedRun) -> Iterator[Metric]:
    for name, motion in c.trajectory.markers.items():
        expected = c.reference.marker(name)
        error = c.distance(motion.position, expected.position)
        yield Metric(name="position_max", subject=name, value=error.max(), unit="m")
        yield Metric(name="position_rms", subject=name, value=_rms(error), unit="m")
        yield c.largest("velocity_max", motion.velocity, expected.velocity, "m/s", name)


def _coordinates(c: AlignedRun) -> Iterator[Metric]:
    n_angles = len(c.trajectory.mechanism.angles)
    for i, name in enumerate(c.trajectory.mechanism.coordinates):
        value = float(c.distance(c.trajectory.q[:, i], c.reference.q[:, i]).max())
        turns = i < n_angles
        kind, unit = ("angle_max", "rad") if turns else ("slide_max", "m")
        yield Metric(name=kind, subject=name, value=value, unit=unit)
        kind, unit = ("angular_speed_max", "rad/s") if turns else ("slide_speed_max", "m/s")
        yield c.largest(kind, c.trajectory.u[:, i], c.reference.u[:, i], unit, name)


def _launch(c: AlignedRun) -> Iterator[Metric]:
    if c.thrown not in c.trajectory.markers:
        return
    launch = c.trajectory.launch(marker=c.thrown)
    expected = c.solution.launch_at(LAUNCH_ANGLE, c.thrown)
    time, due = (None if each is None else each.time for each in (launch, expected))
    if not _either_within(c, time, due):
        return
    subject = None if c.thrown == THROWN else c.thrown
    what = f"{c.thrown} comes to the launch angle"
    yield _event_metric("launch_time", subject, time, due, what)
    speed, note = None, "only one of the two launches"
    if launch is not None and expected is not None:
        speed, note = launch.speed - expected.speed, None
    yield Metric(name="launch_speed", subject=subject, value=speed, unit="m/s", note=note)


def _releases(c: AlignedRun) -> Iterator[Metric]:
    for stop in c.trajectory.mechanism.stops:
        if not stop.closed and c.solution.problem.stop_law is StopLaw.UNILATERAL:
            continue  # it can only open after an impact, which is another event
        times = c.trajectory.release_times.get(stop.name), c.solution.release_times.get(stop.name)
        if not _either_within(c, *times):
            continue
        why = _no_release(c, stop.name) if stop.closed else None
        if why is not None:
            yield not_observed("release_time", stop.name, "s", why)
        else:
            yield _event_metric("release_time", stop.name, *times, "released")


def _no_release(c: AlignedRun, stop: str) -> str | None:
    """Reason why the time at which a stop opens is not unique; None if it is."""
    if stop in c.solution.undetermined_stops:
        return _REDUNDANT
    turns = c.trajectory.mechanism.stop(stop).gap_unit == "rad"
    torque = c.reference.stop_torque(stop) / c.scales.torques[stop]
    gap = c.reference.stop_gap(stop) / (c.scales.angle if turns else c.scales.length)
    if any(np.abs(values[c.keep]).max(initial=0.0) > PARTED for values in (torque, gap)):
        return None
    return "not unique: nothing presses on the stop, and it stays closed"


def _either_within(c: AlignedRun, *times: float | None) -> bool:
    return any(time is not None and time <= c.end * (1 + SAME_END) for time in times)


def _event_metric(
    name: str, subject: str | None, time: float | None, expected: float | None, what: str
) -> Metric:
    """Difference of the times of an event; without a value if one of the two never has it."""
    if time is not None and expected is not None:
        return Metric(name=name, subject=subject, value=time - expected, unit="s")
    engine, reference = _format_time(time), _format_time(expected)
    note = f"{what} at {engine} by the engine, at {reference} by the reference"
    return Metric(name=name, subject=subject, value=None, unit="s", note=note)


def _format_time(time: float | None) -> str:
    return "no time before the end" if time is None else f"{time:.9g} s"


def _impacts(c: AlignedRun) -> Iterator[Metric]:
    """The worst of each stop's first impacts; one that only one motion has is a disagreement."""
    for stop in c.trajectory.mechanism.stops:
        times, expected = impact_times(c.trajectory, stop.name), impact_times(c.solution, stop.name)
        if not _either_within(c, *times, *expected):
            continue
        if not c.trajectory.impacts:
            why = "the engine resolves no impacts; its motion is judged"
            yield not_observed("impact_time", stop.name, "s", why)
            continue
        if stop.name in c.solution.undetermined_stops:
            yield not_observed("impact_time", stop.name, "s", _REDUNDANT)
            continue
        yield from _worst_impact(c, stop.name)


def _worst_impact(c: AlignedRun, stop: str) -> Iterator[Metric]:
    pairs = [pair for pair in c.impact_pairs(stop)[:_COUNTED_IMPACTS] if _either_within(c, *pair)]
    metrics = [_event_metric("impact_time", stop, *pair, "met") for pair in pairs]
    if metrics:
        yield max(metrics, key=lambda metric: np.inf if metric.value is None else abs(metric.value))


def _torques(c: AlignedRun) -> Iterator[Metric]:
    settled = _away_from_releases(c) & c.smooth & c.away
    for stop in c.trajectory.mechanism.stops:
        name, unit = stop.name, stop.force_unit
        torque = c.trajectory.stop_torques.get(name)
        if torque is None:
            yield not_observed("stop_torque_max", name, unit)
            continue
        if name in c.solution.undetermined_stops:
            yield not_observed("stop_torque_max", name, unit, _REDUNDANT)
            continue
        expected = c.reference.stop_torque(name)
        error = c.distance(torque, expected)
        impulse = trapezoid(torque[c.keep], c.t) - trapezoid(expected[c.keep], c.t)
        yield c.largest("stop_torque_max", torque, expected, unit, name, forces=True)
        if settled.any():
            largest = error[settled].max()
            yield Metric(name="stop_torque_settled", subject=name, value=largest, unit=unit)
        yield Metric(name="stop_impulse", subject=name, value=float(impulse), unit=f"{unit} s")


def _away_from_releases(c: AlignedRun) -> BoolArray:
    """Which compared samples are further than one and a half steps from any release, either's."""
    away = np.ones(len(c.t), dtype=bool)
    times = [*c.trajectory.release_times.values(), *c.reference.release_times.values()]
    for time in times:
        if time is not None:
            away &= np.abs(c.t - time) > EVENT_GUARD * c.step
    return away


def _reactions(c: AlignedRun) -> Iterator[Metric]:
    for joint in (each for each in c.trajectory.mechanism.joints if each.held_directions):
        name, force = joint.name, c.trajectory.joint_reactions.get(joint.name)
        if force is None:
            yield not_observed("joint_reaction_max", name, "N")
            continue
        if name in c.solution.undetermined_joints:
            yield not_observed("joint_reaction_max", name, "N", _REDUNDANT)
            continue
        expected = c.reference.joint_reaction(name)
        error = c.largest("joint_reaction_max", force, expected, "N", name, forces=True)
        yield error
        scale = float(np.linalg.norm(expected[c.keep][c.away], axis=1).max(initial=0.0))
        if scale > 0 and error.value is not None:
            part = error.value / scale
            yield Metric(name="joint_reaction_relative", subject=name, value=part, unit="1")


def _energy(c: AlignedRun) -> Iterator[Metric]:
    own, expected = c.trajectory, c.reference
    yield c.largest("kinetic_energy_max", own.kinetic_energy, expected.kinetic_energy, "J")
    potential = c.distance(own.potential_energy, expected.potential_energy).max()
    yield Metric(name="potential_energy_max", value=potential, unit="J")
    yield _balance(c.lasting)
    yield from _drift(c.lasting)
    yield from _momentum(c.lasting)


def _balance(c: AlignedRun) -> Metric:
    metric = c.largest("energy_balance", *c.balance, "J")
    error = float(sampled_balance(c.trajectory)[1][c.keep].max())
    return metric.model_copy(update={"sampling_error": error}) if error else metric


LEAST_START = 1e-2
"""Least energy at the start, in parts of the largest kinetic energy, that a drift is relative to.

The zero of the potential energy is a convention: a start near it would make any drift large."""


def _drift(c: AlignedRun) -> Iterator[Metric]:
    """Change of the balance of energy, of that at the start and of the largest kinetic energy."""
    own, expected = c.balance
    start = float(expected[0])  # every trajectory begins at t = 0
    drift = float(np.abs(own[c.keep] - start).max())
    kinetic = float(c.reference.kinetic_energy[c.keep].max())
    if abs(start) > LEAST_START * kinetic:
        yield Metric(name="energy_drift", value=drift / abs(start), unit="1")
    if kinetic > 0:
        yield Metric(name="energy_drift_kinetic", value=drift / kinetic, unit="1")


def _momentum(c: AlignedRun) -> Iterator[Metric]:
    if not keeps_horizontal_momentum(c.trajectory.mechanism):
        return
    moved = np.abs(c.trajectory.momentum[c.keep, 0] - c.reference.momentum[0, 0]).max()
    yield Metric(name="horizontal_momentum", value=float(moved), unit="kg m/s")


def _constraints(c: AlignedRun) -> Iterator[Metric]:
    for stop in c.trajectory.mechanism.stops:
        gap, unit = c.trajectory.stop_gap(stop.name)[c.keep], stop.gap_unit
        if stop.closed:
            # Held until the earlier of the two releases: in between, the two differ by the release
            # time.
            releases = (motion.release_time(stop.name) for motion in (c.trajectory, c.reference))
            held = c.t <= min([c.end, *(time for time in releases if time is not None)])
            opened = np.abs(gap[held]).max(initial=0.0)
            yield Metric(name="stop_gap_held", subject=stop.name, value=opened, unit=unit)
    yield from _complementarity(c)
    for name, gap in c.trajectory.joint_gaps.items():
        opened = np.abs(gap[c.lasting.keep]).max()
        yield Metric(name="joint_gap_max", subject=name, value=opened, unit="m")


def _complementarity(c: AlignedRun) -> Iterator[Metric]:
    """Violations of gap >= 0, torque >= 0 and torque * gap = 0, the law of unilateral stops."""
    # The law that was asked for counts, whatever the engine says that it followed.
    if c.solution.problem.stop_law is not StopLaw.UNILATERAL:
        return
    for stop in c.trajectory.mechanism.stops:
        gap, name, unit = c.trajectory.stop_gap(stop.name)[c.keep], stop.name, stop.gap_unit
        depth = max(0.0, -float(gap.min()))
        yield Metric(name="stop_penetration", subject=name, value=depth, unit=unit)
        torque = c.trajectory.stop_torques.get(name, np.zeros(len(c.keep)))[c.keep]
        peak = float(torque.max())
        if peak > 0:
            product = float(np.abs(torque * gap).max()) / peak
            yield Metric(name="complementarity", subject=name, value=product, unit=unit)


def _parting(c: AlignedRun) -> Iterator[Metric]:
    if c.stretching is not None:
        angles = c.solution.equations.kinematics.is_angle > 0
        yield from parting(c.trajectory, c.reference, angles, c.scales, c.stretching)


def _missing_time(c: AlignedRun) -> Iterator[Metric]:
    """Compared time without samples: before a late start, after an early end, in long gaps."""
    end = c.lasting.end
    t = np.minimum(np.concatenate([[0.0], c.trajectory.t]), end)
    intervals = np.diff(t)
    missing = intervals[intervals > _RESOLVED * min(c.scales.time, end)].sum() + end - t[-1]
    yield Metric(name="missing_time", value=float(missing), unit="s")


_PARTS = (
    _missing_time, _positions, _coordinates, _launch, _releases, _impacts, _torques, _reactions,
    _energy, _constraints, _parting,
)  # fmt: skip
