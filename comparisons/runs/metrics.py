"""Distances of a trajectory from the reference, read at the trajectory's own times.

No sample of an engine is interpolated, except for the launch, which falls between two samples (a
polynomial through the eight samples around it, :mod:`...models.launch`).

An impact makes speeds and forces jump: between the instants at which the two have it, and within
:attr:`AlignedRun.guard` of either, they are not compared; the instants are. An engine that resolves
no impacts spreads one over some steps, with a force of its impulse over their time, which has no
limit as the step falls: where it begins to push in an impact of the reference's, its forces are not
compared within the guard either. Its speeds are, so that an impact at another time, of another
impulse or of a longer duration is a difference of speeds.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.integrate import trapezoid

from ...models.arrays import BoolArray, FloatArray
from ...models.functions import PointCoefficients
from ...models.kinematics import Kinematics
from ...models.launch import LAUNCH_ANGLE, Launch
from ...models.problem import StopLaw
from ...models.trajectory import Trajectory
from ...reference.solution import Solution
from .balance import keeps_horizontal_momentum, reference_balance, sampled_balance
from .impacts import Pair, impact_times, paired
from .results import Metric
from .scales import Scales, away_from_poles, scales_until
from .stretching import PARTED, Stretching, parting

EVENT_GUARD = 1.5  # steps around an event within which a sample may fall on its other side
UNSEEN = "unseen_time"  # metric of what moves between samples that are far apart
THROWN = "projectile"  # marker whose launch is measured, unless another one is named
SAME_END = 1e-9  # part of the end by which an event may lie beyond it and still be within
# Least energy at the start, in parts of the largest kinetic energy, that a drift is relative to.
# The zero of the potential energy is a convention: a start near it would make any drift large.
LEAST_START = 1e-2
# Of each stop: the first ones; further ones pile up in a shorter and shorter time
_COUNTED_IMPACTS = 10
_REDUNDANT = "not unique: constraints are redundant"
_RESOLVED = 0.5  # characteristic times, or of the end: a longer interval leaves motion unseen


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
    invariants_to: float | None = None  # end of what invariants are compared over [s]
    stretching: Stretching | None = None  # of the reference motion to that end, where it is known

    @property
    def t(self) -> FloatArray:
        """Compared times [s]."""
        return self.trajectory.t[self.keep]

    @cached_property
    def lasting(self) -> AlignedRun:
        """The same up to the end for invariants, unless there is an impact in between."""
        end, impacts = self.invariants_to, (*self.trajectory.impacts, *self.solution.impacts)
        if end is None or any(self.end < time <= end for time, _ in impacts):
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
    def launches(self) -> tuple[Launch | None, Launch | None]:
        """Launches of the trajectory and of the reference; None: none, or no such marker."""
        if self.thrown not in self.trajectory.markers:
            return None, None
        expected = self.solution.launch_at(LAUNCH_ANGLE, self.thrown)
        return self.trajectory.launch(marker=self.thrown), expected

    @cached_property
    def step(self) -> float:
        """Median interval of the samples [s]."""
        return float(np.median(np.diff(self.trajectory.t)))

    @property
    def longest_interval(self) -> float:
        """Longest interval between samples that leaves no motion unseen [s]."""
        return _RESOLVED * min(self.scales.time, self.end)

    @cached_property
    def unseen_intervals(self) -> FloatArray:
        """Intervals between samples up to the end that are longer than that [s]."""
        intervals = np.diff(np.minimum(self.trajectory.t, self.end))
        return intervals[intervals > self.longest_interval]

    @property
    def guard(self) -> float:
        """Time before and after an impact in which what it makes jump is not compared [s].

        It is that by which an impact's own time may be off by default, and some steps. So an
        engine that spreads an impact over no more has the same tolerance as one that resolves it.
        """
        return PARTED * self.scales.time + EVENT_GUARD * self.step

    @cached_property
    def smooth(self) -> BoolArray:
        """Compared samples that are not at an impact of either, nor between two of a pair."""
        windows: list[tuple[float, float]] = []
        for stop in self.trajectory.mechanism.stops:
            for motion in (self.trajectory, self.solution):
                windows += [(time, time) for time in impact_times(motion, stop.name)]
            for time, expected in self.impact_pairs(stop.name):
                if time is not None and expected is not None:
                    windows.append((min(time, expected), max(time, expected)))
        away = np.ones(len(self.t), dtype=bool)
        for first, last in windows:
            away &= (self.t < first - self.guard) | (self.t > last + self.guard)
        return away

    @cached_property
    def unpushed(self) -> BoolArray:
        """Compared samples that are not where an engine without impacts pushes in one instead.

        Each impact of the reference's accounts for one beginning of a stop's force: one that begins
        again and again is compared.
        """
        away = np.ones(len(self.t), dtype=bool)
        for stop in () if self.trajectory.impacts else self.trajectory.mechanism.stops:
            force = self.trajectory.stop_torques.get(stop.name, np.zeros(len(self.keep)))
            begins = self.trajectory.t[1:][(force[:-1] <= 0) & (force[1:] > 0)]
            for time, expected in self._paired(stop.name, begins.tolist()):
                if time is not None and expected is not None:
                    away &= np.abs(self.t - time) > self.guard
        return away

    @cached_property
    def away(self) -> BoolArray:
        """Compared samples that are not beside a singular position, where forces have a pole."""
        return away_from_poles(self.solution, self.t, self.scales.time)

    @cached_property
    def of_forces(self) -> BoolArray:
        """Compared samples at which forces are compared.

        They are smooth, unpushed, away from poles and from instants of a record of efforts.
        """
        return self.smooth & self.away & self.unpushed & self.held

    @cached_property
    def held(self) -> BoolArray:
        """Compared samples that are not beside an instant at which a recorded effort changes.

        An engine has the new effort from the step on that begins there, and times are rounded.
        """
        away, guard = np.ones(len(self.t), dtype=bool), EVENT_GUARD * self.step
        for instant in self.trajectory.mechanism.instants:
            away &= np.abs(self.t - instant) > guard
        return away

    def impact_pairs(self, stop: str) -> list[Pair]:
        """Pairs of times of a stop's impacts in both motions (:func:`.impacts.paired`)."""
        return self._paired(stop, impact_times(self.trajectory, stop))

    def _paired(self, stop: str, times: Sequence[float]) -> list[Pair]:
        """Pairs of these times [s] and of those of a stop's impacts in the reference."""
        end = min(float(self.trajectory.t[-1]), self.solution.problem.duration)
        return paired(times, impact_times(self.solution, stop), self.step, end)

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
        chosen, where = self.smooth, "at an impact"
        if forces:
            chosen, where = self.of_forces, "at an impact or instant, or beside a singular position"
        if not chosen.any():
            return not_observed(name, subject, unit, f"every sample is {where}")
        value = float(self.distance(values, reference)[chosen].max())
        left_out = float(np.diff(self.t)[~(chosen[1:] & chosen[:-1])].sum()) or None
        return Metric(name=name, subject=subject, value=value, unit=unit, left_out=left_out)

    def within(self, *times: float | None) -> bool:
        """Tell whether one of these times is within the compared motion."""
        return any(time is not None and time <= self.end * (1 + SAME_END) for time in times)


def against(
    trajectory: Trajectory,
    solution: Solution,
    end: float,
    reference: Trajectory | None = None,
    *,
    scales: Scales | None = None,
    thrown: str = THROWN,
    invariants_to: float | None = None,
    stretching: Stretching | None = None,
) -> AlignedRun:
    """Set a trajectory beside the reference, which may be known, from the start to `end` [s]."""
    reference = reference or solution.trajectory(trajectory.t)
    compared = (trajectory, reference, solution, end, trajectory.t <= end)
    return AlignedRun(*compared, thrown, scales, invariants_to, stretching)


def points(trajectory: Trajectory) -> dict[str, FloatArray]:
    """Positions that are compared [m], shape (n, 2): markers, else the bodies' centres of mass."""
    mechanism = trajectory.mechanism
    if mechanism.markers:
        return {name: motion.position for name, motion in trajectory.markers.items()}
    kinematics = Kinematics(mechanism)
    rows = compared_points(kinematics)
    return {name: kinematics.position(row, trajectory.q) for name, row in rows.items()}


def compared_points(kinematics: Kinematics) -> dict[str, PointCoefficients]:
    """Points that are compared by their names: markers, else the bodies' centres of mass."""
    mechanism = kinematics.mechanism
    ends = [(marker.name, marker.body, marker.point) for marker in mechanism.markers]
    ends = ends or [(body.name, body.name, body.centre) for body in mechanism.bodies]
    return {name: kinematics.point(body, point) for name, body, point in ends}


def not_observed(
    name: str, subject: str | None, unit: str, why: str = "the engine does not tell it"
) -> Metric:
    """A metric of what cannot be judged, with the reason."""
    return Metric(name=name, subject=subject, value=None, unit=unit, observed=False, note=why)


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
    """Measure every metric; of what the engine does not observe one says so.

    Args:
        end: end of the compared motion, the reference's launch by default of the suite [s].
        reference: at the trajectory's times, where it is known already; so are the scales.
        thrown: marker whose launch is measured.
        invariants_to: end of what invariants are compared over [s], where the motion cannot be
            predicted so long.
        stretching: of the reference motion to that end, for the time of first parting.
    """
    c = against(
        trajectory, solution, end, reference,
        scales=scales, thrown=thrown, invariants_to=invariants_to, stretching=stretching,
    )  # fmt: skip
    return metrics_of(c)


def metrics_of(c: AlignedRun) -> tuple[Metric, ...]:
    """Measure every metric of a run, as :func:`measure`."""
    parts = (_sampled_time, _motion, _launch, _releases, _impacts, _torques, _reactions)
    parts += (_energy, _invariants, _constraints)
    metrics = [metric for part in parts for metric in part(c)]
    if c.stretching is not None:
        angles = c.solution.equations.kinematics.is_angle > 0
        metrics += parting(c.trajectory, c.reference, angles, c.scales, c.stretching)
    return tuple(metrics)


def _sampled_time(c: AlignedRun) -> Iterator[Metric]:
    """Compared time before and after all samples, and between those that are far apart."""
    end = c.lasting.end
    first, last = float(c.trajectory.t[0]), min(float(c.trajectory.t[-1]), end)
    late = first if first > c.longest_interval else 0.0
    yield Metric(name="missing_time", value=min(late, end) + end - last, unit="s")
    unseen = c.lasting.unseen_intervals
    if len(unseen):
        yield Metric(name=UNSEEN, value=float(unseen.sum()), unit="s")


def _motion(c: AlignedRun) -> Iterator[Metric]:
    for name, motion in c.trajectory.markers.items():
        expected = c.reference.marker(name)
        error = c.distance(motion.position, expected.position)
        rms = float(np.sqrt(np.mean(error**2)))
        yield Metric(name="position_max", subject=name, value=error.max(), unit="m")
        yield Metric(name="position_rms", subject=name, value=rms, unit="m")
        yield c.largest("velocity_max", motion.velocity, expected.velocity, "m/s", name)
    mechanism = c.trajectory.mechanism
    for i, name in enumerate(mechanism.coordinates):
        value = float(c.distance(c.trajectory.q[:, i], c.reference.q[:, i]).max())
        kind, speed, unit = "slide_max", "slide_speed_max", "m"
        if i < len(mechanism.angles):
            kind, speed, unit = "angle_max", "angular_speed_max", "rad"
        yield Metric(name=kind, subject=name, value=value, unit=unit)
        yield c.largest(speed, c.trajectory.u[:, i], c.reference.u[:, i], f"{unit}/s", name)


# Events


def _event_metric(
    name: str, subject: str | None, time: float | None, expected: float | None, what: str
) -> Metric:
    """Difference of the times of an event; without a value if one of the two never has it."""
    if time is not None and expected is not None:
        return Metric(name=name, subject=subject, value=time - expected, unit="s")
    engine, reference = (
        "no time before the end" if t is None else f"{t:.9g} s" for t in (time, expected)
    )
    note = f"{what} at {engine} by the engine, at {reference} by the reference"
    return Metric(name=name, subject=subject, value=None, unit="s", note=note)


def launch_errors(
    launch: Launch | None, expected: Launch | None
) -> tuple[float | None, float | None]:
    """Differences of the times [s] and speeds [m/s] of two launches; None unless both are there."""
    if launch is None or expected is None:
        return None, None
    return launch.time - expected.time, launch.speed - expected.speed


def _launch(c: AlignedRun) -> Iterator[Metric]:
    if c.thrown not in c.trajectory.markers:
        return
    launch, expected = c.launches
    time, due = (None if event is None else event.time for event in (launch, expected))
    if not c.within(time, due):
        return
    subject = None if c.thrown == THROWN else c.thrown
    unknown: tuple[float | None, ...] = None, None
    if len(c.unseen_intervals) and expected is not None:
        # Between samples so far apart a launch is read wrongly from a right motion as well.
        unknown = launch_errors(c.reference.launch(marker=c.thrown), expected)
        parts = zip(unknown, (c.scales.time, c.scales.speed), strict=True)
        if any(error is None or abs(error) > PARTED * scale for error, scale in parts):
            for name, unit in (("launch_time", "s"), ("launch_speed", "m/s")):
                yield not_observed(name, subject, unit, "the samples are too far apart to tell it")
            return
    in_time, in_speed = (None if error is None else abs(error) for error in unknown)
    of = _event_metric("launch_time", subject, time, due, f"{c.thrown} comes to the launch angle")
    yield of.model_copy(update={"sampling_error": in_time})
    speed = launch_errors(launch, expected)[1]
    note = "only one of the two launches" if speed is None else None
    of = Metric(name="launch_speed", subject=subject, value=speed, unit="m/s", note=note)
    yield of.model_copy(update={"sampling_error": in_speed})


def _releases(c: AlignedRun) -> Iterator[Metric]:
    for stop in c.trajectory.mechanism.stops:
        name = stop.name
        if not stop.closed and c.solution.problem.stop_law is StopLaw.UNILATERAL:
            continue  # it can only open after an impact, which is another event
        times = c.trajectory.release_times.get(name), c.solution.release_times.get(name)
        if not c.within(*times):
            continue
        if stop.closed and name in c.solution.undetermined_stops:
            yield not_observed("release_time", name, "s", _REDUNDANT)
            continue
        scale = c.scales.angle if stop.gap_unit == "rad" else c.scales.length
        if stop.closed and not (
            _exceeds(c.reference.stop_torque(name)[c.keep] / c.scales.torques[name])
            or _exceeds(c.reference.stop_gap(name)[c.keep] / scale)
        ):
            why = "not unique: nothing presses on the stop, and it stays closed"
            yield not_observed("release_time", name, "s", why)
        else:
            yield _event_metric("release_time", name, *times, "released")


def _exceeds(parts: FloatArray) -> bool:
    """Tell whether any of these parts of a scale is one by which motions have parted."""
    return bool(np.abs(parts).max(initial=0.0) > PARTED)


def _impacts(c: AlignedRun) -> Iterator[Metric]:
    """The worst of each stop's first impacts; one that only one motion has is a disagreement."""
    for stop in c.trajectory.mechanism.stops:
        times, expected = impact_times(c.trajectory, stop.name), impact_times(c.solution, stop.name)
        if not c.within(*times, *expected):
            continue
        if not c.trajectory.impacts:
            why = "the engine resolves no impacts; its motion is judged"
            yield not_observed("impact_time", stop.name, "s", why)
        elif stop.name in c.solution.undetermined_stops:
            yield not_observed("impact_time", stop.name, "s", _REDUNDANT)
        else:
            pairs = [
                pair for pair in c.impact_pairs(stop.name)[:_COUNTED_IMPACTS] if c.within(*pair)
            ]
            metrics = [_event_metric("impact_time", stop.name, *pair, "met") for pair in pairs]
            if metrics:
                yield max(metrics, key=lambda m: np.inf if m.value is None else abs(m.value))


# Forces


def _torques(c: AlignedRun) -> Iterator[Metric]:
    # Samples further than one and a half steps from any release of either
    settled = c.of_forces
    for time in (*c.trajectory.release_times.values(), *c.reference.release_times.values()):
        if time is not None:
            settled = settled & (np.abs(c.t - time) > EVENT_GUARD * c.step)
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
        yield c.largest("stop_torque_max", torque, expected, unit, name, forces=True)
        if settled.any():
            largest = c.distance(torque, expected)[settled].max()
            yield Metric(name="stop_torque_settled", subject=name, value=largest, unit=unit)
        impulse = trapezoid(torque[c.keep], c.t) - trapezoid(expected[c.keep], c.t)
        yield Metric(name="stop_impulse", subject=name, value=float(impulse), unit=f"{unit} s")


def _reactions(c: AlignedRun) -> Iterator[Metric]:
    for joint in c.trajectory.mechanism.joints:
        name, force = joint.name, c.trajectory.joint_reactions.get(joint.name)
        if not joint.held_directions:
            continue
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


# Invariants and constraints


def _energy(c: AlignedRun) -> Iterator[Metric]:
    run, expected = c.trajectory, c.reference
    yield c.largest("kinetic_energy_max", run.kinetic_energy, expected.kinetic_energy, "J")
    potential = c.distance(run.potential_energy, expected.potential_energy).max()
    yield Metric(name="potential_energy_max", value=potential, unit="J")


def _invariants(c: AlignedRun) -> Iterator[Metric]:
    c = c.lasting
    values, expected = c.balance
    balance = c.largest("energy_balance", values, expected, "J")
    unknown = float(sampled_balance(c.trajectory)[1][c.keep].max())
    yield balance.model_copy(update={"sampling_error": unknown}) if unknown else balance
    # Change of the balance, as a part of that at the start and of the largest kinetic energy
    start = float(expected[0])  # every trajectory begins at t = 0
    drift = float(np.abs(values[c.keep] - start).max())
    kinetic = float(c.reference.kinetic_energy[c.keep].max())
    if abs(start) > LEAST_START * kinetic:
        yield Metric(name="energy_drift", value=drift / abs(start), unit="1")
    if kinetic > 0:
        yield Metric(name="energy_drift_kinetic", value=drift / kinetic, unit="1")
    if keeps_horizontal_momentum(c.trajectory.mechanism):
        moved = np.abs(c.trajectory.momentum[c.keep, 0] - c.reference.momentum[0, 0]).max()
        yield Metric(name="horizontal_momentum", value=float(moved), unit="kg m/s")


def _constraints(c: AlignedRun) -> Iterator[Metric]:
    stops = c.trajectory.mechanism.stops
    for stop in stops:
        if stop.closed:
            # Held until the earlier of the two releases: in between, the two differ by the release
            # time.
            releases = (motion.release_time(stop.name) for motion in (c.trajectory, c.reference))
            held = c.t <= min([c.end, *(time for time in releases if time is not None)])
            gap = c.trajectory.stop_gap(stop.name)[c.keep]
            opened = np.abs(gap[held]).max(initial=0.0)
            unit = stop.gap_unit
            yield Metric(name="stop_gap_held", subject=stop.name, value=opened, unit=unit)
    # Violations of gap >= 0, torque >= 0 and torque * gap = 0. The law that was asked for counts,
    # whatever the engine says that it followed.
    for stop in stops if c.solution.problem.stop_law is StopLaw.UNILATERAL else ():
        gap, name, unit = c.trajectory.stop_gap(stop.name)[c.keep], stop.name, stop.gap_unit
        depth = max(0.0, -float(gap.min()))
        yield Metric(name="stop_penetration", subject=name, value=depth, unit=unit)
        torque = c.trajectory.stop_torques.get(name, np.zeros(len(c.keep)))[c.keep]
        peak = float(torque.max())
        if peak > 0:
            product = float(np.abs(torque * gap).max()) / peak
            yield Metric(name="complementarity", subject=name, value=product, unit=unit)
    for name, gap in c.trajectory.joint_gaps.items():
        opened = np.abs(gap[c.lasting.keep]).max()
        yield Metric(name="joint_gap_max", subject=name, value=opened, unit="m")
