"""MJX: MuJoCo rewritten in JAX."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal

from pydantic import Field
from trebucheck.engines.inspection import Inspection, State
from trebucheck.engines.protocol import BuiltinEngine, Capabilities, Recording
from trebucheck.engines.study import EngineStudy
from trebucheck.engines.supplied import HELD, NOTHING, Part, Supplied
from trebucheck.models.features import Basic, Feature
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck_toolkit.event_driver import EventDriver
from trebucheck_toolkit.plain_run import plain_run

from .study import STUDY

_OF_MULTIPLIERS = frozenset(
    {Basic.LOOP, Basic.POINT_STOP, Basic.REBOUND}
    | {Feature.SPRING, Feature.ROTATIONAL_SPRING, Feature.FORCE, Feature.TORQUE}
)


class MjxEngine(BuiltinEngine):
    """MJX on the MJCF of trebucheck; the defaults are the assisted preset.

    Assisted, in double precision, MJX moves the tree of joints by its RK4 while nothing is held.
    Stops, loops and springs are multipliers and generalized forces from its mass matrix and
    accelerations, integrated by RK4 as well; events are located by trebucheck's driver.

    The default preset is MJX as it comes: single precision, joint limits that are soft constraints,
    RK4.

    Raises:
        InputError: an option is unknown or outside its range.
    """

    name: ClassVar[str] = "mjx"
    package: ClassVar[str] = "mujoco-mjx"
    module: ClassVar[str | None] = "mujoco.mjx"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Capabilities] = Capabilities(
        joint_reactions=True,
        joint_gaps=False,
        located_releases=True,
        stop_laws=frozenset(StopLaw),
        formulation="minimal relative joints, RK4, double precision; stops, loops and springs by "
        "multipliers (default: single precision, stops as soft limits)",
        features=frozenset(Feature),
    )
    default_options: ClassVar[Mapping[str, object] | None] = {
        "limits": "soft",
        "precision": "single",
    }

    limits: Literal["multipliers", "soft"] = Field(
        default="multipliers",
        description="what holds a stop: multipliers, or MJX's soft limits of joints and tendons",
    )
    precision: Literal["double", "single"] = Field(
        default="double", description="of MJX's numbers; multipliers ask for double"
    )

    @property
    def lacking(self) -> frozenset[Basic | Feature]:
        """Features lacking without multipliers: MJX's own limits are for stops on angles alone."""
        return frozenset() if self.limits == "multipliers" else _OF_MULTIPLIERS

    @property
    def supplied(self) -> Supplied:
        """Assistance: with multipliers, all but the tree's dynamics and free RK4 steps."""
        return (
            {Part.STEPS: "while something is held", **HELD}
            if self.limits == "multipliers"
            else NOTHING
        )

    def _run(self, problem: Problem) -> Recording:
        if self.limits == "multipliers":
            from .motion import Motion

            return EventDriver(
                problem, Motion(problem.mechanism, self.timestep), self.name, self.timestep
            ).run()
        from .limits import LimitedMotion

        limited = LimitedMotion(problem.mechanism, self.timestep, double=self.precision == "double")
        return plain_run(problem, limited, self.name, self.timestep)

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """The built model's mass matrix, forces and forward dynamics in each state."""
        self.refuse_absence()
        from .inspect import inspect

        return inspect(mechanism, states)
