"""MuJoCo on the model file that a mechanism was read from."""

from __future__ import annotations

from typing import ClassVar

from ...models.errors import EngineNotInstalledError
from ...models.model_source import ModelSource
from ..given import GivenModel
from ..study import ModelFile


class GivenMujocoModel(GivenModel):
    """MuJoCo on the file itself: its step, integrator, cone, softness and contacts."""

    name: ClassVar[str] = "mujoco"

    @classmethod
    def version(cls) -> str:
        """Version of MuJoCo; 'not installed' if it is not."""
        from .engine import MujocoEngine

        return MujocoEngine.version()

    @classmethod
    def read(cls, source: ModelSource) -> ModelFile:
        """Read a mechanism again from its file.

        Raises:
            EngineNotInstalledError: MuJoCo is not installed.
        """
        from .engine import MujocoEngine

        if not MujocoEngine.is_installed():
            raise EngineNotInstalledError(MujocoEngine.absence())
        from .files import reread  # loads MuJoCo

        return reread(source)
