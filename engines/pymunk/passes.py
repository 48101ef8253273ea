"""How many passes of Chipmunk's impulse solver a step needs, from the constraints' own matrices.

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

    one_pass: FloatArray
    """Q in an orthonormal basis of what impulses can change, shape (r, r)."""
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
        while True:
            power = power @ power
            before, left = left, _norm(power)
            if left <= share:
                # Between two powers the logarithm of what is left is nearly linear in the passes.
                fraction = math.log(share / before) / math.log(max(left, share**2) / before)
                return math.ceil(passes * (1 + min(fraction, 1.0)))
            passes *= 2
            if passes > _FAR:
                return passes

    def slowest(self, passes: int) -> tuple[str, ...]:
        """The two bodies, or the one, that move most in what these passes leave."""
        directions, _, _ = np.linalg.svd(np.linalg.matrix_power(self.one_pass, passes))
        energies = np.sum((self.basis @ directions[:, 0]).reshape(-1, 3) ** 2, axis=1)
        return tuple(self.bodies[k] for k in sorted(np.argsort(energies)[-2:]))


def convergence(assembly: Assembly) -> Convergence:
    """Convergence of an assembly in its present position, with the stops active in it."""
    blocks = [
        block
        for block in map(_Columns(assembly).of, assembly.space.constraints)
        if block is not None
    ]
    columns = np.hstack(blocks) if blocks else np.zeros((3 * len(assembly.bodies), 0))
    basis, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    basis = basis[:, sizes > _DRIFT * sizes.max(initial=0.0)]
    one_pass = basis
    for block in blocks:
        one_pass = one_pass - block @ (block.T @ one_pass)
    return Convergence(basis.T @ one_pass, basis, tuple(assembly.parts))


def growth(left: float) -> float:
    """Factor by which a mode's error grows in a step whose passes leave this share of it."""
    g = 1.0 - left
    step = np.array([[1.0, 1.0, 0.0], [-g, 1.0 - 2.0 * g, 1.0 - g], [-g, -2.0 * g, 1.0 - g]])
    return float(np.abs(np.linalg.eigvals(step)).max())


def _norm(matrix: FloatArray) -> float:
    return float(np.linalg.norm(matrix, 2)) if matrix.size else 0.0


class _Columns:
    """Orthonormal columns that span W^(1/2) J^T of single constraints."""

    def __init__(self, assembly: Assembly) -> None:
        self._first = {body: 3 * k for k, body in enumerate(assembly.bodies)}
        inverse = [[1 / body.mass, 1 / body.mass, 1 / body.moment] for body in assembly.bodies]
        self._roots = np.sqrt(np.array(inverse).ravel())

    def of(self, joint: constraints.Constraint) -> FloatArray | None:
        """None of a spring, which is a force, and of what nothing can move against."""
        a, b = joint.a, joint.b
        match joint:
            case constraints.GearJoint():
                rows = [self._row({a: (0.0, 0.0, -1.0), b: (0.0, 0.0, 1.0)})]
            case constraints.PinJoint():
                arms = _arm(a, joint.anchor_a), _arm(b, joint.anchor_b)
                between = complex(*b.position) + arms[1] - complex(*a.position) - arms[0]
                rows = [self._points(a, b, arms, between / abs(between))]
            case constraints.PivotJoint():
                arms = _arm(a, joint.anchor_a), _arm(b, joint.anchor_b)
                rows = [self._points(a, b, arms, direction) for direction in (1.0 + 0j, 1j)]
            case _:
                return None
        block = np.array(rows).T
        return np.linalg.qr(block)[0] if block.any() else None

    def _points(
        self, a: pymunk.Body, b: pymunk.Body, arms: tuple[complex, complex], along: complex
    ) -> FloatArray:
        moments = [(arm.conjugate() * along).imag for arm in arms]
        return self._row(
            {a: (-along.real, -along.imag, -moments[0]), b: (along.real, along.imag, moments[1])}
        )

    def _row(self, rates: dict[pymunk.Body, tuple[float, float, float]]) -> FloatArray:
        row = np.zeros_like(self._roots)
        for body, rate in rates.items():
            if body in self._first:
                row[self._first[body] : self._first[body] + 3] = rate
        return row * self._roots


def _arm(body: pymunk.Body, anchor: tuple[float, float]) -> complex:
    return complex(*anchor) * cmath.exp(1j * body.angle)
