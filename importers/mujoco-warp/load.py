"""MuJoCo Warp on the CPU, single precision: `put_model`, `forward`, and `step` as a graph."""

import sys
from importlib.metadata import version
from pathlib import Path

import mujoco
import mujoco_warp
import numpy as np
import warp

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from compiled import Compiled

warp.config.log_level = warp.LOG_WARNING


class Model(Compiled):
    """A model with one world; what the file says is that of the compiled one."""

    precision = "float32"

    def __init__(self, path: str) -> None:
        super().__init__(mujoco.MjModel.from_xml_path(path))
        self.versions |= {"mujoco-warp": version("mujoco-warp"), "warp-lang": warp.__version__}
        self.put = mujoco_warp.put_model(self.model)

    def total_mass(self) -> float:
        return float(self.put.body_mass.numpy().sum())

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        _, data = self._at(q, np.zeros_like(q))
        mujoco_warp.get_data_into(self.data, self.model, data)
        full = np.zeros((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, self.data, full)
        return full

    def acceleration(self, q: np.ndarray, u: np.ndarray) -> np.ndarray:
        return self._at(q, u)[1].qacc.numpy()[0]

    def simulate(
        self, q: np.ndarray, u: np.ndarray, interval: float, count: int, steps: int
    ) -> dict[str, np.ndarray]:
        self.model.opt.timestep = interval / steps
        mujoco_warp.step(*self._at(q, u))  # compiles what a step needs
        model, data = self._at(q, u)
        # Launched one by one from Python the kernels of a step take 70 ms, as a graph, to the same
        # bits, 0.1 to 1 ms.
        with warp.ScopedCapture(device="cpu") as capture:
            mujoco_warp.step(model, data)
        positions, forces = [q], [np.zeros_like(q)]
        for _ in range(count):
            for _ in range(steps):
                warp.capture_launch(capture.graph)
            positions.append(data.qpos.numpy()[0].copy())
            forces.append(data.qfrc_constraint.numpy()[0].copy())
        return {"q": np.array(positions), "limit_force": np.array(forces)}

    def _at(self, q: np.ndarray, u: np.ndarray) -> tuple[mujoco_warp.Model, mujoco_warp.Data]:
        self.forward(q, u)
        model, data = mujoco_warp.put_model(self.model), mujoco_warp.put_data(self.model, self.data)
        mujoco_warp.forward(model, data)
        return model, data


def load(path: str) -> Model:
    """A file."""
    return Model(path)
