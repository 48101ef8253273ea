"""Newton: `ModelBuilder.add_mjcf`, moved by its `SolverMuJoCo` on the processor."""

import xml.etree.ElementTree as ET
from importlib.metadata import version

import newton
import numpy as np
import warp

warp.config.log_level = warp.LOG_WARNING


class Model:
    """A finalized model."""

    precision = "float32"
    integrator = "SolverMuJoCo"

    def __init__(self, path: str) -> None:
        builder = newton.ModelBuilder()
        newton.solvers.SolverMuJoCo.register_custom_attributes(builder)
        builder.add_mjcf(path)
        self.model = builder.finalize(device="cpu")
        labels = [label.rpartition("/")[2] for label in self.model.joint_label]
        starts, coordinates = self.model.joint_qd_start.numpy(), self.model.joint_q_start.numpy()
        in_tree = self.model.joint_articulation.numpy() >= 0  # others close loops
        self.joints: list[str] = []
        self.dofs: list[int] = []
        self.places: list[int] = []
        for i in np.flatnonzero(in_tree):
            count = starts[i + 1] - starts[i]
            # A body's joints become one joint, whose label is that of all of them.
            self.joints += [labels[i]][:count] if count < 2 else _joints(path, labels[i])
            self.dofs += range(starts[i], starts[i + 1])
            self.places += range(coordinates[i], coordinates[i + 1])
        self.versions = {name: version(name) for name in ("newton", "warp-lang", "mujoco")}

    def total_mass(self) -> float:
        return float(self.model.body_mass.numpy().sum())

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        state = self._state(q, np.zeros_like(q))
        newton.eval_fk(self.model, state.joint_q, state.joint_qd, state)
        blocks = newton.eval_mass_matrix(self.model, state).numpy()
        full, owners = np.zeros((len(q), len(q))), self.model.joint_articulation.numpy()
        dofs = self.model.joint_qd_start.numpy()
        for articulation, block in enumerate(blocks):
            wanted = {
                d
                for i in np.flatnonzero(owners == articulation)
                for d in range(dofs[i], dofs[i + 1])
            }
            own = [place for place, dof in enumerate(self.dofs) if dof in wanted]
            full[np.ix_(own, own)] = block[: len(own), : len(own)]
        return full

    def limits(self) -> dict[str, tuple[float, float]]:
        low, high = self.model.joint_limit_lower.numpy(), self.model.joint_limit_upper.numpy()
        return {
            name: (low[dof], high[dof]) for name, dof in zip(self.joints, self.dofs, strict=True)
        }

    def simulate(
        self, q: np.ndarray, u: np.ndarray, interval: float, count: int, steps: int
    ) -> np.ndarray:
        now, then = self._state(q, u), self.model.state()
        newton.eval_fk(self.model, now.joint_q, now.joint_qd, now)
        solver = newton.solvers.SolverMuJoCo(self.model, use_mujoco_cpu=True)
        control, positions = self.model.control(), [q]
        for _ in range(count):
            for _ in range(steps):
                solver.step(now, then, control, None, interval / steps)
                now, then = then, now
            positions.append(now.joint_q.numpy()[self.places])
        return np.array(positions)

    def _state(self, q: np.ndarray, u: np.ndarray) -> newton.State:
        state = self.model.state()
        for array, places, values in (
            (state.joint_q, self.places, q),
            (state.joint_qd, self.dofs, u),
        ):
            all_of_them = array.numpy()
            all_of_them[places] = values
            array.assign(all_of_them)
        return state


def _joints(path: str, label: str) -> list[str]:
    """Names in the file of a body's joints, which became one."""
    bodies = (
        [joint.get("name", "") for joint in body.findall("joint")]
        for body in ET.parse(path).iter("body")
    )
    return next(names for names in bodies if "_".join(names) == label)


def load(path: str) -> Model:
    """A file."""
    return Model(path)
