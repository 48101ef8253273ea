"""Pinocchio: accelerations by its `aba`, integrated by a Runge-Kutta method of this adapter."""

import xml.etree.ElementTree as ET

import numpy as np
import pinocchio


class Model:
    """A model and its data. It has no limits, contacts or loops in `aba`."""

    integrator = "aba in an RK4 of the adapter"
    lacks = ("limits", "loops", "contact")

    def __init__(self, path: str) -> None:
        self.model = pinocchio.buildModelFromMJCF(path)
        self.data = self.model.createData()
        found = zip(list(self.model.names)[1:], list(self.model.joints)[1:], strict=True)
        self.joints = [name for own, joint in found for name in _joints(path, own, joint.nq)]
        self.versions = {"pin": pinocchio.__version__}

    def total_mass(self) -> float:
        return pinocchio.computeTotalMass(self.model)

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        upper = np.triu(pinocchio.crba(self.model, self.data, q))
        return upper + np.triu(upper, 1).T

    def acceleration(self, q: np.ndarray, u: np.ndarray) -> np.ndarray:
        return pinocchio.aba(self.model, self.data, q, u, np.zeros_like(u)).copy()

    def limits(self) -> dict[str, tuple[float, float]]:
        ends = zip(self.model.lowerPositionLimit, self.model.upperPositionLimit, strict=True)
        return dict(zip(self.joints, ends, strict=True))

    def start(self) -> tuple[np.ndarray]:
        return (self.model.referenceConfigurations["home"],)  # it keeps no speeds

    def simulate(
        self, q: np.ndarray, u: np.ndarray, interval: float, count: int, steps: int
    ) -> np.ndarray:
        h, state, n = interval / steps, np.concatenate([q, u]), len(q)

        def rate(state: np.ndarray) -> np.ndarray:
            return np.concatenate([state[n:], self.acceleration(state[:n], state[n:])])

        positions = [q]
        for _ in range(count):
            for _ in range(steps):
                a = rate(state)
                b = rate(state + h / 2 * a)
                c = rate(state + h / 2 * b)
                state = state + h / 6 * (a + 2 * b + 2 * c + rate(state + h * c))
            positions.append(state[:n])
        return np.array(positions)


def _joints(path: str, name: str, count: int) -> list[str]:
    """File names of joints: several joints of a body become a composite, named after the first."""
    if count == 1:
        return [name]
    bodies = (
        [joint.get("name", "") for joint in body.findall("joint")]
        for body in ET.parse(path).iter("body")
    )
    return next(names for names in bodies if names and name == f"Composite_{names[0]}")


def load(path: str) -> Model:
    """A file."""
    return Model(path)
