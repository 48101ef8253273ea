"""Stretching: how far a small change of the mechanism's inertia moves its motion, and until when that stays small.

A numerical error is a small disturbance of the equations, made in every step and carried on by the motion. So is a
small change of a body's moment of inertia, and its effect can be computed for any mechanism, with stops and loops. The
motion of the changed mechanism minus that of the unchanged one, each quantity in parts of its scale, the largest of all
and per part of the change, is the stretching. Where it is large any two integrators differ, and no tolerance means
anything.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...models.arrays import FloatArray
from ...models.errors import TrebucheckError
from ...models.mechanism import Body, Mechanism
from ...models.problem import Problem
from ...reference.solution import Solution
from ...reference.solver import solve
from .scales import Scales, extent, scales_until

LIMIT = 100.0
"""Where a hundred-thousandth of a body's inertia, less than any is known to, moves something by the default
tolerance of a thousandth of its scale, nothing is judged any more but invariants."""
_CHANGE = 1e-6
"""Of mass times length squared of one body."""
_TOLERANCE = 1e-9  # of the integrations: a thousandth of what the change moves
_SAMPLES = 400
_NEAR = 0.1  # of the interval of the samples


def stretching(solution: Solution, end: float, scales: Scales) -> tuple[FloatArray, FloatArray]:
    """Largest of all bodies' changes so far, over time.

    Args:
        solution: of the reference.
        end: of the compared motion [s].
        scales: of the motion up to there.

    Returns:
        Times [s] and the stretching up to each of them, in parts of scales per part of inertia; shapes (n,). It is
        infinite from where the changed mechanism could not be moved.
    """
    t = _away_from_impacts(solution, np.linspace(0.0, end, _SAMPLES))
    problem = solution.problem
    motion = _motion(solve(_problem(problem, problem.mechanism, end), _TOLERANCE, _TOLERANCE), t, scales)
    largest = np.zeros(len(t))
    for body in problem.mechanism.bodies:
        changed = _with_more_inertia(problem.mechanism, body)
        try:
            moved = _motion(solve(_problem(problem, changed, end), _TOLERANCE, _TOLERANCE), t, scales)
        except TrebucheckError:
            moved = np.full_like(motion, np.inf)
        distance = np.abs(moved - motion).max(axis=0) / _CHANGE
        largest = np.maximum(largest, distance)
    return t, np.maximum.accumulate(largest)


def _away_from_impacts(solution: Solution, t: FloatArray) -> FloatArray:
    """The times without those at which a slightly earlier or later impact would jump; the ends stay."""
    near = np.zeros(len(t), dtype=bool)
    for impact, _ in solution.impacts:
        near |= np.abs(t - impact) < _NEAR * (t[1] - t[0])
    near[[0, -1]] = False
    return t[~near]


def stretching_at(solution: Solution, end: float) -> float:
    """The stretching up to `end` [s]."""
    return float(stretching(solution, end, scales_until(solution, end))[1][-1])


def predictable_until(t: FloatArray, stretched: FloatArray) -> float:
    """The predictability horizon [s]: the last of the times t up to which the stretching stays below its limit."""
    return float(t[max(1, int(np.searchsorted(stretched, LIMIT, side="right")) - 1)])


def _problem(problem: Problem, mechanism: Mechanism, end: float) -> Problem:
    return Problem(mechanism, duration=end, stop_law=problem.stop_law)


def _with_more_inertia(mechanism: Mechanism, body: Body) -> Mechanism:
    more = body.model_copy(update={"inertia": body.inertia + _CHANGE * body.mass * extent(mechanism, body) ** 2})
    bodies = tuple(more if each.name == body.name else each for each in mechanism.bodies)
    return mechanism.model_copy(update={"bodies": bodies})


def _motion(solution: Solution, t: FloatArray, scales: Scales) -> NDArray[np.complex128]:
    """Everything judged along the motion in parts of its scale, plane vectors as complex numbers; shape (n_rows, n)."""
    mechanism, kinematics, motion = solution.problem.mechanism, solution.equations.kinematics, solution.motion(t)
    rows: list[NDArray[Any]] = []
    for i, body in enumerate(mechanism.bodies):
        centre = kinematics.point(body.name, body.centre)
        rows.append(_plane(kinematics.position(centre, motion.q)) / scales.length)
        rows.append(_plane(kinematics.velocity(centre, motion.q, motion.u)) / scales.speed)
        rows += [motion.q[:, i] / scales.angle, motion.u[:, i] / scales.angular_speed]
    rows += [_plane(force) / scales.force for force in solution.joint_reactions(motion).values()]
    return np.array(rows, dtype=np.complex128)


def _plane(vectors: FloatArray) -> NDArray[np.complex128]:
    return vectors[:, 0] + 1j * vectors[:, 1]
