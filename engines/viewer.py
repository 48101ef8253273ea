"""Engines' own interactive viewers."""

from __future__ import annotations

import os
import sys
from typing import Protocol, runtime_checkable

from ..models.errors import InputError
from ..models.mechanism import Mechanism
from .protocol import Engine
from .registry import engine_class


@runtime_checkable
class Viewable(Protocol):
    """An engine with a viewer; one of a plug-in may have it as well."""

    def view(self, mechanism: Mechanism) -> None:
        """Open a window on the mechanism, and return when it is closed."""
        ...


def has_viewer(name: str) -> bool:
    """Whether an engine of that name is here and has a viewer."""
    known = engine_class(name)
    return hasattr(known, "view") and known.is_installed()


def view(engine: Engine, mechanism: Mechanism) -> None:
    """Open an engine's own viewer, and return when it is closed.

    Raises:
        InputError: the engine has none, or there is no display.
        EngineNotInstalledError: the engine's package is not here.
    """
    if not isinstance(engine, Viewable):
        raise InputError(
            f"{engine.name} has no viewer of its own; `trebucheck animate` writes a page to play."
        )
    if sys.platform == "linux" and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        raise InputError(
            "a viewer needs a display, and there is none here (neither DISPLAY nor WAYLAND_DISPLAY is set); "
            "`trebucheck animate` writes a file instead."
        )
    engine.view(mechanism)
