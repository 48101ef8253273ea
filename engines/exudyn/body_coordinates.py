"""Exudyn's coordinates z of the bodies (x, y, rotation by body) as functions of the mechanism's coordinates q."""

from __future__ import annotations

import numpy as np

from ...models.arrays import FloatArray
from ...models.kinematics import Kinematics


class BodyCoordinates:
    """z(q) and its Jacobian: centres of mass, and rotations that are positive anticlockwise."""

    def __init__(self, kinematics: Kinematics) -> None:
        bodies = kinematics.mechanism.bodies
        self.kinematics = kinematics
        self.rows = [kinematics.point(body.name, body.centre) for body in bodies]
        self.angles = [kinematics.angle(body.name) for body in bodies]

    def placed(self, q: FloatArray) -> FloatArray:
        """z(q), shape (3 n_bodies,)."""
        centres = [self.kinematics.position(row, q) for row in self.rows]
        return np.concatenate(
            [[*at, -angle.value(q)] for at, angle in zip(centres, self.angles, strict=True)]
        )

    def jacobian(self, q: FloatArray) -> FloatArray:
        """J = dz/dq, shape (3 n_bodies, n_q)."""
        rates = self.kinematics.rates(q)
        moved = [self.kinematics.gradient(row.coefficients, q, rates) for row in self.rows]
        turns = [-angle.coefficients for angle in self.angles]
        return np.concatenate(
            [[point.real, point.imag, turn] for point, turn in zip(moved, turns, strict=True)]
        )
