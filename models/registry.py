"""Machines by name."""

from __future__ import annotations

from collections.abc import Callable
from difflib import get_close_matches

from .errors import InputError
from .mechanism import Mechanism
from .parameters import TrebuchetParameters
from .trebuchet import fixed, rolling

_MODELS: dict[str, tuple[Callable[[TrebuchetParameters | None], Mechanism], str]] = {
    "fixed": (fixed, "whipper trebuchet, fulcrum pinned to the ground (paper, Sec. II)"),
    "rolling": (rolling, "whipper trebuchet, fulcrum rolling along x on massless wheels (paper, Sec. VI)"),
}


def models() -> dict[str, str]:
    """Names and one-line descriptions of the machines."""
    return {name: text for name, (_, text) in _MODELS.items()}


def model(name: str, parameters: TrebuchetParameters | None = None) -> Mechanism:
    """A named machine.

    Raises:
        InputError: no machine has that name; the sentence lists the names there are.
    """
    if name not in _MODELS:
        close = get_close_matches(name, _MODELS, n=1)
        hint = f" (did you mean {close[0]!r}?)" if close else ""
        raise InputError(f"there is no model {name!r}{hint}; there are: {', '.join(_MODELS)}.")
    return _MODELS[name][0](parameters)
