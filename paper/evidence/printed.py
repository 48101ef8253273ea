"""The numbers the paper prints, each written here once: a value, and the half unit of its last digit."""

from __future__ import annotations

import re
from decimal import Decimal
from typing import NamedTuple

from ...models.errors import InputError

_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?")


class Printed(NamedTuple):
    """A printed number."""

    text: str
    """As printed, with its unit."""
    digits: str
    """The number alone."""
    value: float
    half: float
    """Half a unit of the last printed digit: whatever rounds to the number lies within it."""

    def __str__(self) -> str:
        return self.text


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
    return Printed(text, found.group(), float(number), 0.5 * 10.0**exponent)


# Sec. IV: the best release of the fixed machine.
RELEASE_TIME, BEST_ANGLE = parse("2.745 s"), parse("45°")
SLING_ANGLE, SLING_RADIANS = parse("585°"), parse("10.2 rad")
TIME_STEP, CAPTION_STEP = 0.005, 0.01
"""Between the release times [s] that the range is sampled at: by the text (Sec. IV), and by the caption of Fig. 4."""

# Sec. V: the fulcrum's position on a beam of fixed length.
LAUNCH_SPEED, LEVER_RATIO, BEAM = parse("99.4 m/s"), parse("2.5:1"), parse("14 m")
BEST_L1, BEST_SPEED, BEST_RATIO = parse("9.91 m"), parse("100.55 m/s"), parse("2.42:1")
TABLE_L1, BACKWARD_L1, ZERO_L1, END_L1 = parse("10 m"), parse("9.9 m"), parse("10.3 m"), parse("12.7 m")
NO_SPEED = parse("0 m/s")

# Secs. VI and VII: rolling against fixed, and the error of the paper's computation.
RATIOS = {"fixed": parse("1.42"), "rolling": parse("1.83")}
"""R, the projectile's kinetic over the total energy, at 45 degrees."""
ENERGY_GAIN, SPEED_GAIN = parse("1.3"), parse("13 m/s")
SWING, WAY = parse("3.3 m"), parse("6.6 m")
ENERGY_ERROR, ENERGY_SHARE, JOULE_SHARE = parse("< 1 J"), parse("< 0.0005 %"), parse("0.0005 %")
