"""Ball arithmetic of python-flint, as the rest of the prover uses it."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from contextlib import contextmanager
from decimal import ROUND_CEILING, Context, Decimal
from fractions import Fraction
from typing import Any

import flint

Ball = Any
"""A real ball, flint.arb: it contains the exact result of what it was computed from."""

Matrix = Any
"""A matrix of real balls, flint.arb_mat."""

acb: Any = flint.acb
arb: Any = flint.arb
arb_mat: Any = flint.arb_mat
fmpz_mat: Any = flint.fmpz_mat


@contextmanager
def precision(bits: int) -> Generator[None, None, None]:
    """Compute with so many bits meanwhile. The context is one of the whole process."""
    before = flint.ctx.prec
    flint.ctx.prec = bits
    try:
        yield
    finally:
        flint.ctx.prec = before


def exact(value: Fraction) -> Ball:
    """A dyadic number, such as a sum of steps, without rounding: with as many bits as it has.

    Raises:
        ValueError: it is not dyadic.
    """
    if value.denominator & (value.denominator - 1):
        raise ValueError(f"{value} is no dyadic number")
    with precision(max(value.numerator.bit_length(), 2)):
        return arb(flint.fmpq(value.numerator, value.denominator))


def rounded(value: Fraction) -> Ball:
    """A ball that contains a number, as narrow as the context's precision makes it."""
    return arb(flint.fmpq(value.numerator, value.denominator))


def squared(ball: Ball) -> Ball:
    """A square; the power of a ball about zero is no number in Arb."""
    return ball * ball


def between(low: Ball, high: Ball) -> Ball:
    """The least ball that contains both."""
    return low.union(high)


def identity(n: int) -> Matrix:
    """The identity, n times n."""
    return arb_mat([[int(i == j) for j in range(n)] for i in range(n)])


def polynomial(coefficients: Sequence[Any], remainder: Any, t: Ball) -> Any:
    """Value at t of sum c_k t^k + r t^(n+1), with n + 1 coefficients: balls, or matrices."""
    value = remainder
    for c in reversed(coefficients):
        value = value * t + c
    return value


def diagonal(values: Sequence[Ball | float]) -> Matrix:
    """The matrix with such a diagonal."""
    n = range(len(values))
    return arb_mat([[values[i] if i == j else 0 for j in n] for i in n])


def absolute(matrix: Matrix) -> Matrix:
    """Upper bounds of absolute values, exact."""
    sizes = [x.abs_upper() for x in matrix.entries()]
    return arb_mat(matrix.nrows(), matrix.ncols(), sizes)


def as_decimals(ball: Ball) -> tuple[Decimal, Decimal]:
    """Value and radius as decimals that enclose the ball.

    The value has as many digits as the radius leaves, and two more; what the value is rounded by is
    in the radius.
    """
    middle, spread = _fraction(ball.mid()), _fraction(ball.rad())
    if not spread:
        digits = 60
    else:
        size = max(abs(middle), spread)
        digits = max(3, _exponent(size) - _exponent(spread) + 3)
    context = Context(prec=digits)
    value = context.divide(Decimal(middle.numerator), Decimal(middle.denominator))
    off = spread + abs(Fraction(value) - middle)
    upwards = Context(prec=3, rounding=ROUND_CEILING)
    return value, upwards.divide(Decimal(off.numerator), Decimal(off.denominator))


def _exponent(value: Fraction) -> int:
    """Power of ten next below a positive number, or one beside it."""
    return len(str(value.numerator)) - len(str(value.denominator))


def _fraction(exact_ball: Ball) -> Fraction:
    """An exact ball as a fraction."""
    mantissa, exponent = exact_ball.man_exp()
    mantissa, exponent = int(mantissa), int(exponent)
    return Fraction(mantissa) * Fraction(2) ** exponent
