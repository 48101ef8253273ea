"""Tasks to learn on, for Gymnasium: importing this package registers them.

>>> env = gymnasium.make("trebucheck_environments:trebucheck/Throw-v0")  # doctest: +SKIP

Gymnasium has read no entry points of packages since version 1.0: the part before the colon names
the module that it imports first. After an import of this package the name is "trebucheck/Throw-v0".
"""

from __future__ import annotations

from trebucheck.api.mechanics import EngineNotInstalledError

try:
    import gymnasium
except ImportError as error:
    raise EngineNotInstalledError(
        f"environments need Gymnasium, which 'pip install trebucheck[gym]' brings: {error}"
    ) from error

from .classic_control import Classic, classic_control
from .throw import HOLD, RELEASE, ThrowEnv

__all__ = ["HOLD", "RELEASE", "Classic", "ThrowEnv", "classic_control"]

gymnasium.register("trebucheck/Throw-v0", entry_point=f"{__name__}:ThrowEnv")
