"""A machine moved by plain steps of MuJoCo, read in its mechanism's coordinates; and its pictures."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

from ..models.arrays import FloatArray
from ..models.errors import EngineNotInstalledError, SimulationError
from ..models.mechanism import Mechanism
from ..models.mjcf.recorded import HOME, RecordedMotion
from ..models.mjcf.scene import scene
from ..models.mjcf.tree import joint_values
from ..models.mjcf.writer import mjcf, model_file

LARGEST_PICTURE = (1280, 960)
"""Width and height that the scene allows."""


def mujoco() -> Any:
    """The library.

    Raises:
        EngineNotInstalledError: it cannot be imported.
    """
    try:
        return importlib.import_module("mujoco")
    except ImportError as error:
        raise EngineNotInstalledError(f"this environment needs MuJoCo: {error}") from error


class Motion:
    """One machine's motion from its start.

    Raises:
        EngineNotInstalledError: MuJoCo is not installed.
        SimulationError: MuJoCo refuses the model.
        UnsupportedProblemError: it cannot be written as MJCF.
    """

    def __init__(self, mechanism: Mechanism, timestep: float) -> None:
        self.mechanism, self.timestep = mechanism, timestep
        self._library = mujoco()
        try:
            self._model = self._library.MjModel.from_xml_string(mjcf(mechanism, timestep))
        except ValueError as error:
            raise SimulationError(f"MuJoCo refuses the model of {mechanism.name!r}: {error}") from error
        # Without this flag MuJoCo resets a diverged simulation to the start and goes on.
        self._model.opt.disableflags |= self._library.mjtDisableBit.mjDSBL_AUTORESET
        self._data = self._library.MjData(self._model)
        units = np.eye(len(mechanism.coordinates)).tolist()
        self._from_joints = np.linalg.inv(np.array([joint_values(mechanism, unit) for unit in units]).T)
        self.reset()

    def reset(self) -> None:
        """Back to the start."""
        self._library.mj_resetDataKeyframe(self._model, self._data, self._model.key(HOME).id)

    def advance(self, steps: int) -> None:
        """Make some steps.

        Raises:
            SimulationError: the simulation diverged.
        """
        self._library.mj_step(self._model, self._data, nstep=steps)
        if not (np.isfinite(self._data.qpos).all() and np.isfinite(self._data.qvel).all()):
            raise SimulationError(
                f"{self.mechanism.name!r} diverged in MuJoCo before {self._data.time:.4g} s at a time step of "
                f"{self.timestep:g} s; a smaller one is needed."
            )

    @property
    def state(self) -> tuple[FloatArray, FloatArray]:
        """Coordinates and speeds of the mechanism, each of shape (n_q,)."""
        q, u = (self._from_joints @ values for values in (self._data.qpos, self._data.qvel))
        return np.asarray(self.mechanism.start) + q, u

    def camera(self, path: RecordedMotion, width: int, height: int) -> Camera:
        """A camera whose picture the path fills."""
        return Camera(self.mechanism, self.timestep, path, (width, height))

    def show(self, camera: Camera) -> FloatArray:
        """A picture, shape (height, width, 3), of bytes."""
        return camera.picture(self._data.qpos)


class Camera:
    """The machine in its scene, drawn off screen.

    Raises:
        SimulationError: nothing can be drawn here.
    """

    def __init__(self, mechanism: Mechanism, timestep: float, path: RecordedMotion, size: tuple[int, int]) -> None:
        self._library, file = mujoco(), model_file(mechanism)
        text, files = scene(mechanism, file, path), {file: mjcf(mechanism, timestep).encode()}
        self._model = self._library.MjModel.from_xml_string(text, files)
        self._data = self._library.MjData(self._model)
        try:
            self._renderer = self._library.Renderer(self._model, size[1], size[0])
        except Exception as error:  # whatever the graphics libraries raise
            raise SimulationError(
                f"MuJoCo cannot draw here: {error}; without a display it needs MUJOCO_GL=egl or MUJOCO_GL=osmesa."
            ) from error

    def picture(self, joints: FloatArray) -> FloatArray:
        """With these values of MuJoCo's joints."""
        self._data.qpos[:] = joints
        self._library.mj_forward(self._model, self._data)
        self._renderer.update_scene(self._data, "side")
        return self._renderer.render().copy()

    def close(self) -> None:
        """Give the graphics memory back."""
        self._renderer.close()
