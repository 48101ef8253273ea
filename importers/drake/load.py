"""Drake: accelerations by a continuous plant, motion by a discrete one (limits and loops)."""

import logging
from importlib.metadata import version

import numpy as np
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

logging.getLogger("drake").setLevel(logging.WARNING)


class Model:
    """Plants of one file."""

    integrator = "discrete plant (semi-implicit Euler)"

    def __init__(self, path: str) -> None:
        self.path = path
        self.plant = MultibodyPlant(0.0)
        Parser(self.plant).AddModels(path)
        self.plant.Finalize()
        moving = [self.plant.get_joint(i) for i in self.plant.GetJointIndices()]
        moving = sorted(
            (j for j in moving if j.num_positions() == 1), key=lambda joint: joint.position_start()
        )
        self.joints = [joint.name() for joint in moving]
        self.ends = {
            joint.name(): (joint.position_lower_limits()[0], joint.position_upper_limits()[0])
            for joint in moving
        }
        self.context = self.plant.CreateDefaultContext()
        self.versions = {"drake": version("drake")}

    def total_mass(self) -> float:
        return self.plant.CalcTotalMass(self.context)

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        self.plant.SetPositions(self.context, q)
        return self.plant.CalcMassMatrix(self.context)

    def acceleration(self, q: np.ndarray, u: np.ndarray) -> np.ndarray:
        if self.plant.num_constraints():
            raise NotImplementedError("a continuous plant has no constraints")
        self.plant.SetPositionsAndVelocities(self.context, np.concatenate([q, u]))
        return (
            self.plant.EvalTimeDerivatives(self.context).get_generalized_velocity().CopyToVector()
        )

    def limits(self) -> dict[str, tuple[float, float]]:
        return self.ends

    def simulate(
        self, q: np.ndarray, u: np.ndarray, interval: float, count: int, steps: int
    ) -> np.ndarray:
        builder = DiagramBuilder()
        plant, _ = AddMultibodyPlantSceneGraph(builder, interval / steps)
        Parser(plant).AddModels(self.path)
        plant.Finalize()
        diagram = builder.Build()
        root = diagram.CreateDefaultContext()
        context = plant.GetMyMutableContextFromRoot(root)
        plant.SetPositionsAndVelocities(context, np.concatenate([q, u]))
        simulator, positions = Simulator(diagram, root), [q]
        for i in range(1, count + 1):
            simulator.AdvanceTo((i + 1e-6 / steps) * interval)
            positions.append(plant.GetPositions(context).copy())
        return np.array(positions)


def load(path: str) -> Model:
    """A file."""
    return Model(path)
