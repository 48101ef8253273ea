r"""Sets of states: parallelepipeds, which follow the flow where boxes would grow by turning.

A set is {c + B s : |s_i| <= r_i}. Over a step the motions from it are

    phi(c + B s) in phi(c) + A B s,        A = d phi / d y over the set's box,

a mean-value form; the orthogonal part of A B is the next basis, whose directions are taken in the
order of their lengths (Lohner, *Computation of guaranteed enclosures for the solutions
of ordinary initial and boundary value problems*, 1992; Nedialkov, Jackson and Corliss, *Validated
solutions of initial value problems for ODEs*, Appl. Math. Comput. 105 (1999) 21). A box grows by
the absolute values of A, which turning alone makes larger than one; a parallelepiped about as the
motions themselves part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...models.arrays import FloatArray
from .balls import Ball, Matrix, arb, arb_mat, identity, precision

BITS = 80
"""Precision of boxes, bases and spreads, which are wide or small."""
_ITERATIONS = 60  # of the Perron vector, which need not be exact
_LEAST_SIZE = 1e-6  # of a part, to the largest


@dataclass(frozen=True)
class StateSet:
    """States c + B s with |s_i| <= r_i: coordinates, then speeds."""

    centre: Sequence[Ball]
    """c, exact."""
    basis: Matrix
    """B."""
    spread: Sequence[Ball]
    """r, not negative."""

    @classmethod
    def of(cls, state: Sequence[Ball]) -> StateSet:
        """Make the set of a box."""
        n = len(state)
        with precision(BITS):
            return cls([x.mid() for x in state], identity(n), [x.rad() for x in state])

    def box(self) -> list[Ball]:
        """The least box around it, in the context's precision."""
        with precision(BITS):
            wide = widths(self.basis, self.spread)
        return [c + arb(0, w) for c, w in zip(self.centre, wide, strict=True)]

    def moved(self, reached: Sequence[Ball], derivative: Matrix, weights: FloatArray) -> StateSet:
        """The set after a step.

        Args:
            reached: where the centre's motion ends.
            derivative: A, by the state at the step's start.
            weights: sizes of the state's parts that are alike, such as a speed's and an angle's.
        """
        with precision(BITS):
            turned = derivative * self.basis
            basis = _orthogonal(turned, self.spread, weights)
            inverse = basis.inv()
            kept = widths(inverse * turned, self.spread)
            added = widths(inverse, [x.rad() for x in reached])
            spread = [(a + b).upper() for a, b in zip(kept, added, strict=True)]
        return StateSet([x.mid() for x in reached], basis, spread)


def widths(matrix: Matrix, spread: Sequence[Ball]) -> list[Ball]:
    """Bounds of the absolute values of M s with |s_i| <= r_i."""
    bounds: list[Ball] = []
    for row in matrix.tolist():
        total: Ball = sum((x.abs_upper() * r for x, r in zip(row, spread, strict=True)), arb(0))
        bounds.append(total.upper())
    return bounds


def alike(jacobian: Matrix) -> FloatArray:
    """Sizes of the state's parts that grow at one rate: the Perron vector of |J|, powers of two.

    In parts of these, directions of coordinates and of speeds are turned into each other; in SI
    units a set's short directions would take up parts of the long ones.
    """
    rates: FloatArray = np.array([[float(x.abs_upper()) for x in row] for row in jacobian.tolist()])
    sizes = np.ones(len(rates))
    if not np.all(np.isfinite(rates)):
        return sizes
    for _ in range(_ITERATIONS):
        sizes = sizes + rates @ sizes
        sizes = sizes / sizes.max()
    return np.exp2(np.round(np.log2(np.maximum(sizes, _LEAST_SIZE))))


def _orthogonal(turned: Matrix, spread: Sequence[Ball], weights: FloatArray) -> Matrix:
    """A basis, orthogonal in the weights, whose first columns span the set's longest directions."""
    largest = max(spread, key=float, default=arb(0))
    lengths = [1.0] * len(spread)
    if largest > 0:
        lengths = [float((r / largest).mid()) for r in spread]
    middle: FloatArray = np.array([[float(x.mid()) for x in row] for row in turned.tolist()])
    columns = middle * np.array(lengths) / weights[:, None]
    if not np.all(np.isfinite(columns)):
        return identity(len(spread))
    order = np.argsort(-np.linalg.norm(columns, axis=0), kind="stable")
    orthogonal, _ = np.linalg.qr(columns[:, order])
    return arb_mat((weights[:, None] * orthogonal).tolist())
