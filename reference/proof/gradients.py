"""First derivatives of a tape's outputs by the state, in balls (forward accumulation).

Of every operation the value is computed with a row of its derivatives by the coordinates and
speeds, from those of its arguments (Griewank and Walther, *Evaluating Derivatives*, 2008, ch. 3).
On a box the rows enclose the derivatives in all its states.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from .balls import Ball, Matrix, arb, arb_mat, squared
from .tape import Factored, Series, Tape, unknowns

_ZERO = arb(0)


class _Tangent(NamedTuple):
    """A value with its derivatives by the state, a row; None: it is a constant."""

    value: Ball
    rates: Matrix | None


class _Wave(NamedTuple):
    """A sine and a cosine."""

    sine: Ball
    cosine: Ball


class _Solved(NamedTuple):
    """The solution of a linear system with its derivatives by the state."""

    values: Series
    rates: list[list[Ball]]


class _Inputs(NamedTuple):
    """Numbers and state, on which values depend beside the operations."""

    numbers: Sequence[Ball]
    state: Sequence[Ball]


def gradients(
    tape: Tape, numbers: Sequence[Ball], q: Sequence[Ball], u: Sequence[Ball]
) -> list[list[Ball]]:
    """Enclose each output's derivatives by the coordinates, then the speeds.

    Args:
        tape: accelerations and functions of the state.
        numbers: of the mechanism, those that are not zero.
        q, u: the state, which may be a box.
    """
    inputs = _Inputs(numbers, [*q, *u])
    known: list[Any] = []
    for kind, arguments in tape.operations:
        known.append(_TANGENTS[kind](inputs, arguments, known))
    zeros = [_ZERO] * len(inputs.state)
    rows = [known[place].rates for place in tape.outputs]
    return [zeros if row is None else row.entries() for row in rows]


_Of = Sequence[Any]
_Known = Sequence[Any]


def _number(inputs: _Inputs, of: _Of, _: _Known) -> _Tangent:
    return _Tangent(inputs.numbers[of[0]], None)


def _constant(_: _Inputs, of: _Of, __: _Known) -> _Tangent:
    return _Tangent(arb(of[0]), None)


def _variable(inputs: _Inputs, of: _Of, _: _Known) -> _Tangent:
    row = arb_mat([[int(i == of[0]) for i in range(len(inputs.state))]])
    return _Tangent(inputs.state[of[0]], row)


def _sum(_: _Inputs, of: _Of, known: _Known) -> _Tangent:
    x, y = (known[k] for k in of)
    return _Tangent(x.value + y.value, _plus(x.rates, y.rates))


def _difference(_: _Inputs, of: _Of, known: _Known) -> _Tangent:
    x, y = (known[k] for k in of)
    return _Tangent(x.value - y.value, _plus(x.rates, _times(y.rates, arb(-1))))


def _negative(_: _Inputs, of: _Of, known: _Known) -> _Tangent:
    x = known[of[0]]
    return _Tangent(-x.value, _times(x.rates, arb(-1)))


def _product(_: _Inputs, of: _Of, known: _Known) -> _Tangent:
    x, y = (known[k] for k in of)
    value = squared(x.value) if of[0] == of[1] else x.value * y.value
    return _Tangent(value, _plus(_times(x.rates, y.value), _times(y.rates, x.value)))


def _quotient(_: _Inputs, of: _Of, known: _Known) -> _Tangent:
    x, y = (known[k] for k in of)
    value, inverse = x.value / y.value, 1 / y.value
    return _Tangent(value, _plus(_times(x.rates, inverse), _times(y.rates, -value * inverse)))


def _root(_: _Inputs, of: _Of, known: _Known) -> _Tangent:
    x = known[of[0]]
    root = x.value.sqrt()
    return _Tangent(root, _times(x.rates, 1 / (2 * root)))


def _wave(_: _Inputs, of: _Of, known: _Known) -> _Wave:
    return _Wave(*known[of[0]].value.sin_cos())


def _sine(_: _Inputs, of: _Of, known: _Known) -> _Tangent:
    angle, wave = (known[k] for k in of)
    return _Tangent(wave.sine, _times(angle.rates, wave.cosine))


def _cosine(_: _Inputs, of: _Of, known: _Known) -> _Tangent:
    angle, wave = (known[k] for k in of)
    return _Tangent(wave.cosine, _times(angle.rates, -wave.sine))


def _system(inputs: _Inputs, of: _Of, known: _Known) -> _Solved:
    """X and x' = K^-1 (r' - K' x) of K x = r."""
    n = unknowns(of)
    rows, right = [of[i * n : (i + 1) * n] for i in range(n)], of[n * n :]
    factored = Factored.of(arb_mat([[known[k].value for k in row] for row in rows]))
    values = factored.solution(arb_mat([[known[k].value] for k in right])).entries()
    changes: list[list[Ball]] = []
    for row, k in zip(rows, right, strict=True):
        total = known[k].rates
        for entry, value in zip(row, values, strict=True):
            total = _plus(total, _times(known[entry].rates, -value))
        changes.append([_ZERO] * len(inputs.state) if total is None else total.entries())
    return _Solved(values, factored.solution(arb_mat(changes)).tolist())


def _solution(_: _Inputs, of: _Of, known: _Known) -> _Tangent:
    solved: _Solved = known[of[0]]
    return _Tangent(solved.values[of[1]], arb_mat([solved.rates[of[1]]]))


def _times(row: Matrix | None, factor: Ball) -> Matrix | None:
    return None if row is None else row * factor


def _plus(x: Matrix | None, y: Matrix | None) -> Matrix | None:
    if x is None or y is None:
        return y if x is None else x
    return x + y


_TANGENTS: dict[str, Callable[[_Inputs, Any, Any], Any]] = {
    "number": _number,
    "constant": _constant,
    "variable": _variable,
    "sum": _sum,
    "difference": _difference,
    "negative": _negative,
    "product": _product,
    "scaled": _product,
    "quotient": _quotient,
    "root": _root,
    "wave": _wave,
    "sine": _sine,
    "cosine": _cosine,
    "system": _system,
    "solution": _solution,
}
