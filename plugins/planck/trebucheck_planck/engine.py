"""planck.js: Cartesian bodies, joints and limits by sequential impulses, double precision."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field
from trebucheck.engines.inspection import Inspection, State
from trebucheck.engines.point_masses import LeastInertia, NoPointMasses
from trebucheck.engines.protocol import BuiltinEngine, Capabilities, Recording
from trebucheck.engines.study import EngineStudy
from trebucheck.engines.supplied import Part, Supplied
from trebucheck.models.features import Basic, Feature
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.models.spec import Positive
from trebucheck_toolkit.node_samples import NodeSamples
from trebucheck_toolkit.node_scene import Json, NodeScene

from .bridge import PLANCK
from .inspect import inspect
from .motion import recording
from .study import STUDY


class PlanckEngine(BuiltinEngine):
    """planck.js's world in Node.js; defaults are the assisted preset: short steps, small slops.

    The default preset has the iterations and slops of planck.js, limits where the stops are, and
    steps of 1 ms.

    Raises:
        InputError: an option is unknown or outside its range.
    """

    name: ClassVar[str] = "planck"
    package: ClassVar[str] = "trebucheck-planck"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Capabilities] = Capabilities(
        joint_reactions=True,
        joint_gaps=True,
        located_releases=False,
        stop_laws=frozenset(StopLaw),
        formulation="Cartesian coordinates, joints and limits by sequential impulses, "
        "semi-implicit Euler",
        features=frozenset(Feature) - {Feature.MOVING_WALL},
        lacking=frozenset({Basic.POINT_STOP, Basic.REBOUND}),
    )
    default_options: ClassVar[Mapping[str, object] | None] = {
        "timestep": 1e-3,
        "first_iterations": 8,
        "velocity_iterations": 8,
        "position_iterations": 3,
        "linear_slop": 5e-3,
        "angular_slop": math.radians(2.0),
        "hold": False,
    }

    timestep: Positive = Field(default=1e-4, le=1.0, description="step size [s]")
    velocity_iterations: Annotated[int, Field(ge=1, le=1_000_000)] = Field(
        default=30, description="of the impulses of the joints, each step"
    )
    first_iterations: Annotated[int, Field(ge=1, le=1_000_000)] = Field(
        default=3000,
        description="those of the first step, which begins without impulses of one before",
    )
    position_iterations: Annotated[int, Field(ge=1, le=1_000_000)] = Field(
        default=30,
        description="of the correction of the joints' drift, each step; it ends within the slops",
    )
    linear_slop: Positive = Field(
        default=1e-9, le=1.0, description="drift of joints that is let be [m]"
    )
    angular_slop: Positive = Field(
        default=1e-9, le=0.1, description="drift of angles and limits that is let be [rad]"
    )
    hold: bool = Field(
        default=True,
        description="whether a stop that pushes is held from both sides until it would pull: the "
        "correction of pins turns bodies, and opens a limit that holds from one side",
    )
    least_inertia: LeastInertia = 1e-3

    @property
    def supplied(self) -> Supplied:
        """Assistance: springs and motors are forces on bodies; held stops are released by us."""
        held = "a stop is held from both sides while it pushes, and let go where it would pull"
        return {Part.ELEMENTS: ""} | ({Part.EVENTS: held} if self.hold else {})

    @classmethod
    def is_installed(cls) -> bool:
        """Tell whether Node.js is on the path and planck.js beside this package."""
        return PLANCK.is_installed()

    @classmethod
    def version(cls) -> str:
        """Version of planck.js's npm package; 'not installed' if there is none."""
        return PLANCK.version()

    @classmethod
    def absence(cls) -> str:
        """Missing program or package and how to install it, in one sentence."""
        return PLANCK.absence()

    def _run(self, problem: Problem) -> Recording:
        spread = NoPointMasses(problem.mechanism, self.least_inertia)
        scene = NodeScene(spread.mechanism, self.name)
        steps = math.ceil(problem.duration / self.timestep - 1e-9)
        moved = PLANCK.move(
            scene.description(problem, problem.duration / steps, steps) | self._settings()
        )
        samples = NodeSamples(scene, np.linspace(0.0, problem.duration, steps + 1), moved)
        return recording(samples, spread, problem)

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """Masses, inertias, anchors and gravity of the built world, and what follows from them."""
        self.refuse_absence()
        return inspect(mechanism, states, self._settings())

    def _settings(self) -> Json:
        return {
            "firstIterations": self.first_iterations,
            "velocityIterations": self.velocity_iterations,
            "positionIterations": self.position_iterations,
            "linearSlop": self.linear_slop,
            "angularSlop": self.angular_slop,
            "hold": self.hold,
        }
