r"""Sparse linear algebra of expressions: None stands for what is zero by structure.

The matrix is that of :mod:`.system`: positive definite among the accelerations, and after their
elimination negative definite among the multipliers. So accelerations may be eliminated in any
order, and a multiplier as soon as all accelerations of its constraint are: what is left on its
diagonal is -G M^-1 G^T of those, which is not zero.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

_WORTH = 0.75  # of the usual order's products: an order that saves less is not worth a change

Matrix = dict[tuple[int, int], Any]
"""Both triangles of a symmetric matrix; what is zero by structure is absent."""
Pair = tuple[Any, Any]
"""Re and Im of a complex expression."""


def put(matrix: Matrix, i: int, j: int, value: Any) -> None:
    """Enter a value and its mirror image, unless it is zero by structure."""
    if value is not None:
        matrix[i, j] = matrix[j, i] = value


def times(x: Any, y: Any) -> Any:
    """The product."""
    return None if x is None or y is None else x * y


def minus(x: Any) -> Any:
    """The negative."""
    return None if x is None else -x


def total(terms: Iterable[Any]) -> Any:
    """The sum; None if all terms are."""
    kept = [term for term in terms if term is not None]
    return sum(kept[1:], kept[0]) if kept else None


def multiplied(x: Pair, y: Pair) -> Pair:
    """The complex product."""
    return (
        total([times(x[0], y[0]), minus(times(x[1], y[1]))]),
        total([times(x[0], y[1]), times(x[1], y[0])]),
    )


def combined(terms: Iterable[tuple[Any, Pair]]) -> Pair:
    """The sum of complex expressions times real factors."""
    kept = list(terms)
    return total(times(f, pair[0]) for f, pair in kept), total(
        times(f, pair[1]) for f, pair in kept
    )


def elimination(
    keys: Iterable[tuple[int, int]], n_free: int, usual: Sequence[int]
) -> tuple[list[int], int]:
    """An order of elimination with little fill-in, and the number of products that it takes.

    Least degree first, of what may be eliminated; the usual order where that is not clearly better.

    Args:
        keys: the matrix's entries that are not zero by structure.
        n_free: number of accelerations, the first of the unknowns.
        usual: another valid order.
    """
    neighbours: dict[int, set[int]] = {i: set() for i in usual}
    for i, j in keys:
        if i != j:
            neighbours[i].add(j)
    waits = {i: {j for j in neighbours[i] if j < n_free} for i in usual if i >= n_free}
    least = _least_degree(neighbours, waits, usual)
    usual_cost, least_cost = _products(neighbours, usual), _products(neighbours, least)
    return (least, least_cost) if least_cost < _WORTH * usual_cost else (list(usual), usual_cost)


def _least_degree(
    neighbours: Mapping[int, set[int]], waits: Mapping[int, set[int]], usual: Sequence[int]
) -> list[int]:
    left, order = {i: set(found) for i, found in neighbours.items()}, list[int]()
    while left:
        ready = [i for i in usual if i in left and not waits.get(i, set()) & left.keys()]
        k = min(ready, key=lambda i: len(left[i]))
        order.append(k)
        _eliminate(left, k)
    return order


def _eliminate(left: dict[int, set[int]], k: int) -> int:
    """Take an unknown out of a graph, joining its neighbours; their number."""
    found = left.pop(k)
    for i in found:
        left[i] |= found
        left[i] -= {i, k}
    return len(found)


def _products(neighbours: Mapping[int, set[int]], order: Sequence[int]) -> int:
    left = {i: set(found) for i, found in neighbours.items()}
    degrees = [_eliminate(left, k) for k in order]
    return sum(d * (d + 1) // 2 + 3 * d + 1 for d in degrees)


def solve_ldl(matrix: Matrix, right: Sequence[Any], order: Sequence[int]) -> list[Any]:
    """Solve a sparse symmetric system by L D L^T in the given order, without pivoting.

    Args:
        matrix: both triangles; what is zero by structure is absent.
        right: the right-hand side; None where zero by structure.
        order: of elimination.
    """
    a, b = dict(matrix), list(right)
    for step, k in enumerate(order):
        below = [i for i in order[step + 1 :] if (i, k) in a]
        factors = {i: a[i, k] / a[k, k] for i in below}
        for i, factor in factors.items():
            for j in below:
                a[i, j] = total([a.get((i, j)), -(factor * a[j, k])])
            b[i] = total([b[i], minus(times(factor, b[k]))])
    x: dict[int, Any] = {}
    for step, k in reversed(list(enumerate(order))):
        rest = [minus(times(a.get((k, i)), x[i])) for i in order[step + 1 :]]
        x[k] = total([b[k], *rest])
        x[k] = None if x[k] is None else x[k] / a[k, k]
    return [x[k] if x[k] is not None else 0.0 for k in range(len(right))]
