"""Growth of small errors of parameters and of the start along a motion ("stretching").

A numerical error is a small disturbance of the equations, made in every step and carried on by the
motion. So is a small change of a body's moment of inertia, and its effect can be computed for any
mechanism, with stops and loops. The motion of the changed mechanism minus that of the unchanged
one, each quantity in parts of its scale, the largest of all and per part of the change, is the
stretching. Errors of the start are carried on as well: of each coordinate in parts of its scale, of
each speed in parts of the natural one, projected onto the constraints. Where either is large any
two integrators differ, and no tolerance means anything.

Not every large stretching is one of an unpredictable motion. A clock that is wrong by a part in a
million is wrong by more every day and remains a clock: what a parameter does to a period grows in
proportion to time, and so does an integrator's own error of it, which a tolerance may well bound.
Growth by no more than `REGULAR` in a characteristic time is such a drift.

Beyond the predictability horizon an engine is judged by the time at which its motion leaves the
reference. An error of the relative size eps, made all along the motion, has grown to eps times the
stretching by a time t. A motion that first differs by `PARTED` of a scale at t so shows the base
error eps = PARTED / stretching(t). At the horizon the stretching reaches its limit: any engine that
holds the default tolerance has a base error below PARTED / LIMIT, and leaves the reference later.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import chain
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ...models.arrays import BoolArray, FloatArray
from ...models.elements import (
    refuse_unknown,
)
from ...models.errors import TrebucheckError
from ...models.kinematics import initial_state
from ...models.mechanism import Body, Mechanism
from ...models.problem import Problem
from ...models.trajectory import Trajectory
from ...reference.equations import Equations, consistent_coordinates, consistent_speeds
from ...reference.solution import Solution
from ...reference.solver import TOLERANCE, solve
from .results import Metric
from .scales import Scales, away_from_poles, extent, scales_until

PARTED = 1e-3
"""Part of a scale by which motions differ that have parted: the default tolerance.

It is three digits, as fine as a plot shows and finer than most machines' masses are known."""
LIMIT = 100.0
"""Growth beyond which nothing is judged but invariants and the time of first parting.

A hundred-thousandth of a body's inertia, less than any is known to, then moves something by the
default tolerance."""
START_LIMIT = 1000.0
"""Limit for errors of the start, which engines take over exactly: ten times as large."""
REGULAR = 2.5
"""Regular growth in a characteristic time: a pendulum has 0.5 (a point mass) to 1.5 (a rod)."""
_CHANGE = 1e-6
"""Change of a body's inertia, in m l^2; of an angle, a slide or a speed, in its scale."""
_TOLERANCE = 1e-9  # of the integrations: a thousandth of what the change moves
_KNOWN = 1e-4  # of a scale: if the reference is known no better, nothing is judged any more
_SAMPLES = 400
_NEAR = 0.1  # of the interval of the samples
# Most bodies whose inertias are changed one by one; random combinations of more
_EACH, _COMBINATIONS = (6, 3)
_ROWS = 4  # of each body before those of forces: place, velocity, angle and its speed
# Of the end: how far a changed mechanism is moved that cannot be moved to the end
_SHORTER = (1.0, 0.75, 0.5, 0.25)


@dataclass(frozen=True)
class Stretching:
    """Growth of errors over time, in parts of scales per part of a change; shapes (n,).

    It never decreases, and is infinite from where a changed mechanism could not be moved.
    """

    t: FloatArray
    """[s], from the start to the end of the compared motion."""
    parameters: FloatArray
    """Growth by inertia, and by the numbers of force elements."""
    start: FloatArray
    """Growth in the configuration alone, by coordinates and speeds at the start."""
    rounding: FloatArray
    """Estimated error of the reference's own integration, in parts of scales."""
    allowed: FloatArray
    """Most that is predictable at each time, of parameters; of the start in proportion."""

    @property
    def largest(self) -> FloatArray:
        """The larger of the two, that of the start in proportion to its limit; shape (n,)."""
        return np.maximum(self.parameters, self.start * (LIMIT / START_LIMIT))

    @property
    def horizon(self) -> float:
        """The predictability horizon [s], at most the end."""
        return predictable_until(
            self.t, np.where(self.rounding <= _KNOWN, self.largest / self.allowed * LIMIT, np.inf)
        )

    def before(self, time: float) -> int:
        """Index of the last of the times that is not later [s]."""
        return max(0, int(np.searchsorted(self.t, time, side="right")) - 1)


def stretching_until(solution: Solution, end: float, scales: Scales) -> Stretching:
    """Computes the growth of errors of a reference motion.

    Args:
        solution: of the reference.
        end: of the compared motion [s].
        scales: of the motion up to there.
    """
    changed = _Changed(solution, end, scales)
    t, mechanism = changed.t, solution.problem.mechanism
    parameters = changed.largest(
        chain(_with_other_inertias(mechanism), _with_other_forces(mechanism)), _motion
    )
    start = changed.largest(_with_other_starts(mechanism, scales), _configuration)
    steps = np.searchsorted(
        np.concatenate([segment.interpolant.ts for segment in solution.segments]), t
    )
    allowed = np.maximum(LIMIT, REGULAR * t / scales.time)
    carried = np.maximum(1.0, np.maximum(parameters, start))
    rounding = np.asarray(TOLERANCE * steps * carried, dtype=np.float64)
    return Stretching(t, parameters, start, rounding, allowed)


def stretching(solution: Solution, end: float, scales: Scales) -> tuple[FloatArray, FloatArray]:
    """Times [s] and the stretching by inertia up to each of them, shapes (n,)."""
    changed = _Changed(solution, end, scales)
    return changed.t, changed.largest(_with_other_inertias(solution.problem.mechanism), _motion)


def stretching_at(solution: Solution, end: float) -> float:
    """The stretching by inertia up to `end` [s]."""
    return float(stretching(solution, end, scales_until(solution, end))[1][-1])


def predictable_until(t: FloatArray, stretched: FloatArray) -> float:
    """Predictability horizon [s]: the last time up to which the stretching is below its limit."""
    beyond = np.flatnonzero(~(stretched <= LIMIT))
    return float(t[max(1, int(beyond[0]) - 1 if len(beyond) else len(t) - 1)])


_Reading = Callable[[Solution, FloatArray, Scales], NDArray[np.complex128]]


class _Changed:
    """How far changed mechanisms move from the unchanged one."""

    def __init__(self, solution: Solution, end: float, scales: Scales) -> None:
        self.problem, self.end, self.scales = solution.problem, end, scales
        self.first_force = _ROWS * len(solution.problem.mechanism.bodies)
        self.tolerance = _tolerance(self.problem.mechanism, scales)
        self.t = _away_from_impacts(solution, np.linspace(0.0, end, _SAMPLES))
        self.poles = ~away_from_poles(solution, self.t, scales.time)
        try:
            self.unchanged = self._solved(self.problem.mechanism, end)
        except TrebucheckError:  # as loosely as that it cannot be moved
            self.unchanged = solution

    def largest(self, mechanisms: Iterable[Mechanism], read: _Reading) -> FloatArray:
        """Largest difference so far from any changed mechanism, per part of change; shape (n,)."""
        motion, found = read(self.unchanged, self.t, self.scales), np.zeros(len(self.t))
        for mechanism in mechanisms:
            moved = self._moved(mechanism, read)
            # What is unique in both
            apart = np.nan_to_num(np.abs(moved - motion[:, : moved.shape[1]]))
            apart[self.first_force :, self.poles[: moved.shape[1]]] = 0.0
            distance = apart.max(axis=0) / _CHANGE
            found[: len(distance)] = np.maximum(found[: len(distance)], distance)
            found[len(distance) :] = np.inf
        return np.maximum.accumulate(found)

    def _moved(self, mechanism: Mechanism, read: _Reading) -> NDArray[np.complex128]:
        for part in _SHORTER:
            try:
                return read(
                    self._solved(mechanism, part * self.end),
                    self.t[self.t <= part * self.end],
                    self.scales,
                )
            except TrebucheckError:
                continue
        return np.empty((1, 0), dtype=np.complex128)

    def _solved(self, mechanism: Mechanism, end: float) -> Solution:
        problem = Problem(mechanism, duration=end, stop_law=self.problem.stop_law)
        return solve(problem, self.tolerance, self.tolerance)


def _tolerance(mechanism: Mechanism, scales: Scales) -> float:
    """Tolerance of the integrations: smaller for motions slower than the natural one."""
    return max(TOLERANCE, _TOLERANCE * min(1.0, scales.speed / _natural_speed(mechanism, scales)))


def _away_from_impacts(solution: Solution, t: FloatArray) -> FloatArray:
    """The times that are not near an impact, whose shift would be a jump; the ends stay."""
    near = np.zeros(len(t), dtype=bool)
    for impact, _ in solution.impacts:
        near |= np.abs(t - impact) < _NEAR * (t[1] - t[0])
    near[[0, -1]] = False
    return t[~near]


def _with_other_inertias(mechanism: Mechanism) -> Iterator[Mechanism]:
    """One body changed in each; of many bodies all of them in each, up or down at random."""
    n = len(mechanism.bodies)
    changes = (
        np.eye(n)
        if n <= _EACH
        else np.random.default_rng(n).choice([-1.0, 1.0], (_COMBINATIONS, n))
    )
    for signs in changes:
        yield mechanism.model_copy(
            update={
                "bodies": tuple(
                    _with_inertia(mechanism, *each)
                    for each in zip(mechanism.bodies, signs, strict=True)
                )
            }
        )


def _with_inertia(mechanism: Mechanism, body: Body, sign: float) -> Body:
    change = sign * _CHANGE * body.mass * extent(mechanism, body) ** 2
    return body.model_copy(
        update={"inertia": body.inertia + (change if body.inertia + change >= 0 else -change)}
    )


def _with_other_forces(mechanism: Mechanism) -> Iterator[Mechanism]:
    """All numbers of all force elements changed by a part of themselves, up or down at random."""
    refuse_unknown("The growth of errors", mechanism.force_elements)
    # One sign a number, in the order of the elements and of their fields.
    signs = np.random.default_rng(len(mechanism.force_elements))

    def changed(value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(changed(each) for each in cast("tuple[float, ...]", value))
        return value * (1 + float(signs.choice([-_CHANGE, _CHANGE])))

    elements = tuple(
        element.model_copy(
            update={name: changed(getattr(element, name)) for name in element.numbers()}
        )
        for element in mechanism.force_elements
    )
    if elements:
        yield mechanism.model_copy(update={"force_elements": elements})


def _with_other_starts(mechanism: Mechanism, scales: Scales) -> Iterator[Mechanism]:
    """All coordinates, then all speeds, up or down at random, made consistent."""
    equations, (q, u) = Equations(mechanism), initial_state(mechanism)
    closed = [stop.name for stop in mechanism.stops if stop.closed]
    signs = np.random.default_rng(len(q)).choice([-_CHANGE, _CHANGE], len(q))
    angles = equations.kinematics.is_angle > 0
    other_q = signs * np.where(angles, scales.angle, scales.length)
    other_u = signs * np.where(angles, 1.0 / scales.length, 1.0) * _natural_speed(mechanism, scales)
    for dq, du in ((other_q, 0.0), (0.0, other_u)):
        near = consistent_coordinates(equations, q + dq, closed)
        if near is not None:
            speeds = consistent_speeds(equations, near, u + du, closed)
            yield mechanism.model_copy(
                update={"start": tuple(near.tolist()), "start_speeds": tuple(speeds.tolist())}
            )


def _natural_speed(mechanism: Mechanism, scales: Scales) -> float:
    """[m/s] of a start from rest as well: what gravity gives within the mechanism's own size."""
    return math.sqrt(mechanism.gravity * scales.length) or scales.speed


def _motion(solution: Solution, t: FloatArray, scales: Scales) -> NDArray[np.complex128]:
    """Judged quantities in parts of their scales, vectors as complex numbers; shape (rows, n).

    Forces that are not unique are NaN.
    """
    mechanism, kinematics, motion = (
        solution.problem.mechanism,
        solution.equations.kinematics,
        solution.motion(t),
    )
    rows: list[NDArray[Any]] = []
    for body in mechanism.bodies:
        centre, angle = kinematics.point(body.name, body.centre), kinematics.angle(body.name)
        rows.append(_plane(kinematics.position(centre, motion.q)) / scales.length)
        rows.append(_plane(kinematics.velocity(centre, motion.q, motion.u)) / scales.speed)
        rows += [
            angle.value(motion.q) / scales.angle,
            motion.u @ angle.coefficients / scales.angular_speed,
        ]
    for name, force in solution.joint_reactions(motion).items():
        unique = name not in solution.undetermined_joints
        rows.append(_plane(force) / scales.force if unique else np.full(len(t), np.nan))
    return np.array(rows, dtype=np.complex128)


def _configuration(solution: Solution, t: FloatArray, scales: Scales) -> NDArray[np.complex128]:
    """Positions and angles in parts of their scales, shape (n_rows, n)."""
    angles = solution.equations.kinematics.is_angle > 0
    return (solution.motion(t).q / np.where(angles, scales.angle, scales.length)).T.astype(
        np.complex128
    )


def _plane(vectors: FloatArray) -> NDArray[np.complex128]:
    return vectors[:, 0] + 1j * vectors[:, 1]


def parting(
    trajectory: Trajectory,
    reference: Trajectory,
    angles: BoolArray,
    scales: Scales,
    stretching: Stretching,
) -> Iterator[Metric]:
    """Time of first parting and its base error, if the end is beyond the horizon.

    Args:
        reference: at the trajectory's times.
        angles: which coordinates are angles, shape (n_q,).
        scales: of the compared motion.
        stretching: of the reference motion to its end.
    """
    end = float(stretching.t[-1])
    if stretching.horizon >= end:
        return
    within = trajectory.t <= end
    apart = np.flatnonzero(~(_distance(trajectory, reference, angles, scales)[within] <= PARTED))
    time = float(trajectory.t[apart[0]]) if len(apart) else None
    by = (
        f"by {PARTED:g} of a scale"
        if time is not None
        else f"it does not part by the end, {end:.6g} s"
    )
    yield Metric(
        name="base_error", value=_base_error(stretching, end if time is None else time), unit="1"
    )
    yield Metric(name="first_parting", value=time, unit="s", note=by)


def _distance(
    trajectory: Trajectory, reference: Trajectory, angles: BoolArray, scales: Scales
) -> FloatArray:
    """Largest distance of coordinates and markers at each time, in parts of their scales."""
    distance = (
        np.abs(trajectory.q - reference.q) / np.where(angles, scales.angle, scales.length)
    ).max(axis=1)
    for name, motion in trajectory.markers.items():
        apart = np.linalg.norm(motion.position - reference.marker(name).position, axis=1)
        distance = np.maximum(distance, apart / scales.length)
    return distance


def _base_error(stretching: Stretching, time: float) -> float:
    """Largest base error of a motion that has not parted before a time [s]."""
    index = min(int(np.searchsorted(stretching.t, time)), len(stretching.t) - 1)
    least = LIMIT if time > stretching.horizon else 1.0
    return PARTED / max(float(stretching.largest[index]), least)
