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
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ...models.arrays import BoolArray, FloatArray
from ...models.elements import AnyForceElement, refuse_unknown
from ...models.errors import TrebucheckError
from ...models.kinematics import initial_state
from ...models.mechanism import Body, Mechanism
from ...models.problem import Problem
from ...models.trajectory import Trajectory
from ...reference.equations import Equations, consistent_coordinates, consistent_speeds
from ...reference.solution import Solution
from ...reference.solver import TOLERANCE, solve
from .results import Metric
from .scales import LIMIT, Scales, away_from_poles, extent, scales_until

# Part of a scale by which motions differ that have parted: the default tolerance. It is three
# digits, as fine as a plot shows and finer than most machines' masses are known.
PARTED = 1e-3
START_LIMIT = 1000.0  # for errors of the start, which engines take over exactly
REGULAR = 2.5  # growth in a characteristic time: a pendulum has 0.5 (a point mass) to 1.5 (a rod)
_CHANGE = 1e-6  # of a body's inertia, in m l^2; of an angle, a slide or a speed, in its scale
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

    t: FloatArray  # [s], from the start to the end of the compared motion
    parameters: FloatArray  # growth by inertia, and by the numbers of force elements
    start: FloatArray  # growth in the configuration alone, by coordinates and speeds at the start
    rounding: FloatArray  # estimated error of the reference's own integration, in parts of scales
    allowed: FloatArray  # most that is predictable, of parameters; of the start in proportion

    @property
    def largest(self) -> FloatArray:
        """The larger of the two, that of the start in proportion to its limit; shape (n,)."""
        return np.maximum(self.parameters, self.start * (LIMIT / START_LIMIT))

    @property
    def horizon(self) -> float:
        """The predictability horizon [s], at most the end."""
        growth = self.largest / self.allowed * LIMIT
        return predictable_until(self.t, np.where(self.rounding <= _KNOWN, growth, np.inf))

    @property
    def known_until(self) -> float:
        """Last time [s] up to which the reference itself is known, at most the end."""
        return predictable_until(self.t, np.where(self.rounding <= _KNOWN, 0.0, np.inf))

    def before(self, time: float) -> int:
        """Index of the last of the times that is not later [s]."""
        return max(0, int(np.searchsorted(self.t, time, side="right")) - 1)


def stretching_until(solution: Solution, end: float, scales: Scales) -> Stretching:
    """Computes the growth of errors of a reference motion up to `end` [s], by its scales."""
    changed = _Changed(solution, end, scales)
    t, mechanism = changed.t, solution.problem.mechanism
    others = chain(_with_other_inertias(mechanism), _with_other_forces(mechanism))
    parameters = changed.largest(others, _motion)
    start = changed.largest(_with_other_starts(mechanism, scales), _configuration)
    nodes = np.concatenate([segment.interpolant.ts for segment in solution.segments])
    carried = np.maximum(1.0, np.maximum(parameters, start))
    rounding = np.asarray(TOLERANCE * np.searchsorted(nodes, t) * carried, dtype=np.float64)
    allowed = np.maximum(LIMIT, REGULAR * t / scales.time)
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


_ComplexArray = NDArray[np.complex128]
_Reading = Callable[[Solution, FloatArray, Scales], _ComplexArray]
"""Quantities of a motion in parts of their scales, shape (rows, n)."""


class _Changed:
    """Distances that changed mechanisms move from the unchanged one."""

    def __init__(self, solution: Solution, end: float, scales: Scales) -> None:
        self.problem, self.end, self.scales = solution.problem, end, scales
        mechanism = self.problem.mechanism
        self.first_force = _ROWS * len(mechanism.bodies)
        # Smaller for motions slower than the natural one
        slow = min(1.0, scales.speed / _natural_speed(mechanism, scales))
        self.tolerance = max(TOLERANCE, _TOLERANCE * slow)
        self.t = _away_from_impacts(solution, np.linspace(0.0, end, _SAMPLES))
        self.poles = ~away_from_poles(solution, self.t, scales.time)
        try:
            self.unchanged = self._solved(mechanism, end)
        except TrebucheckError:  # as loosely as that it cannot be moved
            self.unchanged = solution

    def largest(self, mechanisms: Iterable[Mechanism], read: _Reading) -> FloatArray:
        """Largest difference so far from any changed mechanism, per part of change; shape (n,)."""
        motion, growth = read(self.unchanged, self.t, self.scales), np.zeros(len(self.t))
        for mechanism in mechanisms:
            moved = self._moved(mechanism, read)
            n = moved.shape[1]
            # What is unique in both
            differences = np.nan_to_num(np.abs(moved - motion[:, :n]))
            differences[self.first_force :, self.poles[:n]] = 0.0
            growth[:n] = np.maximum(growth[:n], differences.max(axis=0) / _CHANGE)
            growth[n:] = np.inf
        return np.maximum.accumulate(growth)

    def _moved(self, mechanism: Mechanism, read: _Reading) -> _ComplexArray:
        """The changed motion, as far as it can be computed."""
        for part in _SHORTER:
            with suppress(TrebucheckError):
                end = part * self.end
                return read(self._solved(mechanism, end), self.t[self.t <= end], self.scales)
        return np.empty((1, 0), dtype=np.complex128)

    def _solved(self, mechanism: Mechanism, end: float) -> Solution:
        problem = Problem(mechanism, duration=end, stop_law=self.problem.stop_law)
        return solve(problem, self.tolerance, self.tolerance)


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
    changes = np.eye(n)
    if n > _EACH:
        changes = np.random.default_rng(n).choice([-1.0, 1.0], (_COMBINATIONS, n))
    for signs in changes:
        bodies: list[Body] = []
        for body, sign in zip(mechanism.bodies, signs, strict=True):
            change = sign * _CHANGE * body.mass * extent(mechanism, body) ** 2
            inertia = body.inertia + (change if body.inertia + change >= 0 else -change)
            bodies.append(body.model_copy(update={"inertia": inertia}))
        yield mechanism.model_copy(update={"bodies": tuple(bodies)})


def _with_other_forces(mechanism: Mechanism) -> Iterator[Mechanism]:
    """Numbers of all force elements changed by a part of themselves, up or down at random."""
    refuse_unknown("The growth of errors", mechanism.force_elements)
    # One sign a number, in the order of the elements and of their fields.
    signs = np.random.default_rng(len(mechanism.force_elements))

    def changed(value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(changed(number) for number in cast("tuple[float, ...]", value))
        return value * (1 + float(signs.choice([-_CHANGE, _CHANGE])))

    elements: list[AnyForceElement] = []
    for element in mechanism.force_elements:
        update = {name: changed(getattr(element, name)) for name in element.numbers()}
        elements.append(element.model_copy(update=update))
    if elements:
        yield mechanism.model_copy(update={"force_elements": tuple(elements)})


def _with_other_starts(mechanism: Mechanism, scales: Scales) -> Iterator[Mechanism]:
    """Coordinates, then all speeds, up or down at random, made consistent."""
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
            update = {"start": tuple(near.tolist()), "start_speeds": tuple(speeds.tolist())}
            yield mechanism.model_copy(update=update)


def _natural_speed(mechanism: Mechanism, scales: Scales) -> float:
    """[m/s] of a start from rest as well: what gravity gives within the mechanism's own size."""
    return math.sqrt(mechanism.gravity * scales.length) or scales.speed


def _motion(solution: Solution, t: FloatArray, scales: Scales) -> _ComplexArray:
    """Judged quantities, vectors as complex numbers; forces that are not unique are NaN."""
    kinematics, motion = solution.equations.kinematics, solution.motion(t)
    q, u = motion.q, motion.u
    rows: list[NDArray[Any]] = []
    for body in solution.problem.mechanism.bodies:
        centre, angle = kinematics.point(body.name, body.centre), kinematics.angle(body.name)
        rows.append(_plane(kinematics.position(centre, q)) / scales.length)
        rows.append(_plane(kinematics.velocity(centre, q, u)) / scales.speed)
        rows.append(angle.value(q) / scales.angle)
        rows.append(u @ angle.coefficients / scales.angular_speed)
    for name, force in solution.joint_reactions(motion).items():
        unique = name not in solution.undetermined_joints
        rows.append(_plane(force) / scales.force if unique else np.full(len(t), np.nan))
    return np.array(rows, dtype=np.complex128)


def _configuration(solution: Solution, t: FloatArray, scales: Scales) -> _ComplexArray:
    """Positions and angles."""
    angles = solution.equations.kinematics.is_angle > 0
    q = solution.motion(t).q / np.where(angles, scales.angle, scales.length)
    return q.T.astype(np.complex128)


def _plane(vectors: FloatArray) -> _ComplexArray:
    return vectors[:, 0] + 1j * vectors[:, 1]


def parting(
    trajectory: Trajectory,
    reference: Trajectory,
    angles: BoolArray,
    scales: Scales,
    stretching: Stretching,
) -> Iterator[Metric]:
    """Time of first parting and its base error, if the end is beyond the horizon.

    The reference is at the trajectory's times; `angles` says which coordinates are angles.
    """
    end = float(stretching.t[-1])
    if stretching.horizon >= end:
        return
    # Largest distance of coordinates and markers at each time, in parts of their scales
    units = np.where(angles, scales.angle, scales.length)
    distance = (np.abs(trajectory.q - reference.q) / units).max(axis=1)
    for name, motion in trajectory.markers.items():
        error = np.linalg.norm(motion.position - reference.marker(name).position, axis=1)
        distance = np.maximum(distance, error / scales.length)
    parted = np.flatnonzero(~(distance[trajectory.t <= end] <= PARTED))
    time, note = None, f"it does not part by the end, {end:.6g} s"
    if len(parted):
        time, note = float(trajectory.t[parted[0]]), f"by {PARTED:g} of a scale"
    # Largest base error of a motion that has not parted before
    until = end if time is None else time
    index = min(int(np.searchsorted(stretching.t, until)), len(stretching.t) - 1)
    least = LIMIT if until > stretching.horizon else 1.0
    base_error = PARTED / max(float(stretching.largest[index]), least)
    yield Metric(name="base_error", value=base_error, unit="1")
    yield Metric(name="first_parting", value=time, unit="s", note=note)
