"""DART: skeletons by their own steps and joint limits, or by their dynamics in an own scheme."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal

from pydantic import Field
from trebucheck.engines.inspection import Inspection, State
from trebucheck.engines.protocol import BuiltinEngine, Capabilities, Recording
from trebucheck.engines.study import EngineStudy
from trebucheck.engines.supplied import MOVED, Assistance, Part, Supplied, all_by
from trebucheck.models.features import Basic, Feature
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck_toolkit.event_driver import EventDriver
from trebucheck_toolkit.given_forces import GIVEN
from trebucheck_toolkit.joint_tree import TreeMotion

from .study import STUDY


class DartEngine(BuiltinEngine):
    """A skeleton of DART's; the defaults are the assisted preset.

    Assisted, its mass matrix and its Coriolis and gravity forces are moved by RK4, stops and joints
    that close loops are constraint multipliers on them, and events are located by trebucheck's
    driver.

    By itself (`mode="step"`, :mod:`.alone`) it is `World.step` from start to end, with limits of
    DART's joints and its ball-joint constraints. DART enforces a limit only where it is asked to,
    which the adapter does. Limits stay in the skeleton whatever the law: it keeps to release-once
    only while no stop is met again. A stop is read as released at the end of the first step after
    which its limit has no torque. Its step has no options but its length, so that the presets
    `default` and `settings` are the same.

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
        elements=GIVEN,
    )
    default_options: ClassVar[Mapping[str, object] | None] = {"mode": "step"}
    settings_options: ClassVar[Mapping[str, object] | None] = {"mode": "step"}
    assistance: ClassVar[tuple[Assistance, ...] | None] = all_by("mode", "step", MOVED)
    readings: ClassVar[Supplied] = {
        Part.ELEMENTS: "forces of loads and of springs on no joint, given before each step",
        Part.LOOP_REACTIONS: "of pins, from the bodies' accelerations and the other joints' forces",
    }

    mode: Literal["dynamics", "step"] = Field(
        default="dynamics",
        description="DART's dynamics in RK4, or its own `World.step` with joint limits",
    )

    @property
    def lacking(self) -> frozenset[Basic | Feature]:
        """Elements that the adapter builds none of DART's for, in DART's own steps."""
        return (
            frozenset() if self.mode == "dynamics" else frozenset({Basic.POINT_STOP, Basic.REBOUND})
        )

    @property
    def supplied(self) -> Supplied:
        """Parts that trebucheck does: all but the dynamics; by itself readings and loads."""
        return MOVED if self.mode == "dynamics" else self.readings

    def _run(self, problem: Problem) -> Recording:
        if self.mode == "step":
            from .alone import run_alone

            return run_alone(problem, self)
        from .tree import DartTree

        motion = TreeMotion(DartTree(problem.mechanism))
        return EventDriver(problem, motion, self.name, self.timestep).run()

    def _script(self, problem: Problem) -> str:
        from .alone import script

        return script(problem, self)

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """The built model's mass matrix, forces and accelerations in each state."""
        self.refuse_absence()
        from .tree import DartTree

        return TreeMotion(DartTree(mechanism)).inspect(states)
