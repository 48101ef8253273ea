"""MJCF, MuJoCo's model format: the writer, and the committed models of the named machines.

A module of each machine has the paths of its files, as `robot_descriptions` names them:
`rolling.MJCF_PATH` of `from trebucheck.models.mjcf import rolling` or of `import
trebucheck.models.mjcf.rolling`.
"""

from __future__ import annotations

import sys
from types import ModuleType

from .paths import description

__all__ = ["catapult", "fixed", "floating_arm", "hinged", "rolling"]


class MachinePaths(ModuleType):
    """Paths of the MJCF files of a machine; a module, so that it can be imported."""

    PACKAGE_PATH: str
    MJCF_PATH: str
    MJCF_PATH_SCENE: str

    def __init__(self, machine: str) -> None:
        super().__init__(f"{__name__}.{machine.replace('-', '_')}", f"MJCF files of {machine}.")
        vars(self).update(description(machine)._asdict())
        sys.modules[self.__name__] = self


catapult = MachinePaths("catapult")
fixed = MachinePaths("fixed")
floating_arm = MachinePaths("floating-arm")
hinged = MachinePaths("hinged")
rolling = MachinePaths("rolling")
