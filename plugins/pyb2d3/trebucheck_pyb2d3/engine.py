"""Box2D 3 by pyb2d3: Cartesian bodies, soft joints solved in sub-steps, single precision."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar

from pydantic import Field
from trebucheck.engines.inspection import Inspection, State
from trebucheck.engines.protocol import Capabilities
from trebucheck.engines.study import EngineStudy
from trebucheck.engines.supplied import Assistance, Part
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem
from trebucheck.models.spec import Positive
from trebucheck_toolkit.body_plan import BodyEngine
from trebucheck_toolkit.kept_limits import LIMITS_TAKEN_OUT
from trebucheck_toolkit.node_scene import body_capabilities

from .alone import Plan
from .study import STUDY

_FASTER = "lets the world's time run faster, in which the joints' 60 Hz are stiffer"


class Box2D3Engine(BodyEngine):
    """Box2D 3's world; every preset's run is a program of its own (:mod:`.alone`)."""

    name: ClassVar[str] = "pyb2d3"
    package: ClassVar[str] = "pyb2d3"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Capabilities] = body_capabilities(
        "Cartesian coordinates in single precision, soft joints and limits by impulses "
        "in sub-steps, semi-implicit Euler",
    )
    settings_options: ClassVar[Mapping[str, object] | None] = {
        "world_step": None,
        "keep_limits": True,
    }
    # `step` has no defaults: step and sub-steps of Box2D's Hello.
    default_options: ClassVar[Mapping[str, object] | None] = {
        **settings_options,
        "timestep": 1 / 60,
        "allow_sleep": True,
    }
    assistance: ClassVar[tuple[Assistance, ...] | None] = (
        Assistance(Part.UNITS, _FASTER, "world_step", off=None),
        LIMITS_TAKEN_OUT,
    )

    timestep: Positive = Field(default=1e-3, le=1.0, description="step size [s]")
    sub_steps: Annotated[int, Field(ge=1, le=10_000)] = Field(
        default=4, description="in each step, in each of which joints are solved once"
    )
    allow_sleep: bool = Field(
        default=False, description="let bodies that hardly move for half a second stand still"
    )
    world_step: Positive | None = Field(
        default=2e-3,
        le=1.0,
        description="how long a shorter step lasts in the time of Box2D's world [s]: its joints "
        "give way like springs of 60 Hz, which no setting of pyb2d3 changes; None: as it is",
    )
    keep_limits: bool = Field(
        default=False,
        description="keep the limit of every stop for the whole run, whatever the law: otherwise a "
        "stop that releases for good is taken out where it is open by 1e-3 rad",
    )

    def plan(self, problem: Problem) -> Plan:
        """Plan a run in Box2D's own world."""
        return Plan(problem, self)

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """Masses, inertias, anchors and gravity of the built world, and what follows from them."""
        self.refuse_absence()
        from .inspect import inspect

        return inspect(mechanism, states, self)
