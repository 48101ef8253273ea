"""OpenSim: Simbody's trees of mobilizers and error-controlled integrators."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar, Literal

from pydantic import Field
from trebucheck.engines.inspection import Inspection, State
from trebucheck.engines.protocol import BuiltinEngine, Capabilities, Recording
from trebucheck.engines.study import EngineStudy
from trebucheck.engines.supplied import HELD, NOTHING, Part, Supplied
from trebucheck.models.features import Basic, Feature
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.models.spec import Positive, Real
from trebucheck_toolkit.event_driver import EventDriver
from trebucheck_toolkit.plain_run import plain_run

from .study import STUDY

_OF_LOCKS = frozenset(
    {Basic.LOOP, Basic.POINT_STOP, Basic.REBOUND}
    | {Feature.SPRING, Feature.ROTATIONAL_SPRING, Feature.FORCE, Feature.TORQUE}
)


class OpenSimEngine(BuiltinEngine):
    """OpenSim's models of rigid bodies, which Simbody moves; the defaults are the assisted preset.

    Assisted, stops lock the coordinates that they are on, and Simbody's integrator moves the rest;
    which stops hold is found by multipliers on Simbody's mass matrix and accelerations, events are
    located by trebucheck's driver. Where something else is held, or springs act, OpenSim's
    accelerations are integrated by RK4 instead.

    The default preset has OpenSim's `CoordinateLimitForce` for stops: springs with dampers, of a
    stiffness of one's choice, and the accuracy of its forward tool.

    Raises:
        InputError: an option is unknown or outside its range.
    """

    name: ClassVar[str] = "opensim"
    package: ClassVar[str] = "opensim"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Capabilities] = Capabilities(
        joint_reactions=True,
        joint_gaps=False,
        located_releases=True,
        stop_laws=frozenset(StopLaw),
        formulation="mobilizers (Simbody), stops as locked coordinates, error-controlled "
        "Runge-Kutta-Merson; with loops or springs multipliers and RK4 (default: stops as "
        "coordinate limit forces)",
        features=frozenset(Feature),
    )
    default_options: ClassVar[Mapping[str, object] | None] = {"limits": "springs", "accuracy": 1e-5}

    integrator: Literal[
        "RungeKuttaMerson", "RungeKuttaFeldberg", "RungeKutta3", "SemiExplicitEuler2"
    ] = Field(default="RungeKuttaMerson", description="Simbody's integrator")
    accuracy: Annotated[Real, Field(ge=1e-14, le=1e-1)] = Field(
        default=1e-11, description="relative local error that the integrator is asked for"
    )
    limits: Literal["locks", "springs"] = Field(
        default="locks",
        description="what a stop is: a locked coordinate while it holds, or a coordinate limit "
        "force",
    )
    limit_stiffness: Positive = Field(
        default=1e6, description="of a coordinate limit force [N m/degree]"
    )
    limit_damping: Positive = Field(
        default=1e3, description="of a coordinate limit force [N m s/degree]"
    )
    limit_transition: Positive = Field(
        default=0.01, description="angle to a limit force's full stiffness [degrees]"
    )

    @property
    def lacking(self) -> frozenset[Basic | Feature]:
        """Features lacking without locks: limit forces act on joints alone and rebound."""
        return frozenset() if self.limits == "locks" else _OF_LOCKS

    @property
    def supplied(self) -> Supplied:
        """Assistance: with locks, stops and their torques; Simbody integrates between events."""
        if self.limits == "springs":
            return NOTHING
        own = {Part.STOPS: "torques: Simbody's locks hold them"}
        return {Part.STEPS: "with loops, springs or stops on points", **HELD, **own}

    def _run(self, problem: Problem) -> Recording:
        from .motion import Motion

        motion = Motion(problem.mechanism, self.integrator, self.accuracy, self.timestep)
        if self.limits == "locks":
            return EventDriver(problem, motion, self.name, self.timestep).run()
        from .limits import LimitedMotion

        stiffness, damping, width = self.limit_stiffness, self.limit_damping, self.limit_transition
        limited = LimitedMotion(problem.mechanism, motion, stiffness, damping, width)
        return plain_run(problem, limited, self.name, self.timestep)

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """The built model's mass matrix, forces and forward dynamics in each state."""
        self.refuse_absence()
        from .inspect import inspect

        return inspect(mechanism, states)
