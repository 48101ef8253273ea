"""Engines, each behind the same protocol, none imported before it is asked for.

`trebucheck.engines` is the function that lists them, and this subpackage has the same name: the
function has the subpackage's attributes, so that `trebucheck.engines.registry` is found either way,
in whatever order they are imported (see `trebucheck/__init__.py`).
"""

from __future__ import annotations

from .registry import engines

__all__ = ["engines"]

engines.__dict__ = globals()
