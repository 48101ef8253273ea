"""Zeros of a function over a step: proved to be there, and to be the only ones.

An interval of the step holds no zero where the function's enclosure has one sign. Where its slope's
enclosure has one sign there is at most one zero, and the signs at the ends tell whether there is.
What neither decides is halved, until it is decided or too short. The zero itself is enclosed by
Newton's method in balls (Moore, *Methods and Applications of Interval Analysis*, 1979, ch. 5).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

from .balls import Ball, arb, between, exact
from .steps import TaylorModel

_HALVINGS = 40  # of a step, before a zero is undecided
_PARTS = 4  # of a step, on each of which a sign is looked for
_NEWTON = 60  # iterations at most


@dataclass
class UndecidedZeroError(Exception):
    """Balls do not tell whether a function has a zero here; which inequality stays open."""

    low: Fraction
    """Since the step's start [s]."""
    high: Fraction
    inequality: str


@dataclass(frozen=True)
class Zero:
    """A zero of a function: the only one in an interval, where it changes its sign."""

    time: Ball
    """Since the step's start [s]."""
    falls: bool


def zeros(
    function: TaylorModel, slope: TaylorModel, length: Fraction, begin: Fraction = Fraction(0)
) -> Iterator[Zero]:
    """Enclose the zeros of a function over a step, in their order.

    Args:
        function, slope: the function and its derivative.
        length: of the step [s].
        begin: time from which it is looked at [s].

    Raises:
        UndecidedZeroError: a double zero, or one at an end of the step, to the balls' precision.
    """
    waiting = [(begin, length, 0)] if begin < length else []
    while waiting:
        low, high, halvings = waiting.pop()
        start, end = exact(low), exact(high)
        interval = between(start, end)
        if _sign(function.at(interval)):
            continue
        if _sign(slope.at(interval)):
            before, after = _sign(function.at(start)), _sign(function.at(end))
            if before and after:
                if before != after:
                    yield Zero(_located(function, slope, interval), falls=before > 0)
                continue
        if halvings == _HALVINGS:
            raise UndecidedZeroError(low, high, "f != 0 or f' != 0")
        middle = _beside_middle(low, high)
        waiting += [(middle, high, halvings + 1), (low, middle, halvings + 1)]


def keeps_sign(function: TaylorModel, length: Fraction) -> bool:
    """Tell whether a function is proved to have one sign over a step."""
    signs: set[int] = set()
    for k in range(_PARTS):
        part = between(exact(length * k / _PARTS), exact(length * (k + 1) / _PARTS))
        signs.add(_sign(function.at(part)))
    return len(signs) == 1 and 0 not in signs


def _beside_middle(low: Fraction, high: Fraction) -> Fraction:
    """A point with few bits beside the middle, where symmetric motions have their zeros."""
    finer = Fraction(2) ** (_finest(high - low) - 6)
    return finer * round((low + high) / 2 / finer - Fraction(13, 10))


def _finest(width: Fraction) -> int:
    """Exponent of a power of two that is at most a width."""
    return width.numerator.bit_length() - width.denominator.bit_length() - 1


def clear_of_start(function: TaylorModel, length: Fraction, known: int) -> tuple[int, Fraction]:
    """The sign of a function that begins at zero, and a time until which it is proved to have it.

    The first derivative there that is not zero has its sign over that time.

    Args:
        function: its value is zero by what it stands for.
        length: of the step [s].
        known: number of derivatives that are zero there, too, by what it stands for.

    Raises:
        UndecidedZeroError: balls do not tell the sign of the next derivative.
    """
    derivative = function
    for k in range(1, len(function.coefficients)):
        derivative = derivative.derivative()
        first = derivative.coefficients[0]
        sign = _sign(first)
        if not sign:
            if k <= known or first.is_zero():
                continue
            break
        until = length
        for _ in range(_HALVINGS):
            if _sign(derivative.at(between(arb(0), exact(until)))) == sign:
                return sign, until
            until /= 2
        break
    raise UndecidedZeroError(Fraction(0), length, "a derivative != 0")


def _sign(ball: Ball) -> int:
    """1 or -1 of a ball without zero, else 0."""
    if ball > 0:
        return 1
    return -1 if ball < 0 else 0


def _located(function: TaylorModel, slope: TaylorModel, interval: Ball) -> Ball:
    """The only zero in an interval in which the slope has one sign."""
    for _ in range(_NEWTON):
        middle = interval.mid()
        found = middle - function.at(middle) / slope.at(interval)
        if not found.is_finite() or not found.overlaps(interval):
            break
        narrower = found.intersection(interval)
        if not narrower.rad() < 0.9 * interval.rad():
            return narrower
        interval = narrower
    return interval
