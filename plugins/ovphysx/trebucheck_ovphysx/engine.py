"""PhysX's articulations by ovphysx: trees of joints in joint coordinates, single precision."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar, Literal

from pydantic import Field
from trebucheck.engines.inspection import Inspection, State
from trebucheck.engines.protocol import Capabilities
from trebucheck.engines.study import EngineStudy
from trebucheck.models.features import Basic
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem
from trebucheck.models.spec import Positive
from trebucheck_toolkit.body_plan import BodyEngine
from trebucheck_toolkit.body_program import apart
from trebucheck_toolkit.node_scene import body_capabilities

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


class OvphysxEngine(BodyEngine):
    """A scene of ovphysx on the processor; every preset's run is a program of its own.

    Raises:
        InputError: an option is unknown or outside its range.
    """

    name: ClassVar[str] = "ovphysx"
    package: ClassVar[str] = "ovphysx"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Capabilities] = body_capabilities(
        "minimal relative joints in single precision, limits by impulses, semi-implicit Euler",
        Basic.LOOP,
        Basic.SLOT,
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

    def attributes(self, kind: str) -> list[str]:
        """Attributes in USD of the scene, its articulations or bodies, that are not PhysX's own."""
        own, given = self.default_options or {}, ATTRIBUTES[kind].items()
        return [
            f"{attribute} = {json.dumps(getattr(self, option))}"
            for option, attribute in given
            if getattr(self, option) != own[option]
        ]

    def plan(self, problem: Problem) -> Plan:
        """Plan a run, whose scene is in USD."""
        return Plan(problem, self)

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """Dynamics of the built scene in each state, as :mod:`.tree` reads them."""
        self.refuse_absence()
        return apart(inspect, mechanism, states, self)
