"""Box2D 2.3: Cartesian bodies, joints and limits by sequential impulses, single precision."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar

from pydantic import Field
from trebucheck.engines.inspection import Inspection, State
from trebucheck.engines.point_masses import LeastInertia
from trebucheck.engines.protocol import BuiltinEngine, Capabilities, Recording
from trebucheck.engines.study import EngineStudy
from trebucheck.engines.supplied import Part, Supplied
from trebucheck.models.features import Basic, Feature
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.models.spec import NonNegative
from trebucheck_toolkit.plain_run import plain_run

from .study import STUDY


class Box2DEngine(BuiltinEngine):
    """Box2D's world; defaults are the assisted preset: many iterations a step, a margin of stops.

    The default preset has the iterations that Box2D's manual suggests, and limits where the stops
    are.

    Raises:
        InputError: an option is unknown or outside its range.
    """

    name: ClassVar[str] = "box2d"
    package: ClassVar[str] = "box2d"
    module: ClassVar[str | None] = "Box2D"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Capabilities] = Capabilities(
        joint_reactions=True,
        joint_gaps=True,
        located_releases=False,
        stop_laws=frozenset(StopLaw),
        formulation="Cartesian coordinates in single precision, joints and limits by sequential "
        "impulses, semi-implicit Euler",
        features=frozenset(Feature) - {Feature.MOVING_WALL},
        lacking=frozenset({Basic.POINT_STOP, Basic.REBOUND}),
    )
    default_options: ClassVar[Mapping[str, object] | None] = {
        "velocity_iterations": 8,
        "position_iterations": 3,
        "set_back": 0.0,
    }

    velocity_iterations: Annotated[int, Field(ge=1, le=1_000_000)] = Field(
        default=100, description="of the impulses of the joints, each step"
    )
    position_iterations: Annotated[int, Field(ge=0, le=1_000_000)] = Field(
        default=100, description="of the correction of the joints' drift, each step"
    )
    set_back: NonNegative = Field(
        default=1e-3,
        le=0.03,
        description="by how much limits lie beyond the stops [rad]: Box2D tolerates up to 2 "
        "degrees, and a limit is active only where the angle is not short of it by rounding",
    )
    least_inertia: LeastInertia = 1e-3

    @property
    def supplied(self) -> Supplied:
        """Springs and motors are forces on the bodies, which Box2D's users apply themselves."""
        return {Part.ELEMENTS: ""}

    def _run(self, problem: Problem) -> Recording:
        from .motion import Motion

        motion = Motion(problem, self)
        return plain_run(problem, motion, self.name, self.timestep)

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """Masses, inertias, anchors and gravity of the built world, and what follows from them."""
        self.refuse_absence()
        from .inspect import inspect

        return inspect(mechanism, states)
