"""Loops whose constraints depend on each other: in a position that a run comes near, or always.

Two errors of the trapezoidal rule of index 2 grow without bounds there, with 1/s or 1/s^2 for the
constraints' least singular value s:

* The rule carries an error of the accelerations along the constraints on without damping, with the
  other sign after every step (its stability function is -1 at infinity); in the multipliers it is
  that error over s. Steps beside a singular position, where multipliers have poles, make it of any
  size. Accelerations and multipliers that follow from the state are free of it: behind such a
  position a run begins anew whenever s has doubled.
* Constraints hold speeds, and positions drift by d = O(h^2). A drifted loop has no singular
  position: its branches are those of a hyperbola, at a distance of sqrt(d) = O(h) from where they
  should cross, however short the step is. So the drift is taken away a few steps before the
  position. It is not taken away elsewhere: the rule's drift follows the accelerations and vanishes
  again with them, and what a projection takes away of a part of it does not.

Where constraints depend on each other in every position, those that follow from others are not
built (:func:`implied_angles`): they contradict the others by the drift of the positions, and
Newton's iteration does not get below that.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ...models.arrays import FloatArray
from ...models.elements import AnyJoint
from ...models.kinematics import Kinematics, initial_state
from ...models.mechanism import Mechanism
from ..events import Contacts

DEPENDENT = 1e-6
"""Singular value of a Jacobian, over its largest, below which constraints are dependent."""
_GROWN = 2.0  # times: so much the least singular value grows until a run begins anew
# Steps to a singular position, between which the drift is taken away.
_FARTHEST, _NEAREST = 256.0, 4.0
_VANISHED = 0.1  # of the present singular value: what falls below that at this rate vanishes
_AHEAD = 0.25  # of the steps to a singular position at the present rate, until the next look
_LONGEST = 32  # steps without a look
_CORRECTIONS = 3


class LoopConstraints:
    """Closures of the loops and gaps of active stops."""

    def __init__(self, kinematics: Kinematics, active: Contacts) -> None:
        self.kinematics, self.active = kinematics, active

    def jacobian(self, q: FloatArray) -> FloatArray:
        """Shape (n, n_q)."""
        stops = [self.kinematics.gap_jacobian(name, q)[None] for name in self.active]
        return np.concatenate([self.kinematics.loop_jacobian(q), *stops])

    def residual(self, q: FloatArray) -> FloatArray:
        """[m, rad], shape (n,)."""
        return np.array(
            [
                *self.kinematics.loop_residual(q),
                *(self.kinematics.gap(name, q) for name in self.active),
            ]
        )

    def projected(self, q: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The nearest coordinates and speeds without drift."""
        for _ in range(_CORRECTIONS):
            q = q - np.linalg.pinv(self.jacobian(q), rcond=DEPENDENT) @ self.residual(q)
        rows = self.jacobian(q)
        return q, u - np.linalg.pinv(rows, rcond=DEPENDENT) @ (rows @ u)


class Conditioning:
    """Watches the least singular value of constraints from step to step."""

    def __init__(self, constraints: LoopConstraints) -> None:
        self.constraints = constraints
        self.is_due = False
        """Whether the run should begin anew at the end of the step that was looked at last."""
        self.has_neared = False
        """Whether that is so because a singular position is ahead, and then without drift."""
        self._jacobian, self._rank = np.zeros((0, 0)), 0
        self._value = self._least = self._ahead = np.inf
        self._since, self._wait = 0, 1

    def begin(self, q: FloatArray) -> None:
        """Where a run begins, shape (n_q,)."""
        self._jacobian = self.constraints.jacobian(q)
        values = _singular_values(self._jacobian)
        self._rank = self._rank or int(np.sum(values > DEPENDENT * values[0]))
        self._value = self._least = float(values[self._rank - 1])
        self._since, self._wait, self.is_due = 0, 1, False

    def look(self, coordinates: Callable[[], FloatArray]) -> bool:
        """Note one more step; whether the run should begin anew at its end (seldom computed)."""
        self._since += 1
        if self._since < self._wait:
            return False
        jacobian = self.constraints.jacobian(coordinates())
        change, value = (jacobian - self._jacobian) / self._since, self._least_of(jacobian)
        fall = (self._value - value) / self._since
        self._value, self._least, self._jacobian = value, min(self._least, value), jacobian
        rate = float(np.linalg.norm(change, 2))  # no singular value changes faster
        self._since = 0
        self._wait = int(np.clip(_AHEAD * value / rate if rate else np.inf, 1, _LONGEST))
        self.has_neared = self._nears(value / fall, change) if fall > 0 else False
        left = value > _GROWN * self._least
        self._ahead = np.inf if left else self._ahead
        self.is_due = self.has_neared or left
        return self.is_due

    def steps_ahead(self, q: FloatArray) -> float:
        """Number of steps from the last of some equal ones to the next singular position.

        Args:
            q: coordinates at the end of each step, shape (n, n_q).
        """
        if len(q) < 2:
            return math.inf
        before, value = (self._least_of(self.constraints.jacobian(each)) for each in q[-2:])
        return value / (before - value) if value < before else math.inf

    def _nears(self, ahead: float, change: FloatArray) -> bool:
        """Whether a singular position is near, for the first time or at half the last distance."""
        if not _NEAREST < ahead < min(_FARTHEST, self._ahead / 2):
            return False
        if self._least_of(self._jacobian + ahead * change) > _VANISHED * self._value:
            return False
        self._ahead = ahead
        return True

    def _least_of(self, jacobian: FloatArray) -> float:
        return float(_singular_values(jacobian)[self._rank - 1])


def _singular_values(jacobian: FloatArray) -> FloatArray:
    values: FloatArray = np.linalg.svd(jacobian, compute_uv=False).astype(np.float64)
    return values


_AWAY = 0.1  # [rad, m] of positions beside the start, which may itself be singular
_WELL_HELD = 1e-3  # of the largest singular value: the least one of the conditions that are left
_FOLLOWS = 1e-9  # of a row: what others leave of it


def implied_angles(mechanism: Mechanism) -> frozenset[str]:
    """Loop joints whose held angle follows from the other conditions.

    The bodies of such a joint do not move relative to each other in any position. The forces
    of the joints between them, which are not unique, are those without the torque of that joint.
    None is left out where the loops hold the gap of a closed stop: which of all these is redundant
    is then decided by the forces.
    """
    kinematics = Kinematics(mechanism)
    if not any(joint.turned_by is not None for joint in mechanism.loop_joints):
        return frozenset()
    positions, left_out = _positions(kinematics), set[str]()
    if any(
        _holds(kinematics.loop_jacobian(q), kinematics.gap_jacobian(stop.name, q)[None])
        for stop in mechanism.stops
        for q in positions
        if stop.closed
    ):
        return frozenset()
    for joint in reversed(mechanism.loop_joints):
        candidates = left_out | {joint.name}
        if joint.turned_by is not None and all(
            _is_implied(kinematics, q, joint, candidates) for q in positions
        ):
            left_out = candidates
    return frozenset(left_out)


def built_rows(
    kinematics: Kinematics, q: FloatArray, left_out: frozenset[str] | set[str]
) -> FloatArray:
    """Jacobian of the loops' conditions but for the angles of some joints, shape (n, n_q)."""
    keep: list[bool] = []
    for joint in kinematics.mechanism.loop_joints:
        keep += [True] * len(joint.held_directions)
        keep += [joint.name not in left_out] * (joint.turned_by is not None)
    return kinematics.loop_jacobian(q)[np.array(keep, dtype=bool)]


def _positions(kinematics: Kinematics) -> list[FloatArray]:
    """The start, and positions to both sides of it in which loops are closed."""
    q, u = initial_state(kinematics.mechanism)
    rows = kinematics.loop_jacobian(q)
    away = np.cos(np.arange(len(q)))
    away -= np.linalg.pinv(rows, rcond=DEPENDENT) @ (rows @ away)
    constraints = LoopConstraints(kinematics, ())
    return [q, *(constraints.projected(q + sign * _AWAY * away, u)[0] for sign in (1, -1))]


def _is_implied(kinematics: Kinematics, q: FloatArray, joint: AnyJoint, left_out: set[str]) -> bool:
    """Whether the child does not move relative to the parent although its angle is not held."""
    rows = built_rows(kinematics, q, left_out)
    values = np.linalg.svd(rows, compute_uv=False)
    held = values[values > DEPENDENT * values[0]]
    return bool(held.min(initial=np.inf) > _WELL_HELD * values[0]) and _holds(
        rows, _relative_motion(kinematics, q, joint)
    )


def _holds(rows: FloatArray, moved: FloatArray) -> bool:
    """Whether conditions of Jacobian `rows` hold quantities of Jacobian `moved` constant."""
    rest = moved - moved @ np.linalg.pinv(rows, rcond=DEPENDENT) @ rows
    return bool(np.abs(rest).max() <= _FOLLOWS * np.abs(moved).max())


def _relative_motion(kinematics: Kinematics, q: FloatArray, joint: AnyJoint) -> FloatArray:
    """Jacobian of a joint's relative angle and of its child's point in the parent, (3, n_q)."""
    rates = kinematics.rates(q)
    vector = kinematics.between(joint.child, joint.child_point, joint.parent, joint.parent_point)
    along = [
        kinematics.component(axis, joint.parent, vector).jacobian(q, rates)
        for axis in (1.0 + 0.0j, 1.0j)
    ]
    return np.stack([kinematics.angle(joint.child, joint.parent).coefficients, *along])
