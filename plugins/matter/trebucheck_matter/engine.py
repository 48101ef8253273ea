"""matter-js: Cartesian bodies, pins by corrections of positions, double precision.

A body is a body of no collisions with its mass and inertia, a pin a constraint of length 0, a weld
two of them. matter-js has no sliders and no limits. Springs, dampers and motors are forces and
torques given to the bodies before each step.

Positions are in pixels, times in milliseconds. A constraint adds a mass to a moment of inertia, so
that the motion depends on the unit of length (the README has how): the more pixels a metre has, the
less.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import Field
from trebucheck.engines.point_masses import LeastInertia
from trebucheck.engines.protocol import Capabilities
from trebucheck.engines.study import EngineStudy
from trebucheck.models.features import Basic, Feature
from trebucheck.models.spec import Positive
from trebucheck_toolkit.node_engine import ALONE, NodeEngine
from trebucheck_toolkit.node_package import NodePackage
from trebucheck_toolkit.node_scene import BUILT, NodeScene

from .study import STUDY

OWN: Mapping[str, Any] = {
    "timestep": 1 / 60,
    "iterations": 2,
    "stiffness": 0.7,
    "air_friction": 0.01,
    "pixels": 100.0,
}
"""matter-js's own options; it has no metre, but at 102 pixels its own gravity is the Earth's."""


class MatterEngine(NodeEngine):
    """matter-js's world in Node.js.

    Raises:
        InputError: an option is unknown or outside its range.
    """

    timestep: Positive = Field(default=1e-4, le=1.0, description="step size [s]")
    iterations: Annotated[int, Field(ge=1, le=1_000_000)] = Field(
        default=10, description="over all constraints, twice in each step"
    )
    stiffness: Positive = Field(
        default=0.7,
        le=1e6,
        description="part of a pin's gap that an iteration takes back of two point masses in a "
        "step of 1/60 s; in shorter steps it takes back less in proportion",
    )
    air_friction: Annotated[float, Field(ge=0.0, le=1.0)] = Field(
        default=0.0, description="part of its speeds that every body loses in 1/60 s"
    )
    pixels: Positive = Field(
        default=1e6, le=1e12, description="unit of length of the world, in a metre"
    )
    least_inertia: LeastInertia = 0.1

    npm: ClassVar[NodePackage] = NodePackage(
        "matter-js", "matter-js", module="trebucheck_matter", folder=Path(__file__).parent / "node"
    )
    name: ClassVar[str] = "matter"
    package: ClassVar[str] = "trebucheck-matter"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Capabilities] = Capabilities(
        joint_reactions=False,
        stop_torques=False,
        joint_gaps=True,
        located_releases=False,
        stop_laws=frozenset(),
        formulation="Cartesian coordinates, pins by corrections of positions, Verlet",
        features=frozenset(Feature) - {Feature.MOVING_SLOT, Feature.MOVING_WALL, Feature.PRISMATIC},
        elements=BUILT,
        lacking=frozenset({Basic.SLOT, Basic.STOP, Basic.POINT_STOP, Basic.REBOUND}),
    )
    default_options: ClassVar[Mapping[str, object] | None] = {**ALONE, **OWN}
    settings_options: ClassVar[Mapping[str, object] | None] = ALONE

    def _values(self, scene: NodeScene) -> Mapping[str, Any]:
        del scene
        return {"own": OWN}
