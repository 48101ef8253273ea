"""Importer on a compiled MuJoCo model, shared by packages that compile files with MuJoCo."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np


class Compiled:
    """A model and its data; positions are `qpos`."""

    def __init__(self, model: Any, data: Any | None = None) -> None:
        self.model = model
        self.data = mujoco.MjData(model) if data is None else data
        self.joints = [model.joint(i).name for i in range(model.njnt)]
        self.integrator = mujoco.mjtIntegrator(model.opt.integrator).name
        self.versions = {"mujoco": mujoco.__version__}

    def total_mass(self) -> float:
        return float(np.sum(self.model.body_mass))

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        self.forward(q, np.zeros_like(q))
        full = np.zeros((self.model.nv, self.model.nv))
        try:
            mujoco.mj_fullM(self.model, self.data, full)
        except TypeError:  # MuJoCo 3
            mujoco.mj_fullM(self.model, full, self.data.qM)
        return full

    def acceleration(self, q: np.ndarray, u: np.ndarray) -> np.ndarray:
        self.forward(q, u)
        return np.array(self.data.qacc)

    def limits(self) -> dict[str, tuple[float, float]]:
        limited, ranges = self.model.jnt_limited, self.model.jnt_range
        return {name: tuple(ranges[i]) for i, name in enumerate(self.joints) if limited[i]}

    def start(self) -> tuple[np.ndarray, np.ndarray]:
        key = self.model.key("home")
        return key.qpos, key.qvel

    def simulate(
        self, q: np.ndarray, u: np.ndarray, interval: float, count: int, steps: int
    ) -> dict[str, np.ndarray]:
        self.model.opt.timestep = interval / steps
        self.forward(q, u)
        positions, forces = [q], [np.array(self.data.qfrc_constraint)]
        for _ in range(count):
            self.advance(steps)
            positions.append(np.array(self.data.qpos))
            forces.append(np.array(self.data.qfrc_constraint))
        return {"q": np.array(positions), "limit_force": np.array(forces)}

    def advance(self, steps: int) -> None:
        """Step the model so many times."""
        mujoco.mj_step(self.model, self.data, steps)

    def forward(self, q: np.ndarray, u: np.ndarray) -> None:
        """Put the data into a state."""
        self.data.qpos[:], self.data.qvel[:] = q, u
        self.data.qacc_warmstart[:] = 0.0
        self.data.time = 0.0
        mujoco.mj_forward(self.model, self.data)
