r"""Remainders of the operations of a tape along a polynomial motion (Taylor models in time).

Of every operation the coefficients z_0 ... z_p of its result along x~(t) are known; over a step
its result is

    z(t) = sum z_k t^k + r t^(p+1),    0 <= t <= h,

and r is enclosed from those of its arguments (Makino and Berz, *Taylor models and other validated
functional inclusion methods*, Int. J. Pure Appl. Math. 4 (2003) 379). With the tails

    Z_m = sum_(k >= m) z_k t^(k-m)    over the step,

a product x y of polynomials has beyond t^p the terms t^(p+1) sum_i x_i Y_(p+1-i). What is divided
or solved for is held against its own polynomial, z~: of z = x / y

    (z - z~) y = x - z~ y,    which begins with t^(p+1),

so that no remainder is computed from earlier coefficients' widths: recursions that do lose the
step, as their widths grow with the series of absolute values.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from operator import mul
from typing import Any, NamedTuple

from .balls import Ball, Matrix, arb, arb_mat, between, squared
from .tape import Expansion, Factored, Series, unknowns

_ZERO = arb(0)


class Remainders(NamedTuple):
    """Ranges and remainders over a step of an expansion's variables and outputs."""

    state: list[Ball]
    """Values of q, then u."""
    outputs: list[Ball]
    """Remainders of the accelerations, then the functions, in parts of t^(p+1)."""


@dataclass(frozen=True)
class Model:
    """A result over the step."""

    series: Series
    """Its coefficients of t^0 ... t^p."""
    tails: Series
    """Z_0 ... Z_p."""
    remainder: Ball
    powers: Series
    """t^0 ... t^(p+1) over the step."""

    @cached_property
    def whole(self) -> Ball:
        """Its values, with the remainder."""
        own = self.tails[0] if self.tails else _ZERO
        return own + self.remainder * self.powers[-1]

    @cached_property
    def multiplication(self) -> Matrix:
        """Matrix by which a row of another's coefficients and remainder is multiplied."""
        n = len(self.series)
        rows = [[self.remainder * power] for power in self.powers]
        for j in range(1, n + 1):
            rows[j][0] += self.tails[n - j]
        return arb_mat([[_ZERO] * j + self.series[: n - j] + row for j, row in enumerate(rows)])


@dataclass(frozen=True)
class Wave:
    """A sine and a cosine."""

    sine: Model
    cosine: Model


@dataclass(frozen=True)
class Solved:
    """The solution of a linear system."""

    unknowns: list[Model]
    first: Factored | None
    """The matrix at t = 0; None: only its values are known."""
    whole: Factored
    """Its values."""


class _Step(NamedTuple):
    """Numbers of a step that remainders depend on beside the operations."""

    powers: Series
    """t^0 ... t^(p+1), with t from 0 to h."""
    state: Series
    """Remainders of q and u."""

    def model(self, series: Series, remainder: Ball) -> Model:
        """A result with its tails."""
        tail, tails = _ZERO, Series()
        for c in reversed(series):
            tail = c + self.powers[1] * tail
            tails.append(tail)
        tails.reverse()
        return Model(series, tails, remainder, self.powers)


def models(expansion: Expansion, length: Ball, state: Series) -> list[Any]:
    """Enclose the results of all operations over a step.

    Args:
        expansion: of motions, up to order p.
        length: h [s].
        state: remainders of q, then u.

    Returns:
        A :class:`Model`, :class:`Wave` or :class:`Solved` each, with balls that are not finite
        where a result may not exist.
    """
    return _models(expansion, _step(expansion, length, state))


def _models(expansion: Expansion, step: _Step) -> list[Any]:
    made = list[Any]()
    for operation, result in zip(expansion.operations, expansion.results, strict=True):
        made.append(_MODELS[operation.kind](step, operation.arguments, result, made))
    return made


def _step(expansion: Expansion, length: Ball, state: Series) -> _Step:
    return _Step(powers(length, len(expansion.state[0])), state)


def powers(length: Ball, last: int) -> Series:
    """t^0 ... t^last over a step from 0 to a length."""
    return [arb(1), *(between(_ZERO, length**k) for k in range(1, last + 1))]


def remainders(expansion: Expansion, length: Ball) -> Remainders:
    """Enclose what the outputs have beside their polynomials along the state's polynomials.

    Args:
        expansion, length: see :func:`models`.
    """
    step = _step(expansion, length, [_ZERO] * len(expansion.state))
    made = _models(expansion, step)
    state = [step.model(series, _ZERO).whole for series in expansion.state]
    return Remainders(state, [made[place].remainder for place in expansion.outputs])


def ranges(expansion: Expansion) -> list[Any]:
    """Results of all operations as models without coefficients, whose remainders are the values.

    Args:
        expansion: of order 0.
    """
    made: list[Any] = []
    for operation, result in zip(expansion.operations, expansion.results, strict=True):
        if operation.kind == "wave":
            made.append(Wave(_range(result.sine[0]), _range(result.cosine[0])))
        elif operation.kind == "system":
            made.append(Solved([*map(_range, result.solution[0])], None, result.first))
        else:
            made.append(_range(result[0]))
    return made


def _range(value: Ball) -> Model:
    return Model([], [], value, [arb(1)])


def _overflow(x: Model, y: Model) -> Ball:
    """The terms of a product of polynomials beyond t^p, in parts of t^(p+1)."""
    return sum(map(mul, x.series[1:], y.tails[:0:-1]), _ZERO)


_Of = Sequence[int]


def _exact(step: _Step, _: _Of, result: Series, __: Any) -> Model:
    return step.model(result, _ZERO)


def _variable(step: _Step, of: _Of, result: Series, _: Any) -> Model:
    return step.model(result, step.state[of[0]])


def _sum(step: _Step, of: _Of, result: Series, models: Any) -> Model:
    x, y = (models[k] for k in of)
    return step.model(result, x.remainder + y.remainder)


def _difference(step: _Step, of: _Of, result: Series, models: Any) -> Model:
    x, y = (models[k] for k in of)
    return step.model(result, x.remainder - y.remainder)


def _negative(step: _Step, of: _Of, result: Series, models: Any) -> Model:
    return step.model(result, -models[of[0]].remainder)


def _product(step: _Step, of: _Of, result: Series, models: Any) -> Model:
    x, y = (models[k] for k in of)
    beside = x.tails[0] * y.remainder + x.remainder * y.whole
    return step.model(result, _overflow(x, y) + beside)


def _scaled(step: _Step, of: _Of, result: Series, models: Any) -> Model:
    factor, y = (models[k] for k in of)
    return step.model(result, factor.series[0] * y.remainder)


def _quotient(step: _Step, of: _Of, result: Series, models: Any) -> Model:
    x, y = (models[k] for k in of)
    own = step.model(result, _ZERO)
    left = x.remainder - _overflow(own, y) - own.tails[0] * y.remainder
    return step.model(result, left / y.whole)


def _root(step: _Step, of: _Of, result: Series, models: Any) -> Model:
    x, own = models[of[0]], step.model(result, _ZERO)
    left = x.remainder - _overflow(own, own)
    return step.model(result, left / (x.whole.sqrt() + own.tails[0]))


def _wave(step: _Step, of: _Of, result: Any, models: Any) -> Wave:
    """Sine and cosine: what their polynomials lack turns with the angle, and does not grow.

    With the angle's polynomial P, s~' - P' c~ and c~' + P' s~ begin with t^p.
    """
    angle: Model = models[of[0]]
    sine, cosine = step.model(result.sine, _ZERO), step.model(result.cosine, _ZERO)
    rates = result.weighted[1:]
    lacks: list[Ball] = [sum(map(mul, rates, x.tails[:0:-1]), _ZERO) for x in (sine, cosine)]
    parts = [squared(lack.abs_upper()) for lack in lacks]
    size = (parts[0] + parts[1]).sqrt() / len(result.sine)
    wide = arb(0, (size + angle.remainder.abs_upper()).upper())
    return Wave(step.model(result.sine, wide), step.model(result.cosine, wide))


def _sine(_: _Step, of: _Of, __: Series, models: Any) -> Model:
    return models[of[1]].sine


def _cosine(_: _Step, of: _Of, __: Series, models: Any) -> Model:
    return models[of[1]].cosine


def _system(step: _Step, of: _Of, result: Any, models: Any) -> Solved:
    """K (s - s~) = r - K s~, which begins with t^(p+1)."""
    n = unknowns(of)
    own = [step.model(list(series), _ZERO) for series in zip(*result.solution, strict=True)]
    left: list[list[Ball]] = []
    for i in range(n):
        rest = models[of[n * n + i]].remainder
        for place, s in zip(of[i * n : (i + 1) * n], own, strict=True):
            entry: Model = models[place]
            rest = rest - _overflow(entry, s) - entry.remainder * s.tails[0]
        left.append([rest])
    matrix = arb_mat(n, n, [models[place].whole for place in of[: n * n]])
    whole = Factored.of(matrix)
    found = whole.solution(arb_mat(left)).entries()
    solved = [step.model(s.series, r) for s, r in zip(own, found, strict=True)]
    return Solved(solved, result.first, whole)


def _solution(_: _Step, of: _Of, __: Series, models: Any) -> Model:
    return models[of[0]].unknowns[of[1]]


_MODELS: dict[str, Callable[[_Step, Any, Any, Any], Any]] = {
    "number": _exact,
    "constant": _exact,
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
