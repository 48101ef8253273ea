"""MJX on the processor, in double precision: `put_model`, `forward`, `step`."""

import sys
import warnings
from functools import partial
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
        model, self.device_model = _put(path)
        super().__init__(model)
        self.blank = mjx.make_data(self.model)
        self.versions |= {"mujoco-mjx": version("mujoco-mjx"), "jax": jax.__version__}
        self._forward = jax.jit(mjx.forward)

    def total_mass(self) -> float:
        return float(np.sum(self.device_model.body_mass))

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        return np.asarray(mjx.full_m(self.device_model, self._at(q, np.zeros_like(q))))

    def acceleration(self, q: np.ndarray, u: np.ndarray) -> np.ndarray:
        return np.asarray(self._at(q, u).qacc)

    def simulate(self, q: np.ndarray, u: np.ndarray, interval: float, count: int, steps: int) -> dict[str, np.ndarray]:
        model = self.device_model.tree_replace({"opt.timestep": np.array(interval / steps)})
        positions, forces = _run(model, self._at(q, u), count, steps)
        return {"q": np.vstack([q, positions]), "limit_force": np.vstack([np.zeros_like(q), forces])}

    def _at(self, q: np.ndarray, u: np.ndarray) -> mjx.Data:
        return self._forward(self.device_model, self.blank.replace(qpos=np.array(q), qvel=np.array(u)))


@partial(jax.jit, static_argnums=(2,))
def _run(model: mjx.Model, data: mjx.Data, count: int, steps: int) -> tuple[jax.Array, jax.Array]:
    def sample(data: mjx.Data, _: None) -> tuple[mjx.Data, tuple[jax.Array, jax.Array]]:
        data = jax.lax.fori_loop(0, steps, lambda _, at: mjx.step(model, at), data)
        return data, (data.qpos, data.qfrc_constraint)

    return jax.lax.scan(sample, data, None, length=count)[1]


def _put(path: str) -> tuple[mujoco.MjModel, mjx.Model]:
    """The model, compiled and on the device; without its sensors where MJX has not all of them."""
    spec = mujoco.MjSpec.from_file(path)
    model = spec.compile()
    try:
        return model, mjx.put_model(model)
    except NotImplementedError as refusal:
        for sensor in list(spec.sensors):
            spec.delete(sensor)
        model = spec.compile()
        put = mjx.put_model(model)
        warnings.warn(f"refused with its sensors, loaded without them: {refusal}", stacklevel=2)
        return model, put


def load(path: str) -> Model:
    """A file."""
    return Model(path)
