"""One step of a proved motion: a box that it does not leave, and a polynomial with a remainder.

A box Q, U of coordinates and speeds contains the motion over a step [0, h] if Picard's operator
takes it into itself: q0 + [0, h] U within Q, and u0 + [0, h] a(Q, U) within U. Then the motion is
its Taylor polynomial of order p at the start, evaluated in balls, plus h^(p+1) times the
coefficient of order p + 1 on the box (Moore, *Methods and Applications of Interval Analysis*, 1979,
ch. 8).

Balls grow by evaluating polynomials on balls (wrapping). No mean-value form fights that here: bits
are cheap, and :mod:`.proof` takes as many as are needed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from .balls import Ball, arb, between, precision, radius, rounded
from .tape import Series, Tape

_BOX_BITS = 80  # of boxes, which are wide
_INFLATIONS = 8  # of a box that the motion may leave, before the step is halved
_WIDER = 0.1  # by which each is widened
_SHORTEST = 2.0**-60  # [s]
_CLOSER = 0.95  # of the step that a remainder promises: the box grows with it
_MANTISSA = 8  # parts of a power of two that steps are whole numbers of


@dataclass(frozen=True)
class TaylorModel:
    """A function of time over a step, sum c_k t^k + r t^(p+1), which encloses it."""

    coefficients: Series
    remainder: Ball

    def at(self, t: Ball) -> Ball:
        """Enclose its values at the times of a ball, which are within the step."""
        value = self.remainder
        for c in reversed(self.coefficients):
            value = value * t + c
        return value

    def derivative(self) -> TaylorModel:
        """Its derivative, whose remainder is that of one order less."""
        kept = [k * c for k, c in enumerate(self.coefficients)][1:]
        return TaylorModel(kept, len(self.coefficients) * self.remainder)


@dataclass(frozen=True)
class Step:
    """A step of a motion and of functions of its state."""

    start: Fraction
    """Since the last event [s]."""
    length: Fraction
    state: list[TaylorModel]
    """Models of q, then of u."""
    functions: list[TaylorModel]
    slopes: list[TaylorModel]
    """Derivatives of the functions."""

    @property
    def end(self) -> Fraction:
        """Since the last event [s]."""
        return self.start + self.length

    def at(self, t: Ball) -> tuple[list[Ball], list[Ball]]:
        """Coordinates and speeds at a time since the step's start [s]."""
        values = [model.at(t) for model in self.state]
        return values[: len(values) // 2], values[len(values) // 2 :]


class NoBoxError(Exception):
    """No box was found that the motion does not leave, however short the step."""


@dataclass
class StepMaker:
    """Makes steps of a motion under one set of closed stops.

    Args:
        tape: accelerations and functions.
        numbers: of the mechanism.
        order: of the polynomials.
        remainder: largest that a step may have, in parts of one [rad, m and per s].
    """

    tape: Tape
    numbers: Sequence[Ball]
    order: int
    remainder: float
    longest: float = 2.0**-7
    """The next step is no longer than this [s]."""

    def step(self, start: Fraction, q: Sequence[Ball], u: Sequence[Ball], left: Fraction) -> Step:
        """Make a step from a state.

        Args:
            start: since the last event [s].
            q, u: the state.
            left: longest that the step may be [s].

        Raises:
            NoBoxError: no step is short enough.
        """
        order = self.order
        state, functions = self.tape.expand(self.numbers, q, u, order)
        self.longest = min(self.longest, self._promised(state))
        while self.longest >= _SHORTEST:
            length = min(_dyadic(self.longest), left)
            with precision(_BOX_BITS):
                box = self._box(q, u, length)
                if box is None:
                    self.longest = float(length) / 2
                    continue
                on_box, of_functions = self.tape.expand(self.numbers, *box, order + 1)
            sizes = [_size(series[-1]) for series in on_box]
            for series, there in zip(functions, of_functions, strict=True):
                sizes.append(_size(there[-1]) / max(1.0, _size(series[0])))
            # The remainder in parts of that allowed: it goes at least as h^(order + 1).
            parts = max(sizes) * float(length) ** (order + 1) / self.remainder
            factor = _CLOSER * parts ** (-1 / (order + 1)) if 0 < parts < math.inf else 0.25
            self.longest = float(length) * min(max(factor, 0.25), 2.0)
            if not parts <= 1.0:
                continue
            models = [TaylorModel(c, b[-1]) for c, b in zip(state, on_box, strict=True)]
            values = [TaylorModel(c, b[-1]) for c, b in zip(functions, of_functions, strict=True)]
            slopes = [model.derivative() for model in values]
            return Step(start, length, models, values, slopes)
        raise NoBoxError

    def _promised(self, state: Sequence[Series]) -> float:
        """Step at which the last coefficients are as small as the remainder [s]."""
        longest = math.inf
        for k, order in ((-1, self.order), (-2, self.order - 1)):
            size = max(_size(series[k]) for series in state)
            if 0 < size < math.inf:
                longest = min(longest, (self.remainder / size) ** (1 / order))
        return longest

    def _box(
        self, q: Sequence[Ball], u: Sequence[Ball], length: Fraction
    ) -> tuple[list[Ball], list[Ball]] | None:
        """Coordinates and speeds that the motion does not leave over a step; None: not found."""
        time = between(arb(0), rounded(length))
        speeds = self._reached(q, u, u, time)
        for _ in range(_INFLATIONS):
            if speeds is None:
                return None
            wider = [_widened(v) for v in speeds]
            reached = self._reached(q, u, wider, time)
            if reached is None:
                return None
            if all(w.contains(r) for w, r in zip(wider, reached, strict=True)):
                return [x + time * v for x, v in zip(q, reached, strict=True)], reached
            speeds = [between(w, r) for w, r in zip(wider, reached, strict=True)]
        return None

    def _reached(
        self, q: Sequence[Ball], u: Sequence[Ball], speeds: Sequence[Ball], time: Ball
    ) -> list[Ball] | None:
        """Speeds that Picard's operator makes of some; None where accelerations are not finite."""
        positions = [x + time * v for x, v in zip(q, speeds, strict=True)]
        accelerations = self.tape.accelerations(self.numbers, positions, speeds)
        if not all(a.is_finite() for a in accelerations):
            return None
        return [v + time * a for v, a in zip(u, accelerations, strict=True)]


def _dyadic(value: float) -> Fraction:
    """The next number below one that is exact in few bits."""
    mantissa, exponent = math.frexp(value)
    return Fraction(math.floor(mantissa * _MANTISSA), _MANTISSA) * Fraction(2) ** exponent


def _size(ball: Ball) -> float:
    """An upper bound of the absolute values in a ball; infinite where it is not finite."""
    return float(ball.abs_upper()) if ball.is_finite() else math.inf


def _widened(ball: Ball) -> Ball:
    """A ball with the same middle, and a radius that is larger than its own."""
    more = radius(ball) * _WIDER + 1e-30 * (1.0 + _size(ball))
    return ball + arb(0, more)
