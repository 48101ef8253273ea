"""How numbers read, on pages, in terminals and in the README."""

from __future__ import annotations

import re
from collections.abc import Mapping


def format_number(value: float | None) -> str:
    """Two significant digits; a dash for none."""
    if value is None:
        return "–"
    return "0" if value == 0 else _scientific(value, digits=1)


def format_value(value: object) -> str:
    """Any value of a table: a number to six digits, a dash for none."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def format_step(value: object) -> str:
    """A time step with as many digits as it needs, four at most; a dash for what is no number."""
    if not isinstance(value, float):
        return "–"
    digits = next(n for n in range(17) if float(_scientific(value, n)) == value or n == 3)
    return _scientific(value, digits)


def _scientific(value: float, digits: int) -> str:
    mantissa, exponent = f"{value:.{digits}e}".split("e")
    return f"{mantissa}e{int(exponent)}"


def format_percent(fraction: float | None) -> str:
    """A signed share in per cent, a dash for none."""
    if fraction is None:
        return "–"
    value = 100.0 * fraction
    if abs(value) >= 10:
        return f"{value:.0f} %"
    return f"{value:.1f} %" if abs(value) >= 0.1 else ("0 %" if value == 0 else "< 0.1 %")


def format_settings(settings: Mapping[str, object]) -> str:
    """Options and their values in a line."""
    return ", ".join(f"{name} = {value}" for name, value in settings.items())


def sentence(text: str) -> str:
    """A sentence with a capital and a full stop; a symbol at its beginning, such as l1, is kept."""
    first = re.match(r"\w*", text)
    word = first.group() if first else ""
    capital = text[:1].upper() + text[1:] if len(word) > 1 and word.isalpha() else text
    return capital if text.endswith(".") else f"{capital}."
