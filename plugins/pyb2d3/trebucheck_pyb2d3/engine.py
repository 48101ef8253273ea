"""Box2D 3 by pyb2d3: Cartesian bodies, soft joints solved in sub-steps, single precision."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar

from pydantic import Field
from trebucheck.engines.inspection import Inspection, State
from trebucheck.engines.protocol import BuiltinEngine, Capabilities, Recording
from trebucheck.engines.study import EngineStudy
from trebucheck.engines.supplied import Assistance, Part, Supplied
from trebucheck.models.features import Basic, Feature
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.models.spec import Positive

from .study import STUDY

_ALONE: Mapping[str, object] = {"world_step": None, "keep_limits": True}
"""Options with which trebucheck takes no part in a run."""


def _has_stops(mechanism: Mechanism) -> bool:
    return bool(mechanism.stops)


class Box2D3Engine(BuiltinEngine):
    """Box2D 3's world of bodies, joints and limits; every preset's run is a program (:mod:`.alone`).

    Raises:
        InputError: an option is unknown or outside its range.
    """

    name: ClassVar[str] = "pyb2d3"
    package: ClassVar[str] = "pyb2d3"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Capabilities] = Capabilities(
        joint_reactions=True,
        joint_gaps=True,
        located_releases=False,
        stop_laws=frozenset(StopLaw),
        formulation="Cartesian coordinates in single precision, soft joints and limits by impulses "
        "in sub-steps, semi-implicit Euler",
        features=frozenset(Feature) - {Feature.MOVING_WALL},
        lacking=frozenset({Basic.POINT_STOP, Basic.REBOUND}),
    )
    default_options: ClassVar[Mapping[str, object] | None] = {
        **_ALONE,
        "timestep": 1 / 60,  # `step` has none: that of Box2D's Hello, and so its four sub-steps
        "allow_sleep": True,
    }
    settings_options: ClassVar[Mapping[str, object] | None] = _ALONE
    assistance: ClassVar[tuple[Assistance, ...] | None] = (
        Assistance(
            Part.UNITS,
            "lets the world's time run faster, in which the joints' 60 Hz are stiffer",
            "world_step",
            off=None,
        ),
        Assistance(
            Part.EVENTS,
            "takes the limits of stops that are open for good out of the model",
            "keep_limits",
            off=True,
            acts_on=_has_stops,
        ),
    )
    readings: ClassVar[Supplied] = {Part.ELEMENTS: "as forces given before each step"}

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

    def _run(self, problem: Problem) -> Recording:
        from .alone import run

        return run(problem, self)

    def _script(self, problem: Problem) -> str:
        from .alone import Plan

        return Plan(problem, self).program()

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """Masses, inertias, anchors and gravity of the built world, and what follows from them."""
        self.refuse_absence()
        from .inspect import inspect

        return inspect(mechanism, states, self)
