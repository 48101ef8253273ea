"""PyBullet: `loadMJCF` makes a body of each tree; gravity and keyframes are not read."""

from importlib.metadata import version

import numpy as np
import pybullet

pybullet.connect(pybullet.DIRECT)


class Model:
    """The bodies of one file."""

    integrator = "semi-implicit Euler"
    precision = "float32"  # of what it reads from files; it moves in double precision

    def __init__(self, path: str) -> None:
        pybullet.resetSimulation()
        pybullet.setGravity(0, 0, -9.81)
        self.bodies = pybullet.loadMJCF(path)
        self.places: list[tuple[int, int]] = []
        self.joints: list[str] = []
        self.ends: dict[str, tuple[float, float]] = {}
        for body in self.bodies:
            for joint in range(pybullet.getNumJoints(body)):
                facts = pybullet.getJointInfo(body, joint)
                if facts[2] not in (pybullet.JOINT_REVOLUTE, pybullet.JOINT_PRISMATIC):
                    continue
                self.places.append((body, joint))
                self.joints.append(facts[1].decode())
                if facts[8] <= facts[9]:
                    self.ends[facts[1].decode()] = facts[8:10]
                # The motors that hold every joint by default, and the damping of all bodies, are
                # switched off.
                pybullet.setJointMotorControl2(body, joint, pybullet.VELOCITY_CONTROL, force=0)
            for link in range(-1, pybullet.getNumJoints(body)):
                pybullet.changeDynamics(
                    body, link, linearDamping=0, angularDamping=0, jointDamping=0
                )
        self.versions = {"pybullet": version("pybullet")}

    def total_mass(self) -> float:
        return sum(
            pybullet.getDynamicsInfo(body, link)[0]
            for body in self.bodies
            for link in range(-1, pybullet.getNumJoints(body))
        )

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        full = np.zeros((len(q), len(q)))
        for body, own in self._by_body():
            full[np.ix_(own, own)] = pybullet.calculateMassMatrix(body, list(q[own]))
        return full

    def acceleration(self, q: np.ndarray, u: np.ndarray) -> np.ndarray:
        found = np.zeros_like(q)
        for body, own in self._by_body():
            at, speeds, none = list(q[own]), list(u[own]), [0.0] * len(own)
            bias = pybullet.calculateInverseDynamics(body, at, speeds, none)
            found[own] = -np.linalg.solve(pybullet.calculateMassMatrix(body, at), bias)
        return found

    def limits(self) -> dict[str, tuple[float, float]]:
        return self.ends

    def simulate(
        self, q: np.ndarray, u: np.ndarray, interval: float, count: int, steps: int
    ) -> np.ndarray:
        pybullet.setTimeStep(interval / steps)
        for (body, joint), at, speed in zip(self.places, q, u, strict=True):
            pybullet.resetJointState(body, joint, at, speed)
        positions = [q]
        for _ in range(count):
            for _ in range(steps):
                pybullet.stepSimulation()
            positions.append(
                [pybullet.getJointState(body, joint)[0] for body, joint in self.places]
            )
        return np.array(positions)

    def _by_body(self) -> list[tuple[int, np.ndarray]]:
        owners = np.array([body for body, _ in self.places])
        return [(body, np.flatnonzero(owners == body)) for body in dict.fromkeys(owners.tolist())]


def load(path: str) -> Model:
    """A file."""
    return Model(path)
