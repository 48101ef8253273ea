r"""Taylor coefficients of the equations of motion, one order after the other.

The expressions of :class:`..taylor.expressions.TaylorSystem` become a list of operations, each on
results of earlier ones. Of every operation the coefficients of t^0, t^1, ... are computed from
those of its arguments up to the same order (Moore, *Methods and Applications of Interval Analysis*,
1979, ch. 3):

    (x y)_k = sum_i x_i y_(k-i)             (x / y)_k = (x_k - sum_(i<k) (x/y)_i y_(k-i)) / y_0
    (K^-1 r)_k = K_0^-1 (r_k - sum_(i>0) K_i (K^-1 r)_(k-i))
    (sin x)_k = (1/k) sum_j j x_j (cos x)_(k-j)     (cos x)_k = -(1/k) sum_j j x_j (sin x)_(k-j)

and the next coefficient of the motion follows from the accelerations': u_(k+1) = a_k / (k + 1). In
balls the coefficients enclose those of every motion that begins in the state's balls.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from operator import mul
from typing import Any, NamedTuple

from .balls import Ball, Matrix, absolute, arb, arb_mat, identity, squared

Series = list[Ball]
"""Coefficients of t^0, t^1, ..."""
_Key = tuple[Any, ...]


@dataclass(frozen=True, eq=False)
class Expression:
    """A node of the list of operations; plain numbers are exact."""

    algebra: Algebra
    index: int
    """Place of its operation."""
    number: float | None = None
    """Its value, where that is a plain number."""

    def __add__(self, other: Any) -> Expression:
        return self.algebra.sum(self, self.algebra.expression(other))

    def __radd__(self, other: Any) -> Expression:
        return self.algebra.sum(self.algebra.expression(other), self)

    def __sub__(self, other: Any) -> Expression:
        return self.algebra.sum(self, -self.algebra.expression(other))

    def __rsub__(self, other: Any) -> Expression:
        return self.algebra.sum(self.algebra.expression(other), -self)

    def __mul__(self, other: Any) -> Expression:
        return self.algebra.product(self, self.algebra.expression(other))

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Expression:
        return self.algebra.quotient(self, self.algebra.expression(other))

    def __rtruediv__(self, other: Any) -> Expression:
        return self.algebra.quotient(self.algebra.expression(other), self)

    def __neg__(self) -> Expression:
        return self.algebra.negative(self)


class Operation(NamedTuple):
    """A function of earlier results, or a number or variable."""

    kind: str
    arguments: tuple[int, ...]


@dataclass
class Algebra:
    """Makes expressions in place of heyoka: variables, parameters, functions of them.

    What is the same is made once; sums and products with 0 and 1 are none.
    """

    switches: Mapping[int, float]
    """Parameters that are 0 or 1, by index."""
    operations: list[Operation] = field(default_factory=list[Operation])
    _known: dict[_Key, Expression] = field(default_factory=dict[_Key, Expression])
    _negatives: dict[int, Expression] = field(default_factory=dict[int, Expression])

    @property
    def par(self) -> Algebra:
        """Parameters by index, in the manner of heyoka."""
        return self

    def __getitem__(self, index: int) -> Expression:
        if index in self.switches:
            return self.expression(self.switches[index])
        return self._made("number", index)

    def make_vars(self, *names: str) -> Any:
        """Variables; one or several, in the manner of heyoka."""
        made = [self._made("variable", name) for name in names]
        return made[0] if len(made) == 1 else made

    def expression(self, value: Any) -> Expression:
        """An expression as it is, or a plain number as one."""
        if isinstance(value, Expression):
            return value
        return self._made("constant", float(value), number=float(value))

    def _made(self, kind: str, *arguments: Any, number: float | None = None) -> Expression:
        key = (kind, *arguments)
        if key not in self._known:
            self._known[key] = Expression(self, len(self.operations), number)
            self.operations.append(Operation(kind, arguments))
        return self._known[key]

    def sum(self, x: Expression, y: Expression) -> Expression:
        """X + y."""
        if x.number is not None and y.number is not None:
            total = x.number + y.number
            if Fraction(total) == Fraction(x.number) + Fraction(y.number):
                return self.expression(total)
        if x.number == 0.0 or y.number == 0.0:
            return y if x.number == 0.0 else x
        if self._is_negative(y):
            return self._made("difference", x.index, self.operations[y.index].arguments[0])
        if self._is_negative(x):
            return self._made("difference", y.index, self.operations[x.index].arguments[0])
        return self._made("sum", *sorted((x.index, y.index)))

    def _is_negative(self, x: Expression) -> bool:
        return self.operations[x.index].kind == "negative"

    def negative(self, x: Expression) -> Expression:
        """-x."""
        if x.number is not None:
            return self.expression(-x.number)
        if self._is_negative(x):
            return self._negatives[x.index]
        made = self._made("negative", x.index)
        self._negatives[made.index] = x
        return made

    def product(self, x: Expression, y: Expression) -> Expression:
        """X y."""
        if x.number is not None and y.number is not None:
            product = x.number * y.number
            if Fraction(product) == Fraction(x.number) * Fraction(y.number):
                return self.expression(product)
        for one, other in ((x, y), (y, x)):
            if one.number == 0.0:
                return one
            if one.number == 1.0:
                return other
            if one.number == -1.0:
                return -other
        return self._made("product", *sorted((x.index, y.index)))

    def quotient(self, x: Expression, y: Expression) -> Expression:
        """X / y."""
        if x.number == 0.0 or y.number == 1.0:
            return x
        if y.number == -1.0:
            return -x
        return self._made("quotient", x.index, y.index)

    def solve(
        self, matrix: Mapping[tuple[int, int], Any], right: Sequence[Any]
    ) -> list[Expression]:
        """The solution of a symmetric linear system.

        Args:
            matrix: both triangles; what is absent is zero.
            right: its right-hand side; None is zero.
        """
        entries = {place: self.expression(value) for place, value in matrix.items()}
        entries = {place: entry for place, entry in entries.items() if entry.number != 0.0}
        values = [self.expression(0.0 if value is None else value) for value in right]
        coupled = sorted({i for i, j in entries if i != j})
        zero = self.expression(0.0)
        block = [entries.get((i, j), zero).index for i in coupled for j in coupled]
        solved = [
            value if i in coupled else self.quotient(value, entries[i, i])
            for i, value in enumerate(values)
        ]
        if coupled:
            system = self._made("system", *block, *(values[i].index for i in coupled))
            for place, i in enumerate(coupled):
                solved[i] = self._made("solution", system.index, place)
        return solved

    def sqrt(self, x: Expression) -> Expression:
        """Square root."""
        return self._made("root", x.index)

    def cos(self, x: Expression) -> Expression:
        """Cosine; its sine is computed with it."""
        return self._made("cosine", x.index, self._wave(x))

    def sin(self, x: Expression) -> Expression:
        """Sine; its cosine is computed with it."""
        return self._made("sine", x.index, self._wave(x))

    def _wave(self, x: Expression) -> int:
        return self._made("wave", x.index).index


class Expansion(NamedTuple):
    """Coefficients of t^0 ... t^p along a motion."""

    state: list[Series]
    """Series of q, then u."""
    operations: Sequence[Operation]
    results: list[Any]
    """A series for each operation; several for waves and linear systems."""
    outputs: Sequence[int]
    """Places of the results that are accelerations, then functions."""

    def output(self, i: int) -> Series:
        """Coefficients of an output."""
        return self.results[self.outputs[i]]


class Tape:
    """The operations that some outputs need, with their numbers.

    Args:
        algebra: in which they were made.
        variables: names of the coordinates, then of their speeds.
        outputs: accelerations, then functions of the state.
    """

    def __init__(
        self, algebra: Algebra, variables: Sequence[str], outputs: Sequence[Expression]
    ) -> None:
        needed, waiting = set[int](), [output.index for output in outputs]
        while waiting:
            index = waiting.pop()
            if index in needed:
                continue
            needed.add(index)
            waiting += _inputs(algebra.operations[index])
        order = sorted(needed)  # an operation's arguments were made before it
        place = {index: k for k, index in enumerate(order)}
        self.n_q = len(variables) // 2
        self._names = {name: k for k, name in enumerate(variables)}
        self.outputs = [place[output.index] for output in outputs]
        self.operations: list[Operation] = []
        constant = _constants(algebra, order)
        for index in order:
            kind, arguments = algebra.operations[index]
            if kind == "product" and constant.intersection(arguments):
                ordered = sorted(arguments, key=lambda of: of not in constant)
                kind, arguments = "scaled", tuple(ordered)
            if kind == "variable":
                arguments = (self._names[str(arguments[0])],)
            else:
                inputs = _inputs(Operation(kind, arguments))
                arguments = (*(place[k] for k in inputs), *arguments[len(inputs) :])
            self.operations.append(Operation(kind, arguments))

    def expand(
        self, numbers: Sequence[Ball], q: Sequence[Ball], u: Sequence[Ball], order: int
    ) -> Expansion:
        """Compute Taylor coefficients of the motion and of the outputs, up to an order.

        Args:
            numbers: of the mechanism, those that are not zero.
            q, u: the state.
            order: of the highest coefficients.
        """
        n_q = self.n_q
        state: list[Series] = [[value] for value in (*q, *u)]
        results: list[Any] = [_begin(operation, numbers) for operation in self.operations]
        accelerations = self.outputs[:n_q]
        for k in range(order + 1):
            for operation, result in zip(self.operations, results, strict=True):
                _EXTEND[operation.kind](k, result, operation.arguments, results, state)
            if k < order:
                for i, place in enumerate(accelerations):
                    state[i].append(state[n_q + i][k] / (k + 1))
                    state[n_q + i].append(results[place][k] / (k + 1))
        return Expansion(state, self.operations, results, self.outputs)

    def values(self, numbers: Sequence[Ball], q: Sequence[Ball], u: Sequence[Ball]) -> list[Ball]:
        """Enclose all outputs in every state of the balls."""
        expansion = self.expand(numbers, q, u, 0)
        return [expansion.results[place][0] for place in self.outputs]


def _inputs(operation: Operation) -> tuple[int, ...]:
    """Operations on whose results one works; they are the first of its arguments."""
    if operation.kind in ("number", "constant", "variable"):
        return ()
    return operation.arguments[:1] if operation.kind == "solution" else operation.arguments


def _constants(algebra: Algebra, order: Sequence[int]) -> set[int]:
    """Operations whose results do not change with time."""
    constant = set[int]()
    for index in order:
        operation = algebra.operations[index]
        if operation.kind != "variable" and constant.issuperset(_inputs(operation)):
            constant.add(index)
    return constant


class Factored(NamedTuple):
    """A matrix K with an inverse of its middle, for several right-hand sides.

    With E = I - C K, C about K^-1, the solution of K x = r differs from x_0 by

        (I - E)^-1 d in d +- (I - |E|)^-1 |E| |d|,        d = C (r - K x_0),

    if a w > 0 has |E| w < w, as then the powers of |E| have a sum (the bounds are those of Rump,
    *Verification methods*, Acta Numerica 19 (2010) 287). They hold part by part, so that nothing
    depends on the units of coordinates and of constraints.
    """

    matrix: Matrix
    inverse: Matrix
    """C, exact."""
    excess: Matrix | None
    """(I - |E|)^-1 |E|; None: it is not known that every matrix of the balls has an inverse."""

    @classmethod
    def of(cls, matrix: Matrix) -> Factored:
        """Invert the middle of a matrix, and bound what others of its balls have beside it."""
        unit = identity(matrix.nrows())
        inverse = matrix.mid().solve(unit, nonstop=True, algorithm="approx").mid()
        off = absolute(unit - inverse * matrix)
        rest = (unit - off).inv(nonstop=True)
        # There is w > 0 with |E| w < w.
        w = (rest * arb_mat([[1]] * matrix.nrows())).mid()
        known = all(x > 0 for x in (*w.entries(), *((unit - off) * w).entries()))
        return cls(matrix, inverse, rest * off if known else None)

    def solution(self, right: Matrix) -> Matrix:
        """Enclose the solution of K x = r, for each column of r; not finite if it may have none."""
        about = (self.inverse * right.mid()).mid()
        off = self.inverse * (right - self.matrix * about)
        if self.excess is None:
            return arb_mat(right.nrows(), right.ncols(), [arb.nan()] * len(right.entries()))
        wide = [arb(0, x.upper()) for x in (self.excess * absolute(off)).entries()]
        return about + off + arb_mat(right.nrows(), right.ncols(), wide)


def unknowns(of: Sequence[int]) -> int:
    """N of a linear system's n^2 + n arguments: the matrix row by row, then the right side."""
    return math.isqrt(len(of))


@dataclass
class _Wave:
    """Coefficients of a sine and a cosine, and those of the angle times their order."""

    sine: Series = field(default_factory=Series)
    cosine: Series = field(default_factory=Series)
    weighted: Series = field(default_factory=Series)


@dataclass
class _System:
    """Coefficients of a linear system's matrix and of its solution, a column each."""

    first: Factored | None = None
    """The matrix at t = 0."""
    matrices: list[Matrix] = field(default_factory=list[Matrix])
    columns: list[Matrix] = field(default_factory=list[Matrix])
    solution: list[Series] = field(default_factory=list[Series])
    """The columns' entries."""


def _begin(operation: Operation, numbers: Sequence[Ball]) -> Any:
    """The list that an operation's coefficients are written to, with a constant's own."""
    if operation.kind == "wave":
        return _Wave()
    if operation.kind == "system":
        return _System()
    if operation.kind == "number":
        return [numbers[operation.arguments[0]]]
    if operation.kind == "constant":
        return [arb(operation.arguments[0])]
    return Series()


_ZERO = arb(0)


def _constant(k: int, result: Series, *_: Any) -> None:
    if k:
        result.append(_ZERO)


def _variable(k: int, result: Series, of: Any, _: Any, state: Any) -> None:
    result.append(state[of[0]][k])


def _sum(k: int, result: Series, of: Any, results: Any, _: Any) -> None:
    result.append(results[of[0]][k] + results[of[1]][k])


def _difference(k: int, result: Series, of: Any, results: Any, _: Any) -> None:
    result.append(results[of[0]][k] - results[of[1]][k])


def _negative(k: int, result: Series, of: Any, results: Any, _: Any) -> None:
    result.append(-results[of[0]][k])


def _product(k: int, result: Series, of: Any, results: Any, _: Any) -> None:
    x, y = results[of[0]], results[of[1]]
    if of[0] != of[1]:
        result.append(sum(map(mul, x, y[::-1]), _ZERO))
        return
    # Of a square each pair once.
    twice = 2 * sum(map(mul, x[: (k + 1) // 2], x[k : k // 2 : -1]), _ZERO)
    result.append(twice if k % 2 else twice + squared(x[k // 2]))


def _scaled(k: int, result: Series, of: Any, results: Any, _: Any) -> None:
    result.append(results[of[0]][0] * results[of[1]][k])


def _quotient(k: int, result: Series, of: Any, results: Any, _: Any) -> None:
    x, y = results[of[0]], results[of[1]]
    known = sum(map(mul, result, y[k:0:-1]), _ZERO)
    result.append((x[k] - known) / y[0])


def _root(k: int, result: Series, of: Any, results: Any, _: Any) -> None:
    x = results[of[0]]
    if k == 0:
        result.append(x[0].sqrt())
        return
    known = sum(map(mul, result[1:], result[:0:-1]), _ZERO)
    result.append((x[k] - known) / (2 * result[0]))


def _wave(k: int, result: _Wave, of: Any, results: Any, _: Any) -> None:
    x = results[of[0]]
    result.weighted.append(k * x[k])
    if k == 0:
        sine, cosine = x[0].sin_cos()
    else:
        rates = result.weighted[1:]
        sine = sum(map(mul, rates, result.cosine[::-1]), _ZERO) / k
        cosine = -sum(map(mul, rates, result.sine[::-1]), _ZERO) / k
    result.sine.append(sine)
    result.cosine.append(cosine)


def _system(k: int, result: _System, of: Any, results: Any, _: Any) -> None:
    n = unknowns(of)
    matrix = arb_mat(n, n, [results[place][k] for place in of[: n * n]])
    column = arb_mat(n, 1, [results[place][k] for place in of[n * n :]])
    if result.first is None:
        result.first = Factored.of(matrix)
    else:
        result.matrices.append(matrix)
        for known, solved in zip(result.matrices, reversed(result.columns), strict=True):
            column = column - known * solved
    column = result.first.solution(column)
    result.columns.append(column)
    result.solution.append(column.entries())


def _solution(k: int, result: Series, of: Any, results: Any, _: Any) -> None:
    result.append(results[of[0]].solution[k][of[1]])


def _sine(k: int, result: Series, of: Any, results: Any, _: Any) -> None:
    result.append(results[of[1]].sine[k])


def _cosine(k: int, result: Series, of: Any, results: Any, _: Any) -> None:
    result.append(results[of[1]].cosine[k])


_EXTEND: dict[str, Any] = {
    "number": _constant,
    "constant": _constant,
    "variable": _variable,
    "sum": _sum,
    "difference": _difference,
    "negative": _negative,
    "product": _product,
    "scaled": _scaled,
    "quotient": _quotient,
    "root": _root,
    "wave": _wave,
    "sine": _sine,
    "cosine": _cosine,
    "system": _system,
    "solution": _solution,
}
