"""Impacts in a file: their times and impulses, and the speeds before and after them, against the reference's."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...models.arrays import FloatArray
from ...models.kinematics import Kinematics
from ...models.trajectory import Trajectory
from ...reference.solution import Solution
from ..runs.comparison import against, not_observed
from ..runs.results import Metric

SPEED, IMPULSE = "impact_speed", "impact_impulse"
_COUNTED = 10  # of a stop: as many as have their times judged
_SAME = 1e-9  # of the duration: how far a sample may be from an impact that it belongs to
_MET = 1e-2  # of an angle, or of the longest arm: gap of a stop that is met
_JUMP = 1e-9  # of the largest speed


@dataclass(frozen=True)
class Impact:
    """One, as a file gives it."""

    stop: str
    time: float
    """[s]."""
    impulse: float = math.nan
    """[N m s or N s]; NaN: not given."""


def merged(impacts: Sequence[Impact]) -> tuple[tuple[float, dict[str, float]], ...]:
    """As a trajectory has them; an impulse that is not given counts as one that pushes."""
    found: dict[float, dict[str, float]] = {}
    for impact in sorted(impacts, key=lambda impact: impact.time):
        found.setdefault(impact.time, {})[impact.stop] = (
            1.0 if math.isnan(impact.impulse) else impact.impulse
        )
    return tuple(found.items())


def jumps(
    t: FloatArray, q: FloatArray, u: FloatArray, kinematics: Kinematics, arm: float
) -> list[Impact]:
    """Impacts that speeds show: two samples at one time, between which the speed into a stop that is met jumps up.

    Args:
        t: times [s], shape (n,).
        q, u: states, shape (n, n_q).
        kinematics: of the mechanism.
        arm: its longest [m].
    """
    found: list[Impact] = []
    for k in np.flatnonzero(np.diff(t) == 0):
        for stop in kinematics.mechanism.stops:
            rates = u[k : k + 2] @ kinematics.gap_jacobian(stop.name, q[k])
            met = abs(float(kinematics.gap(stop.name, q[k]))) <= _MET * (
                1.0 if stop.gap_unit == "rad" else arm
            )
            least = _JUMP * float(np.abs(rates).max())
            if met and rates[0] < -least and rates[1] > rates[0] + least:
                found.append(Impact(stop.name, float(t[k])))
    return found


def metrics(
    given: Trajectory, impacts: Sequence[Impact], solution: Solution, end: float
) -> Iterator[Metric]:
    """Impulses of each stop, and the speeds beside impacts of each coordinate and of each marker: the largest errors.

    Args:
        given: the file's motion, with its impacts.
        impacts: as the file gives them.
        solution: the reference.
        end: of what is judged [s].
    """
    pairs = list(_pairs(given, solution, end))
    if pairs:
        yield from _impulses(pairs, impacts, solution)
        yield from _speeds(given, [(own, other) for _, own, other in pairs], solution)


def _pairs(given: Trajectory, solution: Solution, end: float) -> Iterator[tuple[str, float, float]]:
    """Stop, time in the file and time in the reference of impacts that both have."""
    comparison = against(given, solution, end)
    for stop in given.mechanism.stops:
        for own, other in comparison.impact_pairs(stop.name)[:_COUNTED]:
            if own is not None and other is not None and max(own, other) <= end:
                yield stop.name, own, other


def _impulses(
    pairs: Sequence[tuple[str, float, float]], impacts: Sequence[Impact], solution: Solution
) -> Iterator[Metric]:
    given = {(impact.stop, impact.time): impact.impulse for impact in impacts}
    expected = {
        (name, time): value
        for time, impulses in solution.impacts
        for name, value in impulses.items()
    }
    for stop in dict.fromkeys(name for name, _, _ in pairs):
        unit = "N m s" if solution.problem.mechanism.stop(stop).effort == "torque" else "N s"
        errors = [
            given[stop, own] - expected[stop, other] for name, own, other in pairs if name == stop
        ]
        if stop in solution.undetermined_stops or np.isnan(errors).any():
            why = (
                "it is not unique"
                if stop in solution.undetermined_stops
                else "the file does not give it"
            )
            yield not_observed(IMPULSE, stop, unit, why)
        else:
            yield Metric(name=IMPULSE, subject=stop, value=float(np.abs(errors).max()), unit=unit)


def _speeds(
    given: Trajectory, pairs: Sequence[tuple[float, float]], solution: Solution
) -> Iterator[Metric]:
    """Where the file has two samples at an impact: of both, from the reference's speeds at its own impact."""
    mechanism, kinematics = given.mechanism, Kinematics(given.mechanism)
    errors: dict[tuple[str, str], list[float]] = {}
    for own, other in pairs:
        near = np.flatnonzero(np.abs(given.t - own) <= _SAME * given.t[-1])
        if len(near) < 2:
            continue
        for k, (q, u) in zip((near[0], near[-1]), _beside(solution, other), strict=True):
            for name, error in zip(mechanism.coordinates, np.abs(given.u[k] - u), strict=True):
                errors.setdefault(
                    (name, "rad/s" if name in mechanism.angles else "m/s"), []
                ).append(float(error))
            for marker in mechanism.markers:
                speed = kinematics.velocity(kinematics.point(marker.body, marker.point), q, u)
                apart = float(np.linalg.norm(given.marker(marker.name).velocity[k] - speed))
                errors.setdefault((marker.name, "m/s"), []).append(apart)
    for (subject, unit), found in errors.items():
        yield Metric(name=SPEED, subject=subject, value=max(found), unit=unit)


def _beside(solution: Solution, time: float) -> Iterator[tuple[FloatArray, FloatArray]]:
    """States of the reference before and after its impact."""
    n = len(solution.problem.mechanism.coordinates)
    before = next(segment for segment in solution.segments if segment.end >= time)
    after = solution.motion(np.array([time]))
    y = np.asarray(before.interpolant(time))
    yield y[:n], y[n:]
    yield after.q[0], after.u[0]
