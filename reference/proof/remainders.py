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
from operator import mul
from typing import Any, NamedTuple

from .balls import Ball, arb, arb_mat, between, squared
from .tape import Expansion, Factored, Series, unknowns

_ZERO = arb(0)


class Remainders(NamedTuple):
    """Ranges and remainders over a step of an expansion's variables and outputs."""

    state: list[Ball]
    """Values of the polynomials of q, then u."""
    outputs: list[Ball]
    """Remainders of the accelerations, then the functions, in parts of t^(p+1)."""


@dataclass(frozen=True)
class _Model:
    """A result over the step."""

    series: Series
    """Its coefficients of t^0 ... t^p."""
    tails: Series
    """Z_0 ... Z_p."""
    remainder: Ball
    whole: Ball
    """Its values, with the remainder."""


@dataclass(frozen=True)
class _Wave:
    """A sine and a cosine."""

    sine: _Model
    cosine: _Model


@dataclass(frozen=True)
class _Solved:
    """The solution of a linear system."""

    unknowns: list[_Model]


class _Step(NamedTuple):
    """Times and their powers, on which remainders depend beside the operations."""

    time: Ball
    """0 to h."""
    last: Ball
    """Powers t^(p+1)."""

    def model(self, series: Series, remainder: Ball) -> _Model:
        """A result with its tails."""
        tail, tails = _ZERO, Series()
        for c in reversed(series):
            tail = c + self.time * tail
            tails.append(tail)
        tails.reverse()
        return _Model(series, tails, remainder, tail + remainder * self.last)


def remainders(expansion: Expansion, length: Ball) -> Remainders:
    """Enclose what the outputs have beside their polynomials along the state's polynomials.

    Args:
        expansion: of a motion, up to order p.
        length: h [s].

    Returns:
        Balls that are not finite where a result may not exist.
    """
    order = len(expansion.state[0]) - 1
    step = _Step(between(_ZERO, length), between(_ZERO, length ** (order + 1)))
    models: list[Any] = []
    for operation, result in zip(expansion.operations, expansion.results, strict=True):
        models.append(_MODELS[operation.kind](step, operation.arguments, result, models))
    state = [step.model(series, _ZERO).whole for series in expansion.state]
    return Remainders(state, [models[place].remainder for place in expansion.outputs])


def _overflow(x: _Model, y: _Model) -> Ball:
    """The terms of a product of polynomials beyond t^p, in parts of t^(p+1)."""
    return sum(map(mul, x.series[1:], y.tails[:0:-1]), _ZERO)


_Of = Sequence[int]


def _exact(step: _Step, _: _Of, result: Series, __: Any) -> _Model:
    return step.model(result, _ZERO)


def _sum(step: _Step, of: _Of, result: Series, models: Any) -> _Model:
    x, y = (models[k] for k in of)
    return step.model(result, x.remainder + y.remainder)


def _difference(step: _Step, of: _Of, result: Series, models: Any) -> _Model:
    x, y = (models[k] for k in of)
    return step.model(result, x.remainder - y.remainder)


def _negative(step: _Step, of: _Of, result: Series, models: Any) -> _Model:
    return step.model(result, -models[of[0]].remainder)


def _product(step: _Step, of: _Of, result: Series, models: Any) -> _Model:
    x, y = (models[k] for k in of)
    beside = x.tails[0] * y.remainder + x.remainder * y.whole
    return step.model(result, _overflow(x, y) + beside)


def _scaled(step: _Step, of: _Of, result: Series, models: Any) -> _Model:
    factor, y = (models[k] for k in of)
    return step.model(result, factor.series[0] * y.remainder)


def _quotient(step: _Step, of: _Of, result: Series, models: Any) -> _Model:
    x, y = (models[k] for k in of)
    own = step.model(result, _ZERO)
    left = x.remainder - _overflow(own, y) - own.tails[0] * y.remainder
    return step.model(result, left / y.whole)


def _root(step: _Step, of: _Of, result: Series, models: Any) -> _Model:
    x, own = models[of[0]], step.model(result, _ZERO)
    left = x.remainder - _overflow(own, own)
    return step.model(result, left / (x.whole.sqrt() + own.tails[0]))


def _wave(step: _Step, of: _Of, result: Any, models: Any) -> _Wave:
    """Sine and cosine: what their polynomials lack turns with the angle, and does not grow.

    With the angle's polynomial P, s~' - P' c~ and c~' + P' s~ begin with t^p.
    """
    angle: _Model = models[of[0]]
    sine, cosine = step.model(result.sine, _ZERO), step.model(result.cosine, _ZERO)
    rates = result.weighted[1:]
    lacks: list[Ball] = [sum(map(mul, rates, x.tails[:0:-1]), _ZERO) for x in (sine, cosine)]
    parts = [squared(lack.abs_upper()) for lack in lacks]
    size = (parts[0] + parts[1]).sqrt() / len(result.sine)
    wide = arb(0, (size + angle.remainder.abs_upper()).upper())
    return _Wave(step.model(result.sine, wide), step.model(result.cosine, wide))


def _sine(_: _Step, of: _Of, __: Series, models: Any) -> _Model:
    return models[of[1]].sine


def _cosine(_: _Step, of: _Of, __: Series, models: Any) -> _Model:
    return models[of[1]].cosine


def _system(step: _Step, of: _Of, result: Any, models: Any) -> _Solved:
    """K (s - s~) = r - K s~, which begins with t^(p+1)."""
    n = unknowns(of)
    own = [step.model(list(series), _ZERO) for series in zip(*result.solution, strict=True)]
    left: list[list[Ball]] = []
    for i in range(n):
        rest = models[of[n * n + i]].remainder
        for place, s in zip(of[i * n : (i + 1) * n], own, strict=True):
            entry: _Model = models[place]
            rest = rest - _overflow(entry, s) - entry.remainder * s.tails[0]
        left.append([rest])
    matrix = arb_mat(n, n, [models[place].whole for place in of[: n * n]])
    found = Factored.of(matrix).solution(arb_mat(left)).entries()
    return _Solved([step.model(s.series, r) for s, r in zip(own, found, strict=True)])


def _solution(_: _Step, of: _Of, __: Series, models: Any) -> _Model:
    return models[of[0]].unknowns[of[1]]


_MODELS: dict[str, Callable[[_Step, Any, Any, Any], Any]] = {
    "number": _exact,
    "constant": _exact,
    "variable": _exact,
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
