"""p2-es: Cartesian bodies, joints and limits by regularized impulses, double or single precision.

A body is a dynamic body with its mass and inertia, a pin a revolute constraint, a slider a
prismatic one, a slot a prismatic one without its rotational lock, a weld a revolute one with a
rotational lock. A stop is a limit of a revolute constraint and stays there for the whole run; those
that a release-once law leaves out are left out. Springs, dampers and motors are forces and torques
given to the bodies before each step.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import Field
from trebucheck.engines.protocol import Capabilities
from trebucheck.engines.study import EngineStudy
from trebucheck.models.spec import Positive
from trebucheck_toolkit.node_engine import ALONE, NodeEngine
from trebucheck_toolkit.node_package import NodePackage
from trebucheck_toolkit.node_scene import NodeScene, body_capabilities

from .study import STUDY

OWN: Mapping[str, Any] = {
    "timestep": 1 / 60,
    "iterations": 10,
    "tolerance": 1e-7,
    "stiffness": 1e6,
    "relaxation": 4.0,
    "damping": 0.1,
    "single_precision": True,
}
"""p2-es's own options; `step` has no step size of its own: that of the example of its README."""


class P2Engine(NodeEngine):
    """p2-es's world in Node.js.

    Raises:
        InputError: an option is unknown or outside its range.
    """

    timestep: Positive = Field(default=1e-4, le=1.0, description="step size [s]")
    iterations: Annotated[int, Field(ge=1, le=1_000_000)] = Field(
        default=1000, description="of the solver in each step, at most"
    )
    tolerance: Annotated[float, Field(ge=0.0, le=1.0)] = Field(
        default=0.0,
        description="sum of the changes of an iteration, over the number of equations, "
        "at which the solver ends",
    )
    stiffness: Positive = Field(
        default=1e14, le=1e30, description="of every constraint [N/m, N m/rad]"
    )
    relaxation: Positive = Field(
        default=4.0, le=1e6, description="steps in which an error of a constraint is taken back"
    )
    damping: Annotated[float, Field(ge=0.0, lt=1.0)] = Field(
        default=0.0, description="part of its speeds that every body loses in a second"
    )
    single_precision: bool = Field(
        default=False, description="vectors of float32, as p2-es has them where nothing is set"
    )

    npm: ClassVar[NodePackage] = NodePackage(
        "p2-es", "p2-es", module="trebucheck_p2", folder=Path(__file__).parent / "node"
    )
    name: ClassVar[str] = "p2"
    package: ClassVar[str] = "trebucheck-p2"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Capabilities] = body_capabilities(
        "Cartesian coordinates, joints and limits by regularized impulses, semi-implicit Euler",
    )
    default_options: ClassVar[Mapping[str, object] | None] = {**ALONE, **OWN}
    settings_options: ClassVar[Mapping[str, object] | None] = ALONE

    def _values(self, scene: NodeScene) -> Mapping[str, Any]:
        del scene
        solver = {"iterations": self.iterations, "tolerance": self.tolerance}
        return {
            "own": OWN,
            "solver": {name: value for name, value in solver.items() if value != OWN[name]},
        }
