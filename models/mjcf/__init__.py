"""MJCF, MuJoCo's model format: the writer, and the committed models of the named machines.

A module of each machine has the paths of its files, as `robot_descriptions` names them:
`rolling.MJCF_PATH` of `from trebucheck.models.mjcf import rolling` or of `import
trebucheck.models.mjcf.rolling`.
"""

from __future__ import annotations

import sys
from importlib.resources import files
from pathlib import Path
from types import ModuleType
from typing import Any

from ..errors import EngineNotInstalledError, InputError
from .scene import SCENE_FILE

__all__ = ["as_spec", "catapult", "fixed", "floating_arm", "hinged", "mjcf_path", "rolling"]


class MachinePaths(ModuleType):
    """Paths of the MJCF files of a machine; a module, so that it can be imported."""

    PACKAGE_PATH: str
    """The folder."""
    MJCF_PATH: str
    """The model alone."""
    MJCF_PATH_SCENE: str
    """The model with ground, frame, light and camera."""

    def __init__(self, folder: Path) -> None:
        machine = folder.name
        super().__init__(f"{__name__}.{machine.replace('-', '_')}", f"MJCF files of {machine}.")
        vars(self).update(
            PACKAGE_PATH=str(folder),
            MJCF_PATH=str(folder / f"{machine}.xml"),
            MJCF_PATH_SCENE=str(folder / SCENE_FILE),
        )
        sys.modules[self.__name__] = self


_PATHS: dict[str, MachinePaths] = {}
for _folder in sorted(Path(str(files(__name__))).iterdir()):
    if (_folder / SCENE_FILE).is_file():
        _PATHS[_folder.name] = MachinePaths(_folder)
catapult, fixed, floating_arm = _PATHS["catapult"], _PATHS["fixed"], _PATHS["floating-arm"]
hinged, rolling = _PATHS["hinged"], _PATHS["rolling"]


def mjcf_path(name: str, *, scene: bool = False) -> str:
    """Path of the MJCF file of a machine with its default parameters.

    Args:
        name: of a machine, such as "rolling".
        scene: the file with ground, frame, light and camera, which includes the model.

    Raises:
        InputError: it is none of the machines; :func:`mjcf` writes the MJCF of any other.
    """
    if name not in _PATHS:
        known = ", ".join(_PATHS)
        raise InputError(
            f"there are no MJCF files of {name!r}; there are of {known}; tb.mjcf writes any other."
        )
    return _PATHS[name].MJCF_PATH_SCENE if scene else _PATHS[name].MJCF_PATH


def as_spec(text: str) -> Any:
    """MJCF text as a `mujoco.MjSpec`, to be edited or attached to another one.

    Raises:
        EngineNotInstalledError: MuJoCo is not installed.
    """
    try:
        import mujoco as untyped
    except ImportError as error:
        raise EngineNotInstalledError(f"an MjSpec needs MuJoCo: {error}") from error
    mujoco: Any = untyped
    return mujoco.MjSpec.from_string(text)
