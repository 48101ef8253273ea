"""Engines by name and their protocol, for distributions built on trebucheck."""

from __future__ import annotations

from ..engines.protocol import Engine
from ..engines.reference.engine import ReferenceEngine
from ..engines.registry import engine, engine_class, engine_names

__all__ = [
    "Engine",
    "ReferenceEngine",
    "engine",
    "engine_class",
    "engine_names",
]
