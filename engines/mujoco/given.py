"""MuJoCo on the model file that a mechanism was read from."""

from __future__ import annotations

from typing import ClassVar

from ...models.model_source import ModelSource
from ..given import GivenModel
from ..study import ModelFile


class GivenMujocoModel(GivenModel):
    """MuJoCo on the file itself: its step, integrator, cone, softness and contacts."""

    name: ClassVar[str] = "mujoco"
    package: ClassVar[str] = "mujoco"

    def read(self, source: ModelSource) -> ModelFile:
        """Read a mechanism again from its file."""
        from .files import reread  # loads MuJoCo

        return reread(source)
