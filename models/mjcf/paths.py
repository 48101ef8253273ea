"""Paths of the MJCF files of the named machines."""

from __future__ import annotations

import importlib
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

from ..errors import EngineNotInstalledError, InputError
from ..library.registry import model, models
from .scene import SCENE_FILE
from .writer import model_file


class Description(NamedTuple):
    """Paths of one machine's files, as `robot_descriptions` names them."""

    PACKAGE_PATH: str
    """The folder."""
    MJCF_PATH: str
    """The model alone."""
    MJCF_PATH_SCENE: str
    """The model with ground, frame, light and camera."""


def description(name: str) -> Description:
    """Paths of a named machine's files.

    Raises:
        InputError: it is none of the machines; the sentence lists them.
    """
    if name not in models():
        known = ", ".join(models())
        raise InputError(
            f"there are no MJCF files of {name!r}; there are of {known}; tb.mjcf writes any other."
        )
    folder = Path(str(files(__package__ or ""))) / name
    return Description(str(folder), str(folder / model_file(model(name))), str(folder / SCENE_FILE))


def mjcf_path(name: str, *, scene: bool = False) -> str:
    """Path of the MJCF file of a machine with its default parameters.

    Args:
        name: of a machine, such as "rolling".
        scene: the file with ground, frame, light and camera, which includes the model.

    Raises:
        InputError: it is none of the machines; :func:`mjcf` writes the MJCF of any other.
    """
    paths = description(name)
    return paths.MJCF_PATH_SCENE if scene else paths.MJCF_PATH


def as_spec(text: str) -> Any:
    """MJCF text as a `mujoco.MjSpec`, to be edited or attached to another one.

    Raises:
        EngineNotInstalledError: MuJoCo is not installed.
    """
    try:
        mujoco: Any = importlib.import_module("mujoco")
    except ImportError as error:
        raise EngineNotInstalledError(f"an MjSpec needs MuJoCo: {error}") from error
    return mujoco.MjSpec.from_string(text)
