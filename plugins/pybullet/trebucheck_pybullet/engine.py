"""PyBullet: multibodies by its own steps and joint limits, or by its dynamics in an own scheme."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar, Literal

from pydantic import Field
from trebucheck.engines.inspection import Inspection, State
from trebucheck.engines.protocol import BuiltinEngine, Capabilities, Recording
from trebucheck.engines.study import EngineStudy
from trebucheck.engines.supplied import LIMITED, MOVED, Supplied
from trebucheck.models.features import Basic, Feature
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.models.spec import NonNegative
from trebucheck_toolkit.event_driver import EventDriver
from trebucheck_toolkit.joint_tree import LimitedMotion, TreeMotion
from trebucheck_toolkit.plain_run import plain_run

from .study import STUDY


class PyBulletEngine(BuiltinEngine):
    """Bullet's multibody; the defaults are the assisted preset.

    Assisted, its `calculateMassMatrix` and `calculateInverseDynamics` are moved by RK4, stops and
    joints that close loops are constraint multipliers on them, and events are located by
    trebucheck's driver.

    The default preset is `stepSimulation` with Bullet's joint limits, every other setting Bullet's
    default.

    Raises:
        InputError: an option is unknown or outside its range.
    """

    name: ClassVar[str] = "pybullet"
    package: ClassVar[str] = "pybullet"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Capabilities] = Capabilities(
        joint_reactions=True,
        joint_gaps=False,
        located_releases=True,
        stop_laws=frozenset(StopLaw),
        formulation="minimal relative joints; inverse dynamics in RK4, stops and loops by "
        "multipliers (default: semi-implicit Euler, joint limits as velocity constraints solved by "
        "iteration)",
        features=frozenset(Feature),
    )
    default_options: ClassVar[Mapping[str, object] | None] = {"mode": "step"}

    mode: Literal["dynamics", "step"] = Field(
        default="dynamics",
        description="Bullet's dynamics in RK4, or its own `stepSimulation` with joint limits",
    )
    solver_iterations: Annotated[int, Field(ge=1, le=100_000)] = Field(
        default=50, description="most iterations of the solver of the joint limits in a step"
    )
    solver_threshold: NonNegative = Field(
        default=1e-7,
        description="change of an iteration below which the solver of the joint limits ends",
    )

    @property
    def lacking(self) -> frozenset[Basic | Feature]:
        """Bullet's own steps are of trees, with limits of joints, without restitution."""
        return (
            frozenset()
            if self.mode == "dynamics"
            else frozenset({Basic.LOOP, Basic.POINT_STOP, Basic.REBOUND})
        )

    @property
    def supplied(self) -> Supplied:
        """Assistance: in `stepSimulation` limits are Bullet's; torques from speed changes."""
        return MOVED if self.mode == "dynamics" else LIMITED

    def _run(self, problem: Problem) -> Recording:
        from .tree import BulletTree

        if self.mode == "step":
            solver = {
                "numSolverIterations": self.solver_iterations,
                "solverResidualThreshold": self.solver_threshold,
            }
            tree = BulletTree(problem.mechanism, self.timestep, solver)
            motion = LimitedMotion(problem, tree, self.timestep, "pybullet's own step")
            return plain_run(problem, motion, self.name, self.timestep)
        return EventDriver(
            problem, TreeMotion(BulletTree(problem.mechanism)), self.name, self.timestep
        ).run()

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """The built model's mass matrix, forces and accelerations in each state."""
        self.refuse_absence()
        from .tree import BulletTree

        return TreeMotion(BulletTree(mechanism)).inspect(states)
