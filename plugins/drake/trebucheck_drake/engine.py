"""Drake: MultibodyPlant, continuous with its own integrator, or discrete with its own limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar, Literal

from pydantic import Field
from trebucheck.engines.inspection import Inspection, State
from trebucheck.engines.protocol import BuiltinEngine, Capabilities, Recording
from trebucheck.engines.study import EngineStudy
from trebucheck.engines.supplied import HELD, Part, Supplied
from trebucheck.models.features import Basic, Feature
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.models.spec import Real
from trebucheck_toolkit.event_driver import EventDriver

from .study import STUDY


class DrakeEngine(BuiltinEngine):
    """Drake's MultibodyPlant; the defaults are the assisted preset.

    Assisted, the plant is continuous and moved by an error-controlled integrator of Drake's. Such a
    plant has no limits, no contacts without compliance and no constraints (Drake refuses them by a
    warning or an error), so that stops and joints that close loops are held by generalized forces
    from its mass matrix and accelerations, and events are located by trebucheck's driver.

    The default preset is the discrete plant that Drake's documentation leads to, with joint limits
    (a compliant penalty of Drake's choice) and ball and weld constraints of its own.

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
    )
    default_options: ClassVar[Mapping[str, object] | None] = {"mode": "discrete"}

    mode: Literal["continuous", "discrete"] = Field(
        default="continuous", description="the plant: continuous, or with time steps of its own"
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
        """Features lacking: discrete limits act on joints, do not rebound; loop forces unknown."""
        return (
            frozenset()
            if self.mode == "continuous"
            else frozenset({Basic.LOOP, Basic.POINT_STOP, Basic.REBOUND})
        )

    @property
    def supplied(self) -> Supplied:
        """A continuous plant has Drake's integrator, but neither limits nor constraints."""
        return HELD if self.mode == "continuous" else {Part.ELEMENTS: ""}

    def _run(self, problem: Problem) -> Recording:
        if self.mode == "discrete":
            from .discrete import run

            return run(problem, self.timestep)
        from .motion import Motion

        motion = Motion(problem.mechanism, self.integrator, self.accuracy, self.timestep)
        return EventDriver(problem, motion, self.name, self.timestep).run()

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """The built model's mass matrix, forces and forward dynamics in each state."""
        self.refuse_absence()
        from .inspect import inspect

        return inspect(mechanism, states)
