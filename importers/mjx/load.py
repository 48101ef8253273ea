"""MJX on the processor, in double precision: `put_model`, `forward`, `step`."""

import sys
from importlib.metadata import version
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_platforms", "cpu")
import mujoco
import numpy as np
from mujoco import mjx

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from compiled import Compiled


class Model(Compiled):
    """A model on a device; what the file says is that of the compiled one."""

    def __init__(self, path: str) -> None:
        super().__init__(mujoco.MjModel.from_xml_path(path))
        self.device_model = mjx.put_model(self.model)
        self.blank = mjx.make_data(self.model)
        self.versions |= {"mujoco-mjx": version("mujoco-mjx"), "jax": jax.__version__}

    def total_mass(self) -> float:
        return float(np.sum(self.device_model.body_mass))

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        return np.asarray(_mass_matrix(self.device_model, self._at(q, np.zeros_like(q))))

    def acceleration(self, q: np.ndarray, u: np.ndarray) -> np.ndarray:
        return np.asarray(self._at(q, u).qacc)

    def simulate(
        self, q: np.ndarray, u: np.ndarray, interval: float, count: int, steps: int
    ) -> dict[str, np.ndarray]:
        model = self.device_model.tree_replace({"opt.timestep": np.array(interval / steps)})
        data, positions, forces = self._at(q, u), [q], [np.zeros_like(q)]
        for _ in range(count):
            data = _advance(model, data, steps)
            positions.append(np.asarray(data.qpos))
            forces.append(np.asarray(data.qfrc_constraint))
        return {"q": np.array(positions), "limit_force": np.array(forces)}

    def _at(self, q: np.ndarray, u: np.ndarray) -> mjx.Data:
        return _forward(self.device_model, self.blank.replace(qpos=np.array(q), qvel=np.array(u)))


_forward, _mass_matrix = jax.jit(mjx.forward), jax.jit(mjx.full_m)


@jax.jit
def _advance(model: mjx.Model, data: mjx.Data, steps: int) -> mjx.Data:
    """Take several steps; their number is a static argument, so that a model is compiled once."""
    return jax.lax.fori_loop(0, steps, lambda _, at: mjx.step(model, at), data)


def load(path: str) -> Model:
    """A file."""
    return Model(path)
