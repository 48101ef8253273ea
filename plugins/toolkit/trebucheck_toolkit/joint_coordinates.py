"""Joint coordinates of trees: each body's slides, and its angle relative to its parent."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import GROUND, AnyJoint, AnyStop, Stop
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.mechanism import Body, Mechanism


@dataclass(frozen=True)
class Freedom:
    """One joint coordinate."""

    joint: AnyJoint
    """The tree's joint that it belongs to."""
    index: int
    """Index of its mechanism coordinate: the slide, or the child's angle."""
    direction: complex | None
    """Direction of a slide in the parent's frame, length 1; None of an angle (clockwise)."""


@dataclass(frozen=True)
class Limit:
    """One end of the range of a joint coordinate."""

    index: int
    """Index of the joint coordinate."""
    sense: int
    """1 for the lower end, -1 for the upper: its torque is along the coordinate times this."""
    value: float
    """[rad]"""

    @staticmethod
    def ranges(limits: Iterable[Limit]) -> dict[int, tuple[float, float]]:
        """Lower and upper end of each joint coordinate that has a limit."""
        found: dict[int, tuple[float, float]] = {}
        for each in limits:
            low, high = found.get(each.index, (-math.inf, math.inf))
            found[each.index] = (
                (max(low, each.value), high) if each.sense > 0 else (low, min(high, each.value))
            )
        return found


@dataclass(frozen=True)
class JointCoordinates:
    """j = D q + d and v = D u, bodies depth first, of each its slides and then its turn.

    A slide is the mechanism's own coordinate; a turn is the child's angle less the parent's,
    whatever it is at the start. Arrays of states are shaped (..., n_q).
    """

    mechanism: Mechanism

    @cached_property
    def links(self) -> tuple[tuple[Body, AnyJoint], ...]:
        """The bodies with their joints in the tree, depth first, so that subtrees are ranges."""
        found, waiting = list[tuple[Body, AnyJoint]](), [*reversed(self.mechanism.children(GROUND))]
        while waiting:
            body = waiting.pop()
            found.append((body, self.mechanism.joint_of(body.name)))
            waiting += reversed(self.mechanism.children(body.name))
        return tuple(found)

    @cached_property
    def freedoms(self) -> tuple[Freedom, ...]:
        """The joint coordinates in order."""
        mechanism, found = self.mechanism, list[Freedom]()
        indices = {name: k for k, name in enumerate(mechanism.coordinates)}
        for body, joint in self.links:
            for name, direction in zip(joint.slides, joint.free_directions, strict=True):
                found.append(Freedom(joint, indices[name], direction))
            if body.angle is not None:
                found.append(Freedom(joint, indices[body.angle], None))
        return tuple(found)

    def limit(self, stop: AnyStop) -> Limit | None:
        """A stop on angles as the end of one joint coordinate's range; None if it is none."""
        for index, freedom in enumerate(self.freedoms):
            between = {freedom.joint.child, freedom.joint.parent}
            if (
                freedom.direction is None
                and isinstance(stop, Stop)
                and between == {stop.body, stop.relative_to}
            ):
                sense = stop.sense if stop.body == freedom.joint.child else -stop.sense
                return Limit(index, sense, sense * stop.limit)
        return None

    @cached_property
    def _differences(self) -> tuple[FloatArray, FloatArray]:
        """D and d."""
        n, kinematics = len(self.freedoms), Kinematics(self.mechanism)
        matrix, constants = np.zeros((n, n)), np.zeros(n)
        for row, freedom in enumerate(self.freedoms):
            if freedom.direction is None:
                angle = kinematics.angle(freedom.joint.child, freedom.joint.parent)
                matrix[row], constants[row] = angle.coefficients, angle.constant
            else:
                matrix[row, freedom.index] = 1.0
        return matrix, constants

    @property
    def offsets(self) -> FloatArray:
        """Constants d of j = D q + d."""
        return self._differences[1]

    @cached_property
    def sums(self) -> FloatArray:
        """C, the inverse of D: u = C v."""
        return np.asarray(np.rint(np.linalg.inv(self._differences[0])), dtype=np.float64)

    def positions(self, q: FloatArray) -> FloatArray:
        """Joint coordinates j of the mechanism's q."""
        matrix, constants = self._differences
        return q @ matrix.T + constants

    def speeds(self, u: FloatArray) -> FloatArray:
        """Joint speeds v of the mechanism's u."""
        return u @ self._differences[0].T

    def forces(self, generalized: FloatArray) -> FloatArray:
        """Joint forces (slides) and torques (turns, clockwise) of generalized forces on q."""
        return generalized @ self.sums

    def mass_matrix(self, matrix: FloatArray) -> FloatArray:
        """Mass matrix of q from that of j."""
        differences = self._differences[0]
        return differences.T @ matrix @ differences

    def mechanism_positions(self, j: FloatArray) -> FloatArray:
        """The mechanism's q of joint coordinates."""
        return (j - self._differences[1]) @ self.sums.T

    def mechanism_speeds(self, v: FloatArray) -> FloatArray:
        """The mechanism's u of joint speeds, and accelerations of joint accelerations."""
        return v @ self.sums.T
