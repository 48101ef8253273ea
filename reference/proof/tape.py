r"""Taylor coefficients of the equations of motion, one order after the other.

The expressions of :class:`..taylor.expressions.TaylorSystem` become a list of operations, each on
results of earlier ones. Of every operation the coefficients of t^0, t^1, ... are computed from
those of its arguments up to the same order (Moore, *Methods and Applications of Interval Analysis*,
1979, ch. 3):

    (x y)_k = sum_i x_i y_(k-i)             (x / y)_k = (x_k - sum_(i<k) (x/y)_i y_(k-i)) / y_0
    (sin x)_k = (1/k) sum_j j x_j (cos x)_(k-j)     (cos x)_k = -(1/k) sum_j j x_j (sin x)_(k-j)

and the next coefficient of the motion follows from the accelerations': u_(k+1) = a_k / (k + 1). In
balls the coefficients enclose those of every motion that begins in the state's balls.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from operator import mul
from typing import Any, NamedTuple

from .balls import Ball, arb, squared

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


class _Operation(NamedTuple):
    kind: str
    arguments: tuple[int, ...]


@dataclass
class Algebra:
    """Makes expressions in place of heyoka: variables, parameters, functions of them.

    What is the same is made once; sums and products with 0 and 1 are none.
    """

    switches: Mapping[int, float]
    """Parameters that are 0 or 1, by index."""
    operations: list[_Operation] = field(default_factory=list[_Operation])
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
            self.operations.append(_Operation(kind, arguments))
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
            operation = algebra.operations[index]
            if operation.kind not in ("number", "constant", "variable"):
                waiting += operation.arguments
        order = sorted(needed)  # an operation's arguments were made before it
        place = {index: k for k, index in enumerate(order)}
        self.n_q = len(variables) // 2
        self._names = {name: k for k, name in enumerate(variables)}
        self._outputs = [place[output.index] for output in outputs]
        self._operations: list[_Operation] = []
        constant = _constants(algebra, order)
        for index in order:
            kind, arguments = algebra.operations[index]
            if kind == "product" and constant.intersection(arguments):
                ordered = sorted(arguments, key=lambda of: of not in constant)
                kind, arguments = "scaled", tuple(ordered)
            if kind == "variable":
                arguments = (self._names[str(arguments[0])],)
            elif kind not in ("number", "constant"):
                arguments = tuple(place[argument] for argument in arguments)
            self._operations.append(_Operation(kind, arguments))

    def expand(
        self, numbers: Sequence[Ball], q: Sequence[Ball], u: Sequence[Ball], order: int
    ) -> tuple[list[Series], list[Series]]:
        """Compute Taylor coefficients of the motion and of the outputs.

        Args:
            numbers: of the mechanism, those that are not zero.
            q, u: the state.
            order: of the highest coefficient of q and u.

        Returns:
            Of q, then u, those up to `order`; of the functions after the accelerations those up to
            `order`, too.
        """
        n_q = self.n_q
        state: list[Series] = [[value] for value in (*q, *u)]
        results: list[Any] = [_begin(operation, numbers) for operation in self._operations]
        accelerations = self._outputs[:n_q]
        for k in range(order + 1):
            for operation, result in zip(self._operations, results, strict=True):
                _EXTEND[operation.kind](k, result, operation.arguments, results, state)
            if k < order:
                for i, place in enumerate(accelerations):
                    state[i].append(state[n_q + i][k] / (k + 1))
                    state[n_q + i].append(results[place][k] / (k + 1))
        return state, [list(results[place]) for place in self._outputs[n_q:]]

    def values(self, numbers: Sequence[Ball], q: Sequence[Ball], u: Sequence[Ball]) -> list[Ball]:
        """Enclose all outputs in every state of the balls."""
        state: list[Series] = [[value] for value in (*q, *u)]
        results: list[Any] = [_begin(operation, numbers) for operation in self._operations]
        for operation, result in zip(self._operations, results, strict=True):
            _EXTEND[operation.kind](0, result, operation.arguments, results, state)
        return [results[place][0] for place in self._outputs]

    def accelerations(
        self, numbers: Sequence[Ball], q: Sequence[Ball], u: Sequence[Ball]
    ) -> list[Ball]:
        """Enclose the first outputs, one for each coordinate."""
        return self.values(numbers, q, u)[: self.n_q]


def _constants(algebra: Algebra, order: Sequence[int]) -> set[int]:
    """Operations whose results do not change with time."""
    constant = set[int]()
    for index in order:
        kind, arguments = algebra.operations[index]
        if kind in ("number", "constant") or (
            kind != "variable" and constant.issuperset(arguments)
        ):
            constant.add(index)
    return constant


@dataclass
class _Wave:
    """Coefficients of a sine and a cosine, and those of the angle times their order."""

    sine: Series = field(default_factory=Series)
    cosine: Series = field(default_factory=Series)
    weighted: Series = field(default_factory=Series)


def _begin(operation: _Operation, numbers: Sequence[Ball]) -> Any:
    """The list that an operation's coefficients are written to, with a constant's own."""
    if operation.kind == "wave":
        return _Wave()
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
}
