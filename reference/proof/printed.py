"""Printed numbers beside proved ones: whether an enclosure lies where the print says.

A number that is printed with n digits stands for all that round to it: an interval of half a unit
of its last printed place to both sides. What is proved is consistent with it if the enclosure meets
that interval; it is decided where the enclosure lies wholly in it, or wholly outside.
"""

from __future__ import annotations

from decimal import Decimal
from enum import StrEnum
from fractions import Fraction
from typing import NamedTuple

from ...models.errors import InputError
from .proof import Enclosure


class Standing(StrEnum):
    """Place of an enclosure beside an interval."""

    INSIDE = "inside"
    OUTSIDE = "outside"
    OPEN = "across its end"


class ClosedInterval(NamedTuple):
    """Values for which a statement holds, ends included; None: it has no end there."""

    low: Fraction | None
    high: Fraction | None

    @classmethod
    def rounding_to(cls, digits: str) -> ClosedInterval:
        """Numbers that round to a printed one, such as '99.4' or '1.5e-3'.

        Raises:
            InputError: it is no decimal number.
        """
        try:
            number = Decimal(digits)
        except ArithmeticError:
            raise InputError(
                f"printed = {digits!r} is no decimal number, such as '99.4'."
            ) from None
        exponent = number.as_tuple().exponent
        if not isinstance(exponent, int):
            raise InputError(f"printed = {digits!r} is not finite.")
        half = Fraction(10) ** exponent / 2
        return cls(Fraction(number) - half, Fraction(number) + half)

    @classmethod
    def around(cls, value: float, tolerance: float) -> ClosedInterval:
        """Numbers within a tolerance of a value."""
        return cls(Fraction(value) - Fraction(tolerance), Fraction(value) + Fraction(tolerance))

    def standing(self, enclosure: Enclosure) -> Standing:
        """Where an enclosure lies."""
        low, high = _ends(enclosure)
        if (self.low is None or self.low <= low) and (self.high is None or high <= self.high):
            return Standing.INSIDE
        beyond = self.high is not None and low > self.high
        before = self.low is not None and high < self.low
        return Standing.OUTSIDE if beyond or before else Standing.OPEN

    def distance(self, enclosure: Enclosure) -> Fraction:
        """Distance of an enclosure from the middle, or from the only end, at least."""
        low, high = _ends(enclosure)
        if self.low is not None and self.high is not None:
            stated = (self.low + self.high) / 2
        else:
            stated = self.low if self.low is not None else self.high
        if stated is None or low <= stated <= high:
            return Fraction(0)
        return min(abs(low - stated), abs(high - stated))


def _ends(enclosure: Enclosure) -> tuple[Fraction, Fraction]:
    value, radius = map(Fraction, enclosure)
    return value - radius, value + radius
