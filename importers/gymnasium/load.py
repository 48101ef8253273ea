"""Gymnasium: a `MujocoEnv` of the file, stepped by `do_simulation`."""

import sys
from pathlib import Path

import gymnasium
import numpy as np
from gymnasium.envs.mujoco import MujocoEnv

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from compiled import Compiled


class Environment(MujocoEnv):
    """The least that `MujocoEnv` asks for."""

    metadata = {"render_modes": ["human", "rgb_array", "depth_array", "rgbd_tuple"]}  # noqa: RUF012

    def __init__(self, path: str) -> None:
        super().__init__(
            path, frame_skip=1, observation_space=gymnasium.spaces.Box(-np.inf, np.inf, (1,))
        )


class Model(Compiled):
    """An environment's model and data."""

    def __init__(self, path: str) -> None:
        self.environment = Environment(path)
        super().__init__(self.environment.model, self.environment.data)
        self.versions["gymnasium"] = gymnasium.__version__

    def advance(self, steps: int) -> None:
        """Step the environment so many times, without control."""
        self.environment.do_simulation(np.zeros(self.model.nu), steps)


def load(path: str) -> Model:
    """A file."""
    return Model(path)
