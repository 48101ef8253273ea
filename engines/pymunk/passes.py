"""Number of passes of Chipmunk's impulse solver a step needs, from the constraints' matrices.

A pass of projected Gauss-Seidel solves one constraint after the other. In velocities weighted by
the roots of the masses, with the columns B_i of W^(1/2) J_i^T, that is an orthogonal projection for
each: a pass leaves Q v of an error v of the velocities, with Q = (1 - P_m) ... (1 - P_1) and P_i
the projection on the span of B_i. The impulses can make errors within the span of all B_i only;
there the norm of Q^n is the share that n passes leave, in terms of kinetic energy. Constraints that
are nearly parallel leave nearly all of it.

What is left decides on more than accuracy. A step undoes the error C of the positions, and starts
with the impulses of the last one, so that it finds the share g = 1 - |Q^n| of what their sum should
be changed by. For one slow mode with x = C / h, the speed y along the constraint, and the speed z
that the impulse makes in a step:

    x' = x + y,    z' = (1 - g) z - g (x' + y),    y' = y + z'

which grows for each g < 1/2: for small g by exp(g^(1/3) / 2) in a step. What passes do not see,
because it is too slow to change anything in them, thus comes up from rounding errors.

Of redundant constraints the span of the B_i is less than their number; directions within it that
only the drift of joints makes are left out, for they grow too slowly to be seen.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np
import pymunk
from pymunk import constraints

from ...models.arrays import FloatArray
from .bodies import Assembly

TRACKED = 1e-3  # of the change of the impulses in a step: error that is let be
MOST_PASSES = 20_000  # in a step of loops that need more than the option says
_FAR = 2**22
_DRIFT = 1e-7  # of the largest singular value: drift (1e-8 m) of redundant joints makes less


@dataclass(frozen=True)
class Convergence:
    """Share of a velocity error that passes of the impulse solver leave in one position."""

    one_pass: FloatArray  # Q in an orthonormal basis of what impulses can change, shape (r, r)
    basis: FloatArray
    """Columns of that basis: (x, y, angle) speeds times roots of mass, (3 n_bodies, r)."""
    bodies: tuple[str, ...]

    def left_after(self, passes: int) -> float:
        """Share of an error that is left at most."""
        return _norm(np.linalg.matrix_power(self.one_pass, passes))

    def passes_to(self, share: float) -> int:
        """Passes that leave at most this share of an error, exact up to `_FAR` of them."""
        power, passes, left = self.one_pass, 1, _norm(self.one_pass)
        if left <= share:
            return 1
        while passes <= _FAR:
            power = power @ power
            before, left = left, _norm(power)
            if left <= share:
                # Between two powers the logarithm of what is left is nearly linear in the passes.
                fraction = math.log(share / before) / math.log(max(left, share**2) / before)
                return math.ceil(passes * (1 + min(fraction, 1.0)))
            passes *= 2
        return passes

    def slowest(self, passes: int) -> tuple[str, ...]:
        """The two bodies, or the one, that move most in what these passes leave."""
        directions, _, _ = np.linalg.svd(np.linalg.matrix_power(self.one_pass, passes))
        energies = np.sum((self.basis @ directions[:, 0]).reshape(-1, 3) ** 2, axis=1)
        return tuple(self.bodies[k] for k in sorted(np.argsort(energies)[-2:]))


def convergence(assembly: Assembly) -> Convergence:
    """Convergence of an assembly in its present position, with the stops active in it."""
    first = {body: 3 * k for k, body in enumerate(assembly.bodies)}
    inverse = [[1 / body.mass, 1 / body.mass, 1 / body.moment] for body in assembly.bodies]
    roots = np.sqrt(np.array(inverse).ravel())
    # Orthonormal columns that span W^(1/2) J^T of each constraint that anything can move against.
    blocks: list[FloatArray] = []
    for joint in assembly.space.constraints:
        rows: list[FloatArray] = []
        for rates in _rates(joint):
            row = np.zeros_like(roots)
            for body, rate in rates.items():
                if body in first:
                    row[first[body] : first[body] + 3] = rate
            rows.append(row * roots)
        block = np.array(rows).T
        if block.any():
            blocks.append(np.linalg.qr(block)[0])
    columns = np.hstack(blocks) if blocks else np.zeros((len(roots), 0))
    basis, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    basis = basis[:, sizes > _DRIFT * sizes.max(initial=0.0)]
    one_pass = basis
    for block in blocks:
        one_pass = one_pass - block @ (block.T @ one_pass)
    return Convergence(basis.T @ one_pass, basis, tuple(assembly.parts))


_Rates = dict[pymunk.Body, tuple[float, float, float]]
"""Derivatives of a constraint's error by x, y and angle of the bodies."""


def _rates(joint: constraints.Constraint) -> list[_Rates]:
    """Rows of J, by bodies; none of a spring, which is a force."""
    a, b = joint.a, joint.b
    match joint:
        case constraints.GearJoint():
            return [{a: (0.0, 0.0, -1.0), b: (0.0, 0.0, joint.ratio)}]
        case constraints.PinJoint() | constraints.PivotJoint():
            arm_a, arm_b = (
                complex(*anchor) * cmath.exp(1j * body.angle)
                for body, anchor in ((a, joint.anchor_a), (b, joint.anchor_b))
            )
            directions = [1.0 + 0j, 1j]
            if not isinstance(joint, constraints.PivotJoint):
                between = complex(*b.position) + arm_b - complex(*a.position) - arm_a
                directions = [between / abs(between)]
            rows: list[_Rates] = []
            for along in directions:
                moment_a, moment_b = ((arm.conjugate() * along).imag for arm in (arm_a, arm_b))
                x, y = along.real, along.imag
                rows.append({a: (-x, -y, -moment_a), b: (x, y, moment_b)})
            return rows
        case _:
            return []


def growth(left: float) -> float:
    """Factor by which a mode's error grows in a step whose passes leave this share of it."""
    # Factors k of the recurrence above are the roots of (1 - g) (k - 1)^3 + g k^3 = 0.
    a, b = left ** (1 / 3), (1.0 - min(left, 1.0)) ** (1 / 3)
    return a / math.sqrt(a * a - a * b + b * b)


def _norm(matrix: FloatArray) -> float:
    return float(np.linalg.norm(matrix, 2)) if matrix.size else 0.0
