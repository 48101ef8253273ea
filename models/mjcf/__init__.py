"""MJCF, MuJoCo's model format: the writer, and the committed models of the named machines.

`from trebucheck.models.mjcf import rolling` gives paths: `rolling.MJCF_PATH`, `rolling.PACKAGE_PATH`.
"""

from __future__ import annotations

from typing import Any


def __getattr__(name: str) -> Any:
    from ..machines.registry import models
    from .paths import description

    machine = name.replace("_", "-")
    if machine not in models():
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return description(machine)
