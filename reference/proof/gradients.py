"""First derivatives of a tape's outputs by the state over a step (forward accumulation).

To every operation belong its derivatives by the coordinates and speeds, which follow from the
models of its arguments and from theirs (Griewank and Walther, *Evaluating Derivatives*, 2008,
ch. 3). They are Taylor models in time as the results are: a matrix with a row for each part of the
state, of the coefficients of t^0 ... t^p and the remainder. As a product with a model is linear in
the other factor's coefficients and remainder, it is one with a matrix
(:attr:`.remainders.Model.multiplication`). Models without coefficients are values in a box.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from .balls import Ball, Matrix, arb, arb_mat
from .remainders import Model, ranges
from .tape import Factored, Tape, unknowns

_ZERO = arb(0)


class _Known(NamedTuple):
    """Models of the operations' results, and the derivatives so far."""

    models: Sequence[Any]
    slopes: list[Any]
    """A matrix each; None: it is a constant. Of a linear system a list of matrices."""
    size: int
    """Number of coordinates and speeds."""


def gradients(
    tape: Tape, numbers: Sequence[Ball], q: Sequence[Ball], u: Sequence[Ball]
) -> list[list[Ball]]:
    """Enclose each output's derivatives by the coordinates, then the speeds.

    Args:
        tape: accelerations and functions of the state.
        numbers: of the mechanism, those that are not zero.
        q, u: the state, which may be a box.
    """
    values = ranges(tape.expand(numbers, q, u, 0))
    return [slopes.entries() for slopes in slope_models(tape, values)]


def slope_models(tape: Tape, models: Sequence[Any]) -> list[Matrix]:
    """Enclose each output's derivatives over a step.

    Args:
        tape: accelerations and functions of the state.
        models: of its operations' results (:func:`.remainders.models`).

    Returns:
        Matrices with a row for each coordinate, then each speed: coefficients, and the remainder.
    """
    known = _Known(models, [], 2 * tape.n_q)
    for k, (kind, arguments) in enumerate(tape.operations):
        known.slopes.append(_SLOPES[kind](arguments, models[k], known))
    columns = _columns(models)
    zeros = arb_mat(known.size, columns)
    found = [known.slopes[place] for place in tape.outputs]
    return [zeros if slopes is None else slopes for slopes in found]


def _columns(models: Sequence[Any]) -> int:
    """Number of coefficients, with the remainder."""
    return next(len(each.series) + 1 for each in models if isinstance(each, Model))


_Of = Sequence[int]
_Slopes = Matrix | None


def _constant(_: _Of, __: Any, ___: _Known) -> _Slopes:
    return None


def _variable(of: _Of, model: Model, known: _Known) -> _Slopes:
    """One, by itself: a coefficient, or a value in a box."""
    slopes = arb_mat(known.size, len(model.series) + 1)
    slopes[of[0], 0] = 1
    return slopes


def _sum(of: _Of, _: Any, known: _Known) -> _Slopes:
    return _plus(known.slopes[of[0]], known.slopes[of[1]])


def _difference(of: _Of, _: Any, known: _Known) -> _Slopes:
    return _plus(known.slopes[of[0]], _negated(known.slopes[of[1]]))


def _negative(of: _Of, _: Any, known: _Known) -> _Slopes:
    return _negated(known.slopes[of[0]])


def _product(of: _Of, _: Any, known: _Known) -> _Slopes:
    x, y = (known.models[k] for k in of)
    return _plus(_times(known.slopes[of[0]], y), _times(known.slopes[of[1]], x))


def _quotient(of: _Of, value: Model, known: _Known) -> _Slopes:
    """(x' - (x / y) y') / y."""
    left = _plus(known.slopes[of[0]], _negated(_times(known.slopes[of[1]], value)))
    return _divided(left, known.models[of[1]])


def _root(of: _Of, value: Model, known: _Known) -> _Slopes:
    twice = _divided(known.slopes[of[0]], value)
    return None if twice is None else twice / 2


def _sine(of: _Of, _: Any, known: _Known) -> _Slopes:
    return _times(known.slopes[of[0]], known.models[of[1]].cosine)


def _cosine(of: _Of, _: Any, known: _Known) -> _Slopes:
    return _negated(_times(known.slopes[of[0]], known.models[of[1]].sine))


def _system(of: _Of, solved: Any, known: _Known) -> list[Matrix]:
    """X' of K x = r: K x' = r' - K' x."""
    n = unknowns(of)
    changes: list[Matrix] = []
    for i in range(n):
        total = known.slopes[of[n * n + i]]
        for entry, value in zip(of[i * n : (i + 1) * n], solved.unknowns, strict=True):
            total = _plus(total, _negated(_times(known.slopes[entry], value)))
        zeros = arb_mat(known.size, len(solved.unknowns[0].series) + 1)
        changes.append(zeros if total is None else total)
    rows = [known.models[place].multiplication.tolist() for place in of[: n * n]]
    return _solutions(rows, changes, solved.first, solved.whole)


def _solutions(
    factors: list[list[list[Ball]]],
    right: list[Matrix],
    first: Factored | None,
    whole: Factored,
) -> list[Matrix]:
    """Solve K x = r for coefficients and remainders: a triangular system of blocks.

    Args:
        factors: matrices of the products with each entry of K, row by row.
        right: r, a matrix for each row of K.
        first, whole: K at t = 0, and over the step.
    """
    n, size, last = len(right), right[0].nrows(), right[0].ncols() - 1
    values = [part.tolist() for part in right]
    columns: list[Matrix] = []
    for k in range(last + 1):
        column = arb_mat([[values[i][s][k] for s in range(size)] for i in range(n)])
        for j, known in enumerate(columns):
            block = arb_mat(n, n, [factor[j][k] for factor in factors])
            column = column - block * known
        matrix = whole if k == last or first is None else first
        columns.append(matrix.solution(column))
    parts = [column.tolist() for column in columns]
    return [arb_mat([[part[i][s] for part in parts] for s in range(size)]) for i in range(n)]


def _solution(of: _Of, _: Any, known: _Known) -> _Slopes:
    return known.slopes[of[0]][of[1]]


def _times(slopes: _Slopes, factor: Model) -> _Slopes:
    return None if slopes is None else slopes * factor.multiplication


def _divided(slopes: _Slopes, divisor: Model) -> _Slopes:
    """The quotient's product with the divisor is known: a triangular system, column by column."""
    if slopes is None:
        return None
    factor, quotients = divisor.multiplication.tolist(), list[list[Ball]]()
    for row in slopes.tolist():
        found: list[Ball] = []
        for k, value in enumerate(row):
            known = sum((x * factor[j][k] for j, x in enumerate(found)), _ZERO)
            found.append((value - known) / factor[k][k])
        quotients.append(found)
    return arb_mat(quotients)


def _negated(slopes: _Slopes) -> _Slopes:
    return None if slopes is None else -slopes


def _plus(x: _Slopes, y: _Slopes) -> _Slopes:
    if x is None or y is None:
        return y if x is None else x
    return x + y


_SLOPES: dict[str, Callable[[Any, Any, _Known], Any]] = {
    "number": _constant,
    "constant": _constant,
    "variable": _variable,
    "sum": _sum,
    "difference": _difference,
    "negative": _negative,
    "product": _product,
    "scaled": _product,
    "quotient": _quotient,
    "root": _root,
    "wave": _constant,
    "sine": _sine,
    "cosine": _cosine,
    "system": _system,
    "solution": _solution,
}
