r"""Sets of states: zonotopes, which follow the flow where boxes would grow by turning.

A set is {c + G s : |s_i| <= 1}. Over a step the motions from it are

    phi(c + G s) in phi(c) + A G s,        A = d phi / d y over the set's box,

a mean-value form. The middle of A G is the next G; what its radii and those of phi(c) add is a box,
with columns of its own. Once there are too many columns, the shortest are enclosed in a
parallelepiped of n columns whose directions are those of a QR decomposition, taken in the order of
the columns' lengths (Kuehn, *Rigorously computed orbits of dynamical systems without the wrapping
effect*, Computing 61 (1998) 47; Lohner, *Computation of guaranteed enclosures for the solutions of
ordinary initial and boundary value problems*, 1992). A box grows by the absolute values of A, which
turning alone makes larger than one; such a set about as the motions themselves part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...models.arrays import FloatArray
from .balls import Ball, Matrix, arb, arb_mat, diagonal, precision

BITS = 80
"""Precision of boxes, bases and spreads, which are wide or small."""
_MOST_COLUMNS = 8  # of generators, for each part of the state
_ITERATIONS = 60  # of the Perron vector, which need not be exact
_LEAST_SIZE = 1e-6  # of a part, to the largest


@dataclass(frozen=True)
class StateSet:
    """States c + G s with |s_i| <= 1: coordinates, then speeds."""

    centre: Sequence[Ball]
    """c, exact."""
    generators: Matrix
    """G."""

    @classmethod
    def of(cls, state: Sequence[Ball]) -> StateSet:
        """Make the set of a box."""
        with precision(BITS):
            return cls([x.mid() for x in state], diagonal([x.rad() for x in state]))

    def box(self) -> list[Ball]:
        """The least box around it, in the context's precision."""
        with precision(BITS):
            wide = sums(self.generators)
        return [c + arb(0, w) for c, w in zip(self.centre, wide, strict=True)]

    def apart(self, derivative: Matrix) -> list[Ball]:
        """Bounds of how far a function is from that of c, with its derivative by the state."""
        return sums(derivative * self.generators)

    def moved(self, reached: Sequence[Ball], derivative: Matrix, weights: FloatArray) -> StateSet:
        """The set after a step.

        Args:
            reached: where the centre's motion ends.
            derivative: A, by the state at the step's start.
            weights: sizes of the state's parts that are alike, such as a speed's and an angle's.
        """
        with precision(BITS):
            turned = derivative * self.generators
            rounding = sums(turned - turned.mid())
            added = [(r + x.rad()).upper() for r, x in zip(rounding, reached, strict=True)]
            generators = _beside(turned.mid(), diagonal(added))
            if generators.ncols() > _MOST_COLUMNS * len(added):
                generators = _reduced(generators, weights)
        return StateSet([x.mid() for x in reached], generators)


def sums(matrix: Matrix) -> list[Ball]:
    """Bounds of the absolute values of M s with |s_i| <= 1."""
    return widths(matrix, [arb(1)] * matrix.ncols())


def widths(matrix: Matrix, spread: Sequence[Ball]) -> list[Ball]:
    """Bounds of the absolute values of M s with |s_i| <= r_i."""
    bounds: list[Ball] = []
    for row in matrix.tolist():
        total: Ball = sum((x.abs_upper() * r for x, r in zip(row, spread, strict=True)), arb(0))
        bounds.append(total.upper())
    return bounds


def _reduced(generators: Matrix, weights: FloatArray) -> Matrix:
    """Generators of a set that contains another's, the shortest of whose columns are enclosed."""
    n = len(weights)
    scaled = _middles(generators) / weights[:, None]
    longest_first = np.argsort(-np.linalg.norm(scaled, axis=0), kind="stable")
    kept, short = np.split(longest_first, [(_MOST_COLUMNS - 1) * n])
    columns = generators.transpose().tolist()
    left = arb_mat([columns[k] for k in short]).transpose()
    orthogonal, _ = np.linalg.qr(scaled[:, short])
    basis = arb_mat((weights[:, None] * orthogonal).tolist())
    box = basis * diagonal(sums(basis.inv() * left))
    return _beside(arb_mat([columns[k] for k in kept]).transpose(), box)


def _middles(matrix: Matrix) -> FloatArray:
    """Middles in parts of the largest, which may be too small for doubles."""
    largest = max(sums(matrix), key=float)
    if not largest > 0:
        return np.zeros((matrix.nrows(), matrix.ncols()))
    return np.array([[float((x / largest).mid()) for x in row] for row in matrix.tolist()])


def _beside(first: Matrix, second: Matrix) -> Matrix:
    """The columns of both."""
    rows = zip(first.tolist(), second.tolist(), strict=True)
    return arb_mat([[*one, *other] for one, other in rows])


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
