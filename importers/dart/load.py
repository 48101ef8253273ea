"""DART: `MjcfParser` makes a world with a skeleton of each tree."""

from importlib.metadata import version
from pathlib import Path

import dartpy
import numpy as np


class Model:
    """The skeletons of one file."""

    integrator = "semi-implicit Euler"

    def __init__(self, path: str) -> None:
        self.world = dartpy.utils.MjcfParser.readWorld(dartpy.common.Uri(Path(path).as_uri()))
        if self.world is None:
            raise ValueError("readWorld returned no world")
        skeletons = [self.world.getSkeleton(i) for i in range(self.world.getNumSkeletons())]
        self.skeletons = [skeleton for skeleton in skeletons if skeleton.getNumDofs()]
        self.dofs = [s.getDof(i) for s in self.skeletons for i in range(s.getNumDofs())]
        self.joints = [dof.getName() for dof in self.dofs]
        for skeleton in self.skeletons:  # limits act only where this is asked for
            for i in range(skeleton.getNumJoints()):
                skeleton.getJoint(i).setLimitEnforcement(True)
        self.versions = {"dartpy": version("dartpy")}

    def total_mass(self) -> float:
        return sum(skeleton.getMass() for skeleton in self.skeletons)

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        self._set(q, np.zeros_like(q))
        full, first = np.zeros((len(q), len(q))), 0
        for skeleton in self.skeletons:
            own = slice(first, first + skeleton.getNumDofs())
            full[own, own] = skeleton.getMassMatrix()
            first = own.stop
        return full

    def acceleration(self, q: np.ndarray, u: np.ndarray) -> np.ndarray:
        self._set(q, u)
        for skeleton in self.skeletons:
            skeleton.computeForwardDynamics()
        return np.array([dof.getAcceleration() for dof in self.dofs])

    def limits(self) -> dict[str, tuple[float, float]]:
        return {
            name: (dof.getPositionLowerLimit(), dof.getPositionUpperLimit())
            for name, dof in zip(self.joints, self.dofs, strict=True)
        }

    def simulate(
        self, q: np.ndarray, u: np.ndarray, interval: float, count: int, steps: int
    ) -> np.ndarray:
        self.world.setTimeStep(interval / steps)
        self._set(q, u)
        positions = [q]
        for _ in range(count):
            for _ in range(steps):
                self.world.step()
            positions.append([dof.getPosition() for dof in self.dofs])
        return np.array(positions)

    def _set(self, q: np.ndarray, u: np.ndarray) -> None:
        for dof, position, speed in zip(self.dofs, q, u, strict=True):
            dof.setPosition(position)
            dof.setVelocity(speed)


def load(path: str) -> Model:
    """A file."""
    return Model(path)
