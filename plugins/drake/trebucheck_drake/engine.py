"""Drake: MultibodyPlant, continuous with its own integrator, or discrete with its own limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar, Literal

from pydantic import Field
from trebucheck.engines.inspection import Inspection, State
from trebucheck.engines.protocol import BuiltinEngine, Capabilities, Recording
from trebucheck.engines.study import EngineStudy
from trebucheck.engines.supplied import HELD, Assistance, Part, Supplied, all_by
from trebucheck.models.features import Basic, Feature
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.models.spec import Real
from trebucheck_toolkit.event_driver import EventDriver
from trebucheck_toolkit.given_forces import GIVEN

from .study import STUDY

HELD_BUT_SPRINGS: Supplied = {
    **HELD,
    Part.ELEMENTS: "forces of loads and of springs that Drake does not have",
}
"""Of a continuous plant: it has springs of its own."""


class DrakeEngine(BuiltinEngine):
    """Drake's MultibodyPlant; the defaults are the assisted preset.

    Assisted, the plant is continuous and moved by an error-controlled integrator of Drake's. Such a
    plant has no limits, no contacts without compliance and no constraints (Drake refuses them by a
    warning or an error), so that stops and joints that close loops are held by generalized forces
    from its mass matrix and accelerations, and events are located by trebucheck's driver. Springs
    are Drake's where it has them.

    By itself (`mode="discrete"`, :mod:`.alone`) it is a plant with time steps that a simulator of
    Drake's moves from start to end, with joint limits, ball constraints and springs of its own;
    with `continuous_plant` it is a continuous one where nothing has to be held. Limits stay in the
    plant whatever the law: it keeps to release-once only while no stop is met again. A stop is read
    as released at the end of the first step after which its limit has no torque.

    Raises:
        InputError: an option is unknown or outside its range.
    """

    name: ClassVar[str] = "drake"
    package: ClassVar[str] = "drake"
    module: ClassVar[str | None] = "pydrake"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Capabilities] = Capabilities(
        joint_reactions=True,
        joint_gaps=False,
        located_releases=True,
        stop_laws=frozenset(StopLaw),
        formulation="minimal relative joints; continuous: error-controlled Runge-Kutta, stops and "
        "loops by multipliers (default: discrete, joint limits as compliant constraints, "
        "semi-implicit Euler)",
        features=frozenset(Feature),
        elements=GIVEN,
    )
    # The step of `MultibodyPlantConfig()`, which is that of the options here.
    default_options: ClassVar[Mapping[str, object] | None] = {
        "mode": "discrete",
        "continuous_plant": False,
    }
    settings_options: ClassVar[Mapping[str, object] | None] = {"mode": "discrete"}
    assistance: ClassVar[tuple[Assistance, ...] | None] = all_by(
        "mode", "discrete", HELD_BUT_SPRINGS
    )
    readings: ClassVar[Supplied] = {
        Part.ELEMENTS: "forces of loads and of springs that Drake does not have, given before each "
        "step",
        Part.LOOP_REACTIONS: "of pins, from the bodies' accelerations and the other joints' forces",
    }

    mode: Literal["continuous", "discrete"] = Field(
        default="continuous",
        description="continuous, what is held by trebucheck; or Drake by itself, with time steps",
    )
    continuous_plant: bool = Field(
        default=True,
        description="whether Drake by itself takes a continuous plant where nothing is to be held",
    )
    integrator: Literal[
        "runge_kutta5", "runge_kutta3", "bogacki_shampine3", "radau3", "implicit_euler"
    ] = Field(default="runge_kutta5", description="Drake's integrator of a continuous plant")
    accuracy: Annotated[Real, Field(ge=1e-15, le=1e-1)] = Field(
        default=1e-10,
        description="relative local error that the integrator of a continuous plant is asked for",
    )

    @property
    def lacking(self) -> frozenset[Basic | Feature]:
        """Elements that the adapter builds none of Drake's for, by itself."""
        return (
            frozenset()
            if self.mode == "continuous"
            else frozenset({Basic.POINT_STOP, Basic.REBOUND})
        )

    @property
    def supplied(self) -> Supplied:
        """Parts that trebucheck does: what is held and pushed, or by itself the given forces."""
        return HELD_BUT_SPRINGS if self.mode == "continuous" else self.readings

    def _run(self, problem: Problem) -> Recording:
        if self.mode == "discrete":
            from .alone import run_alone

            return run_alone(problem, self)
        from .motion import Motion

        motion = Motion(problem.mechanism, self.integrator, self.accuracy, self.timestep)
        return EventDriver(problem, motion, self.name, self.timestep).run()

    def _script(self, problem: Problem) -> str:
        from .alone import script

        return script(problem, self)

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """The built model's mass matrix, forces and forward dynamics in each state."""
        self.refuse_absence()
        from .inspect import inspect

        return inspect(mechanism, states)
