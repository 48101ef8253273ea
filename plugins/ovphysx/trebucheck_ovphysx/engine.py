"""PhysX's articulations by ovphysx: trees of joints in joint coordinates, single precision."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Annotated, ClassVar, Literal

from pydantic import Field
from trebucheck.engines.inspection import Inspection, State
from trebucheck.engines.protocol import BuiltinEngine, Capabilities, Recording
from trebucheck.engines.study import EngineStudy
from trebucheck.engines.supplied import Assistance, Part, Supplied
from trebucheck.models.features import Basic, Feature
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.models.spec import Positive
from trebucheck_toolkit.body_program import apart, run_program
from trebucheck_toolkit.kept_limits import LIMITS_TAKEN_OUT, KeepLimits
from trebucheck_toolkit.node_scene import BUILT

from .alone import Plan
from .study import STUDY
from .tree import inspect

ATTRIBUTES: Mapping[str, Mapping[str, str]] = {
    "scene": {"solver": "uniform token physxScene:solverType"},
    "articulation": {
        "position_iterations": "int physxArticulation:solverPositionIterationCount",
        "velocity_iterations": "int physxArticulation:solverVelocityIterationCount",
        "sleep_threshold": "float physxArticulation:sleepThreshold",
    },
    "body": {
        "angular_damping": "float physxRigidBody:angularDamping",
        "max_angular_velocity": "float physxRigidBody:maxAngularVelocity",
        "sleep_threshold": "float physxRigidBody:sleepThreshold",
    },
}
"""Attributes of USD that options set, with their types."""
Iterations = Annotated[int, Field(ge=1, le=255)]


class OvphysxEngine(BuiltinEngine):
    """A scene of ovphysx on the processor; every preset's run is a program of its own.

    Raises:
        InputError: an option is unknown or outside its range.
    """

    name: ClassVar[str] = "ovphysx"
    package: ClassVar[str] = "ovphysx"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Capabilities] = Capabilities(
        joint_reactions=True,
        joint_gaps=True,
        located_releases=False,
        stop_laws=frozenset(StopLaw),
        formulation="minimal relative joints in single precision, limits by impulses, "
        "semi-implicit Euler",
        features=frozenset(Feature) - {Feature.MOVING_WALL},
        elements=BUILT,
        lacking=frozenset({Basic.LOOP, Basic.SLOT, Basic.POINT_STOP, Basic.REBOUND}),
    )
    default_options: ClassVar[Mapping[str, object] | None] = {
        "keep_limits": True,
        "timestep": 1 / 60,
        "solver": "TGS",
        "position_iterations": 32,
        "velocity_iterations": 1,
        "angular_damping": 0.05,
        "max_angular_velocity": 5729.58,
        "sleep_threshold": 5e-5,
    }
    settings_options: ClassVar[Mapping[str, object] | None] = {"keep_limits": True}
    assistance: ClassVar[tuple[Assistance, ...] | None] = (LIMITS_TAKEN_OUT,)
    readings: ClassVar[Supplied] = {Part.ELEMENTS: "as forces given before each step"}

    timestep: Positive = Field(default=2.5e-4, le=1.0, description="step size [s]")
    solver: Literal["TGS", "PGS"] = Field(
        default="PGS", description="projected Gauss-Seidel, or temporal: in sub-steps"
    )
    position_iterations: Iterations = Field(
        default=32, description="of a step; of the temporal solver its sub-steps"
    )
    velocity_iterations: Iterations = Field(default=1, description="after them, of speeds alone")
    angular_damping: Annotated[float, Field(ge=0.0)] = Field(
        default=0.0, description="rate at which every link loses its angular speed [1/s]"
    )
    max_angular_velocity: Positive = Field(default=1e7, description="of bodies [deg/s]")
    sleep_threshold: Annotated[float, Field(ge=0.0)] = Field(
        default=0.0, description="kinetic energy over mass below which links fall asleep [J/kg]"
    )
    keep_limits: KeepLimits = False

    def attributes(self, kind: str) -> list[str]:
        """Attributes in USD of the scene, its articulations or bodies, that are not PhysX's own."""
        own, given = self.default_options or {}, ATTRIBUTES[kind].items()
        return [
            f"{attribute} = {json.dumps(getattr(self, option))}"
            for option, attribute in given
            if getattr(self, option) != own[option]
        ]

    def _run(self, problem: Problem) -> Recording:
        return Plan(problem, self).run(partial(apart, run_program))

    def _script(self, problem: Problem) -> str:
        return Plan(problem, self).program()

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """Dynamics of the built scene in each state, as :mod:`.tree` reads them."""
        self.refuse_absence()
        return apart(inspect, mechanism, states, self)
