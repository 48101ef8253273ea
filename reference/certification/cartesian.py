r"""Vectors between points of bodies, angles between bodies and forces on them, in three coordinates a body.

A state is x = (centre x, centre y, angle) body by body and its rate v, each of shape (3 n_bodies,).
With the arm r of a point from its body's centre, turned clockwise by the angle, the vector from a
point to another one is d = c_1 + r_1 - c_0 - r_0, and a function e . d of it has the derivatives

    d(e . d)/dt   = e . (v_1 + w_1 r_1' - v_0 - w_0 r_0')  [+ w_0 e' . d]
    d2(e . d)/dt2 = the same of accelerations  - e . (w_1^2 r_1 - w_0^2 r_0)  [+ 2 w_0 e' . dd/dt -
    w_0^2 e . d],

where r' is r turned by a right angle clockwise; what stands in brackets is there if e turns with
the second body.

Nothing here uses :mod:`...models.kinematics` or :mod:`...models.applied_forces`, on purpose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...models.arrays import FloatArray
from ...models.force_elements import (
    ConstantForce,
    ConstantTorque,
    RotationalSpringDamper,
    SpringDamper,
)
from ...models.joints import GROUND
from ...models.mechanism import Mechanism
from ...models.spec import Vector

BodyPoint = tuple[str, Vector]
"""A body (or the ground) and a point in its frame [m]."""


_CLOCKWISE = np.array([1.0, -1.0])


def right_angle(vectors: FloatArray) -> FloatArray:
    """Vectors (..., 2) turned by a right angle clockwise: the derivative of a clockwise turn."""
    return vectors[..., ::-1] * _CLOCKWISE


def turned(vectors: FloatArray, angles: FloatArray | float) -> FloatArray:
    """Vectors (..., 2) turned clockwise by angles (...) [rad]."""
    return vectors * np.cos(angles)[..., None] + right_angle(vectors) * np.sin(angles)[..., None]


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    products = a * b
    return products[..., 0] + products[..., 1]


@dataclass(frozen=True)
class _Ends:
    """Both ends of m vectors, the one they lead to first: arrays (m, 2, 2), angular speeds (m, 2)."""

    centres: FloatArray
    arms: FloatArray
    speeds: FloatArray
    """Of the centres."""
    spins: FloatArray

    @property
    def places(self) -> FloatArray:
        """Of the points, shape (m, 2, 2) [m]."""
        return self.centres + self.arms

    @property
    def vectors(self) -> FloatArray:
        """Shape (m, 2) [m]."""
        places = self.places
        return places[:, 0] - places[:, 1]

    @property
    def rates(self) -> FloatArray:
        """Of the vectors, shape (m, 2) [m/s]."""
        speeds = self.speeds + self.spins[..., None] * right_angle(self.arms)
        return speeds[:, 0] - speeds[:, 1]


class Vectors:
    """Vectors to points of bodies from points of others."""

    def __init__(self, mechanism: Mechanism, ends: Sequence[tuple[BodyPoint, BodyPoint]]) -> None:
        self._n = 3 * len(mechanism.bodies)
        indices = {body.name: i for i, body in enumerate(mechanism.bodies)} | {
            GROUND: len(mechanism.bodies)
        }
        centres = {body.name: body.centre for body in mechanism.bodies} | {GROUND: (0.0, 0.0)}
        bodies = np.array(
            [[indices[body] for body, _ in pair] for pair in ends], dtype=int
        ).reshape(-1, 2)
        offsets = [[np.subtract(point, centres[body]) for body, point in pair] for pair in ends]
        self._offsets = np.array(offsets, dtype=np.float64).reshape(-1, 2, 2)
        self._columns = 3 * bodies[..., None] + np.arange(3)
        self._number = np.arange(len(bodies))[:, None]

    def __len__(self) -> int:
        return len(self._columns)

    def ends(self, x: FloatArray, v: FloatArray) -> _Ends:
        """Both ends of each."""
        states = np.zeros((2, self._n + 3))  # the ground is the last body
        states[0, : self._n], states[1, : self._n] = x, v
        at, moving = states[:, self._columns]
        return _Ends(
            at[..., :2], turned(self._offsets, at[..., 2]), moving[..., :2], moving[..., 2]
        )

    def rows(self, ends: _Ends, along: FloatArray, turning: FloatArray | None = None) -> FloatArray:
        """Gradients of components along directions (m, 2), shape (m, 3 n_bodies).

        Args:
            turning: which of the directions turn with the second body, shape (m,); none if left
                out.
        """
        rows, moments = (
            np.zeros((len(self), self._n + 3)),
            _dot(along[:, None], right_angle(ends.arms)),
        )
        rows[self._number, self._columns[:, 0, :2]] = along
        rows[self._number[:, 0], self._columns[:, 0, 2]] = moments[:, 0]
        rows[self._number, self._columns[:, 1, :2]] -= along
        if turning is not None:
            moments[:, 1] -= np.where(turning, _dot(right_angle(along), ends.vectors), 0.0)
        rows[self._number[:, 0], self._columns[:, 1, 2]] -= moments[:, 1]
        return rows[:, : self._n]


class Components(Vectors):
    """Components of vectors along directions of the ground, or of the body that they start from."""

    def __init__(
        self,
        mechanism: Mechanism,
        ends: Sequence[tuple[BodyPoint, BodyPoint]],
        directions: Sequence[complex],
        turning: Sequence[bool],
    ) -> None:
        super().__init__(mechanism, ends)
        self._directions = np.array(
            [(d.real, d.imag) for d in directions], dtype=np.float64
        ).reshape(-1, 2)
        self._turning = np.array(turning, dtype=bool) if any(turning) else None

    def along(self, x: FloatArray) -> FloatArray:
        """The directions in the world, shape (m, 2)."""
        if self._turning is None:
            return self._directions
        angles = np.append(x, np.zeros(3))[self._columns[:, 1, 2]]
        return turned(self._directions, np.where(self._turning, angles, 0.0))

    def values(self, x: FloatArray) -> FloatArray:
        """Shape (m,) [m]."""
        projected = _dot(self.along(x)[:, None], self.ends(x, x).places)
        return projected[:, 0] - projected[:, 1]

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Shape (m, 3 n_bodies)."""
        return self.rows(self.ends(x, x), self.along(x), self._turning)

    def derivatives(self, x: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The Jacobian, and minus the second derivatives without accelerations, shape (m,) [m/s^2]."""
        ends, along = self.ends(x, v), self.along(x)
        centripetal = _dot(along[:, None], ends.arms) * ends.spins**2
        inward = centripetal[:, 0] - centripetal[:, 1]
        if self._turning is not None:
            spin = np.where(self._turning, ends.spins[:, 1], 0.0)
            inward += spin**2 * _dot(along, ends.vectors) - 2 * spin * _dot(
                right_angle(along), ends.rates
            )
        return self.rows(ends, along, self._turning), inward


def angle_rows(mechanism: Mechanism, pairs: Sequence[tuple[str, str]]) -> FloatArray:
    """Gradients of bodies' angles less those of others, shape (m, 3 n_bodies)."""
    index = {body.name: 3 * i + 2 for i, body in enumerate(mechanism.bodies)}
    rows = np.zeros((len(pairs), 3 * len(mechanism.bodies)))
    for row, (body, other) in zip(rows, pairs, strict=True):
        for name, sign in ((body, 1.0), (other, -1.0)):
            if name != GROUND:
                row[index[name]] += sign
    return rows


class AppliedCartesian:
    """Weights and the forces of springs, dampers and motors on three coordinates a body."""

    def __init__(self, mechanism: Mechanism) -> None:
        elements = mechanism.force_elements
        self._weight = np.ravel(
            [(*np.multiply(body.mass, mechanism.gravity_vector), 0.0) for body in mechanism.bodies]
        )
        springs = [e for e in elements if isinstance(e, SpringDamper)]
        twists = [e for e in elements if isinstance(e, RotationalSpringDamper)]
        motors = [e for e in elements if isinstance(e, ConstantTorque)]
        forces = [e for e in elements if isinstance(e, ConstantForce)]
        self._any = bool(elements)
        self._springs = Vectors(
            mechanism, [((e.body, e.point), (e.relative_to, e.relative_point)) for e in springs]
        )
        self._spring_data = _columns([(e.stiffness, e.damping, e.rest_length) for e in springs])
        self._twists = angle_rows(mechanism, [(e.body, e.relative_to) for e in twists])
        self._twist_data = _columns([(e.stiffness, e.damping, e.rest_angle) for e in twists])
        self._torque = np.array([e.torque for e in motors]) @ angle_rows(
            mechanism, [(e.body, e.relative_to) for e in motors]
        )
        self._pulled = Vectors(
            mechanism, [((e.body, e.point), (GROUND, (0.0, 0.0))) for e in forces]
        )
        self._pulls = np.array([e.force for e in forces], dtype=np.float64).reshape(-1, 2)

    def generalized(self, x: FloatArray, v: FloatArray) -> FloatArray:
        """Forces and torques on all coordinates, shape (3 n_bodies,) [N, N m]."""
        if not self._any:
            return self._weight
        pulls = self._pulled.rows(self._pulled.ends(x, v), self._pulls).sum(axis=0)
        stiffness, damping, rest = self._twist_data
        twisting = (
            -(stiffness * (self._twists @ x - rest) + damping * (self._twists @ v)) @ self._twists
        )
        return self._weight + pulls + self._torque + twisting + self._of_springs(x, v)

    def _of_springs(self, x: FloatArray, v: FloatArray) -> FloatArray:
        stiffness, damping, rest = self._spring_data
        ends = self._springs.ends(x, v)
        lengths = np.hypot(ends.vectors[:, 0], ends.vectors[:, 1])
        along = ends.vectors / np.where(lengths > 0, lengths, 1.0)[:, None]
        tension = stiffness * (lengths - rest) + damping * _dot(along, ends.rates)
        return -tension @ self._springs.rows(ends, along)

    def potential_energy(self, x: FloatArray) -> float:
        """Of gravity, zero at the world's origin, and of the springs [J]."""
        energy = -float(self._weight @ x)
        if self._any:
            stiffness, _, rest = self._spring_data
            vectors = self._springs.ends(x, x).vectors
            energy += float(stiffness @ (np.hypot(vectors[:, 0], vectors[:, 1]) - rest) ** 2) / 2
            stiffness, _, rest = self._twist_data
            energy += float(stiffness @ (self._twists @ x - rest) ** 2) / 2
        return energy


def _columns(rows: Sequence[tuple[float, ...]]) -> FloatArray:
    return np.array(rows, dtype=np.float64).reshape(-1, 3).T
