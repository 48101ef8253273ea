"""First derivatives of a tape's outputs by the state, in balls (forward accumulation).

To every operation belongs a row of derivatives by the coordinates and speeds, which follows from
the values and the rows of its arguments (Griewank and Walther, *Evaluating Derivatives*, 2008,
ch. 3). On a box the rows enclose the derivatives in all its states.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from .balls import Ball, Matrix, arb, arb_mat
from .tape import Tape, unknowns

_ZERO = arb(0)


class _Known(NamedTuple):
    """Results of the operations, and their derivatives so far."""

    values: Sequence[Any]
    """Series of one coefficient; several for waves and linear systems."""
    rows: list[Any]
    """A row each; None: it is a constant. Of a linear system a list of rows."""
    size: int
    """Number of derivatives in a row."""


def gradients(
    tape: Tape, numbers: Sequence[Ball], q: Sequence[Ball], u: Sequence[Ball]
) -> list[list[Ball]]:
    """Enclose each output's derivatives by the coordinates, then the speeds.

    Args:
        tape: accelerations and functions of the state.
        numbers: of the mechanism, those that are not zero.
        q, u: the state, which may be a box.
    """
    expansion = tape.expand(numbers, q, u, 0)
    known = _Known(expansion.results, [], len(expansion.state))
    for k, (kind, arguments) in enumerate(tape.operations):
        known.rows.append(_ROWS[kind](arguments, expansion.results[k], known))
    zeros = [_ZERO] * known.size
    rows = [known.rows[place] for place in tape.outputs]
    return [zeros if row is None else row.entries() for row in rows]


_Of = Sequence[int]
_Row = Matrix | None


def _constant(_: _Of, __: Any, ___: _Known) -> _Row:
    return None


def _variable(of: _Of, _: Any, known: _Known) -> _Row:
    return arb_mat([[int(i == of[0]) for i in range(known.size)]])


def _sum(of: _Of, _: Any, known: _Known) -> _Row:
    return _plus(known.rows[of[0]], known.rows[of[1]])


def _difference(of: _Of, _: Any, known: _Known) -> _Row:
    return _plus(known.rows[of[0]], _times(known.rows[of[1]], arb(-1)))


def _negative(of: _Of, _: Any, known: _Known) -> _Row:
    return _times(known.rows[of[0]], arb(-1))


def _product(of: _Of, _: Any, known: _Known) -> _Row:
    x, y = (known.values[k][0] for k in of)
    return _plus(_times(known.rows[of[0]], y), _times(known.rows[of[1]], x))


def _quotient(of: _Of, value: Any, known: _Known) -> _Row:
    inverse = 1 / known.values[of[1]][0]
    by_divisor = _times(known.rows[of[1]], -value[0] * inverse)
    return _plus(_times(known.rows[of[0]], inverse), by_divisor)


def _root(of: _Of, value: Any, known: _Known) -> _Row:
    return _times(known.rows[of[0]], 1 / (2 * value[0]))


def _sine(of: _Of, _: Any, known: _Known) -> _Row:
    return _times(known.rows[of[0]], known.values[of[1]].cosine[0])


def _cosine(of: _Of, _: Any, known: _Known) -> _Row:
    return _times(known.rows[of[0]], -known.values[of[1]].sine[0])


def _system(of: _Of, solved: Any, known: _Known) -> list[list[Ball]]:
    """X' = K^-1 (r' - K' x) of K x = r."""
    n = unknowns(of)
    changes: list[list[Ball]] = []
    for i in range(n):
        total = known.rows[of[n * n + i]]
        for entry, value in zip(of[i * n : (i + 1) * n], solved.solution[0], strict=True):
            total = _plus(total, _times(known.rows[entry], -value))
        changes.append([_ZERO] * known.size if total is None else total.entries())
    return solved.first.solution(arb_mat(changes)).tolist()


def _solution(of: _Of, _: Any, known: _Known) -> _Row:
    return arb_mat([known.rows[of[0]][of[1]]])


def _times(row: _Row, factor: Ball) -> _Row:
    return None if row is None else row * factor


def _plus(x: _Row, y: _Row) -> _Row:
    if x is None or y is None:
        return y if x is None else x
    return x + y


_ROWS: dict[str, Callable[[Any, Any, _Known], Any]] = {
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
