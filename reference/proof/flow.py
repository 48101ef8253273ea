r"""Derivative of the flow by the state at a step's start, d phi_t / d y, for all motions of a set.

Where the Jacobian of the rates is known to be in a box only, a bound follows (Peano and Baker). As
a Taylor model, J(t) = sum J_k t^k + R t^(p+1), it gives the solution of Phi' = J Phi, Phi(0) = I:

    (k + 1) Phi_(k+1) = sum_i J_i Phi_(k-i),    k <= p,

whose polynomial Phi~ has J Phi~ - Phi~' = D t^(p+1), so that with a bound P of d phi / d y between
any two times of the step

    |Phi - Phi~| <= P |D| t^(p+2) / (p + 2).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ...models.arrays import FloatArray
from .balls import Ball, Matrix, absolute, arb, arb_mat, diagonal, identity, polynomial
from .sets import sums

_TERMS = 14  # of the exponential, at least
_TERMS_PER_NORM = 8
_LARGEST = 100.0  # norm of a step's Jacobian times its length


@dataclass(frozen=True)
class FlowDerivative:
    """A model sum Phi_k t^k + R t^(n+1) over a step, with n + 1 coefficients."""

    coefficients: Sequence[Matrix]
    remainder: Matrix

    def at(self, t: Ball) -> Matrix:
        """Enclose it at the times of a ball, which are within the step."""
        return polynomial(self.coefficients, self.remainder, t)


def flow_derivative(
    jacobian: Sequence[Matrix], powers: Sequence[Ball], bound: Matrix
) -> FlowDerivative:
    """Solve the variational equations over a step.

    Args:
        jacobian: J_0 ... J_p, and R.
        powers: t^0 ... t^(p+1) over the step.
        bound: of the derivative between any two of its times (:func:`flow_bound`).
    """
    *known, rest = jacobian
    n = rest.nrows()
    phi = [identity(n)]
    for k in range(len(known)):
        total = known[k]
        for i in range(k):
            total = total + known[i] * phi[k - i]
        phi.append(total / (k + 1))
    beyond, tail = arb_mat(n, n), arb_mat(n, n)
    for part, power, of in zip([None, *reversed(known)], powers, phi, strict=True):
        if part is not None:
            tail = part + tail * powers[1]
        beyond = beyond + (tail + rest * power) * of
    lacks = absolute(bound) * absolute(beyond) / len(phi)
    wide = arb_mat(n, n, [arb(0, x.upper()) for x in lacks.entries()])
    return FlowDerivative(phi, wide)


def flow_bound(jacobian: Matrix, time: Ball, sizes: FloatArray) -> Matrix:
    """Enclose d phi_t / d y, where the Jacobian of the rates stays in a matrix of balls.

    It is the sum over k of the integrals of products J(t_1) ... J(t_k) over t_1 > ... > t_k, each
    within J^k t^k / k! (Peano and Baker). The terms left out are bounded by a geometric series.

    Args:
        jacobian, time: J and t [s].
        sizes: of the state's parts that are alike (:func:`.sets.alike`), in which norms are taken.
    """
    n = len(sizes)
    stretched, shrunk = diagonal(sizes.tolist()), diagonal((1 / sizes).tolist())
    scaled = shrunk * jacobian * stretched * time
    norm = max(sums(scaled), key=float)
    if not norm < _LARGEST:
        return arb_mat(n, n, [arb.nan()] * (n * n))
    n_terms = max(_TERMS, math.ceil(_TERMS_PER_NORM * float(norm)))
    term = total = identity(n)
    for k in range(1, n_terms + 1):
        term = term * scaled / k
        total = total + term
    left = norm ** (n_terms + 1) / arb.fac_ui(n_terms + 1) / (1 - norm / (n_terms + 2))
    rest = arb_mat(n, n, [arb(0, left.abs_upper())] * (n * n))
    return stretched * (total + rest) * shrunk
