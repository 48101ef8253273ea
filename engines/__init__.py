"""Engines, each behind the same protocol, none imported before it is asked for.

The public function `trebucheck.engines()` and this subpackage share one name. Python binds a
subpackage to its parent whenever it is first imported, so the only answer that does not depend on
the order of imports is a module that can be called.
"""

from __future__ import annotations

import sys
from types import ModuleType

from .registry import EngineStatus, engines


class _CallableModule(ModuleType):
    def __call__(self) -> dict[str, EngineStatus]:
        """See :func:`.registry.engines`."""
        return engines()


sys.modules[__name__].__class__ = _CallableModule
