"""PyBullet: multibodies by its own steps and joint limits, or by its dynamics in an own scheme."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar, Literal

from pydantic import Field
from trebucheck.engines.inspection import Inspection, State
from trebucheck.engines.protocol import BuiltinEngine, Capabilities, Recording
from trebucheck.engines.study import EngineStudy
from trebucheck.engines.supplied import MOVED, Assistance, Part, Supplied, all_by
from trebucheck.models.features import Basic, Feature
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.models.spec import NonNegative, Positive
from trebucheck_toolkit.event_driver import EventDriver
from trebucheck_toolkit.given_forces import GIVEN
from trebucheck_toolkit.joint_tree import TreeMotion

from .study import STUDY

NO_LIMIT = 1e30  # of a joint's angle or speed


class PyBulletEngine(BuiltinEngine):
    """Bullet's multibody; the defaults are the assisted preset.

    Assisted, its `calculateMassMatrix` and `calculateInverseDynamics` are moved by RK4, stops and
    joints that close loops are constraint multipliers on them, and events are located by
    trebucheck's driver.

    By itself (`mode="step"`, :mod:`.alone`) it is `stepSimulation` from start to end, with limits
    of Bullet's joints and its point-to-point constraints. Limits stay in the tree whatever the
    law: it keeps to release-once only while no stop is met again. A stop is read as released at the
    end of the first step after which its limit has no torque.

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
        elements=GIVEN,
    )
    default_options: ClassVar[Mapping[str, object] | None] = {
        "mode": "step",
        "timestep": 1 / 240,
        "linear_damping": 0.04,
        "angular_damping": 0.04,
        "max_joint_velocity": 100.0,
    }
    settings_options: ClassVar[Mapping[str, object] | None] = {
        "mode": "step",
        "solver_iterations": 500,
        "solver_threshold": 0.0,
    }
    assistance: ClassVar[tuple[Assistance, ...] | None] = all_by("mode", "step", MOVED)
    readings: ClassVar[Supplied] = {
        Part.ELEMENTS: "forces of springs and loads, given before each step",
        Part.TORQUES: "from the speeds that limits change",
    }

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
    linear_damping: NonNegative = Field(
        default=0.0, description="Bullet's damping of the links' velocities in its own steps [1/s]"
    )
    angular_damping: NonNegative = Field(
        default=0.0, description="Bullet's damping of the links' turning in its own steps [1/s]"
    )
    max_joint_velocity: Positive = Field(
        default=NO_LIMIT,
        description="speed of a joint above which Bullet's own steps cut it off [rad/s, m/s]",
    )

    @property
    def lacking(self) -> frozenset[Basic | Feature]:
        """Elements that the adapter builds none of Bullet's for, in Bullet's own steps."""
        return (
            frozenset() if self.mode == "dynamics" else frozenset({Basic.POINT_STOP, Basic.REBOUND})
        )

    @property
    def supplied(self) -> Supplied:
        """Parts that trebucheck does: all but the dynamics; by itself readings and given forces."""
        return MOVED if self.mode == "dynamics" else self.readings

    def _run(self, problem: Problem) -> Recording:
        if self.mode == "step":
            from .alone import run_alone

            return run_alone(problem, self)
        from .tree import BulletTree

        motion = TreeMotion(BulletTree(problem.mechanism))
        return EventDriver(problem, motion, self.name, self.timestep).run()

    def _script(self, problem: Problem) -> str:
        from .alone import script

        return script(problem, self)

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """The built model's mass matrix, forces and accelerations in each state."""
        self.refuse_absence()
        from .tree import BulletTree

        return TreeMotion(BulletTree(mechanism)).inspect(states)
