"""Numbers as a paper prints them: a value, and the half unit of the last digit that it may be off by rounding."""

from __future__ import annotations

import re
from decimal import Decimal
from typing import NamedTuple

from ..models.errors import InputError

_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?")


class Printed(NamedTuple):
    """A printed number."""

    value: float
    half: float
    """Half a unit of the last printed digit: whatever rounds to the number lies within it."""


def parse(text: str) -> Printed:
    """The first number of a text, with its printed digits: '99.4' is 99.4 to within 0.05, '2.42:1' 2.42 to 0.005.

    Raises:
        InputError: there is no number in it.
    """
    found = _NUMBER.search(text)
    if found is None:
        raise InputError(f"printed = {text!r} holds no number; one with its printed digits is needed, such as '99.4'.")
    number = Decimal(found.group())
    exponent = number.as_tuple().exponent
    assert isinstance(exponent, int)  # a number of the pattern is finite
    return Printed(float(number), 0.5 * 10.0**exponent)
