"""DART: skeletons by their own steps and joint limits, or by their dynamics in an own scheme."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal

from pydantic import Field
from trebucheck.engines.inspection import Inspection, State
from trebucheck.engines.protocol import BuiltinEngine, Capabilities, Recording
from trebucheck.engines.study import EngineStudy
from trebucheck.engines.supplied import LIMITED, MOVED, Supplied
from trebucheck.models.features import Basic, Feature
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck_toolkit.event_driver import EventDriver
from trebucheck_toolkit.joint_tree import LimitedMotion, TreeMotion
from trebucheck_toolkit.plain_run import plain_run

from .study import STUDY


class DartEngine(BuiltinEngine):
    """A skeleton of DART's; the defaults are the assisted preset.

    Assisted, its mass matrix and its Coriolis and gravity forces are moved by RK4, stops and joints
    that close loops are constraint multipliers on them, and events are located by trebucheck's
    driver.

    The default preset is `World.step` with DART's joint limits, every other setting DART's default.

    Raises:
        InputError: an option is unknown or outside its range.
    """

    name: ClassVar[str] = "dart"
    package: ClassVar[str] = "dartpy"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Capabilities] = Capabilities(
        joint_reactions=True,
        joint_gaps=False,
        located_releases=True,
        stop_laws=frozenset(StopLaw),
        formulation="minimal relative joints; its dynamics in RK4, stops and loops by multipliers "
        "(default: semi-implicit Euler, joint limits as velocity constraints)",
        features=frozenset(Feature),
    )
    default_options: ClassVar[Mapping[str, object] | None] = {"mode": "step"}

    mode: Literal["dynamics", "step"] = Field(
        default="dynamics",
        description="DART's dynamics in RK4, or its own `World.step` with joint limits",
    )

    @property
    def lacking(self) -> frozenset[Basic | Feature]:
        """DART's own steps are of trees, with limits of joints, without restitution."""
        return (
            frozenset()
            if self.mode == "dynamics"
            else frozenset({Basic.LOOP, Basic.POINT_STOP, Basic.REBOUND})
        )

    @property
    def supplied(self) -> Supplied:
        """Assistance: in `World.step` limits are DART's; torques come from speed changes."""
        return MOVED if self.mode == "dynamics" else LIMITED

    def _run(self, problem: Problem) -> Recording:
        from .tree import DartTree

        if self.mode == "step":
            tree = DartTree(problem.mechanism, self.timestep)
            motion = LimitedMotion(problem, tree, self.timestep, "dart's own step")
            return plain_run(problem, motion, self.name, self.timestep)
        return EventDriver(
            problem, TreeMotion(DartTree(problem.mechanism)), self.name, self.timestep
        ).run()

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """The built model's mass matrix, forces and accelerations in each state."""
        self.refuse_absence()
        from .tree import DartTree

        return TreeMotion(DartTree(mechanism)).inspect(states)
