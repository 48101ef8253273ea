"""dm_control: `mjcf` parses and writes the file again, `Physics` steps it."""

import sys
from pathlib import Path

from dm_control import mjcf

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from importlib.metadata import version

from compiled import Compiled


class Model(Compiled):
    """A physics of dm_control."""

    def __init__(self, path: str) -> None:
        self.physics = mjcf.Physics.from_mjcf_model(mjcf.from_path(path))
        super().__init__(self.physics.model.ptr, self.physics.data.ptr)
        self.versions["dm_control"] = version("dm_control")

    def advance(self, steps: int) -> None:
        """Step the physics so many times."""
        self.physics.step(steps)


def load(path: str) -> Model:
    """A file."""
    return Model(path)
