"""Machines by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

from ..errors import InputError
from ..mechanism import Mechanism
from ..spec import Spec
from .catapult import CatapultParameters, catapult
from .floating_arm import FloatingArmParameters, floating_arm
from .parameters import TrebuchetParameters
from .trebuchet import HingedParameters, fixed, hinged, rolling


@dataclass(frozen=True)
class _Model:
    build: Callable[[Any], Mechanism]
    parameters: type[Spec]
    text: str


_MODELS = {
    "fixed": _Model(fixed, TrebuchetParameters, "whipper trebuchet, fulcrum pinned to the ground (paper, Sec. II)"),
    "rolling": _Model(
        rolling, TrebuchetParameters, "whipper trebuchet, fulcrum rolling along x on massless wheels (paper, Sec. VI)"
    ),
    "catapult": _Model(
        catapult, CatapultParameters, "one rigid body: counterweight and projectile on one arm (paper, Sec. I)"
    ),
    "hinged": _Model(
        hinged,
        HingedParameters,
        "hinged counterweight, classical orientation, sling from a trough (Denny, paper Ref. 1)",
    ),
    "floating-arm": _Model(
        floating_arm,
        FloatingArmParameters,
        "counterweight in a vertical track, arm's wheel on a level one (paper, Sec. VI)",
    ),
}


def models() -> dict[str, str]:
    """Names and one-line descriptions of the machines."""
    return {name: entry.text for name, entry in _MODELS.items()}


def parameters_type(name: str) -> type[Spec]:
    """The class of a named machine's parameters.

    Raises:
        InputError: no machine has that name; the sentence lists the names there are.
    """
    return _entry(name).parameters


def model(name: str, parameters: Spec | None = None) -> Mechanism:
    """A named machine.

    Args:
        parameters: of the class that :func:`parameters_type` says; its defaults where left out.

    Raises:
        InputError: no machine has that name, or its parameters are of another class.
    """
    entry = _entry(name)
    if parameters is not None and not isinstance(parameters, entry.parameters):
        raise InputError(
            f"model {name!r} is built from {entry.parameters.__name__}, not from {type(parameters).__name__}."
        )
    return entry.build(parameters)


def _entry(name: str) -> _Model:
    if name not in _MODELS:
        close = get_close_matches(name, _MODELS, n=1)
        hint = f" (did you mean {close[0]!r}?)" if close else ""
        raise InputError(f"there is no model {name!r}{hint}; there are: {', '.join(_MODELS)}.")
    return _MODELS[name]
